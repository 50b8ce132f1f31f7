"""Steps of an assembly: what must be so before them, the run from list to list, what is said when particles blow up."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from particles import listing, motion, network
from particles.dispatch import Direct
from particles.motion import Unstable
from particles.system import TRAVEL, TRAVEL_LIMIT, Terms
from particles.walls.listing import driven
from particles.walls.servo import set_contact_constants

if TYPE_CHECKING:
    from particles.assembly import Assembly

advance, _evaluate, _kick = Direct(motion.advance), Direct(motion.evaluate), Direct(motion.kick)
_stale, _runaway = Direct(motion.stale), Direct(motion.runaway)


def is_worn(soil: Assembly) -> bool:
    """Whether the neighbour list is used up."""
    clock = soil._system.clock
    return not clock[TRAVEL] <= clock[TRAVEL_LIMIT] and bool(_stale(soil._system))


def is_led(soil: Assembly) -> bool:
    """Whether a coupling moves some of the particles, or carries a share of the body."""
    return bool(soil._ghost.any()) or soil._system.share is not None


def start(soil: Assembly, terms: Terms, step: float, led: bool, border: Any = None, halo: Any = None) -> None:
    """Compute forces and accelerations of the present state (collective with `border` and `halo`, as `motion.advance`).

    Args:
        step: s, of the steps that follow.
        led: `is_led` on any rank: loops of a coupling follow, and two short functions are compiled sooner than the loop of
            the steps, which is compiled anyway without one.
    """
    network.hold(soil._system.walls)
    if soil.cell is not None:
        soil.cell.arrays.rate[:] = soil.cell.arrays.gradient @ soil.cell.arrays.matrix
    if led:
        _evaluate(soil._system, terms, 0.0, border, halo)
        _kick(soil._system, terms, 0.0)
    else:
        advance(soil._system, terms, 0, step, False, border, halo)
    soil._primed = (terms[5:],)


def needs_start(soil: Assembly, terms: Terms) -> bool:
    """Whether forces and accelerations are not those of the present state and loads."""
    loaded = [wall.has_new_load() for wall in soil.plates]  # of all, each is asked once
    return soil._primed != (terms[5:],) or any(loaded)


def prepare(soil: Assembly, step: float, steps: int, loads: dict[str, Any]) -> Terms:
    """See `Assembly.prepare`."""
    if not (np.isfinite(step) and step > 0.0):
        raise ValueError(f"step={step} must be positive (s)")
    if soil._loads is None or soil._loads[0] != loads:
        soil._loads = loads, soil.terms(**loads)
    terms = soil._loads[1]
    soil._step = step
    if is_worn(soil):
        listing.rebuild(soil)
    set_contact_constants(soil)
    if needs_start(soil, terms):
        start(soil, terms, step, is_led(soil))
    walls = soil._system.walls
    if walls is not None and (driving := driven(soil.plates, walls, soil.time, step, steps)) is not walls:
        soil._system = soil._system._replace(walls=driving)
    return terms


def run(soil: Assembly, terms: Terms, steps: int, step: float) -> None:
    """Make steps, with new lists on the way."""
    left, resume = steps, False
    while True:
        done, code = advance(soil._system, terms, left, step, resume, None, None)
        left -= done
        if code == motion.FINISHED:
            return
        raise_runaway(soil, step, f" in step {steps - left}")
        listing.rebuild(soil)
        resume = True


def refresh(soil: Assembly) -> None:
    """See `Assembly.refresh`."""
    if _stale(soil._system):
        raise_runaway(soil, soil._step, "")
        listing.rebuild(soil)


def raise_runaway(soil: Assembly, step: float, where: str) -> None:
    """Raise `Unstable` where a particle moves by more than the smallest radius in a step."""
    row = _runaway(soil._system, step)
    if row >= 0:
        motion_of = soil.velocities[soil._ids[row]]
        speed, spin = np.linalg.norm(motion_of[: soil.axes]), np.linalg.norm(motion_of[soil.axes :])
        raise Unstable(
            f"particle {soil._label(row)} runs away{where} at t={soil.time:g} s with {speed:.3g} m/s and "
            f"{spin:.3g} rad/s: more than the smallest radius in a step of {step:g} s; take a smaller step"
        )
