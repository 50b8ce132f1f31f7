"""Elements of a regular mesh over the sites of a lattice: who is in which element, and which nodes they share."""

from __future__ import annotations

import numpy as np

from bridge.manifold.raster import Raster

CORNERS = np.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)])  # in basix's order; the first four in the plane
AROUND = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)])


class Grid:
    """Bricks of `per_element` cells of a raster; an element is there where it holds a site.

    Args:
        raster: of the lattice, the first element begins at its first cell.
        per_element: cells along each axis of an element.
        periodic: axes along which the body repeats; their number of cells must fit.
    """

    def __init__(self, raster: Raster, per_element: np.ndarray, periodic: tuple[bool, ...]) -> None:
        self.per_element, self.periodic = per_element, np.array(periodic)
        self.places = raster.places
        cells = self.places // per_element
        self.shape = cells.max(axis=0) + 1
        self.sites_shape = self.shape * per_element
        fits = self.places.max(axis=0) - self.places.min(axis=0) + 1 == self.sites_shape
        if np.any(self.periodic & ~fits):
            raise ValueError(f"per_element={tuple(per_element.tolist())} must divide the number of sites along a periodic axis")
        numbers = np.ravel_multi_index(tuple(cells.T), tuple(self.shape))
        found, self.element = np.unique(numbers, return_inverse=True)
        self.element = self.element.reshape(-1).astype(np.int32)
        self.cells = np.column_stack(np.unravel_index(found, tuple(self.shape)))  # (elements, 3)
        inside = self.places - cells * per_element
        self.slot = np.ravel_multi_index(tuple(inside.T), tuple(per_element)).astype(np.int32)
        self.count = len(found)
        self.capacity = int(np.prod(per_element)) // raster.dense  # sites of a full element
        self._order = np.argsort(self.element, kind="stable")
        self._first = np.searchsorted(self.element[self._order], np.arange(self.count + 1))
        self._around = AROUND if raster.axes == 3 else AROUND[AROUND[:, 2] == 0]
        self._site_at = self._table(self.places, self.sites_shape)
        self._element_at = self._table(self.cells, self.shape)
        corners = self.cells[:, None, :] + CORNERS[: 2**raster.axes]
        repeats = np.where(self.periodic, self.shape, self.shape + 1)
        corners = corners % repeats
        keys, nodes = np.unique(np.ravel_multi_index(tuple(corners.reshape(-1, 3).T), tuple(repeats)), return_inverse=True)
        self.nodes = nodes.reshape(-1, 2**raster.axes).astype(np.int32)  # (elements, corners)
        self.node_places = np.column_stack(np.unravel_index(keys, tuple(repeats)))
        self.distinct, self.fold = self._fold()

    def _fold(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners (k,) that are nodes of their own where a body repeats after one element, and which of them (corners, k) each one is."""
        same = np.all(self.nodes[:, :, None] == self.nodes[:, None, :], axis=0)
        distinct, which = np.unique(same.argmax(axis=0), return_inverse=True)
        return distinct, np.eye(len(distinct))[which.reshape(-1)]

    @staticmethod
    def _table(coordinates: np.ndarray, shape: np.ndarray) -> np.ndarray:
        table = np.full(tuple(shape), -1, dtype=np.int32)
        table[tuple(coordinates.T)] = np.arange(len(coordinates))
        return table

    def _at(self, table: np.ndarray, coordinates: np.ndarray) -> np.ndarray:
        """Entries of a table at coordinates (..., 3), -1 outside; periodic axes wrap."""
        shape = np.array(table.shape)
        wrapped = np.where(self.periodic, coordinates % shape, coordinates)
        outside = np.any((wrapped < 0) | (wrapped >= shape), axis=-1)
        wrapped = np.where(outside[..., None], 0, wrapped)
        return np.where(outside, -1, table[tuple(np.moveaxis(wrapped, -1, 0))])

    def site_at(self, places: np.ndarray) -> np.ndarray:
        """Site numbers (...) at places (..., 3), -1 where there is none."""
        return self._at(self._site_at, places)

    def element_at(self, cells: np.ndarray) -> np.ndarray:
        """Element numbers (...) at cells (..., 3), -1 where there is none."""
        return self._at(self._element_at, cells)

    def around(self, elements: np.ndarray) -> np.ndarray:
        """Elements that share a corner with some, themselves included; sorted."""
        found = self.element_at(self.cells[elements][:, None, :] + self._around)
        return np.unique(found[found >= 0])

    def at_faces(self, full: np.ndarray) -> np.ndarray:
        """Elements (n,) bool beside which, across a face or an edge, bonds of the lattice have no site.

        Args:
            full: elements (n,) bool that hold all their sites.
        """
        steps = self._around[np.abs(self._around).sum(axis=1) < 3]  # no bond of the lattice crosses a corner
        found = self.element_at(self.cells[:, None, :] + steps)
        return np.any((found < 0) | ~full[found], axis=1)

    def sites_of(self, elements: np.ndarray) -> np.ndarray:
        """Sites of some elements, sorted."""
        chosen = np.unique(elements)
        first, number = self._first[chosen], self._first[chosen + 1] - self._first[chosen]
        before = np.cumsum(number) - number
        return np.sort(self._order[np.repeat(first - before, number) + np.arange(number.sum())])

    def extremes(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Smallest and largest (elements,) of values (sites,) in each element."""
        ordered, first = values[self._order], self._first[:-1]
        return np.minimum.reduceat(ordered, first), np.maximum.reduceat(ordered, first)

    def filling(self) -> np.ndarray:
        """Number of sites (elements,)."""
        return np.diff(self._first)

    def full(self) -> np.ndarray:
        """Elements (n,) bool that hold all their sites."""
        return self.filling() == self.capacity
