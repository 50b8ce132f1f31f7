"""The foundation's models behind one face: time steps, samples, energies and snapshots; here particles and continuum alone.

Here rank 0 holds all particles (`studies.foundation_shared` spreads them); the continuum is spread over the ranks. Every method is
collective.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from mpi4py import MPI

from bridge import kept
from bridge.run import Stopwatch, on_root
from particles import state as particle_state
from studies import foundation as scene
from studies.foundation import AVERAGING, Parameters
from studies.foundation_steps import COARSE_RATIO, check_number_of_steps
from studies.snapshots import Snapshot, continuum_fields, particle_fields

UNSTABLE = 3  # exit status
LARGEST_ADVANCE = 0.1  # of the plate in a step, as a share of the smallest radius
TERMS = (
    "external_work",
    "kinetic",
    "elastic",
    "strain",
    "friction",
    "viscous",
    "contact_loss",
    "mass_damping",
    "interface",
    "penalty",
)


class Foundation:
    """What the models share.

    Attributes:
        steps: Number of steps until the plate has its displacement.
        counts: Particles, elements, ... for the summary.
        step_sizes: Time steps and the critical ones, s.
        last_words: Called with the message on rank 0 before an unstable run on several ranks is ended.
    """

    soil: Any = None
    body: Any = None
    ghosts: Any = None

    def __init__(self, p: Parameters, comm: Any = MPI.COMM_WORLD) -> None:
        self.p, self.comm = p, comm
        self.steps, self.step = 0, 0.0
        self.last_words: Callable[[str], None] = lambda message: None
        self.counts: dict[str, int] = {}
        self.step_sizes: dict[str, float] = {}
        self.material = on_root(comm, lambda: scene.material(p))

    def _plan(self, step: float, largest: float) -> None:
        """Steps of at most `step` that end exactly at the displacement."""
        check_number_of_steps(self.p, min(step, largest))
        self.steps = max(1, math.ceil(self.p.duration / min(step, largest) * (1.0 - 1e-9)))
        self.step = self.p.duration / self.steps

    def _fine_step(self, critical: float) -> float:
        p = self.p
        if p.step is not None and p.step > critical:
            raise ValueError(f"step={p.step} must be at most the particles' critical step of {critical:.4g} s")
        step = p.step_ratio * critical if p.step is None else p.step
        check_number_of_steps(p, step)
        smallest = scene.smallest_radius(p)
        if p.speed * step > LARGEST_ADVANCE * smallest:
            raise ValueError(
                f"speed={p.speed} moves the plate by {p.speed * step:.3g} m in a step of {step:.3g} s; it must be at most "
                f"{LARGEST_ADVANCE:g} of the smallest radius of {smallest:g} m"
            )
        return step

    @property
    def displacement(self) -> float:
        """Displacement of the plate, m, downwards positive."""
        return self.p.speed * self.time

    time: float

    def load(self) -> float:
        """Vertical load that the plate carries, N, compression positive."""
        raise NotImplementedError

    def energies(self) -> dict[str, float]:
        """All terms since the start, J; see `TERMS`, and `balance` for what is unaccounted for."""
        raise NotImplementedError

    def state(self) -> dict[str, Any]:
        """All that `restore` needs; complete on rank 0."""
        raise NotImplementedError

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state; that of the particles only where there are any."""
        raise NotImplementedError

    def parallel(self) -> dict[str, Any]:
        """How the work was spread over the ranks: particles, halos and seconds of each; empty where one has all of them."""
        return {}

    def sample(self) -> dict[str, float]:
        """A row of the history."""
        row = {"time_s": self.time, "displacement_m": self.displacement, "load_N": self.load()}
        return row | {f"{name}_J": value for name, value in self.energies().items()}

    def snapshot(self) -> Snapshot:
        """All fields; on ranks other than 0 without them."""
        found: tuple[Any, Any] = (None, None)
        if self.soil is not None and self.comm.rank == 0:
            found = particle_fields(
                self.soil, self.ghosts, scene.solid_fraction(self.p), self.material.poisson_ratio, AVERAGING
            )
        continuum = None if self.body is None else continuum_fields(self.body)
        return Snapshot(self.time, self.displacement, *found, continuum)


class ParticleFoundation(Foundation):
    """Particles everywhere; other ranks than 0 look on."""

    def __init__(self, p: Parameters, stopwatch: Stopwatch, comm: Any = MPI.COMM_WORLD) -> None:
        super().__init__(p, comm)
        self.time = 0.0
        self.soil = on_root_only(comm, lambda: scene.all_particles(p))
        critical = on_root(comm, lambda: self.soil.critical_step())
        self._plan(self._fine_step(critical), critical)
        on_root_only(comm, lambda: self.soil.prepare(self.step, mass_damping=p.damping))  # forces of the start
        self.step_sizes = {"fine": self.step, "fine_critical": critical}
        self.counts = {"particles": on_root(comm, lambda: self.soil.count), "fine_steps": self.steps}
        self._advance = stopwatch.part(
            "particles", lambda steps: self.soil.advance(steps, self.step, mass_damping=p.damping)
        )

    def advance(self, steps: int) -> None:
        """Take steps of the particles."""
        _raise_together(self.comm, lambda: self._advance(steps))
        self.time += steps * self.step

    def state(self) -> dict[str, Any]:
        return {"time": self.time, "particles": {} if self.soil is None else particle_state.state_of(self.soil)}

    def restore(self, state: dict[str, Any]) -> None:
        self.time = float(state["time"])
        on_root_only(self.comm, lambda: particle_state.restore(self.soil, state["particles"]))

    def load(self) -> float:
        return on_root(self.comm, lambda: float(self.soil.plates[0].force[1]))

    def energies(self) -> dict[str, float]:
        return on_root(self.comm, lambda: particle_terms(self.soil.energies(), self.soil.energy_balance()))


class ContinuumFoundation(Foundation):
    """A linear Cosserat continuum everywhere; the plate prescribes the vertical velocity of the nodes under it."""

    def __init__(self, p: Parameters, stopwatch: Stopwatch, comm: Any = MPI.COMM_WORLD) -> None:
        super().__init__(p, comm)
        self.body = scene.body(p, self.material, comm)
        self.plate = scene.under_plate(p)
        if comm.allreduce(int(np.count_nonzero(self.plate(self.body.coordinates)))) == 0:
            raise ValueError(f"mesh={p.mesh} has no nodes under the plate of {p.plate_width:g} m: refine it there")
        self.body.prescribe(self.plate, "y", -p.speed)
        critical = self.body.critical_step()
        if p.step is not None and p.step > critical:
            raise ValueError(f"step={p.step} must be at most the continuum's critical step of {critical:.4g} s")
        self._plan(COARSE_RATIO * critical if p.step is None else p.step, critical)
        self.step_sizes = {"coarse": self.step, "coarse_critical": critical}
        elements = comm.allreduce(len(self.body.cell_nodes))
        self.counts = {"elements": elements, "coarse_steps": self.steps}

    def advance(self, steps: int) -> None:
        """Take steps of the continuum."""
        self.body.advance(steps, self.step, mass_damping=self.p.damping)

    @property
    def time(self) -> float:  # type: ignore[override]
        """Time since the start, s."""
        return self.body.time

    def state(self) -> dict[str, Any]:
        return kept.body_state(self.body)

    def restore(self, state: dict[str, Any]) -> None:
        kept.restore_body(self.body, state)

    def load(self) -> float:
        return float(-self.body.reaction(self.plate)[1]) if self.body.time > 0.0 else 0.0

    def energies(self) -> dict[str, float]:
        e = self.body.energies()
        return complete(
            {name: e[name] for name in ("external_work", "kinetic", "strain", "mass_damping")}, e["balance"]
        )


def particle_terms(e: dict[str, float], balance: float) -> dict[str, float]:
    """Energies of an assembly (J) as terms of the foundation."""
    sums = {
        "external_work": e["wall_work"] + e["held_work"],
        "kinetic": e["kinetic"],
        "elastic": sum(value for name, value in e.items() if name.startswith("elastic")),
        "friction": sum(value for name, value in e.items() if name.startswith("friction")),
    }
    return complete(sums | {name: e[name] for name in ("viscous", "contact_loss", "mass_damping")}, balance)


def complete(terms: dict[str, float], balance: float) -> dict[str, float]:
    return {name: float(terms.get(name, 0.0)) for name in TERMS} | {"balance": float(balance)}


def no_particles(p: Parameters) -> Any:
    from particles import Assembly

    return Assembly(np.zeros((0, 2)), np.zeros(0), p.density, scene.contact_law(p))


def on_root_only(comm: Any, work: Callable[[], Any]) -> Any:
    """Result of a function on rank 0, None elsewhere; its ValueError on every rank (collective)."""
    result: list[Any] = [None]

    def keep() -> None:
        result[0] = work()

    on_root(comm, keep)
    return result[0]


def _raise_together(comm: Any, work: Callable[[], None]) -> None:
    """Call on rank 0; its `particles.Unstable` is raised on every rank (collective)."""
    from particles import Unstable

    message = None
    if comm.rank == 0:
        try:
            work()
        except Unstable as unstable:
            message = str(unstable)
    message = comm.bcast(message, root=0)
    if message is not None:
        raise Unstable(message)
