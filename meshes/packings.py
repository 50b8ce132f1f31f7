"""Regular particle layouts: centres of equal discs or spheres that just touch (m). Numpy only.

A lattice is a rectangular cell, repeated along the axes, with sites at given shares of its edges.
"""

from __future__ import annotations

import numpy as np

CENTRED = ((0.0, 0.0), (0.5, 0.5))
FACE_CENTRED = ((0.0, 0.0, 0.0), (0.5, 0.5, 0.0), (0.5, 0.0, 0.5), (0.0, 0.5, 0.5))
EDGE_TOLERANCE = 1e-9  # a centre this close to the edge, relative to the radius, counts as inside


def square_45(region, radius: float, anchor: tuple[float, float] | None = None, surface: str = "tangent") -> np.ndarray:
    """Square lattice turned by 45 degrees: contact normals at +-45 degrees.

    Rows lie r sqrt(2) apart, sites in a row 2 r sqrt(2), neighbouring rows are shifted by half that spacing. All
    sites whose centre lies in the region are returned. Without an anchor the layout is symmetric about the middle x,
    and the top row is the one of the two kinds that holds more sites (Li & Wan 2010: 2426 discs of 0.05 m and 6765
    of 0.03 m in 7.0 x 3.5 m).

    Args:
        region: bounds ((x_min, y_min), (x_max, y_max)) in m, or a region with `bounds` and `contains`.
        radius: radius of the discs (m).
        anchor: any site of the wanted infinite lattice; the same anchor gives the same sites in every region.
        surface: how the top row stands to the region's upper edge: "tangent" (discs touch it from below) or
            "centres" (centres on it). Unused with an anchor.

    Returns:
        Centres (n, 2) in m, row by row from the top, each row from left to right.
    """
    bounds, radius = _bounds(region, 2), _radius(radius)
    spacing = 2.0 * np.sqrt(2.0) * radius
    if anchor is None:
        middle, top = 0.5 * (bounds[0, 0] + bounds[1, 0]), bounds[1, 1] - _inset(surface, radius)
        half = 0.5 * (bounds[1, 0] - bounds[0, 0]) / spacing + EDGE_TOLERANCE
        centred, shifted = 2 * int(np.floor(half)) + 1, 2 * int(np.floor(half + 0.5))
        anchor = (middle, top) if centred >= shifted else (middle + 0.5 * spacing, top)
    return _sites(region, bounds, radius, anchor, (spacing, spacing), CENTRED)


def square(region, radius: float, anchor: tuple[float, float] | None = None, surface: str = "tangent") -> np.ndarray:
    """Square lattice with contact normals along x and y; spacing 2 r, solid fraction pi / 4.

    Arguments and result as in `square_45`; without an anchor the first site lies r from the left edge.
    """
    bounds, radius = _bounds(region, 2), _radius(radius)
    return _sites(region, bounds, radius, _corner(anchor, bounds, radius, surface), (2.0 * radius,) * 2, ((0.0, 0.0),))


def hexagonal(region, radius: float, anchor: tuple[float, float] | None = None, surface: str = "tangent") -> np.ndarray:
    """Hexagonal (densest) lattice with rows along x: spacing 2 r in a row, rows r sqrt(3) apart, shifted by r.

    Arguments and result as in `square_45`; without an anchor the first site lies r from the left edge. Solid fraction
    pi / sqrt(12).
    """
    bounds, radius = _bounds(region, 2), _radius(radius)
    cell = 2.0 * radius, 2.0 * np.sqrt(3.0) * radius
    return _sites(region, bounds, radius, _corner(anchor, bounds, radius, surface), cell, CENTRED)


def simple_cubic(
    region, radius: float, anchor: tuple[float, float, float] | None = None, surface: str = "tangent"
) -> np.ndarray:
    """Simple cubic lattice of spheres, 6 contacts each: spacing 2 r along the axes, solid fraction pi / 6.

    All sites whose centre lies in the region are returned. Without an anchor the first sites lie r from the lower edges
    in x and y.

    Args:
        region: bounds ((x_min, y_min, z_min), (x_max, y_max, z_max)) in m, or a region with `bounds` and `contains`.
        radius: radius of the spheres (m).
        anchor: any site of the wanted infinite lattice; the same anchor gives the same sites in every region.
        surface: how the top layer stands to the region's upper face: "tangent" (spheres touch it from below) or
            "centres" (centres on it). Unused with an anchor.

    Returns:
        Centres (n, 3) in m, layer by layer from the top, in a layer row by row from the largest y.
    """
    bounds, radius = _bounds(region, 3), _radius(radius)
    return _sites(region, bounds, radius, _corner(anchor, bounds, radius, surface), (2.0 * radius,) * 3, ((0.0,) * 3,))


def face_centred_cubic(
    region, radius: float, anchor: tuple[float, float, float] | None = None, surface: str = "tangent"
) -> np.ndarray:
    """Face-centred cubic (densest) lattice of spheres, 12 contacts each: cubes of 2 r sqrt(2), solid fraction pi / sqrt(18).

    Arguments and result as in `simple_cubic`; layers lie r sqrt(2) apart.
    """
    bounds, radius = _bounds(region, 3), _radius(radius)
    cell = (2.0 * np.sqrt(2.0) * radius,) * 3
    return _sites(region, bounds, radius, _corner(anchor, bounds, radius, surface), cell, FACE_CENTRED)


def _sites(region, bounds, radius, anchor, cell, basis) -> np.ndarray:
    """Sites of the infinite lattice through `anchor` inside the region."""
    anchor, cell, axes = np.asarray(anchor, dtype=float), np.asarray(cell), bounds.shape[1]
    if anchor.shape != (axes,) or not np.all(np.isfinite(anchor)):
        kind = {2: "two finite numbers (x, y)", 3: "three finite numbers (x, y, z)"}[axes]
        raise ValueError(f"anchor={anchor} must be {kind} in m")
    slack = EDGE_TOLERANCE * radius
    found = []
    for site in np.asarray(basis):
        first = np.ceil((bounds[0] - slack - anchor) / cell - site)
        last = np.floor((bounds[1] + slack - anchor) / cell - site)
        ticks = [share + np.arange(low, high + 1.0) for low, high, share in zip(first, last, site)]
        found.append(np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, axes))
    places = np.concatenate(found)  # in cells from the anchor, multiples of a half: exact
    places = places[np.lexsort((places[:, 0], *(-places[:, axis] for axis in range(1, axes))))]
    centres = anchor + places * cell
    return centres[region.contains(centres)] if hasattr(region, "contains") else centres


def _corner(anchor, bounds, radius, surface):
    """The anchor, or the first site of the top layer: r from the lower edges."""
    if anchor is not None:
        return anchor
    return np.append(bounds[0, :-1] + radius, bounds[1, -1] - _inset(surface, radius))


def _bounds(region, axes: int) -> np.ndarray:
    """Bounds (2, axes) of a region object or of a pair of corners."""
    bounds = np.asarray(getattr(region, "bounds", region), dtype=float)
    if bounds.shape != (2, axes) or not np.all(np.isfinite(bounds)) or not np.all(bounds[0] < bounds[1]):
        corners = {2: "((x_min, y_min), (x_max, y_max))", 3: "((x_min, y_min, z_min), (x_max, y_max, z_max))"}[axes]
        raise ValueError(f"region={region} must be a finite region or {corners} in m")
    return bounds


def _radius(radius: float) -> float:
    if not (np.isfinite(radius) and radius > 0):
        raise ValueError(f"radius={radius} must be positive (m)")
    return float(radius)


def _inset(surface: str, radius: float) -> float:
    """Distance of the top row's or layer's centres from the region's upper edge."""
    if surface not in ("tangent", "centres"):
        raise ValueError(f'surface="{surface}" must be "tangent" or "centres"')
    return radius if surface == "tangent" else 0.0
