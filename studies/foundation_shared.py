"""Particles alone on several ranks."""

from __future__ import annotations

from typing import Any

from mpi4py import MPI

from bridge.run import Stopwatch, on_root
from studies import foundation as scene
from studies.foundation import Parameters
from studies.foundation_models import Foundation, on_root_only, particle_terms
from studies.snapshots import Snapshot


class SharedParticleFoundation(Foundation):
    """Particles everywhere, each rank with a part of them; every method is collective."""

    def __init__(self, p: Parameters, stopwatch: Stopwatch, comm: Any = MPI.COMM_WORLD) -> None:
        from particles.exchange import SharedAssembly

        super().__init__(p, comm)
        on_root_only(comm, lambda: scene.sites(p))  # a random packing is made once; the others read it
        self.shared = SharedAssembly(lambda: scene.all_particles(p), comm)
        critical = on_root(comm, lambda: self.shared.whole.critical_step())  # type: ignore[union-attr]
        self._plan(self._fine_step(critical), critical)
        self.shared.prepare(self.step, mass_damping=p.damping)  # forces of the start
        self.step_sizes = {"fine": self.step, "fine_critical": critical}
        self.counts = {"particles": self.shared.count, "fine_steps": self.steps}
        self._advance = stopwatch.part(
            "particles", lambda steps: self.shared.advance(steps, self.step, mass_damping=p.damping)
        )
        self._watch = stopwatch

    def advance(self, steps: int) -> None:
        """Take steps of the particles."""
        self._advance(steps)

    @property
    def time(self) -> float:  # type: ignore[override]
        """Time since the start, s."""
        return self.shared.time

    def load(self) -> float:
        return float(self.shared.part.plates[0].force[1])

    def energies(self) -> dict[str, float]:
        return particle_terms(self.shared.energies(), self.shared.energy_balance())

    def snapshot(self) -> Snapshot:
        self.soil = self.shared.collect()
        return super().snapshot()

    def state(self) -> dict[str, Any]:
        return {"time": self.time, "particles": self.shared.state()}

    def restore(self, state: dict[str, Any]) -> None:
        self.shared.restore(state.get("particles"))

    def parallel(self) -> dict[str, Any]:
        return self.shared.parallel(self._watch.parts["particles"])
