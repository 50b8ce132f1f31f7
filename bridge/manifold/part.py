"""A rank's part of a body of elements and particles: its slab of particles, and a share of the elements; nodes move on all ranks alike."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from bridge.manifold import steps
from particles.dispatch import Direct
from particles.lattice import motion
from particles.lattice.part import Part
from particles.lattice.state import Drive, State, Terms

_carry, _pull = Direct(steps.carry_rows), Direct(steps.pull_nodes)
_act_on_nodes, _kick_both, _begin = Direct(steps.act_on_nodes), Direct(steps.kick_both), Direct(steps.begin)
_act = Direct(motion.act_on)


class ManifoldPart(Part):
    """The part of one rank (collective).

    Args:
        nodes, elements: of the whole body, as rank 0 has them; others as for `Part`.
    """

    def __init__(
        self, comm: Any, state: State, terms: Terms, owner: np.ndarray, free: np.ndarray, carried: np.ndarray, nodes: steps.Nodes,
        elements: steps.Elements,
    ) -> None:  # fmt: skip
        super().__init__(comm, state, terms, owner, free, carried)
        self.nodes = steps.Nodes._make(values.copy() for values in nodes)
        self.nodes.sums[:] = 0.0
        mine = self.needed[elements.carried]
        self.elements = elements._replace(carried=elements.carried[mine], carrier=elements.carrier[mine], slot=elements.slot[mine])
        self._share = self.elements._replace(active=np.array_split(elements.active, comm.size)[comm.rank].copy())
        self._pulled = np.empty_like(self.nodes.force)

    def begin_both(self, h: float) -> tuple[np.ndarray, ...]:
        """Go to the middle of a step, see `bridge.manifold.steps.begin` (collective); returns what `advance_both` does."""
        _begin(self.state, self.nodes, h)
        return self._of_nodes()

    def advance_both(self, drive: Drive, nodal_drive: Drive, count: int, h: float, ends: bool) -> tuple[np.ndarray, ...]:
        """Whole steps of particles and nodes together, as `bridge.manifold.steps.advance` (collective).

        Returns:
            Displacements, velocities, forces (3, nodes) and energy sums of the nodes.
        """
        start, drive, nodal_drive = time.perf_counter(), self.mine(drive), self.told(1, nodal_drive)
        state, terms, nodes = self.state, self.terms, self.nodes
        for s in range(count):
            self.exchange()
            _carry(state, nodes, self.elements)
            self.feel(h)
            _pull(state, terms, nodes, self._share)
            self._sum_forces()
            _act(state, terms, drive, s, h)
            _act_on_nodes(nodes, self.elements, terms, nodal_drive, s, h)
            _kick_both(state, nodes, *((h, h) if s < count - 1 or not ends else (0.5 * h, 0.0)))
        if ends:
            _carry(state, nodes, self.elements)
        self.seconds["stepping"] += time.perf_counter() - start
        return self._of_nodes()

    def _of_nodes(self) -> tuple[np.ndarray, ...]:
        nodes = self.nodes
        sums = nodes.sums.copy()
        nodes.sums[:] = 0.0
        return nodes.displacement, nodes.velocity, nodes.force, sums

    def _sum_forces(self) -> None:
        """Forces on the nodes from the shares of all ranks (collective)."""
        start = time.perf_counter()
        self.comm.Allreduce(self.nodes.force, self._pulled)
        self.nodes.force[:] = self._pulled
        self.seconds["agreement"] += time.perf_counter() - start
