"""A bridging-scale coupling whose particles are spread over the ranks (variant `subcycling`).

The coupling is first made as on one rank, by every rank with all particles; then each rank keeps a part of them. The interface
nodes step with the particles on every rank alike: what the particles of all ranks do to them is summed in every particle step
(3 numbers a node). All other nodes step on the rank that owns them.
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
        """New lists, as one rank has asked for (collective)."""
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
        self._saved, self.reaction, self._multiplier = whole._saved[mine], whole.reaction[mine], whole._multiplier[mine]
        self._ghost_acceleration, self._shift = whole._ghost_acceleration[mine], whole._shift[mine]
        self._first_rank = shared.comm.rank == 0
        self._projection_of_all: SpreadProjection | None = None
        self.rearrange()

    def across(self) -> tuple[Any, Any]:
        return self.soil.shared.across

    def fit_covered(self, owned: Array, values: Array, rule: Any) -> None:
        if self._projection_of_all is None:
            covered = np.zeros((len(owned), 1))
            rule.exchange.scatter(self.covered.astype(float)[:, None], covered)
            counting = np.ones((len(self._weights), 1))
            counting[self.ids] = 0.0  # ghosts follow the mesh
            weights = counting * self._weights
            self._projection_of_all = SpreadProjection(
                rule.body.comm, rule.body.owned_range, self._shape, rule.exchange.nodes, weights[:, 0], weights[:, 2],
                covered[:, 0] > 0.0,
            )  # fmt: skip
        by_id = np.zeros((len(self._weights), 3))
        by_id[self._row_ids[self._free]] = values
        owned[:] = self._projection_of_all.coarse(by_id, owned)

    @property
    def lost_by_nodes(self) -> float:
        return super().lost_by_nodes if self._first_rank else 0.0


def spread(coupled: BridgingScale, shared: SharedAssembly) -> None:
    """Let a coupling that every rank has made with all particles go on with those of `shared` (collective).

    Args:
        coupled: Variant `subcycling`, made with `everywhere`; its particles have the state that `shared` was made from.
        shared: The same particles, `room` for 3 numbers a node of the interface.
    """
    coupled.fine = coupled.rule.fine = SharedScale(coupled.fine, shared)
    coupled.rule.spread(coupled.fine.across()[1].seconds)
    coupled.restart_account()
