"""Overlap coupling: particles and continuum share a zone, in which the particles are tied to the mesh (Rojek & Onate 2007).

In the zone both carry a part: stiffness, mass and loads of the continuum count by alpha, contacts, masses and loads of the
particles by 1 - alpha (`OverlapZone`). The ties are

`lagrange`  eqs 85-86: tied components follow from the nodes, u = N d; the nodes carry the particles' mass and forces,
            (M_F + N^T M N) a = f + N^T F, with the consistent matrix, factored once.
`penalty`   eq 89: springs between particles and mesh.

One coarse step takes `substeps` particle steps, by explicit subcycling as in the bridging scale: nodes of the zone take the
particles' steps.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

import numpy as np
from mpi4py import MPI

from bridge import checks, kept
from bridge.interpolation import on_every_rank
from bridge.overlap import limit
from bridge.overlap.fine import ZoneParticles
from bridge.overlap.mesh import WholeNodes
from bridge.overlap.ranks import SharedZone, share
from bridge.overlap.rule import OverlapRule
from bridge.overlap.tie import ROTATIONS, Tie
from particles.exchange import SharedAssembly
from particles.parts import sent
from particles.stability import normal_stiffness

CONSTRAINTS = ("lagrange", "penalty")


class Overlap:
    """A body and particles that overlap, advanced together.

    Rank 0 gives the particles, the others an empty assembly; they stay there, or all ranks move them (`spread`). Construction and
    every method are collective. The particles are weighed (`Assembly.weigh`): from now on their masses are the shares that they carry. Eliminated components
    follow the mesh, also where the motion of the body is written from outside; velocities that they are given do not count.

    Args:
        body: Cauchy or Cosserat body, plane or in space, whose `share` is the zone.
        soil: Discs, or spheres with a body in space; none where the continuum is alone; they may fill a part of the zone only where the body ends.
        zone: OverlapZone.
        constraint: "lagrange" or "penalty".
        rotation: Of tied particles: "micro" (the micro-rotation; default with a Cosserat body), "curl" (half the curl of the
            mesh) or "free" (default with a Cauchy body, as published).
        penalty: Stiffness of the springs: alpha (1 - alpha) of each particle's normal contact stiffness, times this (turning:
            times its radius squared). With 4 a spring in the middle of the zone is as stiff as a contact.
        step: Coarse time step, s.
        substeps: Particle steps in a coarse step.
        mass_damping: c_m of both, 1/s.
        vector_damping: (alpha, alpha_r) of the particles that do not follow the mesh: force -alpha |F| v / |v| and moment
            -alpha_r |T| w / |w| (eqs 25-26); with "lagrange" only.
        spread: Let all ranks move the particles; what rank 0 has is up to date after `collect`. Walls may be driven as ever;
            what else is done to the particles afterwards counts no more.

    Supports, loads and gravity of the body and external forces of the particles must be set before; gravity is the body's and
    acts on the particles too. What is held of a particle in the zone must be fixed of the mesh there, and is not tied.

    Raises:
        ValueError: for arguments out of range or that do not go together, or a step above the critical one of either side.
    """

    def __init__(
        self,
        body: Any,
        soil: Any,
        zone: Any,
        *,
        constraint: str = "lagrange",
        rotation: str | None = None,
        penalty: float = 4.0,
        step: float,
        substeps: int = 1,
        mass_damping: float = 0.0,
        vector_damping: tuple[float, float] | None = None,
        spread: bool = False,
    ):
        if constraint not in CONSTRAINTS:
            raise ValueError(f"constraint={constraint!r} must be one of {', '.join(CONSTRAINTS)}")
        if rotation is None:
            rotation = "micro" if body.turns else "free"
        if rotation not in ROTATIONS:
            raise ValueError(f"rotation={rotation!r} must be one of {', '.join(ROTATIONS)}")
        if rotation == "micro" and not body.turns:
            raise ValueError("rotation='micro' needs a Cosserat body; take 'curl' or 'free' with a Cauchy body")
        checks.number("penalty", penalty)
        if vector_damping is not None and constraint != "lagrange":
            raise ValueError(f"vector_damping={vector_damping} goes with constraint='lagrange' only; leave it out with springs")
        if body.share is not zone:
            raise ValueError("the body does not leave the zone's share to the particles: make it with share=zone, the same zone")
        on_every_rank(body.comm, lambda: _check_axes(body, soil))
        self.shared: SharedAssembly | None = None
        self._given, spread = soil, spread and body.comm.size > 1
        if spread:  # until all have made the same
            copy = sent(body.comm, soil if body.comm.rank == 0 else None)
            soil = soil if body.comm.rank == 0 else copy
        self.body, self.soil, self.zone, self.constraint, self.rotation = body, soil, zone, constraint, rotation
        self.step, self.substeps = checks.number("step", step), checks.count("substeps", substeps)
        self.mass_damping = checks.number("mass_damping", mass_damping, positive=False)
        self.time, self.coarse_steps = 0.0, 0
        self.mesh = WholeNodes(body)
        tie = Tie(body, soil, zone, rotation, self.mesh.width, spread)
        self.exchange = tie.exchange
        fixed = self.exchange.gather(self.mesh.fixed.astype(float)) > 0.5
        on_every_rank(body.comm, lambda: tie.leave_held(soil, fixed))
        soil.weigh(tie.share, tie.mass_share, np.isin(np.arange(soil.count), tie.ids, invert=True))
        springs = None
        if constraint == "penalty":
            springs = penalty * tie.spring_shares(normal_stiffness(soil), soil.radii)
        gravity = body.gravity_acceleration
        self.fine: Any = ZoneParticles(soil, tie, springs, self.step / self.substeps, mass_damping, gravity, vector_damping)
        self._revision = body.boundaries.revision
        self.rule = OverlapRule(self)
        self._check_steps()
        if spread:
            self.shared = share(body.comm, soil, self.fine.nodes.link.size)
            whole = self.fine
            self.fine = self.rule.fine = SharedZone(whole, self.shared)
            self.soil, whole.soil = self.fine.soil, self._given
        self._initial = self._terms()

    @property
    def tie(self) -> Tie:
        """The tied particles of this rank."""
        return self.fine.tie

    @contextlib.contextmanager
    def _together(self, collected: bool = True) -> Iterator[None]:
        """Work with the particles on rank 0 as if they were not spread (collective); `collected`: as they are now."""
        if self.shared is None:
            yield
            return
        if collected:
            self.collect()
        own, soil = self.fine, self.soil
        self.fine = self.rule.fine = own.whole
        self.soil = self._given
        try:
            yield
        finally:
            self.fine = self.rule.fine = own
            self.soil = soil

    def collect(self) -> None:
        """Bring the particles that rank 0 gave up to date there (collective)."""
        if self.shared is not None:
            self.fine.collect()

    def state(self) -> dict[str, Any]:
        """Particles, body and ties as named arrays, complete on rank 0 (collective); see `bridge.kept`."""
        with self._together():
            found = kept.coupled_state(self)
        if self.shared is not None:
            ranks = self.shared.states()
            if self.body.comm.rank == 0:
                found["own_sums"][1:] = 0.0  # every rank keeps the same
                found["particles"]["ranks"] = ranks
        return found

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state, of any number of ranks, which rank 0 has (collective)."""
        given = state
        if self.shared is not None:
            state = kept.for_all_ranks(self.body.comm, state)
        with self._together(collected=False):
            kept.restore_coupled(self, state)
        if self.shared is not None:
            self.shared.restore(given["particles"] if self.body.comm.rank == 0 else None)
            self.fine.rearrange()

    def parallel(self, stepping: float | None = None) -> dict[str, Any]:
        """How the work is shared out, see `SharedAssembly.parallel` (collective); empty where one rank has all particles."""
        return {} if self.shared is None else self.shared.parallel(stepping)

    def release(self) -> None:
        """Give back what MPI holds for messages; the particles can no longer be moved."""
        if self.shared is not None:
            self.shared.release()

    def critical_step(self, sharp: bool = False) -> float:
        """Largest stable particle step, s (collective): particles, ties and the nodes that take this step.

        By default a rigorous bound; `sharp` solves for the largest frequency (`bridge.overlap.limit`).
        """
        with self._together():
            own = limit.sharp(self) if sharp else limit.bound(self)
        return self.body.comm.allreduce(own, op=MPI.MIN)

    def _check_steps(self) -> None:
        """Raise a ValueError where a step exceeds what its side can take by itself (collective)."""
        fine, body = self.step / self.substeps, self.body
        if fine > self.critical_step() and fine > (most := self.critical_step(sharp=True)):
            raise ValueError(
                f"step={self.step:g} s in {self.substeps} substeps: {fine:.4g} s must be at most {most:.4g} s, the critical "
                f"step of the particles and the zone (constraint={self.constraint!r}); take a smaller step"
            )
        if self.step > body.critical_step() and self.step > (most := body.critical_step("power")):
            raise ValueError(
                f"step={self.step:g} s must be at most the continuum's critical step of {most:.4g} s; take fewer substeps"
            )

    def advance(self, steps: int) -> None:
        """Take that many coarse steps.

        Raises:
            ValueError: for a negative number, or when supports or loads were changed meanwhile.
        """
        if steps < 0:
            raise ValueError(f"steps={steps} must be zero or positive")
        same = self.body.boundaries.revision == self._revision
        on_every_rank(self.body.comm, lambda: self._check_loads(same))
        shared = self.shared
        if shared is None:
            self.rule.run(steps)
            return
        if (news := self.body.comm.bcast(shared.news_of_walls(), root=0)) is not None:
            shared.hear_of_walls(news)
        try:
            self.rule.run(steps)
        finally:
            shared.tell_whole()

    def _check_loads(self, same: bool) -> None:
        if not (same and np.array_equal(self.soil.external_forces[self.tie.ids], self.fine.external)):
            raise ValueError("supports and loads must be set before Overlap is made: make a new one")

    def count(self, steps: int) -> None:
        """Let the clock go on by coarse steps that were taken."""
        self.coarse_steps += steps
        self.time = self.body.time = self.coarse_steps * self.step

    def mismatch(self) -> float:
        """Largest distance of a tied particle from the motion of the mesh at its place, m (collective)."""
        gap = self.fine.stretch(self.exchange.gather(self.mesh.displacement))
        return float(self.body.comm.allreduce(np.abs(gap[:, : self.body.axes]).max(initial=0.0), op=MPI.MAX))

    def multipliers(self) -> np.ndarray:
        """Forces and moments (g, 3), in space (g, 6), of the tied particles `tie.ids` of this rank on the mesh, N and N m; zero where free.

        lambda = F - M a with the weighted contact forces F (lagrange), k times the stretch (penalty).
        """
        force = np.where(self.tie.tied, self.fine.force, 0.0)
        if not self.fine.eliminated or not self.soil.count:
            return force
        accelerations = self.soil.accelerations[self.tie.ids]
        return np.where(self.tie.tied, force - self.fine.masses * accelerations, 0.0)

    def energies(self) -> dict[str, float]:
        """Energies of the whole system since the start, J, in the plane per metre (collective).

        Kinetic and elastic energy of the particles' part, kinetic and strain energy of the continuum's; `penalty`, stored in
        the springs; what friction, dashpots, damping, opened and broken contacts took; `external` work of walls, loads and
        gravity; `interface`, what substeps take where the zone meets the other nodes. `balance` is what is unaccounted for, with the kinetic energy 1/2 v(n-1/2) M v(n+1/2) of the time integration,
        which differs from 1/2 v M v by h^2/8 a M a.
        """
        terms = self._terms()
        result = {name: terms[name] - self._initial[name] for name in terms}
        stored = sum(result[name] for name in ("kinetic", "elastic", "strain", "penalty"))
        lost = sum(result[name] for name in ("friction", "viscous", "contact_loss", "mass_damping", "local_damping", "interface"))
        result["balance"] = stored + lost - result["external"] - result.pop("stepping")
        return result

    def _terms(self) -> dict[str, float]:
        names = self.fine.ENERGY_NAMES
        self.rule.receive()
        local = self.fine.energies(self.exchange.gather(self.mesh.displacement))
        sums = self.body.comm.allreduce(np.concatenate([local, self.rule.energies()])).tolist()
        result = dict(zip(names, sums[: len(names)], strict=True))
        kinetic, strain, damping, external, interface, stepping = sums[len(names) :]
        result["kinetic"] += kinetic
        result["stepping"] += stepping
        result["strain"], result["interface"] = strain, interface
        result["mass_damping"] += damping
        result["external"] += external
        return result


def _check_axes(body: Any, soil: Any) -> None:
    if soil.count and soil.axes != body.axes:
        kinds = {2: "discs with a plane body", 3: "spheres with a body in space"}
        raise ValueError(f"particles have {soil.axes} axes, the body has {body.axes}: {kinds[2]}, {kinds[3]}")
