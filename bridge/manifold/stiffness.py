"""Stiffness of all elements of a body: one matrix for each way in which they own their bonds, and for each material of the continuum."""

from __future__ import annotations

import numpy as np

from bridge.manifold.grid import Grid
from bridge.manifold.kinds import CONTINUUM, MANIFOLD, PARTICLES
from bridge.manifold.raster import Raster
from bridge.manifold.template import Template
from continuum import bricks
from particles.lattice import Lattice, LatticeMaterial
from particles.lattice.lanes import WIDTH

AT_ONCE = 512  # elements whose bonds are looked at together


class Stiffness:
    """The matrices that elements share, found as elements need them.

    Args:
        lattice: whose bonds are counted.
        grid: sites and elements.
        raster: of the lattice.
        shape: functions (slots, distinct corners) of the places in an element.
    """

    def __init__(self, lattice: Lattice, grid: Grid, raster: Raster, shape: np.ndarray) -> None:
        self._lattice, self._grid, self._shape = lattice, grid, shape
        self._size = (grid.per_element * raster.pitch)[: raster.axes]
        self._template = Template(grid, raster)
        self._fold = np.kron(grid.fold, np.eye(raster.axes))
        self._first_site = np.zeros(grid.count, dtype=np.int64)
        self._first_site[grid.element] = np.arange(len(grid.element))
        self._known: dict[bytes, int] = {}
        self._matrices: list[np.ndarray] = []
        self.number = np.zeros(grid.count, dtype=np.int32)  # of each element's matrix
        self.stiffest = 0.0  # largest omega^2 of an element alone, 1/s2

    @property
    def matrices(self) -> np.ndarray:
        """(kinds, dofs, dofs or more) in N/m of the distinct corners; whole vectors a line, their last numbers zero."""
        dofs = self._fold.shape[1]
        found = np.zeros((len(self._matrices), dofs, -(-dofs // WIDTH) * WIDTH))
        for number, matrix in enumerate(self._matrices):
            found[number, :, :dofs] = matrix
        return found

    def find(self, elements: np.ndarray, kind: np.ndarray) -> None:
        """Numbers of the matrices of some elements, which are there, in a body whose elements are of kinds (all,)."""
        terms, layer = self._lattice._terms, self._lattice.layer
        plain = elements[kind[elements] == CONTINUUM]
        for number, material in enumerate(self._lattice.materials):
            mine = plain[layer[self._first_site[plain]] == number]
            if len(mine):
                key = b"continuum %d" % number
                if key not in self._known:
                    self._keep(key, self._brick(material), mine[0])
                self.number[mine] = self._known[key]
        manifold = elements[kind[elements] == MANIFOLD]
        for part in np.array_split(manifold, max(1, len(manifold) // AT_ONCE)):
            weight, first, second = self._template.weights(part, kind == PARTICLES)
            materials = np.where(weight > 0.0, layer[np.maximum(first, 0)] + 256 * layer[np.maximum(second, 0)].astype(int), 0)
            for row, element in enumerate(part):
                key = weight[row].tobytes() + materials[row].tobytes()
                if key not in self._known:
                    one, two = materials[row] % 256, materials[row] // 256
                    normal, shear = (0.5 * (table[one] + table[two]) for table in (terms.normal, terms.shear))
                    self._keep(key, self._template.stiffness(weight[row], normal, shear), element)
                self.number[element] = self._known[key]

    def _brick(self, material: LatticeMaterial) -> np.ndarray:
        return bricks.stiffness(self._size, material.young_modulus, material.poisson_ratio, self._lattice.plane)

    def _keep(self, key: bytes, matrix: np.ndarray, element: int) -> None:
        self._known[key] = len(self._matrices)
        matrix = self._fold.T @ matrix @ self._fold
        self._matrices.append(matrix)
        sites = self._grid.sites_of(np.array([element]))
        share = self._lattice.mass[sites] @ self._shape[self._grid.slot[sites]]
        light = np.repeat(np.where(share > 1e-9 * share.max(), share, np.inf), len(self._size)) ** -0.5
        self.stiffest = max(self.stiffest, float(np.linalg.eigvalsh(matrix * light[:, None] * light)[-1]))
