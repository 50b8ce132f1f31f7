"""Explicit central difference (Li & Wan 2010, eqs 27-30) as building blocks for jitted loops.

A run of steps of size h is `drift`, then for every step `evaluate` and either `kick_drift` (more steps follow) or `kick`
(the last one). After `drift` and `kick_drift` positions are at the new time and row velocities at the middle of the step;
after `kick` both are at the same time. Between a drift and the evaluation that follows it the list may be stale: ask
`stale(system)`; if so, leave the jitted code, call `Assembly.refresh`, fetch the system anew and go on with `evaluate`.

A caller that moves some rows itself (ghosts) writes their position, angle and velocity after `drift` or `kick_drift`,
such that the displacement of the step is h times the row's velocity, and their acceleration such that velocity + h/2
acceleration is the velocity at the end of the step (read by dashpots only). It adds the distance that these rows may have
moved beyond the others with `moved(system, distance)`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from particles.contacts import pair_forces
from particles.neighbours import largest_distance
from particles.system import (
    EXTERNAL,
    FAST,
    GRAVITY,
    HELD,
    LOCAL_DAMPING,
    MASS_DAMPING,
    PLATE_UX,
    PLATE_UY,
    POWER,
    SMALLEST_RADIUS,
    TIME,
    TRAVEL,
    TRAVEL_LIMIT,
    VISCOUS,
)  # fmt: skip
from particles.walls import move_plates, wall_forces

FINISHED, STALE, UNSTABLE = 0, 1, 2
CHECK_INTERVAL = 32  # steps between two looks for blow-up


class Unstable(RuntimeError):
    """The particles have blown up: one of them moves by more than a radius in one step, or is not finite."""


@njit(cache=True)
def _damped(force, inverse_mass, velocity, mass_damping, local_damping, step):
    """Acceleration with damping (M9: mass damping at the end of the step; local damping against the velocity)."""
    total = force
    if local_damping is not None:
        total -= local_damping * abs(force) * np.sign(velocity)
    total *= inverse_mass
    if mass_damping is None:
        return total
    return (total - mass_damping * velocity) / (1.0 + 0.5 * mass_damping * step)


@njit(cache=True, fastmath={"contract", "arcp", "nsz"})
def _mass_loss(mass_damping, mass, inertia, vx, vy, spin, wx, wy, wz):
    """Power of mass damping at one level (W): c v M w, v there and w the mean velocity around it."""
    if mass_damping is None:
        return 0.0
    return mass_damping * (mass * (vx * wx + vy * wy) + inertia * spin * wz)


@njit(cache=True, fastmath={"contract", "arcp", "nsz"})
def _local_loss(local_damping, force, i, bx, by, bz, wx, wy, wz):
    """Power of local damping at one level (W): alpha |F| sgn(v before) w."""
    if local_damping is None:
        return 0.0
    total = abs(force[i, 0]) * np.sign(bx) * wx + abs(force[i, 1]) * np.sign(by) * wy
    return local_damping * (total + abs(force[i, 2]) * np.sign(bz) * wz)


@njit(cache=True, fastmath={"contract", "arcp", "nsz"})
def _drift(state, acceleration, force, sums, gravity, external, mass_damping, local_damping, step):
    fastest = 0.0
    mass_loss = 0.0
    local_loss = 0.0
    half = 0.5 * step
    for i in range(state.shape[0]):
        mass = 1.0 / state[i, 6]
        inertia = 0.5 * mass * state[i, 5] * state[i, 5]
        bx = state[i, 2]
        by = state[i, 3]
        bz = state[i, 4]
        vx = bx + half * acceleration[i, 0]
        vy = by + half * acceleration[i, 1]
        spin = bz + half * acceleration[i, 2]
        mass_loss += _mass_loss(mass_damping, mass, inertia, bx, by, bz, vx, vy, spin)
        local_loss += _local_loss(local_damping, force, i, bx, by, bz, vx, vy, spin)
        _load_work(sums, i, vx, vy, spin, mass, gravity, external, step)
        state[i, 0] += step * vx
        state[i, 1] += step * vy
        state[i, 7] += step * spin
        state[i, 2] = vx
        state[i, 3] = vy
        state[i, 4] = spin
        fastest = max(fastest, vx * vx + vy * vy)
    sums[MASS_DAMPING] += half * mass_loss
    sums[LOCAL_DAMPING] += half * local_loss
    return fastest


@njit(cache=True, fastmath={"contract", "arcp", "nsz"})
def _load_work(sums, i, vx, vy, spin, mass, gravity, external, step):
    """Book the work of gravity and external forces over the displacement of a step."""
    if gravity is not None:
        sums[GRAVITY] += step * mass * (gravity[0] * vx + gravity[1] * vy)
    if external is not None:
        sums[EXTERNAL] += step * (external[i, 0] * vx + external[i, 1] * vy + external[i, 2] * spin)


@njit(cache=True, fastmath={"contract", "arcp", "nsz"})
def _kick(state, acceleration, force, sums, gravity, external, mass_damping, local_damping, step, move):
    """New accelerations; velocities to the end of the step, or (move = 1) on to the middle of the next, and drift."""
    fastest = 0.0
    mass_loss = 0.0
    local_loss = 0.0
    half = 0.5 * step
    onward = half + move * half
    moved = move * step
    weight = half + move * half
    for i in range(state.shape[0]):
        inverse_mass = state[i, 6]
        radius = state[i, 5]
        inverse_inertia = 2.0 * inverse_mass / (radius * radius)
        vx = state[i, 2]
        vy = state[i, 3]
        spin = state[i, 4]
        ax = _damped(force[i, 0], inverse_mass, vx, mass_damping, local_damping, step)
        ay = _damped(force[i, 1], inverse_mass, vy, mass_damping, local_damping, step)
        az = _damped(force[i, 2], inverse_inertia, spin, mass_damping, local_damping, step)
        acceleration[i, 0] = ax
        acceleration[i, 1] = ay
        acceleration[i, 2] = az
        mass = 1.0 / inverse_mass
        ex = vx + half * ax
        ey = vy + half * ay
        ez = spin + half * az
        # the mean velocity around this level: its own, or at the end of a run that of the half step before
        wx = ex if move == 1 else vx
        wy = ey if move == 1 else vy
        wz = ez if move == 1 else spin
        mass_loss += _mass_loss(mass_damping, mass, 0.5 * mass * radius * radius, ex, ey, ez, wx, wy, wz)
        local_loss += _local_loss(local_damping, force, i, vx, vy, spin, wx, wy, wz)
        vx += onward * ax
        vy += onward * ay
        spin += onward * az
        state[i, 2] = vx
        state[i, 3] = vy
        state[i, 4] = spin
        state[i, 0] += moved * vx
        state[i, 1] += moved * vy
        state[i, 7] += moved * spin
        if move == 1:
            _load_work(sums, i, vx, vy, spin, mass, gravity, external, step)
        fastest = max(fastest, vx * vx + vy * vy)
    sums[MASS_DAMPING] += weight * mass_loss
    sums[LOCAL_DAMPING] += weight * local_loss
    return fastest


@njit(cache=True)
def _suspend(held, state, force):
    """Take held components out of a loop over all rows: no velocity, no force."""
    if held is not None:
        for k in range(held.row.size):
            i = held.row[k]
            for c in range(3):
                held.velocity[k, c] = state[i, 2 + c]
                held.force[k, c] = force[i, c]
                state[i, 2 + c] *= held.free[k, c]
                force[i, c] *= held.free[k, c]


@njit(cache=True)
def _restore(held, state, acceleration, force, sums, weight, step):
    """Give held components their velocity back and move them by `step` s; largest speed squared among them."""
    fastest = 0.0
    if held is not None:
        for k in range(held.row.size):
            i = held.row[k]
            for c in range(3):
                force[i, c] = held.force[k, c]
                if held.free[k, c] == 0.0:
                    state[i, 2 + c] = held.velocity[k, c]
                    state[i, c if c < 2 else 7] += step * held.velocity[k, c]
                    acceleration[i, c] = 0.0
                    sums[HELD] -= weight * held.force[k, c] * held.velocity[k, c]
            fastest = max(fastest, state[i, 2] ** 2 + state[i, 3] ** 2)
    return fastest


@njit(cache=True)
def drift(system, terms, step):
    """First half kick and drift: velocities to the middle of the step, positions and plates to its end."""
    _suspend(system.held, system.state, system.force)
    fastest = _drift(
        system.state, system.acceleration, system.force, system.sums, terms.gravity, system.external,
        terms.mass_damping, terms.local_damping, step,
    )  # fmt: skip
    _arrive(system, fastest, step, 0.5 * step)


@njit(cache=True)
def kick_drift(system, terms, step):
    """After `evaluate`: accelerations, velocities on to the middle of the next step, positions and plates to its end."""
    _suspend(system.held, system.state, system.force)
    fastest = _kick(
        system.state, system.acceleration, system.force, system.sums, terms.gravity, system.external,
        terms.mass_damping, terms.local_damping, step, 1,
    )  # fmt: skip
    _arrive(system, fastest, step, step)


@njit(cache=True)
def _arrive(system, fastest, step, weight):
    held = _restore(system.held, system.state, system.acceleration, system.force, system.sums, weight, step)
    plates = move_plates(system.walls, step)
    system.clock[TRAVEL] += step * max(math.sqrt(max(fastest, held)), plates)
    system.clock[TIME] += step


@njit(cache=True)
def kick(system, terms, step):
    """After the last `evaluate`: accelerations, velocities to the end of the step. With step = 0: accelerations only."""
    _suspend(system.held, system.state, system.force)
    _kick(
        system.state, system.acceleration, system.force, system.sums, terms.gravity, system.external,
        terms.mass_damping, terms.local_damping, step, 0,
    )  # fmt: skip
    _restore(system.held, system.state, system.acceleration, system.force, system.sums, 0.5 * step, 0.0)


@njit(cache=True, fastmath=FAST)
def _load(force, state, gravity, external):
    """Set the forces (n, 3) to the loads: gravity and the caller's external forces."""
    for i in range(force.shape[0]):
        fx = 0.0
        fy = 0.0
        moment = 0.0
        if gravity is not None:
            fx += gravity[0] / state[i, 6]
            fy += gravity[1] / state[i, 6]
        if external is not None:
            fx += external[i, 0]
            fy += external[i, 1]
            moment += external[i, 2]
        force[i, 0] = fx
        force[i, 1] = fy
        force[i, 2] = moment


@njit(cache=True)
def evaluate(system, terms, step):
    """Forces (loads, pair contacts, plates) at the present positions; histories advance by the step just moved.

    Row velocities must be those of the middle of the step (step times velocity = displacement since the last evaluation).
    """
    sums = system.sums
    power = sums[POWER]
    sums[POWER] = 0.0
    _load(system.force, system.state, terms.gravity, system.external)
    pair_forces(
        system.force, system.history, sums, system.state, system.acceleration, system.start, system.neighbour,
        system.material, terms.law, terms.table, step,
    )  # fmt: skip
    wall_forces(system.force, sums, system.state, system.acceleration, system.material, terms.law, system.walls, step)
    sums[VISCOUS] += 0.5 * step * (power + sums[POWER])


@njit(cache=True)
def moved(system, distance):
    """Tell the list that some rows may have moved by `distance` (m) more than the loops know."""
    system.clock[TRAVEL] += distance


@njit(cache=True)
def _plates_travel(walls):
    if walls is None:
        return 0.0
    largest = 0.0
    for k in range(walls.plates.shape[0]):
        dx = walls.plates[k, PLATE_UX] - walls.listed[k, 0]
        dy = walls.plates[k, PLATE_UY] - walls.listed[k, 1]
        largest = max(largest, math.hypot(dx, dy))
    return largest


@njit(cache=True)
def stale(system):
    """Whether the list must be rebuilt before the next `evaluate`: something moved by more than half the skin.

    The sum of largest speeds is looked at first, the true displacements only when that sum exceeds the limit.
    """
    clock = system.clock
    if clock[TRAVEL] <= clock[TRAVEL_LIMIT]:
        return False
    clock[TRAVEL] = max(largest_distance(system.state, system.listed), _plates_travel(system.walls))
    return not clock[TRAVEL] <= clock[TRAVEL_LIMIT]


@njit(cache=True)
def runaway(system, step):
    """Row of a disc that moves by more than the smallest radius in a step, or is not finite; -1 if there is none."""
    state = system.state
    limit = system.clock[SMALLEST_RADIUS] ** 2
    for i in range(state.shape[0]):
        surface = state[i, 4] * state[i, 5]
        distance = step * step * (state[i, 2] * state[i, 2] + state[i, 3] * state[i, 3] + surface * surface)
        if not (distance <= limit and abs(state[i, 0] + state[i, 1] + state[i, 7]) < 1e300):
            return i
    return -1


@njit(cache=True)
def advance(system, terms, steps, step, resume):
    """Make `steps` steps of size `step` (s).

    Returns:
        Steps done and FINISHED; or STALE (drifted, not evaluated: rebuild the list and resume with the steps that are
        left); or UNSTABLE.
    """
    if not resume:
        drift(system, terms, step)
    done = 0
    while True:
        if stale(system):
            return done, STALE
        evaluate(system, terms, step)
        done += 1
        if done == steps:
            kick(system, terms, step)
            return done, UNSTABLE if runaway(system, step) >= 0 else FINISHED
        if done % CHECK_INTERVAL == 0 and runaway(system, step) >= 0:
            return done, UNSTABLE
        kick_drift(system, terms, step)
