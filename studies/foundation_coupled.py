"""The foundation of particles and continuum together: bridging scale and overlap.

Continuum and particles are spread over the ranks.
Every method is collective.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from mpi4py import MPI

from bridge import BridgingScale, Overlap, growth, kept
from bridge.ranks import spread
from bridge.run import Stopwatch, on_root
from continuum import Unstable as ContinuumUnstable
from particles import Unstable
from particles.exchange import SharedAssembly
from studies import foundation as scene
from studies.foundation import Parameters
from studies.foundation_models import (
    UNSTABLE,
    ContinuumFoundation,
    Foundation,
    ParticleFoundation,
    complete,
    no_particles,
    on_root_only,
)
from studies.foundation_shared import SharedParticleFoundation
from studies.foundation_steps import COARSE_RATIO, fit_substeps, warn_of_growth
from studies.snapshots import Snapshot


class CoupledFoundation(Foundation):
    """What the couplings share."""

    coupled: Any

    def _plan_both(self, fine_critical: float) -> int:
        """Plan the steps of both sides, from the particles' critical step (s); returns the substeps."""
        coarse_critical = self.body.critical_step()
        fine, substeps = fit_substeps(self.p, self._fine_step(fine_critical), coarse_critical)
        self._plan(substeps * fine, coarse_critical)
        self.step_sizes = {
            "coarse": self.step, "coarse_critical": coarse_critical,
            "fine": self.step / substeps, "fine_critical": fine_critical,
        }  # fmt: skip
        return substeps

    def _watch(self, stopwatch: Stopwatch) -> None:
        """Count the time of the particles' loops, and know the speed that nodes must not pass."""
        self.coupled.fine.run_loop = stopwatch.part("particles", self.coupled.fine.run_loop)
        stiffness, density = self.material.stiffness, self.material.density
        self._fastest = math.sqrt(float(np.abs(stiffness).max()) / density)

    def advance(self, steps: int) -> None:
        """Take coarse steps."""
        if self.comm.size == 1:
            self.coupled.advance(steps)
        else:
            self._advance_or_abort(steps)
        self._check_stable()

    def _advance_or_abort(self, steps: int) -> None:
        """Particles that blow up inside a step leave the other ranks waiting for ever: the run is ended from here."""
        try:
            self.coupled.advance(steps)
        except Unstable as unstable:
            self.last_words(str(unstable))
            self.comm.Abort(UNSTABLE)

    def _check_stable(self) -> None:
        velocity = self.body.velocity
        if self.comm.size == 1 and np.vdot(velocity, velocity) <= self._fastest**2:
            return  # the usual case, at no cost: not even all nodes together are that fast
        speed = np.abs(velocity[:, :2]).max(axis=1, initial=0.0)
        with np.errstate(invalid="ignore"):
            wild = ~(speed <= self._fastest)
        places = [tuple(place) for found in self.comm.allgather(self.body.coordinates[wild][:1]) for place in found]
        if places:
            x, y = places[0]
            raise ContinuumUnstable(
                f"the continuum became unstable by t={self.time:.6g} s: the node at ({x:.6g}, {y:.6g}) m moves faster than "
                f"the wave speed {self._fastest:.4g} m/s; take fewer substeps, another variant or more damping"
            )

    @property
    def time(self) -> float:  # type: ignore[override]
        """Time since the start, s."""
        return self.coupled.time

    def load(self) -> float:
        return on_root(self.comm, lambda: float(self.soil.plates[0].force[1]))

    def state(self) -> dict[str, Any]:
        return kept.coupled_state(self.coupled)

    def restore(self, state: dict[str, Any]) -> None:
        kept.restore_coupled(self.coupled, state)

    def sample(self) -> dict[str, float]:
        return super().sample() | {"interface_gap_m": self.coupled.mismatch()}

    def energies(self) -> dict[str, float]:
        e = self.coupled.energies()
        return complete({"external_work": e["external"]} | e, e["balance"])


class BridgedFoundation(CoupledFoundation):
    """Particles under the plate and the continuum around them, by the bridging-scale method."""

    everywhere = False  # whether every rank makes all particles
    _share: Any

    def __init__(self, p: Parameters, stopwatch: Stopwatch, comm: Any = MPI.COMM_WORLD) -> None:
        super().__init__(p, comm)
        nested: Any = on_root_only(comm, lambda: scene.nested_particles(p))
        if self.everywhere and nested is None:
            nested = scene.nested_particles(p)
        self.soil, self.ghosts, self._share = nested or (no_particles(p), np.zeros(0, dtype=bool), np.zeros(0))
        critical = on_root(comm, lambda: self.soil.critical_step())
        self.body = scene.body(
            p, self.material, comm, excluded=scene.particle_region(p), costs=self._element_costs(self._fine_step(critical))
        )
        self._substeps = self._plan_both(critical)
        mean_radius = float(np.mean(on_root(comm, lambda: self.soil.radii)))
        warn_of_growth(p, self._substeps, self.step / self.step_sizes["coarse_critical"], mean_radius)
        self.coupled = self._couple()
        self._watch(stopwatch)
        ghosts, particles = on_root(comm, lambda: (int(self.ghosts.sum()), int((~self.ghosts).sum())))
        covered = comm.allreduce(int(np.count_nonzero(self.body.cell_fractions == 0.0)))
        self.counts = {
            "particles": particles, "ghosts": ghosts, "elements": comm.allreduce(len(self.body.cell_nodes)),
            "covered_elements": covered, "coarse_steps": self.steps, "fine_steps": self.steps * self._substeps,
        }  # fmt: skip

    def _element_costs(self, fine: float) -> Any:
        """Costs by which the mesh is spread over the ranks, None for elements alone; `fine` is the particles' step, s."""
        return None

    def _couple(self) -> BridgingScale:
        return BridgingScale(
            self.body, self.soil, self.ghosts, self._share, step=self.step, substeps=self._substeps, variant=self.p.variant,
            mass_damping=self.p.damping, everywhere=self.everywhere,
        )  # fmt: skip

    def grows(self) -> Any:
        """The growth test of the linearised system, with a warning where it grows; takes a while."""
        found = growth(self.coupled)
        found.warn(self.p.duration, f"variant={self.p.variant} with {self.coupled.substeps} substeps")
        return found

    def snapshot(self) -> Snapshot:
        self.coupled.project_covered()
        return super().snapshot()


class SharedBridgedFoundation(BridgedFoundation):
    """The same with the particles spread over the ranks; made from a coupling that every rank has with all particles.

    Each rank has the particles of its own elements. These are known by the particles' places at the start, as N is: what
    wanders makes halos longer, and changes neither N nor who has which particles.
    """

    everywhere = True

    def __init__(self, p: Parameters, stopwatch: Stopwatch, comm: Any = MPI.COMM_WORLD) -> None:
        super().__init__(p, stopwatch, comm)
        self._stopwatch = stopwatch
        self._spread(self._share_out())
        self._watch(stopwatch)

    def _element_costs(self, fine: float) -> Any:
        speed = math.sqrt(float(np.abs(self.material.stiffness).max()) / self.material.density)
        substeps = self.p.substeps or max(1, round(COARSE_RATIO * self.p.element_size / speed / fine))  # about as many
        return scene.element_costs(self.soil.reference, substeps)

    def _share_out(self) -> SharedAssembly:
        """The particles, each on the rank that owns its element."""
        owner = self.body.owners(self.soil.reference)
        return SharedAssembly(self._particles, self.comm, room=3 * len(self.coupled.fine.interface), owner=owner)

    def _particles(self) -> Any:
        soil, ghosts, _ = scene.nested_particles(self.p)
        soil.set_ghosts(ghosts)
        return soil

    def _spread(self, shared: SharedAssembly) -> None:
        self.shared, self._whole_fine = shared, self.coupled.fine
        spread(self.coupled, shared)
        shared.prepare(self.coupled.fine.step, mass_damping=self.p.damping, gravity=self.body.gravity_acceleration)

    def advance(self, steps: int) -> None:
        """Take coarse steps."""
        self.coupled.advance(steps)
        self._check_stable()

    def load(self) -> float:
        return float(self.shared.part.plates[0].force[1])

    def grows(self) -> Any:
        return BridgedFoundation(self.p, Stopwatch(), self.comm).grows()

    def _with_whole(self, work: Callable[[], Any]) -> Any:
        """Do something with all particles on rank 0, where their number does not matter (collective)."""
        whole, coupled = self.shared.collect(), self.coupled
        if whole is not None:
            self.soil = coupled.soil = self._whole_fine.soil = whole
            self._whole_fine.rearrange()
        own = coupled.fine
        coupled.fine = coupled.rule.fine = self._whole_fine
        try:
            return work()
        finally:
            coupled.fine = coupled.rule.fine = own

    def snapshot(self) -> Snapshot:
        self.coupled.project_covered()  # by all ranks
        return self._with_whole(super(BridgedFoundation, self).snapshot)

    def state(self) -> dict[str, Any]:
        self.coupled.fine.collect(self._whole_fine)
        found = self._with_whole(super().state)
        ranks, works = self.shared.states(), self.comm.gather(self.coupled.fine.interface_work)
        if self.comm.rank == 0:
            found["own_sums"][1:] = 0.0  # every rank keeps the same, but for the work of its own ghosts
            found["own_sums"][:, 0] = works
            found["particles"]["ranks"] = ranks
        return found

    def restore(self, state: dict[str, Any]) -> None:
        given, state = state, kept.for_all_ranks(self.comm, state)
        self.soil = self._particles()
        self.coupled = self._couple()
        super().restore(state)
        shared = self._share_out()
        shared.restore(given["particles"] if self.comm.rank == 0 else None)
        initial = self.coupled._initial
        self._spread(shared)
        self.coupled._initial = initial
        self._watch(self._stopwatch)

    def parallel(self) -> dict[str, Any]:
        return self.shared.parallel(self._stopwatch.parts["particles"])


class OverlapFoundation(CoupledFoundation):
    """The same particles without ghosts, the rim of their region shared with the continuum."""

    def __init__(self, p: Parameters, stopwatch: Stopwatch, comm: Any = MPI.COMM_WORLD) -> None:
        super().__init__(p, comm)
        self.soil = on_root_only(comm, lambda: scene.overlapping_particles(p)) or no_particles(p)
        zone = scene.overlap_zone(p)
        self.body = scene.body(p, self.material, comm, share=zone)

        def couple(step: float, substeps: int, spread: bool) -> Overlap:
            return Overlap(
                self.body, self.soil, zone, constraint=p.constraint, step=step, substeps=substeps, mass_damping=p.damping, spread=spread
            )

        substeps = self._plan_both(couple(1e-3 * self.body.critical_step(), 1, False).critical_step())
        self.coupled = couple(self.step, substeps, True)
        self._watch(stopwatch)
        self._stopwatch = stopwatch
        self.counts = {
            "particles": on_root(comm, lambda: self.soil.count), "tied": comm.allreduce(len(self.coupled.tie.ids)),
            "elements": comm.allreduce(len(self.body.cell_nodes)),
            "covered_elements": comm.allreduce(int(np.count_nonzero(self.body.cell_fractions == 0.0))),
            "coarse_steps": self.steps, "fine_steps": self.steps * substeps,
        }  # fmt: skip

    def advance(self, steps: int) -> None:
        """Take coarse steps."""
        self.coupled.advance(steps)
        self._check_stable()

    def snapshot(self) -> Snapshot:
        self.coupled.collect()
        return super().snapshot()

    def state(self) -> dict[str, Any]:
        return self.coupled.state()

    def restore(self, state: dict[str, Any]) -> None:
        self.coupled.restore(state)

    def parallel(self) -> dict[str, Any]:
        return self.coupled.parallel(self._stopwatch.parts["particles"])


def particles_alone(p: Parameters, stopwatch: Stopwatch, comm: Any = MPI.COMM_WORLD) -> Foundation:
    """Particles everywhere, on one rank or on all."""
    return (ParticleFoundation if comm.size == 1 else SharedParticleFoundation)(p, stopwatch, comm)


def bridged(p: Parameters, stopwatch: Stopwatch, comm: Any = MPI.COMM_WORLD) -> BridgedFoundation:
    """Particles and continuum, on one rank or on all."""
    return (BridgedFoundation if comm.size == 1 else SharedBridgedFoundation)(p, stopwatch, comm)


MODELS: dict[str, Callable[..., Any]] = {
    "dem": particles_alone, "bridging": bridged, "overlap": OverlapFoundation, "fem": ContinuumFoundation,
}  # fmt: skip
