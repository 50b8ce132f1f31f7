"""Stiffness of all elements of a body: one matrix for each way in which they own their bonds, and for each material of the continuum."""

from __future__ import annotations

import numpy as np

from bridge.manifold.grid import AROUND, Grid
from bridge.manifold.kinds import CONTINUUM, MANIFOLD, PARTICLES
from bridge.manifold.raster import Raster
from bridge.manifold.template import Template
from continuum import bricks
from particles.lattice import Lattice, LatticeMaterial
from particles.lattice.lanes import WIDTH

AT_ONCE = 512  # elements whose bonds are looked at together
ABSENT, BOUND, LEFT = 0, 1, 2  # what an element around is: none, one that is there, one left to particles


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
        self._fold = np.kron(grid.fold, np.eye(raster.axes))
        self._template = Template(grid, raster, self._fold)
        self._first_site = np.zeros(grid.count, dtype=np.int64)
        self._first_site[grid.element] = np.arange(len(grid.element))
        self._density = np.array([one.density for one in lattice.materials])
        self._rock = self._classes()
        self._known: dict[bytes | tuple[int, int], int] = {}
        dofs = self._fold.shape[1]
        self._table = np.zeros((16, dofs, -(-dofs // WIDTH) * WIDTH))
        self._count = 0
        self._first: list[int] = []  # an element of each matrix
        self.number = np.zeros(grid.count, dtype=np.int32)  # of each element's matrix

    def _classes(self) -> np.ndarray:
        """Number (elements,) of what all particles of a full element are made of, -1 for elements of several materials or with gaps."""
        terms = self._lattice._terms
        made = np.column_stack((terms.normal, terms.shear, self._density))
        of = np.unique(made, axis=0, return_inverse=True)[1].reshape(-1)[self._lattice.layer]
        low, high = self._grid.extremes(of)
        return np.where(self._grid.full() & (low == high), low, -1)

    @property
    def matrices(self) -> np.ndarray:
        """(kinds, dofs, dofs or more) in N/m of the distinct corners; whole vectors a line, their last numbers zero."""
        return self._table[: self._count]

    def stiffest(self) -> float:
        """Largest omega^2 (1/s2) of an element alone, of all so far."""
        found, dofs = 0.0, self._fold.shape[1]
        for number, element in enumerate(self._first):
            sites = self._grid.sites_of(np.array([element]))
            share = self._lattice.mass[sites] @ self._shape[self._grid.slot[sites]]
            light = np.repeat(np.where(share > 1e-9 * share.max(), share, np.inf), len(self._size)) ** -0.5
            found = max(found, float(np.linalg.eigvalsh(self._table[number, :, :dofs] * light[:, None] * light)[-1]))
        return found

    def find(self, elements: np.ndarray, kind: np.ndarray) -> None:
        """Numbers of the matrices of some elements, which are there, in a body whose elements are of kinds (all,)."""
        layer = self._lattice.layer
        plain = elements[kind[elements] == CONTINUUM]
        for number, material in enumerate(self._lattice.materials):
            mine = plain[layer[self._first_site[plain]] == number]
            if len(mine):
                key = b"continuum %d" % number
                if key not in self._known:
                    self._keep(key, self._brick(material), mine[0])
                self.number[mine] = self._known[key]
        manifold = elements[kind[elements] == MANIFOLD]
        around = self._grid.element_at(self._grid.cells[manifold][:, None, :] + AROUND)
        what = np.where(around < 0, ABSENT, np.where((kind == PARTICLES)[around], LEFT, BOUND))
        rock = self._rock[manifold]
        alike = (rock >= 0) & np.all((what != BOUND) | (self._rock[around] == rock[:, None]), axis=1)
        self._find_alike(manifold[alike], rock[alike], what[alike] @ 3 ** np.arange(len(AROUND)), kind)
        rest = manifold[~alike]
        for part in np.array_split(rest, max(1, len(rest) // AT_ONCE)):
            self._find_any(part, kind)

    def _find_alike(self, elements: np.ndarray, rock: np.ndarray, beside: np.ndarray, kind: np.ndarray) -> None:
        """Elements of one material with what they are bound to, `rock` (k,), told apart by what is around them, `beside` (k,)."""
        cases, first, which = np.unique(np.column_stack((rock, beside)), axis=0, return_index=True, return_inverse=True)
        numbers = np.zeros(len(cases), dtype=np.int32)
        for case, (key, one) in enumerate(zip(map(tuple, cases.tolist()), elements[first])):
            if key not in self._known:
                self._find_any(np.array([one]), kind)
                self._known[key] = int(self.number[one])
            numbers[case] = self._known[key]
        self.number[elements] = numbers[which.reshape(-1)]

    def _find_any(self, elements: np.ndarray, kind: np.ndarray) -> None:
        """Elements told apart by the share that they have in each bond, and its stiffness."""
        terms, layer = self._lattice._terms, self._lattice.layer
        weight, first, second = self._template.weights(elements, kind == PARTICLES)
        one, two = layer[np.maximum(first, 0)], layer[np.maximum(second, 0)]
        normal, shear, density = (
            np.where(weight > 0.0, 0.5 * (table[one] + table[two]), 0.0) for table in (terms.normal, terms.shear, self._density)
        )
        for row, element in enumerate(elements):
            key = b"".join(values[row].tobytes() for values in (weight, normal, shear, density))
            if key not in self._known:
                self._keep(key, self._template.stiffness(weight[row], normal[row], shear[row]), element)
            self.number[element] = self._known[key]

    def _brick(self, material: LatticeMaterial) -> np.ndarray:
        whole = bricks.stiffness(self._size, material.young_modulus, material.poisson_ratio, self._lattice.plane)
        return self._fold.T @ whole @ self._fold

    def _keep(self, key: bytes, matrix: np.ndarray, element: int) -> None:
        if self._count == len(self._table):
            self._table = np.concatenate((self._table, np.zeros_like(self._table)))
        self._table[self._count, :, : self._fold.shape[1]] = matrix
        self._known[key], self._count = self._count, self._count + 1
        self._first.append(element)
