"""Periodic images of particles for what is measured after a run; without a cell each particle is its only image."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from particles.cell import PeriodicCell
from particles.volumes import parts_inside, region_volume, volumes


def images_near(
    cell: PeriodicCell | None, positions: np.ndarray, lower: Any, upper: Any, reach: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Images with their centres within `reach` (m) of a box.

    Args:
        positions: (n, d) anywhere, m.
        lower, upper: (d,) corners of the box, m.

    Returns:
        Particle (k,), place (k, d), m, and edges (k, d) from the particle to the image, of each image.
    """
    if cell is None:
        return np.arange(len(positions)), positions, np.zeros_like(positions)
    low, high = np.asarray(lower, dtype=float) - reach, np.asarray(upper, dtype=float) + reach
    inverse, repeats = np.linalg.inv(cell.matrix), cell.periodic
    shares = positions @ inverse.T
    taken = np.where(repeats, np.floor(shares), 0.0)
    home = positions - taken @ cell.matrix.T
    corners = np.array(list(itertools.product(*zip(low, high)))) @ inverse.T
    first, last = np.floor(corners.min(axis=0)), np.floor(corners.max(axis=0))
    ranges = [np.arange(a, b + 1) if one else [0.0] for a, b, one in zip(first, last, repeats)]
    particle, places, edges = [], [], []
    for numbers in itertools.product(*ranges):
        moved = home + cell.matrix @ np.array(numbers)
        inside = np.flatnonzero(((moved >= low) & (moved <= high)).all(axis=1))
        particle.append(inside)
        places.append(moved[inside])
        edges.append(np.array(numbers) - taken[inside])
    return np.concatenate(particle), np.concatenate(places), np.concatenate(edges)


def wrapped(cell: PeriodicCell | None, points: np.ndarray) -> np.ndarray:
    """Points (k, d) taken into a cell by whole edges."""
    if cell is None:
        return points
    shares = points @ np.linalg.inv(cell.matrix).T
    found: np.ndarray = points - np.where(cell.periodic, np.floor(shares), 0.0) @ cell.matrix.T
    return found


def _bounds(region: Any) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the box around a region.

    Raises:
        ValueError: the region does not say, or it is infinite.
    """
    lower, upper = region if not hasattr(region, "contains") else getattr(region, "bounds", (np.nan, np.nan))
    if not (np.isfinite(lower).all() and np.isfinite(upper).all()):
        raise ValueError(
            f"region={region!r} must have finite `bounds` (lower, upper) in a periodic cell, so that the images in it can be found"
        )
    return np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)


def parts_in(cell: PeriodicCell | None, positions: np.ndarray, radii: np.ndarray, region: Any) -> np.ndarray:
    """Part (n,) of each particle, all its images together, inside a box, a region or the whole cell; see `parts_inside`."""
    if cell is None:
        return parts_inside(positions, radii, region)
    if region is cell:
        return volumes(radii, positions.shape[1])
    particle, places, _ = images_near(cell, positions, *_bounds(region), float(radii.max(initial=0.0)))
    return np.bincount(particle, parts_inside(places, radii[particle], region), len(radii))


def volume_of(region: Any) -> float:
    """Area or volume of a box, a cell, or a region that says it itself."""
    return region.volume if isinstance(region, PeriodicCell) else region_volume(region)
