"""Explicit motion of a body: central differences in velocity form, with an exact energy account.

With h the step (Li & Wan 2010, eqs 31-34; the same as their eqs 27-30 for particles):
    v' = v + h/2 a,  d += h v',  a = (F/M - c v') / (1 + h c/2),  v = v' + h/2 a,  F = F_ext - F_int + F_local.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

CHECK_EVERY = 50  # steps between two looks for a blow-up
SUMS = ("mass_damping", "local_damping", "external_work")


class Unstable(RuntimeError):
    """The explicit motion has blown up; the message says where and when."""


class Known(NamedTuple):
    """State that an acceleration belongs to, the settings it was computed with and the account's error then (J)."""

    state: tuple[np.ndarray, ...]
    settings: tuple[int, float]
    imbalance: float


class Motion:
    """Time stepping and energy sums of one body; used through `Body`."""

    def __init__(self, body: Any):
        self._body = body
        self.mass_damping = 0.0
        self._sums = dict.fromkeys(SUMS, 0.0)  # J, this rank's share
        self._fastest = float(np.sqrt(np.abs(body.moduli).max() / body.material.density))  # m/s
        self._lengths = np.full(body.components, body.cell_size)  # from rates to speeds
        self._lengths[: body.axes] = 1.0
        self._known = Known(tuple(np.zeros_like(array) for array in self._state()), (-1, 0.0), 0.0)
        self._damping = np.zeros_like(body.mass)  # N, local damping force of the last evaluation
        self._reaction = np.zeros(0)  # N, on the prescribed components
        self._step = 0.0
        self._reference = 0.0  # J, this rank's share of the energy at the start

    def advance(self, steps: int, step: float, mass_damping: float = 0.0, local_damping: float = 0.0) -> None:
        """Take `steps` explicit steps of `step` seconds (collective).

        Prescribed components move with their velocity at the middle of each step. Displacements or velocities written
        between calls are taken up: the acceleration is then computed anew, unless it was written as well (restart).

        Args:
            steps: number of steps, 0 or more.
            step: s; the caller keeps it below `critical_step`.
            mass_damping: c in 1/s, force -c M v.
            local_damping: alpha in [0, 1), force -alpha |F| sgn(v') on each component (Zhao et al. 2012, eq. 26).

        Raises:
            Unstable: a node moves faster than the fastest wave (looked at every 50 steps and at the end).
        """
        _check(steps, step, mass_damping, local_damping)
        body, half = self._body, 0.5 * step
        d, v, a = body.displacement, body.velocity, body.acceleration
        mass, loads = body.mass, body.external_force()
        boundaries, at = body.boundaries, body.boundaries.fixed_flat
        with np.errstate(divide="ignore"):
            inverse = np.where((mass > 0) & ~body.fixed, 1.0 / mass, 0.0)
        factor = 1.0 / (1.0 + mass_damping * half)
        moving = (mass > 0) & ~body.fixed

        self._begin(step, mass_damping, local_damping, inverse)
        damping, reaction = self._damping, self._reaction
        middle = v + half * a
        middle.ravel()[at] = boundaries.velocity_flat(body.time + half)
        for done in range(steps):
            change = step * middle
            d += change
            force = loads - body.internal_force()
            new_damping = -local_damping * np.abs(force) * np.sign(middle) if local_damping else None
            total = force if new_damping is None else force + new_damping
            work = np.vdot(loads, change)
            drag = np.vdot(mass * v, change) if mass_damping else 0.0
            a[:] = (inverse * total - mass_damping * np.where(moving, middle, 0.0)) * factor
            body.time += step
            following = boundaries.velocity_flat(body.time + half)
            a.ravel()[at] = (following - middle.ravel()[at]) / step
            v[:] = middle + half * a
            if len(at):
                held = (mass.ravel()[at] * (a.ravel()[at] + mass_damping * v.ravel()[at])) - force.ravel()[at]
                work += 0.5 * np.dot(reaction + held, change.ravel()[at])
                reaction = held
            if mass_damping:
                self._sums["mass_damping"] += 0.5 * mass_damping * (drag + np.vdot(mass * v, change))
            if new_damping is not None:
                new_damping = np.where(moving, new_damping, 0.0)
                self._sums["local_damping"] -= 0.5 * np.vdot(damping + new_damping, change)
                damping = new_damping
            self._sums["external_work"] += work
            middle = v + half * a
            middle.ravel()[at] = following
            if (done + 1) % CHECK_EVERY == 0:
                self._check_stable()
        self._check_stable()
        self._damping, self._reaction = damping, reaction
        self._note(step, mass_damping)
        body.update_ghosts()

    def _check_stable(self) -> None:
        """Raise Unstable where a node outruns the fastest wave: its strain would then exceed 1 (collective)."""
        body = self._body
        speed = np.abs(body.velocity) * self._lengths
        with np.errstate(invalid="ignore"):
            wild = ~(speed.max(axis=1, initial=0.0) <= self._fastest)
        places = [p for found in body.comm.allgather(body.coordinates[wild][:1]) for p in found]
        if places:
            place = ", ".join(f"{component:.6g}" for component in places[0])
            raise Unstable(
                f"the continuum became unstable by t={body.time:.6g} s: the node at ({place}) m moves faster than "
                f"the wave speed {self._fastest:.4g} m/s; reduce the step (critical_step) or the load"
            )

    def _begin(self, step: float, mass_damping: float, local_damping: float, inverse: np.ndarray) -> None:
        """Make the acceleration belong to the state, and let the energy account continue from it."""
        body, at, half = self._body, self._body.boundaries.fixed_flat, 0.5 * step
        known = self._known
        settings = (body.boundaries.revision, mass_damping)
        same = [np.array_equal(old, new) for old, new in zip(known.state, self._state())]
        moved = bool(body._total(int(not (same[0] and same[1] and known.settings == settings))))
        given = bool(body._total(int(not same[2])))
        if moved:
            free = inverse > 0
            if not given:
                body.velocity.ravel()[at] = body.boundaries.velocity_flat(body.time)
            force = body.external_force() - body.internal_force()
            before = body.velocity - half * body.acceleration if given else body.velocity
            self._damping = np.where(free, -local_damping * np.abs(force) * np.sign(before), 0.0)
            if not given:
                drag = mass_damping * np.where(free, body.velocity, 0.0)
                body.acceleration[:] = inverse * (force + self._damping) - drag
                ahead = body.boundaries.velocity_flat(body.time + half)
                body.acceleration.ravel()[at] = (ahead - body.velocity.ravel()[at]) / half
            inertia = body.acceleration.ravel()[at] + mass_damping * body.velocity.ravel()[at]
            self._reaction = body.mass.ravel()[at] * inertia - force.ravel()[at]
        if moved or step != self._step:
            # what the user or a new step changed is not an error of the integration
            self._reference += self._imbalance(step) - known.imbalance

    def _state(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return self._body.displacement, self._body.velocity, self._body.acceleration

    def _imbalance(self, step: float) -> float:
        """Energy + losses - work - reference of this rank, with the integrator's own kinetic energy.

        T = 1/2 v(n-1/2) M v(n+1/2) = 1/2 v M v - h^2/8 a M a changes by exactly the work of the trapezoidal forces.
        """
        body = self._body
        kinetic = 0.5 * np.vdot(body.velocity, body.mass * body.velocity)
        kinetic -= step**2 / 8.0 * np.vdot(body.acceleration, body.mass * body.acceleration)
        strain = 0.5 * np.vdot(body.displacement, body.internal_force())
        losses = self._sums["mass_damping"] + self._sums["local_damping"] - self._sums["external_work"]
        return float(kinetic + strain + losses - self._reference)

    def _note(self, step: float, mass_damping: float) -> None:
        """Remember the state that the acceleration belongs to."""
        self.mass_damping, self._step = mass_damping, step
        state = tuple(array.copy() for array in self._state())
        self._known = Known(state, (self._body.boundaries.revision, mass_damping), self._imbalance(step))

    def energies(self) -> dict[str, float]:
        """Energy terms in J (collective).

        strain and kinetic (1/2 v M v) of now; mass_damping and local_damping: lost so far; external_work: done by
        loads and prescribed motion so far; balance: error of the account, zero to rounding. It is formed with the
        integrator's own kinetic energy, from which 1/2 v M v differs by h^2/8 a M a.
        """
        body = self._body
        terms = {"strain": body.strain_energy(), "kinetic": body.kinetic_energy()}
        for name, value in self._sums.items():
            terms[name] = float(body._total(float(value)))
        terms["balance"] = float(body._total(self._imbalance(self._step)))
        return terms


def _check(steps: int, step: float, mass_damping: float, local_damping: float) -> None:
    if isinstance(steps, bool) or int(steps) != steps or steps < 0:
        raise ValueError(f"steps={steps} must be a whole number, 0 or more")
    if not (np.isfinite(step) and step > 0):
        raise ValueError(f"step={step} must be positive (s)")
    if not (np.isfinite(mass_damping) and mass_damping >= 0):
        raise ValueError(f"mass_damping={mass_damping} must be zero or positive (1/s)")
    if not 0 <= local_damping < 1:
        raise ValueError(f"local_damping={local_damping} must lie in [0, 1)")
