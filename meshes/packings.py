"""Regular particle layouts: centres of equal discs that just touch (m). Numpy only."""

from __future__ import annotations

import numpy as np

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
    bounds, radius = _bounds(region), _radius(radius)
    spacing, height = 2.0 * np.sqrt(2.0) * radius, np.sqrt(2.0) * radius
    if anchor is None:
        middle, top = 0.5 * (bounds[0, 0] + bounds[1, 0]), bounds[1, 1] - _inset(surface, radius)
        half = 0.5 * (bounds[1, 0] - bounds[0, 0]) / spacing + EDGE_TOLERANCE
        centred, shifted = 2 * int(np.floor(half)) + 1, 2 * int(np.floor(half + 0.5))
        anchor = (middle, top) if centred >= shifted else (middle + 0.5 * spacing, top)
    return _rows(region, bounds, radius, anchor, spacing, height, shift=0.5)


def square(region, radius: float, anchor: tuple[float, float] | None = None, surface: str = "tangent") -> np.ndarray:
    """Square lattice with contact normals along x and y; spacing 2 r.

    Arguments and result as in `square_45`; without an anchor the first site lies r from the left edge.
    """
    bounds, radius = _bounds(region), _radius(radius)
    if anchor is None:
        anchor = (bounds[0, 0] + radius, bounds[1, 1] - _inset(surface, radius))
    return _rows(region, bounds, radius, anchor, 2.0 * radius, 2.0 * radius, shift=0.0)


def hexagonal(region, radius: float, anchor: tuple[float, float] | None = None, surface: str = "tangent") -> np.ndarray:
    """Hexagonal (densest) lattice with rows along x: spacing 2 r in a row, rows r sqrt(3) apart, shifted by r.

    Arguments and result as in `square_45`; without an anchor the first site lies r from the left edge.
    """
    bounds, radius = _bounds(region), _radius(radius)
    if anchor is None:
        anchor = (bounds[0, 0] + radius, bounds[1, 1] - _inset(surface, radius))
    return _rows(region, bounds, radius, anchor, 2.0 * radius, np.sqrt(3.0) * radius, shift=0.5)


def _rows(region, bounds, radius, anchor, spacing, height, shift) -> np.ndarray:
    """Sites of the infinite lattice through `anchor` inside the region; odd rows are moved by `shift` spacings."""
    anchor = np.asarray(anchor, dtype=float)
    if anchor.shape != (2,) or not np.all(np.isfinite(anchor)):
        raise ValueError(f"anchor={anchor} must be two finite numbers (x, y) in m")
    slack = EDGE_TOLERANCE * radius
    first = int(np.floor((bounds[1, 1] + slack - anchor[1]) / height))
    last = int(np.ceil((bounds[0, 1] - slack - anchor[1]) / height))
    rows = []
    for row in range(first, last - 1, -1):
        origin = anchor[0] + shift * spacing * (row % 2)
        left = int(np.ceil((bounds[0, 0] - slack - origin) / spacing))
        right = int(np.floor((bounds[1, 0] + slack - origin) / spacing))
        x = origin + spacing * np.arange(left, right + 1)
        rows.append(np.column_stack((x, np.full(len(x), anchor[1] + row * height))))
    centres = np.concatenate(rows) if rows else np.empty((0, 2))
    return centres[region.contains(centres)] if hasattr(region, "contains") else centres


def _bounds(region) -> np.ndarray:
    """Bounds (2, 2) of a region object or of a pair of corners."""
    bounds = np.asarray(getattr(region, "bounds", region), dtype=float)
    if bounds.shape != (2, 2) or not np.all(np.isfinite(bounds)) or not np.all(bounds[0] < bounds[1]):
        raise ValueError(f"region={region} must be a finite region or ((x_min, y_min), (x_max, y_max)) in m")
    return bounds


def _radius(radius: float) -> float:
    if not (np.isfinite(radius) and radius > 0):
        raise ValueError(f"radius={radius} must be positive (m)")
    return float(radius)


def _inset(surface: str, radius: float) -> float:
    """Distance of the top row's centres from the region's upper edge."""
    if surface not in ("tangent", "centres"):
        raise ValueError(f'surface="{surface}" must be "tangent" or "centres"')
    return radius if surface == "tangent" else 0.0
