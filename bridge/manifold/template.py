"""Stiffness of particle-based manifold elements: bricks whose energy is that of lattice bonds (Zhao et al. 2012, eqs 28-37).

Bonds are counted by the place of their midpoint: a bond whose midpoint lies in n elements is shared by these n, whichever hold
its ends; a bond that has a force of its own, because one end is a free particle, belongs to none. So every bond of the body counts
once, and a uniform strain has the energy of the lattice.
"""

from __future__ import annotations

import numpy as np

from bridge.manifold.grid import AROUND, Grid
from bridge.manifold.raster import Raster
from continuum import bricks


class Template:
    """Bonds with midpoints in a closed element, and their deformations by its nodes.

    Args:
        grid: sites and elements.
        raster: of the lattice.
        fold: (all dofs, dofs) of an element, of the corners that are distinct.
    """

    def __init__(self, grid: Grid, raster: Raster, fold: np.ndarray) -> None:
        self._grid = grid
        n, ways = grid.per_element, np.arange(0, len(raster.steps), 2)
        origin = np.stack(np.meshgrid(*(np.arange(-1, m + 1) for m in n), indexing="ij"), axis=-1).reshape(-1, 3)
        origin = origin[raster.occupied(origin)]
        first, way = np.repeat(origin, len(ways), axis=0), np.tile(ways, len(origin))
        second = first + raster.steps[way]
        twice = first + second + 1  # of the midpoint, in cells
        inside = np.all((twice >= 0) & (twice <= 2 * n), axis=1)
        way, twice = way[inside], twice[inside]
        self._places, ends = np.unique(np.concatenate((first[inside], second[inside])), axis=0, return_inverse=True)
        self._first, self._second = ends.reshape(2, -1)
        low, high = np.where(twice == 0, -1, 0), np.where(twice == 2 * n, 1, 0)
        across = low + high  # an element further along these axes has the midpoint, too
        owners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * across[:, None, :]
        self._owns = np.zeros((len(AROUND), len(across)))  # how often each of the elements around has a midpoint
        for owner in owners.transpose(1, 0, 2):
            self._owns[(owner + 1) @ (9, 3, 1), np.arange(len(across))] = 1.0
        axes = raster.axes
        strain = bricks.strain_matrix((twice / (2.0 * n))[:, :axes], (n * raster.pitch)[:axes])  # (bonds, 6, dofs)
        tensor = strain[:, [[0, 5, 4], [5, 1, 3], [4, 3, 2]], :]
        arm = raster.steps[way] * raster.pitch
        unit = arm / np.linalg.norm(arm, axis=1, keepdims=True)
        deformation = np.einsum("brsa,bs->bra", tensor, arm) @ fold
        self.stretch = np.einsum("bra,br->ba", deformation, unit)  # (bonds, dofs)
        self.shear = deformation - self.stretch[:, None, :] * unit[:, :, None]  # (bonds, 3, dofs)

    def weights(self, elements: np.ndarray, free: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Share (elements, bonds) of each bond that an element owns, and the sites at its ends.

        Args:
            elements: their numbers.
            free: elements (all,) bool that have been left to particles.
        """
        grid = self._grid
        sites = grid.site_at(grid.cells[elements][:, None, :] * grid.per_element + self._places)
        bound = (sites >= 0) & ~free[grid.element[np.maximum(sites, 0)]]
        there = bound[:, self._first] & bound[:, self._second]
        around = grid.element_at(grid.cells[elements][:, None, :] + AROUND)
        owning = ((around >= 0) & ~free[np.maximum(around, 0)]).astype(float) @ self._owns
        return np.where(there, 1.0 / np.maximum(owning, 1.0), 0.0), sites[:, self._first], sites[:, self._second]

    def stiffness(self, weight: np.ndarray, normal: np.ndarray, shear: np.ndarray) -> np.ndarray:
        """Stiffness (dofs, dofs) in N/m of shares (bonds,) of bonds with stiffnesses (bonds,) in N/m."""
        along = (self.stretch * (weight * normal)[:, None]).T @ self.stretch
        flat = self.shear.reshape(-1, self.shear.shape[2])
        return along + (flat * np.repeat(weight * shear, 3)[:, None]).T @ flat
