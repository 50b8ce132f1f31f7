"""The right-angled raster on whose cells the sites of a lattice lie: elements are bricks of its cells.

The cubic lattice is its own raster. Rows of the hexagonal one are shifted against each other by half a spacing: its raster has
cells of half a spacing along the rows, and every other one is a site.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from particles.lattice import Lattice
from particles.lattice.geometry import directions


class Raster:
    """Cells of a lattice.

    Args:
        lattice: cubic or hexagonal.

    Attributes:
        places: cell (n, 3) of each site, from zero.
        pitch: edges of a cell (3,), m; in the plane the third one is without meaning.
        steps: to the neighbours (directions, 3), in cells.
        dense: cells for each site, 1 or 2.
    """

    def __init__(self, lattice: Lattice) -> None:
        self.axes, d = lattice.axes, lattice.spacing
        if self.axes == 3:
            self.places, self.steps, self.dense = lattice.places, directions(3), 1
            self.pitch: np.ndarray = np.full(3, d)
            return
        self.places, self.steps, self.dense = _upright(lattice.places), _upright(directions(2)), 2
        self.places = self.places - self.places.min(axis=0)
        self.pitch = d * np.array((0.5, math.sqrt(0.75), 1.0))

    def occupied(self, places: np.ndarray) -> np.ndarray:
        """Which cells (k, 3) are sites of the infinite lattice; bool."""
        return (places - self.places[0])[:, :2].sum(axis=1) % self.dense == 0

    def cells(self, per_element: Any) -> np.ndarray:
        """Cells (3,) along the edges of an element, of a given number of sites.

        Args:
            per_element: in space the sites along its edges, one number or three. In the plane spacings along a row and double rows,
                or one number of spacings, for elements as nearly square as can be.

        Raises:
            ValueError: it is something else.
        """
        wanted = np.atleast_1d(np.asarray(per_element))
        if len(wanted) == 1 and self.axes == 2:
            wanted = np.array((wanted[0], max(1, round(float(wanted[0]) / math.sqrt(3.0)))))
        if wanted.shape not in ((1,), (self.axes,)) or not np.issubdtype(wanted.dtype, np.integer) or np.any(wanted < 1):
            raise ValueError(f"per_element={per_element} must be at least 1, one whole number or {self.axes}")
        if self.axes == 3:
            return np.broadcast_to(wanted, 3).astype(np.int64)
        return np.array((2 * wanted[0], 2 * wanted[1], 1), dtype=np.int64)


def _upright(steps: np.ndarray) -> np.ndarray:
    """Steps along a row and up 60 degrees as half spacings along and rows up."""
    return np.column_stack((2 * steps[:, 0] + steps[:, 1], steps[:, 1:]))
