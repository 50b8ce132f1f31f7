"""What holds a packing together: the faces of a box, periodic faces, or the outline of any region with a distance."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np

from particles.relaxation import Planes

SAMES = 0.999  # cosine between two normals above which they belong to one wall
TURNS = (1.0, 1.0, 1.0, 0.5, 0.5, 0.5, 0.25, 0.25)  # steps of the search for the deepest point of a particle's surface


class Faces:
    """A box: plates on its faces, or, if periodic, none."""

    curved = False

    def __init__(self, lower: np.ndarray, upper: np.ndarray, periodic: bool) -> None:
        self.lower, self.upper = lower, upper
        self.period = upper - lower if periodic else np.zeros_like(lower)

    @property
    def measure(self) -> float:
        """Area (m2) or volume (m3)."""
        return float(np.prod(self.upper - self.lower))

    def inside(self, points: np.ndarray) -> np.ndarray:
        """True (n,) for points in the box."""
        return np.asarray(((points >= self.lower) & (points <= self.upper)).all(axis=1))

    def planes(self, places: np.ndarray, radii: np.ndarray, reach: float) -> Planes:
        """Faces closer than `reach` (m) to a particle's surface."""
        rows, normals, offsets = [], [], []
        for axis, sign in product(np.flatnonzero(self.period == 0.0), (-1.0, 1.0)):
            edge = sign * (self.lower if sign < 0 else self.upper)[axis]
            near = np.flatnonzero(sign * places[:, axis] + radii > edge - reach)
            rows.append(near)
            normals.append(np.tile(sign * np.eye(places.shape[1])[axis], (near.size, 1)))
            offsets.append(np.full(near.size, edge))
        if not rows:
            return Planes(np.empty(0, np.int32), np.empty((0, places.shape[1])), np.empty(0))
        return Planes(np.concatenate(rows).astype(np.int32), np.concatenate(normals), np.concatenate(offsets))


class Outline:
    """A region of any shape, as its tangent planes where the particles are: exact for the particles' present places.

    A particle lies within the region when every point of its surface does. The points of the surface that are locally
    deepest in the wall are sought from several directions, so that a particle in a corner is held by all its sides.
    """

    curved = True

    def __init__(self, region: Any) -> None:
        self.distance = region.distance
        self.lower, self.upper = np.asarray(region.bounds, dtype=float)
        self.period = np.zeros_like(self.lower)
        axes = self.lower.size
        probes = np.array([p for p in product((-1.0, 0.0, 1.0), repeat=axes) if any(p)])
        self.probes = probes / np.linalg.norm(probes, axis=1)[:, None]
        self.measure = self._measure(1024 if axes == 2 else 128)

    def _measure(self, count: int) -> float:
        """Area or volume from samples, those near the edge by the share of their cell inside (error about 1e-5)."""
        cell = (self.upper - self.lower) / count
        width = np.prod(cell) ** (1.0 / cell.size)
        ticks = [low + (np.arange(count) + 0.5) * step for low, step in zip(self.lower, cell)]
        others = np.stack(np.meshgrid(*ticks[1:], indexing="ij"), axis=-1).reshape(-1, cell.size - 1)
        inside = 0.0
        for x in ticks[0]:
            distance = self.distance(np.column_stack((np.full(len(others), x), others)))
            inside += float(np.clip(0.5 - distance / width, 0.0, 1.0).sum())
        return inside * float(np.prod(cell))

    def inside(self, points: np.ndarray) -> np.ndarray:
        """True (n,) for points in the region."""
        return np.asarray(self.distance(points)) <= 0.0

    def _normals(self, points: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Unit gradient (n, axes) of the distance, by central differences of `step` (n, 1) m."""
        gradient = np.empty_like(points)
        for axis, shift in enumerate(np.eye(points.shape[1])):
            gradient[:, axis] = self.distance(points + step * shift) - self.distance(points - step * shift)
        return gradient / np.maximum(np.linalg.norm(gradient, axis=1), 1e-300)[:, None]

    def planes(self, places: np.ndarray, radii: np.ndarray, reach: float) -> Planes:
        """Tangent planes closer than `reach` (m) to a particle's surface."""
        near = np.flatnonzero(self.distance(places) + radii > -reach)
        points = places[near, None] + radii[near, None, None] * self.probes
        depth = self.distance(points.reshape(-1, places.shape[1])).reshape(points.shape[:2])
        which, probe = np.nonzero(depth > -reach - 0.2 * radii[near, None])  # a probe is up to 0.12 r less deep
        row, normal = near[which], self.probes[probe]
        centre, radius = places[row], radii[row, None]
        for turn in TURNS:
            normal = (1.0 - turn) * normal + turn * self._normals(centre + radius * normal, 1e-4 * radius)
            normal = normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
        deepest = centre + radius * normal
        depth = self.distance(deepest)
        smooth = np.einsum("ij,ij->i", self._normals(deepest, 1e-4 * radius), normal) > SAMES
        # a re-entrant corner has no smooth deepest point: the distance of the particle's centre tells its overlap, unless
        # it is a mere bound (inside a union)
        own = self._normals(places[near], 1e-4 * radii[near, None])
        beyond, there = self.distance(places[near]) + radii[near], self.distance(places[near] + radii[near, None] * own)
        true = np.where(beyond > 0.0, there > 1e-3 * beyond, np.abs(there - beyond) <= 0.5 * np.abs(beyond))
        found = smooth | ~true[which]
        row, normal, depth = (
            np.r_[row[found], near[true]],
            np.r_[normal[found], own[true]],
            np.r_[depth[found], beyond[true]],
        )
        centre, radius = places[row], radii[row, None]
        kept = np.flatnonzero(depth > -reach)
        kept = kept[np.lexsort((-depth[kept], row[kept]))]  # the deepest point of each particle first
        row, normal, depth, centre, radius = row[kept], normal[kept], depth[kept], centre[kept], radius[kept]
        fresh = np.ones(row.size, dtype=bool)
        for shift in range(1, len(self.probes)):
            same = row[shift:] == row[:-shift]
            if not same.any():
                break
            fresh[shift:] &= ~(same & (np.einsum("ij,ij->i", normal[shift:], normal[:-shift]) > SAMES))
        offset = np.einsum("ij,ij->i", normal, centre) + radius[:, 0] - depth
        return Planes(row[fresh].astype(np.int32), np.ascontiguousarray(normal[fresh]), offset[fresh])


def outline_of(region: Any, periodic: bool) -> Faces | Outline:
    """The walls of a region: a pair of corners, an object with `lower` and `upper` (a box), or with `distance`.

    Raises:
        ValueError: nothing that could be filled.
    """
    box = not hasattr(region, "distance") or (hasattr(region, "lower") and hasattr(region, "upper"))
    try:
        bounds = np.asarray(getattr(region, "bounds", region), dtype=float)
    except (TypeError, ValueError):
        bounds = np.empty(0)
    if bounds.shape not in ((2, 2), (2, 3)) or not np.isfinite(bounds).all() or not (bounds[0] < bounds[1]).all():
        raise ValueError(f"region={region} must be a finite region or a pair of corners in 2D or 3D (m)")
    if hasattr(region, "contains") and not hasattr(region, "distance"):
        raise ValueError(f"region={region} must have a method distance(points), signed and negative inside (m)")
    if periodic and not box:
        raise ValueError(f"periodic=True needs a box, not region={region}")
    return Faces(bounds[0].copy(), bounds[1].copy(), periodic) if box else Outline(region)
