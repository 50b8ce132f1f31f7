"""When elements are released: a criterion of strains, and where in an element it is asked (Zhao et al. 2012, section 3.3)."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from bridge.manifold import steps
from continuum import bricks
from particles.dispatch import Direct
from particles.lattice import LatticeMaterial, geometry
from particles.lattice.lanes import WIDTH

Criterion = Callable[[np.ndarray], np.ndarray]
PLACES = ("centre", "particles")

_strains_at, _largest_principal = Direct(steps.strains_at), Direct(steps.largest_principal)


def ultimate_strain(limit: float, reduction: float = 0.8) -> Criterion:
    """Criterion (eq 40): the largest principal strain is above `reduction` times `limit`."""
    if not (math.isfinite(limit) and limit > 0):
        raise ValueError(f"limit={limit} must be positive")
    if not 0 < reduction <= 1:
        raise ValueError(f"reduction={reduction} must be above 0 and at most 1")
    return lambda strain: principal(strain) > reduction * limit


def bond_limits(material: LatticeMaterial, spacing: float, reduction: float = 0.8, axes: int = 3) -> Criterion:
    """Criterion of the bonds themselves: one that is strained as its element is near a limit at which it breaks.

    Args:
        material: whose limits are meant.
        spacing: of the lattice, m.
        reduction: share of the limits at which elements are released.
        axes: 3 for the cubic lattice, 2 for the hexagonal one.
    """
    if not 0 < reduction <= 1:
        raise ValueError(f"reduction={reduction} must be above 0 and at most 1")
    normal_limit, shear_limit = material.limits
    arms = geometry.vectors(axes, spacing)[::2]
    units = arms / np.linalg.norm(arms, axis=1, keepdims=True)
    longest = float(np.linalg.norm(arms, axis=1).max())
    least = (reduction * min(normal_limit, shear_limit) / longest) ** 2

    def near(strain: np.ndarray) -> np.ndarray:
        strong = strain**2 @ (1.0, 1.0, 1.0, 2.0, 2.0, 2.0) > least  # no bond deforms by more than its length times |strain|
        found = np.zeros(len(strain), dtype=bool)
        found[strong] = reached(strain[strong])
        return found

    def reached(strain: np.ndarray) -> np.ndarray:
        moved = strain[:, [[0, 5, 4], [5, 1, 3], [4, 3, 2]]] @ arms.T  # (k, 3, bonds)
        along = np.einsum("kab,ba->kb", moved, units)
        across = np.sqrt(np.maximum(np.einsum("kab,kab->kb", moved, moved) - along**2, 0.0))
        return ((along > reduction * normal_limit) | (across > reduction * shear_limit)).any(axis=1)

    return near


def principal(strain: np.ndarray) -> np.ndarray:
    """Largest principal value (k,) of strains (k, 6) xx, yy, zz, yz, xz, xy."""
    found = np.empty(len(strain))
    _largest_principal(np.ascontiguousarray(strain), found)
    return found


class Probe:
    """Strains of elements at their centres, or at the particles in their corners.

    Each component of a brick's strain is linear along each axis, so that no particle of an element has a larger principal
    strain (or any other convex measure of strain) than those in its corners.

    Args:
        place: "centre" or "particles".
        per_element: cells of the raster along each axis of an element (axes,).
        size: of an element, m (axes,).
        fold: see `bridge.manifold.grid`; by default all corners are distinct.
    """

    def __init__(self, place: str, per_element: np.ndarray, size: np.ndarray, fold: np.ndarray | None = None) -> None:
        if place not in PLACES:
            raise ValueError(f'strain_at="{place}" must be "{PLACES[0]}" or "{PLACES[1]}"')
        outer = 0.5 / per_element
        ends = [np.unique((end, 1.0 - end)) for end in (outer if place == "particles" else np.full(len(size), 0.5))]
        points = np.stack(np.meshgrid(*ends, indexing="ij"), axis=-1).reshape(-1, len(size))
        matrices = bricks.strain_matrix(points, size)  # (points, 6, dofs)
        if fold is not None:
            matrices = matrices @ np.kron(fold, np.eye(len(size)))
        self._count, flat = len(points), matrices.reshape(-1, matrices.shape[2])
        self._table = np.zeros((flat.shape[1], -(-len(flat) // WIDTH) * WIDTH))
        self._table[:, : len(flat)] = flat.T

    def strains(self, nodes: steps.Nodes, elements: steps.Elements, chosen: np.ndarray) -> np.ndarray:
        """Strains (chosen, points, 6) of some elements."""
        chosen = np.asarray(chosen, dtype=np.int32)
        found = np.empty((len(chosen), self._table.shape[1]))
        _strains_at(nodes, elements, chosen, self._table, found)
        return found[:, : 6 * self._count].reshape(len(chosen), self._count, 6)

    def meets(self, criterion: Criterion, nodes: steps.Nodes, elements: steps.Elements, chosen: np.ndarray) -> np.ndarray:
        """Which (chosen,) of some elements meet a criterion at one of their points."""
        strain = self.strains(nodes, elements, chosen)
        met: np.ndarray = np.asarray(criterion(strain.reshape(-1, 6)), dtype=bool).reshape(strain.shape[:2])
        return np.any(met, axis=1)
