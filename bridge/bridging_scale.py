"""The bridging-scale coupling of a Cosserat body with a nested particle region (Li & Wan 2010), and its variants.

One coarse step takes `substeps` particle steps. The variants (`bridge.variants`) differ in what couples the two:

`paper`       eqs 15-16, 25-34 as published: every node is a coarse unknown, in the covered block the mass is N^T Mp N and the
              force N^T F(N d + Q q); ghosts follow the mesh with constant acceleration.
`resync`      as `paper` with F(q); nodes strictly inside the covered block then take the projection of q.
`subcycling`  (default) only nodes with continuum mass are coarse unknowns; interface nodes take the particles' steps while their
              neighbours move evenly (explicit subcycling, Neal & Belytschko 1989), and a kick at the coarse time brings the
              continuum's impulses to those of the trapezoidal rule. Keeps linear momentum; loses nothing at the interface.
`respa`       only nodes with continuum mass are coarse unknowns; the continuum kicks them at the coarse times, the
              ghosts' contact forces move them in every substep (impulse multi-stepping, Tuckerman et al. 1992). Keeps linear
              momentum; its impulses shake the interface; grows slowly from 0.7 of the continuum's critical step on.
`multiplier`  only nodes with continuum mass are coarse unknowns; ghosts are particles whose velocities are tied to the mesh by
              multipliers in every substep (Gravouil & Combescure 2001). Dissipates at the interface for more than one substep.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from bridge import checks
from bridge.fine import FineScale
from bridge.interpolation import Interpolation, on_every_rank
from bridge.variants import VARIANTS


class BridgingScale:
    """A body and the particles nested in it, advanced together.

    Particles may live on one rank (the others pass an empty assembly); construction and every method are collective.

    Args:
        body: Cosserat body whose integrals leave out the covered region (`excluded`).
        soil: Particles of the region and its ghosts.
        ghosts: Mask (n,) of the ghosts among the particles, in the particles' order.
        share: Inside part of each ghost's mass (g,), see `bridge.layout.nested_layout`.
        step: Coarse time step, s.
        substeps: Particle steps in a coarse step.
        variant: One of `VARIANTS`.
        mass_damping: c_m of both scales, 1/s.
        everywhere: Every rank has all particles, to be spread by `bridge.ranks.spread` before the first step.

    Supports, loads and gravity are those of the body and must be set before; its gravity acts on the particles too.

    Raises:
        ValueError: for an unknown variant, a body without micro-rotation or whose excluded region is not that of the particles,
            a step above the critical one of either side, or sizes that do not match.
    """

    def __init__(
        self,
        body,
        soil,
        ghosts,
        share=0.0,
        *,
        step: float,
        substeps: int = 1,
        variant: str = "subcycling",
        mass_damping: float = 0.0,
        everywhere: bool = False,
    ):
        if variant not in VARIANTS:
            raise ValueError(f"variant={variant!r} must be one of {', '.join(VARIANTS)}")
        if not body.turns:
            raise ValueError("the bridging scale needs a Cosserat body: particle rotations follow its micro-rotation")
        if body.axes != 2:
            raise ValueError("the bridging scale is plane: take Overlap with a body of tetrahedra or hexahedra")
        self.body, self.soil, self.variant = body, soil, variant
        self.step, self.substeps = checks.number("step", step), checks.count("substeps", substeps)
        self.mass_damping = checks.number("mass_damping", mass_damping, positive=False)
        self.time, self.coarse_steps = 0.0, 0
        on_every_rank(body.comm, lambda: self._check_particles(ghosts, share))
        ghosts = np.asarray(ghosts, dtype=bool)
        share = np.broadcast_to(np.asarray(share, dtype=np.float64), (int(ghosts.sum()),))
        self._check_steps()
        self.interpolation = Interpolation(body, soil.reference, everywhere)
        self.exchange = self.interpolation.exchange
        self.fine = FineScale(
            soil,
            ghosts,
            share,
            self.interpolation.matrix,
            self.step / self.substeps,
            mass_damping,
            body.gravity_acceleration,
        )
        self._revision = body.boundaries.revision
        self.rule = VARIANTS[variant](self)
        self.restart_account()

    def restart_account(self) -> None:
        """Count energies from now on (collective)."""
        self._initial = self._terms()

    def _check_particles(self, ghosts, share) -> None:
        """Raise a ValueError where this rank's particles, ghosts and shares do not fit together or to the body."""
        soil, body = self.soil, self.body
        ghosts, share = np.asarray(ghosts), np.asarray(share, dtype=np.float64)
        if ghosts.shape != (soil.count,) or ghosts.dtype != bool:
            raise ValueError(
                f"ghosts of shape {ghosts.shape} and kind {ghosts.dtype} must be ({soil.count},) bools, one a particle"
            )
        if share.shape not in ((), (int(ghosts.sum()),)) or not np.all((share >= 0.0) & (share <= 1.0)):
            raise ValueError(
                f"share of shape {share.shape} must be a number from 0 to 1 for each of the {ghosts.sum()} ghosts"
            )
        if body.excluded is None:
            raise ValueError("the body carries the particles' region as well: give that region as its `excluded`")
        inside = body.excluded.distance(soil.reference) < -1e-6 * soil.radii
        if np.any(inside == ghosts):
            first = int(np.flatnonzero(inside == ghosts)[0])
            kind = "a ghost but lies inside" if inside[first] else "no ghost but lies outside"
            raise ValueError(
                f"particle {first} at {soil.reference[first]} m is {kind} the body's excluded region: give body and layout the same one"
            )

    def _check_steps(self) -> None:
        """Raise a ValueError where a step exceeds what its side can take by itself (collective)."""
        body, fine = self.body, self.step / self.substeps
        limit = self.soil.critical_step()
        if fine > limit:
            limit = self.soil.critical_step(sharp=True)
        limit = body.comm.allreduce(limit, op=MPI.MIN)
        if fine > limit:
            raise ValueError(
                f"step={self.step:g} s in {self.substeps} substeps: {fine:.4g} s must be at most the particles' {limit:.4g} s"
            )
        if not body.comm.allreduce(int(np.any(body.mass > 0.0))):
            return  # particles everywhere
        if self.step > body.critical_step() and self.step > (limit := body.critical_step("power")):
            raise ValueError(
                f"step={self.step:g} s must be at most the continuum's critical step of {limit:.4g} s; take fewer substeps"
            )

    def advance(self, steps: int) -> None:
        """Take that many coarse steps.

        Raises:
            ValueError: for a negative number, or when supports or loads of the body were changed meanwhile.
        """
        if steps < 0:
            raise ValueError(f"steps={steps} must be zero or positive")
        if self.body.boundaries.revision != self._revision:
            raise ValueError(
                "supports, loads and gravity of the body must be set before BridgingScale is made: make a new one"
            )
        self.rule.run(steps)

    def count(self, steps: int) -> None:
        """Let the clock go on by coarse steps that were taken."""
        self.coarse_steps += steps
        self.time = self.body.time = self.coarse_steps * self.step

    def on_outline(self):
        """Mask (n,) of this rank's particles whose centre lies on the outline of the covered region."""
        soil = self.soil
        if self.body.excluded is None or not soil.count:
            return np.zeros(soil.count, dtype=bool)
        return np.abs(self.body.excluded.distance(soil.reference)) < 1e-6 * soil.radii

    @property
    def mass(self):
        """Coarse lumped mass (owned nodes, 3) of the nodes with continuum mass; zero at covered nodes."""
        return self.rule.mass

    def critical_coarse_step(self) -> float:
        """Largest stable coarse step, that of the continuum with its coarse mass by itself, s (collective)."""
        return self.rule.critical_step()

    def project_covered(self) -> None:
        """Give covered nodes the projection of the particles (for output and for N d + Q q); changes no dynamics."""
        self.rule.place_covered()

    def mismatch(self) -> float:
        """Largest distance of a ghost from the motion of the mesh at its place, m (collective)."""
        gap = self.fine.ghost_shape @ self.exchange.gather(self.body.displacement) - self.fine.ghost_displacement()
        return float(self.body.comm.allreduce(np.abs(gap[:, :2]).max(initial=0.0), op=MPI.MAX))

    def energies(self) -> dict[str, float]:
        """Energies of the whole system since the start, J per metre (collective).

        Kinetic and elastic energy of the particles; kinetic and strain energy of the continuum outside them; what friction,
        dashpots, damping and opened contacts took; `external` work of plates, loads and gravity; `interface`, the energy lost
        between the two sides at the ghosts. `balance` is what is unaccounted for.
        """
        terms = self._terms()
        result = {name: terms[name] - self._initial[name] for name in terms}
        stored = result["kinetic"] + result["elastic"] + result["strain"]
        lost = sum(result[name] for name in ("friction", "viscous", "contact_loss", "mass_damping", "interface"))
        result["balance"] = stored + lost - result["external"]
        return result

    def _terms(self) -> dict[str, float]:
        names = self.fine.ENERGY_NAMES
        sums = self.body.comm.allreduce(np.concatenate([self.fine.energies(), self.rule.energies()])).tolist()
        result = dict(zip(names, sums[: len(names)], strict=True))
        kinetic, strain, damping, external, link = sums[len(names) :]
        result["kinetic"] += kinetic
        result["strain"] = strain
        result["mass_damping"] += damping
        result["external"] += external
        result["interface"] = -(result["interface"] + link)
        return result
