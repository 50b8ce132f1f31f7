"""The nodes of a body with three components each, six where it is a Cosserat body in space.

A plane Cauchy body, which has two, gets a rotation that does not move.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray

Array = NDArray[np.float64]


class WholeNodes:
    """Motion, mass and forces of a body as arrays (owned nodes, c) of c = `width` components, 3 or 6.

    `receive` and `send` exchange the motion with a body of two components; all others are used as they are.
    """

    def __init__(self, body: Any):
        self.body, self.comm, self.same = body, body.comm, body.components > 2
        self.width = max(body.components, 3)
        self.displacement, self.velocity = self._padded(body.displacement), self._padded(body.velocity)
        self.acceleration, self.mass = self._padded(body.acceleration), self._padded(body.mass)

    @property
    def fixed(self) -> NDArray[np.bool_]:
        """True (owned nodes, c) where a component is prescribed or not there."""
        if self.same:
            return self.body.fixed
        return np.column_stack((self.body.fixed, np.ones(len(self.body.fixed), dtype=bool)))

    @property
    def moves_prescribed(self) -> bool:
        """Whether any prescribed component moves."""
        return self.body.moves_prescribed

    def _padded(self, values: Array) -> Array:
        return values if self.same else np.column_stack((values, np.zeros(len(values))))

    def receive(self) -> None:
        """Take over what was written into the body."""
        if not self.same:
            self.displacement[:, :2], self.velocity[:, :2] = self.body.displacement, self.body.velocity
            self.acceleration[:, :2] = self.body.acceleration

    def send(self) -> None:
        """Write the motion into the body."""
        if not self.same:
            self.body.displacement[:], self.body.velocity[:] = self.displacement[:, :2], self.velocity[:, :2]
            self.body.acceleration[:] = self.acceleration[:, :2]

    def prescribed_velocity(self, time: float) -> Array:
        """Prescribed velocities (owned nodes, c) at a time."""
        return self._padded(self.body.prescribed_velocity(time))

    def external_force(self) -> Array:
        """Loads (owned nodes, c)."""
        return self._padded(self.body.external_force())

    def internal_force(self, displacement: Array) -> Array:
        """Internal force (owned nodes, c) at displacements (collective)."""
        if self.same:
            return self.body.internal_force(displacement)
        return self._padded(self.body.internal_force(np.ascontiguousarray(displacement[:, :2])))

    def edge_stiffness(self, nodes: NDArray[np.int64], marked: NDArray[np.bool_]) -> sparse.csr_matrix:
        """Stiffness (c k, c k) of the cells that have nodes of both kinds, marked (owned nodes,) and not (collective)."""
        found = self.body.marked_nodes(marked)
        return self.stiffness_matrix(nodes, (found > 0) & (found < self.body.cell_nodes.shape[1]))

    def stiffness_matrix(
        self, nodes: NDArray[np.int64], of_cells: NDArray[np.bool_] | None = None
    ) -> sparse.csr_matrix:
        """Stiffness (c k, c k) among k nodes of any rank, of some owned cells or of all (collective)."""
        matrix = self.body.stiffness_matrix(nodes, of_cells)
        if self.same:
            return matrix
        count = len(nodes)
        places = (3 * np.arange(count)[:, None] + np.arange(2)).ravel()
        wider = sparse.csr_matrix((np.ones(2 * count), (places, np.arange(2 * count))), shape=(3 * count, 2 * count))
        return sparse.csr_matrix(wider @ matrix @ wider.T)
