"""An overlap coupling whose particles are spread over the ranks.

The coupling is first made by every rank with all particles, so that all have the same nodes of the zone and the same factors of
their mass; then each rank keeps a part of the particles. The nodes of the zone step with the particles on every rank alike: what
the ties of all ranks do to them is summed in every particle step (3 or 6 numbers a node), and rank 0 gives the result to the ranks
that own the nodes. Tied particles change hands like others: what belongs to a tie is known on every rank.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sparse

from bridge.overlap.fine import ZoneParticles
from bridge.ranks import SharedSoil
from particles.exchange import SharedAssembly
from particles.parts import sent

_OF_TIED = ("masses", "stiffness", "force", "_origin", "external", "load")


class SharedZone(ZoneParticles):
    """The part of the particles' side that belongs to this rank; its arrays of nodes are those of the whole.

    Attributes:
        whole: The side as it was made; on rank 0 it has all particles, as they were when last collected.

    Args:
        whole: Made with all particles.
        shared: The same particles, `room` for the components of the zone's nodes.
    """

    def __init__(self, whole: ZoneParticles, shared: SharedAssembly) -> None:
        self.__dict__.update(whole.__dict__)
        self.whole, self.soil = whole, SharedSoil(shared)
        self.leads = shared.comm.rank == 0
        self.rearrange()

    def _order(self, rows, order) -> None:
        whole, numbers = self.whole, self.soil.shared.ids
        mine = np.flatnonzero(np.isin(whole.tie.ids, numbers))
        self.tie = whole.tie.part(mine, numbers)
        self.all_masses = whole.all_masses[numbers]
        for name in _OF_TIED:
            setattr(self, name, getattr(whole, name)[mine])
        super()._order(rows, order)

    def across(self) -> tuple[Any, Any]:
        return self.soil.shared.across

    def linearise(self, stiffness: sparse.spmatrix | None) -> None:
        raise ValueError("particles that are spread over ranks cannot be made linear: make the coupling with spread=False")

    def collect(self) -> None:
        """Bring particles and forces of the ties to rank 0 (collective)."""
        shared = self.soil.shared
        force = np.zeros(self.all_masses.shape)
        force[self.tie.ids] = self.force
        everywhere = shared.gather(force)
        shared.collect()
        if everywhere is not None:
            self.whole.force[:] = everywhere[self.whole.tie.ids]
            self.whole.rearrange()


def share(comm: Any, soil: Any, room: int) -> SharedAssembly:
    """Particles that rank 0 has, spread over the ranks; `room` for the numbers that are summed in a step (collective)."""
    whole = soil if comm.rank == 0 else None
    return SharedAssembly(lambda: sent(comm, whole), comm, room=room, whole=whole)
