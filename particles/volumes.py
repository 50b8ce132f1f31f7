"""Parts of discs and spheres inside circles, balls, boxes and regions: areas (m2) in the plane, volumes (m3) in space.

A box is a pair of corners (lower, upper), a region anything with `contains(points)` for points (k, d).
"""

from __future__ import annotations

from typing import Any

import numpy as np

SAMPLES = 2000  # points in a disc or sphere where a region is known by `contains` only: error about 1e-3 of it


def volumes(radii: np.ndarray, axes: int) -> np.ndarray:
    """Areas of discs or volumes of spheres."""
    return np.pi * radii**2 if axes == 2 else 4.0 / 3.0 * np.pi * radii**3


def common_area(distance: Any, first: Any, second: Any) -> np.ndarray:
    """Area (m2) of the intersection of two discs with radii `first`, `second` at a distance of centres."""
    d, a, b = np.broadcast_arrays(np.asarray(distance, float), np.asarray(first, float), np.asarray(second, float))
    d = np.clip(d, np.abs(a - b) + 1e-300, a + b)
    cos_a = np.clip((d * d + a * a - b * b) / (2 * d * a), -1.0, 1.0)
    cos_b = np.clip((d * d + b * b - a * a) / (2 * d * b), -1.0, 1.0)
    half_a, half_b = np.arccos(cos_a), np.arccos(cos_b)
    return a * a * (half_a - np.sin(half_a) * cos_a) + b * b * (half_b - np.sin(half_b) * cos_b)


def common_volume(distance: Any, first: Any, second: Any) -> np.ndarray:
    """Volume (m3) of the intersection of two balls (two caps)."""
    d, a, b = np.broadcast_arrays(np.asarray(distance, float), np.asarray(first, float), np.asarray(second, float))
    inside = d <= np.abs(a - b)
    d = np.where(inside, 1.0, np.minimum(d, a + b))
    lens = np.pi * (a + b - d) ** 2 * (d * d + 2.0 * d * (a + b) - 3.0 * (a - b) ** 2) / (12.0 * d)
    return np.where(inside, 4.0 / 3.0 * np.pi * np.minimum(a, b) ** 3, lens)


def _quadrant(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Area of the disc of radius one where x < a and y < b (both from -1 to 1): columns from -root(1 - x^2) to b or above."""
    edge = np.sqrt(1.0 - b * b)
    middle = np.clip(a, -edge, edge)

    def half(x: np.ndarray) -> np.ndarray:
        return 0.5 * (x * np.sqrt(np.maximum(1.0 - x * x, 0.0)) + np.arcsin(x))

    cut = b * (middle + edge) + half(middle) - half(-edge)
    whole = 2.0 * (half(np.minimum(a, -edge)) + 0.25 * np.pi + half(np.maximum(a, edge)) - half(edge))
    return cut + np.where(b >= 0.0, whole, 0.0)


def area_in_box(positions: np.ndarray, radii: np.ndarray, lower: Any, upper: Any) -> np.ndarray:
    """Area (n,) of each disc inside a box, m2."""
    inside, cut = _inside_and_cut(positions, radii, lower, upper)
    area = np.where(inside, np.pi * radii**2, 0.0)
    at, r = positions[cut], radii[cut, None]
    (a, b), (c, d) = (np.clip((side - at) / r, -1.0, 1.0).T for side in (lower, upper))
    area[cut] = r[:, 0] ** 2 * (_quadrant(c, d) - _quadrant(a, d) - _quadrant(c, b) + _quadrant(a, b))
    return area


def volume_in_box(positions: np.ndarray, radii: np.ndarray, lower: Any, upper: Any) -> np.ndarray:
    """Volume (n,) of each sphere inside a box, m3: areas of slices normal to z by quadrature (error below 1e-9 of it).

    The heights where slices begin to reach over sides or edges part the range; ends of a part are approached by sines,
    in which areas are smooth.
    """
    inside, cut = _inside_and_cut(positions, radii, lower, upper)
    volume = np.where(inside, 4.0 / 3.0 * np.pi * radii**3, 0.0)
    at, r = positions[cut], radii[cut, None]
    x, y = (np.column_stack([side[k] - at[:, k] for side in (lower, upper)]) for k in (0, 1))
    squares = np.hstack([x**2, y**2, (x[:, :, None] ** 2 + y[:, None, :] ** 2).reshape(len(cut), 4)])
    height = np.sqrt(np.maximum(r**2 - squares, 0.0))
    low, high = np.maximum(lower[2] - at[:, 2:], -r), np.minimum(upper[2] - at[:, 2:], r)
    parts = np.sort(np.clip(np.hstack([low, high, height, -height]), low, high), axis=1)
    nodes, weights = np.polynomial.legendre.leggauss(24)
    for start, end in zip(parts.T[:-1], parts.T[1:]):
        long = np.flatnonzero(end > start)
        middle, half = 0.5 * (start + end)[long], 0.5 * (end - start)[long]
        for angle, weight in zip(0.5 * np.pi * nodes, 0.5 * np.pi * weights):
            z = middle + half * np.sin(angle)
            slice_radius = np.sqrt(np.maximum(r[long, 0] ** 2 - z**2, 1e-24 * r[long, 0] ** 2))
            slices = area_in_box(at[long, :2], slice_radius, lower[:2], upper[:2])
            volume[cut[long]] += weight * np.cos(angle) * half * slices
    return volume


def _inside_and_cut(positions, radii, lower, upper):
    inside = np.all((positions - radii[:, None] >= lower) & (positions + radii[:, None] <= upper), axis=1)
    near = np.all((positions + radii[:, None] > lower) & (positions - radii[:, None] < upper), axis=1)
    return inside, np.flatnonzero(~inside & near)


def ball_samples(axes: int, count: int = SAMPLES) -> np.ndarray:
    """Evenly spread points (count, axes) in the circle or ball of radius one (golden angle; additive recurrence)."""
    k = np.arange(count)
    share = (k + 0.5) / count
    if axes == 2:
        angle = k * np.pi * (3.0 - np.sqrt(5.0))
        return np.sqrt(share)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    plastic = 1.324717957244746
    height = 2.0 * ((0.5 + k / plastic) % 1.0) - 1.0
    angle = 2.0 * np.pi * ((0.5 + k / plastic**2) % 1.0)
    across = np.sqrt(1.0 - height**2)
    return np.cbrt(share)[:, None] * np.column_stack([across * np.cos(angle), across * np.sin(angle), height])


def contains(body: Any, points: np.ndarray) -> np.ndarray:
    """Which points (k, d) lie in a box or region."""
    if hasattr(body, "contains"):
        return np.asarray(body.contains(points), dtype=bool)
    lower, upper = body
    return np.all((points >= np.asarray(lower)) & (points <= np.asarray(upper)), axis=1)


def share_inside(points: np.ndarray, radius: float, body: Any) -> np.ndarray:
    """Share (k,) of the circle or ball around each point that lies in a box or region (None: everywhere), by samples."""
    if body is None:
        return np.ones(len(points))
    samples = radius * ball_samples(points.shape[1])
    return np.array([contains(body, point + samples).mean() for point in points])


def parts_inside(positions: np.ndarray, radii: np.ndarray, region: Any) -> np.ndarray:
    """Part (n,) of each disc (m2) or sphere (m3) inside a box or region (a region by samples, error about 1e-3)."""
    axes = positions.shape[1]
    if not hasattr(region, "contains"):
        return (area_in_box if axes == 2 else volume_in_box)(positions, radii, *map(np.asarray, region))
    samples = ball_samples(axes)
    share = [contains(region, point + radius * samples).mean() for point, radius in zip(positions, radii)]
    return np.array(share) * volumes(radii, axes)


def region_volume(region: Any) -> float:
    """Area or volume of a box, or what a region says of itself by `measure`.

    Raises:
        ValueError: it says nothing: the caller has to give the volume.
    """
    if hasattr(region, "measure"):
        return float(region.measure)
    if hasattr(region, "contains"):
        raise ValueError(f"volume is needed (m3; in the plane the area, m2): region={region!r} has no `measure`")
    lower, upper = map(np.asarray, region)
    return float(np.prod(upper - lower))
