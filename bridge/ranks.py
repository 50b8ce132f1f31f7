"""A bridging-scale coupling whose particles are spread over the ranks.

The coupling is first made as on one rank, by every rank with all particles; then each rank keeps a part of them. What the particles
of all ranks do to the nodes that they need is summed, in every particle step where the variant asks for it (3 numbers a node of the
interface), and known to every rank; rank 0 gives it to the ranks that own the nodes. All other nodes step on the rank that owns them.
"""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import scipy.sparse as sparse

from bridge.bridging_scale import BridgingScale
from bridge.fine import Array, FineScale
from bridge.spread_projection import SpreadProjection
from particles.exchange import SharedAssembly

_OF_GHOSTS = ("_saved", "reaction", "_multiplier", "_ghost_acceleration", "_shift")  # arrays (ghosts, ...)


class SharedSoil:
    """The particles of this rank as a coupling sees them; lists are made anew together with the other ranks."""

    def __init__(self, shared: SharedAssembly) -> None:
        self.shared = shared

    def __getattr__(self, name: str) -> Any:
        return getattr(self.shared.part, name)

    @property
    def count(self) -> int:
        """Particles of all ranks: a rank without any takes part in the loops."""
        return self.shared.count

    def prepare(self, step: float, steps: int, **loads: Any) -> tuple[Any, Any]:
        """As `Assembly.prepare` (collective)."""
        terms = self.shared.prepare(step, steps, **loads)
        return self.shared.part.system, terms

    def refresh(self) -> None:
        """New lists where one rank's is used up (collective)."""
        self.shared.refresh()

    def energies(self) -> dict[str, float]:
        """This rank's part of the energies, J."""
        return self.shared.own_energies()


class SharedScale(FineScale):
    """The part of a `FineScale` that belongs to this rank; its arrays of interface nodes are those of the whole."""

    def __init__(self, whole: FineScale, shared: SharedAssembly) -> None:
        self.__dict__.update(copy.copy(whole).__dict__)
        self.__dict__.pop("run_loop", None)  # the whole's, where its time is measured
        ids = shared.ids
        mine = np.flatnonzero(np.isin(whole.ids, ids))
        self.soil, self.ids = SharedSoil(shared), np.searchsorted(ids, whole.ids[mine])
        self._shape, self._weights = sparse.csr_matrix(whole._shape[ids]), whole._weights[ids]
        self.share, self.ghost_mass, self.carried_weight = (a[mine] for a in (whole.share, whole.ghost_mass, whole.carried_weight))
        self.ghost_shape = sparse.csr_matrix(whole.ghost_shape[mine])
        self._local_shape = sparse.csr_matrix(whole._local_shape[mine])
        for name in _OF_GHOSTS:
            setattr(self, name, getattr(whole, name)[mine].copy())
        if self.ghosts_move_by_themselves:
            self._tie = whole._tie._replace(stiffness=whole._tie.stiffness[mine])
        self.comm, self._first_rank, self._mine = shared.comm, shared.comm.rank == 0, mine
        self._work = whole._work.copy()  # zero at the start, later what this rank had
        self._projections: dict[bool, SpreadProjection] = {}
        self.rearrange()

    def collect(self, whole: FineScale) -> None:
        """Bring what belongs to ghosts to rank 0's `whole` (collective)."""
        own = [getattr(self, name) for name in _OF_GHOSTS]
        parts = self.comm.gather((self._mine, own, self._work), root=0)
        if parts is None:
            return
        for mine, arrays, _ in parts:
            for name, values in zip(_OF_GHOSTS, arrays):
                getattr(whole, name)[mine] = values
        whole._work[:] = sum(work for *_, work in parts)

    def across(self) -> tuple[Any, Any]:
        return self.soil.shared.across

    def to_nodes(self, values: Array) -> Array:
        return self.comm.allreduce(super().to_nodes(values))

    def _projection_of_all(self, rule: Any, covered_alone: bool) -> SpreadProjection:
        """Projection of the free particles of all ranks, on all nodes or on the covered ones with the others held (collective)."""
        if covered_alone not in self._projections:
            sought = np.zeros((len(rule.mass), 1))
            rule.exchange.scatter(self.covered.astype(float)[:, None] if covered_alone else np.ones((len(self.covered), 1)), sought)
            weights = self._weights.copy()
            weights[self.ids] = 0.0  # ghosts follow the mesh
            self._projections[covered_alone] = SpreadProjection(
                self.comm, rule.body.owned_range, self._shape, rule.exchange.nodes, weights[:, 0], weights[:, 2], sought[:, 0] > 0.0
            )
        return self._projections[covered_alone]

    def _by_id(self, values: Array) -> Array:
        """Values of the free particles (free, 3) in the order of ids, (n, 3); zero for ghosts."""
        found = np.zeros((len(self._weights), 3))
        found[self._row_ids[self._free]] = values
        return found

    def fit_covered(self, owned: Array, values: Array, rule: Any) -> None:
        owned[:] = self._projection_of_all(rule, True).coarse(self._by_id(values), owned)

    def _mesh_minus_coarse(self, rule: Any, nodal: Array, values: Array) -> Array:
        projection = self._projection_of_all(rule, False)
        rest = self._shape @ nodal - projection.extend(projection.coarse(self._by_id(values)))
        return rest[self._row_ids[self._free]]

    @property
    def lost_by_nodes(self) -> float:
        return super().lost_by_nodes if self._first_rank else 0.0


def spread(coupled: BridgingScale, shared: SharedAssembly) -> None:
    """Let a coupling that every rank has made with all particles go on with those of `shared` (collective).

    Args:
        coupled: Made with `everywhere`; its particles have the state that `shared` was made from.
        shared: The same particles, `room` for 3 numbers a node of the interface.
    """
    coupled.fine = coupled.rule.fine = SharedScale(coupled.fine, shared)
    coupled.rule.spread(coupled.fine.across()[1].seconds)
    coupled.restart_account()
