"""N: the shape functions of the mesh at the particles, and its transpose, on any number of ranks."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray

Array = NDArray[np.float64]


def on_every_rank(comm, check: Callable[[], None]) -> None:
    """Run a check of local data; a ValueError on any rank is raised on all, so that none waits for ever (collective)."""
    problem = None
    try:
        check()
    except ValueError as error:
        problem = str(error)
    problems = [words for words in comm.allgather(problem) if words is not None]
    if problems:
        raise ValueError(problems[0])


class NodeExchange:
    """Values at the nodes that this rank's particles need, whichever rank owns those nodes (construction is collective).

    `nodes` are the global indices of the needed nodes, ascending. `gather` and `scatter` are collective too.
    """

    def __init__(self, comm, owned_range: tuple[int, int], wanted: NDArray[np.int64]):
        self._comm = comm
        self.nodes = np.unique(np.asarray(wanted, dtype=np.int64))
        starts = np.asarray(comm.allgather(owned_range[0]))
        owners = np.searchsorted(starts, self.nodes, side="right") - 1
        # ranks that own nothing share their start with the next one: searchsorted picks the last, which is the owner
        wanted_by_owner = [self.nodes[owners == rank] for rank in range(comm.size)]
        asked_of_me = comm.alltoall(wanted_by_owner)
        self._receive_counts = np.array([len(part) for part in wanted_by_owner])
        self._send_counts = np.array([len(part) for part in asked_of_me])
        self._local = np.concatenate(asked_of_me) - owned_range[0]  # what the others (and I) want of my nodes

    @property
    def wanted_by_others(self) -> list[NDArray[np.int64]]:
        """Own nodes, counted from the first owned one, that each rank needs."""
        return np.split(self._local, np.cumsum(self._send_counts)[:-1])

    @property
    def wanted_of_others(self) -> list[int]:
        """Number of needed nodes of each rank."""
        return [int(count) for count in self._receive_counts]

    def gather(self, owned: Array) -> Array:
        """Copy of the nodal rows (nodes, components) that this rank needs, from the owned rows of all ranks."""
        sent = owned[self._local]
        return sent if self._comm.size == 1 else self._swap(sent, self._send_counts, self._receive_counts)

    def scatter(self, values: Array, owned: Array) -> None:
        """Add the rows (nodes, components) of this rank's needed nodes to the owned rows of their owners."""
        if self._comm.size == 1:
            owned[self._local] += values
        else:
            received = self._swap(np.ascontiguousarray(values), self._receive_counts, self._send_counts)
            np.add.at(owned, self._local, received)

    def _swap(self, sent: Array, send_counts, receive_counts) -> Array:
        width = sent.shape[1]
        received = np.empty((int(receive_counts.sum()), width))
        self._comm.Alltoallv([sent, send_counts * width], [received, receive_counts * width])
        return received


class ExchangeOfOneRank(NodeExchange):
    """The same where every rank has the same values at the same nodes: those of rank 0 go to the owners."""

    def scatter(self, values: Array, owned: Array) -> None:
        super().scatter(values if self._comm.rank == 0 else np.zeros_like(values), owned)


class Interpolation:
    """Scalar shape-function matrix N (particles, needed nodes) of given points, the same for every component.

    Args:
        body: The continuum body (shape functions of its mesh).
        points: Reference positions (n, 2) of this rank's particles, m; may be empty. Collective.
        everywhere: Every rank has the same points; what is scattered is rank 0's.

    Raises:
        ValueError: a point lies outside the mesh.
    """

    def __init__(self, body, points: Array, everywhere: bool = False):
        points = np.asarray(points, dtype=np.float64).reshape(-1, 2)
        nodes, values, found = body.shape_functions(points)
        lost = np.flatnonzero(~np.asarray(found, dtype=bool))
        total_lost = body.comm.allreduce(len(lost))
        if total_lost:
            where = f", the first at {points[lost[0]]} m" if len(lost) else ""
            raise ValueError(
                f"{total_lost} particles lie outside the mesh{where}: the particle region must lie inside it"
            )
        kind = ExchangeOfOneRank if everywhere else NodeExchange
        self.exchange = kind(body.comm, body.owned_range, nodes)
        columns = np.searchsorted(self.exchange.nodes, nodes)
        count, per_cell = nodes.shape
        rows = np.repeat(np.arange(count), per_cell)
        shape = (count, len(self.exchange.nodes))
        matrix = sparse.csr_matrix((np.asarray(values).ravel(), (rows, columns.ravel())), shape=shape)
        matrix.data[np.abs(matrix.data) < 1e-14] = 0.0  # a point on an edge has no share in the nodes across
        matrix.eliminate_zeros()
        self.matrix = matrix

    @property
    def nodes(self) -> NDArray[np.int64]:
        """Global indices of the nodes that are the columns of `matrix`."""
        return self.exchange.nodes
