"""Explicit central difference (Li & Wan 2010, eqs 27-30) as building blocks for jitted loops.

A run of steps of size h is `drift`, then for every step `evaluate` and either `kick_drift` (more steps follow) or `kick`
(the last one). After `drift` and `kick_drift` positions are at the new time and row velocities at the middle of the step;
after `kick` both are at the same time. Between a drift and the evaluation that follows it the list may be stale: ask
`stale(system)`; if so, leave the jitted code, call `Assembly.refresh`, fetch the system anew and go on with `evaluate`.

A caller that moves some rows itself (ghosts) writes their position, rotation and velocity after `drift` or `kick_drift`,
such that the displacement of the step is h times the row's velocity, and their acceleration such that velocity + h/2
acceleration is the velocity at the end of the step (read by dashpots only). It adds the distance that these rows may have
moved beyond the others with `moved(system, distance)`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from particles.block_motion import ONWARD, TO_END, drift_rows, fastest_of, kick_rows, part_of, set_flow
from particles.cell import image_numbers, move_cell
from particles.columns import WIDTH
from particles.contacts import end_pairs, pair_batch, start_pairs
from particles.neighbours import ROOM, travelled
from particles.ranks import highest, receive, send
from particles.system import (
    AGE,
    CELL,
    CELL_POWER,
    EXTERNAL,
    GRAVITY,
    HELD,
    INNER,
    LEAST_SKIN,
    MASS,
    MERGED,
    MERGED_STEPS,
    POWER,
    RADIUS,
    SKIN_SCALE,
    SMALLEST_RADIUS,
    STEPS,
    TIME,
    TRAVEL,
    TRAVEL_LIMIT,
    VISCOUS,
)  # fmt: skip
from particles.vectors import in_plane
from particles.walls.contact import end_wall_forces, wall_forces
from particles.walls.history import record_walls
from particles.walls.motion import end_walls, move_walls, walls_travel

FINISHED, STALE, UNSTABLE = 0, 1, 2
EMPTY, WIDE, FITTING, WORN = range(4)  # states of a list: of no particles, wider than needed, as it should be, used up
CHECK_INTERVAL = 32  # steps between two looks for blow-up
BLOCK = 256  # rows whose motion is advanced at a time, so that they stay in the fastest cache


class Unstable(RuntimeError):
    """The particles have blown up: one of them moves by more than a radius in one step, or is not finite."""


@njit(**MERGED)
def _drift(system, spin, terms, step):
    fastest = 0.0
    count = system.position.shape[0]
    set_flow(system.flow, system.position, system.cell, system.spin)
    for a in range(0, count, BLOCK):
        b = min(a + BLOCK, count)
        drift_rows(
            part_of(system.position, a, b), part_of(system.velocity, a, b), part_of(system.flow, a, b),
            part_of(system.acceleration, a, b), part_of(system.force, a, b),
            part_of(system.lightness, a, b),
            system.sums, terms.mass_damping, terms.local_damping, terms.vector_damping, terms.spin_damping,
            in_plane(system.spin), step,
        )  # fmt: skip
        if spin is not None:
            drift_rows(
                part_of(system.rotation, a, b), part_of(system.spin, a, b), None,
                part_of(system.angular, a, b), part_of(system.torque, a, b), part_of(system.nimbleness, a, b),
                system.sums, terms.mass_damping, terms.local_damping, terms.spin_damping, terms.spin_damping, None, step,
            )  # fmt: skip
        fastest = max(fastest, fastest_of(system.velocity[a:b], in_plane(system.spin)))
    _load_work(system.sums, system.velocity, system.spin, system.lightness, terms.gravity, system.external, step)
    return fastest


@njit(**MERGED)
def _kick_block(system, spin, terms, step, move, a, b):
    """Kick rows a to b, and drift with `move` = ONWARD; their largest speed squared."""
    kick_rows(
        part_of(system.position, a, b), part_of(system.velocity, a, b), part_of(system.flow, a, b),
        part_of(system.acceleration, a, b), part_of(system.force, a, b), part_of(system.lightness, a, b),
        system.sums, terms.mass_damping, terms.local_damping, terms.vector_damping, terms.spin_damping,
        in_plane(system.spin), step, move,
    )  # fmt: skip
    if spin is not None:
        kick_rows(
            part_of(system.rotation, a, b), part_of(system.spin, a, b), None,
            part_of(system.angular, a, b), part_of(system.torque, a, b), part_of(system.nimbleness, a, b),
            system.sums, terms.mass_damping, terms.local_damping, terms.spin_damping, terms.spin_damping, None, step, move,
        )  # fmt: skip
    return fastest_of(system.velocity[a:b], in_plane(system.spin))


@njit(**INNER)
def _load_work(sums, velocity, spin, lightness, gravity, external, step):
    """Book the work of gravity and external forces over the displacement of a step."""
    if gravity is not None:
        power = 0.0
        for i in range(velocity.shape[0]):
            along = gravity[0] * velocity[i, 0] + gravity[1] * velocity[i, 1]
            if spin is not None:
                along += gravity[2] * velocity[i, 2]
            power += along * lightness[i, MASS]
        sums[GRAVITY] += step * power
    if external is not None:
        power = 0.0
        for i in range(velocity.shape[0]):
            for c in range(3):
                power += external[i, c] * velocity[i, c]
                if spin is not None:
                    power += external[i, 3 + c] * spin[i, c]
        sums[EXTERNAL] += step * power


@njit(**INNER)
def _holders_power(held, velocity, force, first, k, last):
    """Power of what holds the rows below `last`, from the k-th held row on (they are in order); the number of the next."""
    power = 0.0
    if held is not None and velocity is not None:
        while k < held.row.size and held.row[k] < last:
            for c in range(3):
                if held.free[k, first + c] == 0.0:
                    power -= force[held.row[k], c] * velocity[held.row[k], c]
            k += 1
    return power, k


@njit(**MERGED)
def _book_held(system, weight, k, last):
    """Work of what holds components of the rows below `last` over a time `weight` (s), against the forces on them."""
    power, following = _holders_power(system.held, system.velocity, system.force, 0, k, last)
    system.sums[HELD] += weight * (power + _holders_power(system.held, system.spin, system.torque, 3, k, last)[0])
    return following


# ----------------------------------------------------------------------------------------------------- building blocks


@njit(**MERGED)
def drift(system, terms, step):
    """First half kick and drift: velocities to the middle of the step, positions and walls to its end."""
    fastest = _drift(system, system.spin, terms, step)
    _book_held(system, 0.5 * step, 0, system.position.shape[0])
    _arrive(system, fastest, step, 0.5 * step)


@njit(**MERGED)
def _end_kick(system, terms, fastest, step, move):
    """After all rows: works, walls, clock."""
    if move == ONWARD:
        _load_work(system.sums, system.velocity, system.spin, system.lightness, terms.gravity, system.external, step)
        _arrive(system, fastest, step, step)
    else:
        end_walls(system.walls, 0.5 * step)


@njit(**MERGED)
def kick_on(system, terms, step, move):
    """`kick` (`move` = TO_END) or `kick_drift` (ONWARD)."""
    fastest, held = 0.0, 0
    count = system.position.shape[0]
    set_flow(system.flow, system.position, system.cell, system.spin)
    for a in range(0, count, BLOCK):
        b = min(a + BLOCK, count)
        fastest = max(fastest, _kick_block(system, system.spin, terms, step, move, a, b))
        held = _book_held(system, 0.5 * step * (1 + move), held, b)
    _end_kick(system, terms, fastest, step, move)


@njit(**MERGED)
def kick_drift(system, terms, step):
    """After `evaluate`: accelerations, velocities on to the middle of the next step, positions and walls to its end."""
    kick_on(system, terms, step, ONWARD)


@njit(**MERGED)
def _arrive(system, fastest, step, weight):
    walls = move_walls(system.walls, step, weight)
    move_cell(system.cell, step)
    system.clock[TRAVEL] += step * max(math.sqrt(fastest), walls)
    system.clock[TIME] += step
    system.clock[AGE] += 1.0


@njit(**MERGED_STEPS)
def kick(system, terms, step):
    """After the last `evaluate`: accelerations, velocities to the end of the step. With step = 0: accelerations only."""
    kick_on(system, terms, step, TO_END)


@njit(**INNER)
def _load(force, torque, lightness, gravity, external, first, last):
    """Set forces and torques of some rows to the loads: gravity and the caller's external forces."""
    force[first:last] = 0.0
    if torque is not None:
        torque[first:last] = 0.0
    if gravity is not None:
        for i in range(first, last):
            force[i, 0] = gravity[0] * lightness[i, MASS]
            force[i, 1] = gravity[1] * lightness[i, MASS]
            if torque is not None:
                force[i, 2] = gravity[2] * lightness[i, MASS]
    if external is not None:
        for i in range(first, last):
            for c in range(3):
                force[i, c] += external[i, c]
                if torque is not None:
                    torque[i, c] += external[i, 3 + c]


@njit(**MERGED)
def _before_pairs(system, terms, step):
    """Walls of this rank; the powers of the last evaluation."""
    sums = system.sums
    powers = sums[POWER], sums[CELL_POWER]
    sums[POWER] = sums[CELL_POWER] = 0.0
    wall_forces(system, terms, step)
    start_pairs(system.scratch)
    return powers


@njit(**MERGED)
def _after_pairs(system, powers, step):
    """Book what dashpots and the cell did over the step just moved (trapezoidal)."""
    sums = system.sums
    end_pairs(system.scratch, sums)
    sums[VISCOUS] += 0.5 * step * (powers[0] + sums[POWER])
    sums[CELL] += 0.5 * step * (powers[1] + sums[CELL_POWER])


@njit(**MERGED)
def _border_pairs(border, terms, step):
    """Contacts with particles of other ranks, which have arrived; all batches are whole, so that both ranks get the same bits."""
    if border is not None:
        _all_pairs_of(border, terms, step)


@njit(**MERGED)
def _all_pairs_of(border, terms, step):
    sums = border.sums
    powers = sums[POWER], sums[CELL_POWER]
    sums[POWER] = sums[CELL_POWER] = 0.0
    start_pairs(border.scratch)
    image = image_numbers(border.cell)
    pairs = border.first.size - ROOM  # whole batches; a constant for their size would be compiled into slower code
    for at in range(0, pairs, WIDTH):
        pair_batch(border, terms, step, image, at, min(WIDTH, pairs - at))
    _after_pairs(border, powers, step)


@njit(**MERGED_STEPS)
def evaluate(system, terms, step, border, halo):
    """Forces (loads, walls, pair contacts) at the present positions; histories advance by the step just moved.

    Row velocities must be those of the middle of the step (step times velocity = displacement since the last evaluation).
    Contacts across the borders of this rank are in it (`border`, `halo`; both None on one rank, collective otherwise).
    """
    evaluate_pairs(system, terms, step, border, halo)
    end_wall_forces(system, terms, step, halo, None)


@njit(**MERGED)
def evaluate_pairs(system, terms, step, border, halo):
    """`evaluate` before `particles.walls.contact.end_wall_forces`, which may sum more than the reactions on walls.

    Messages are under way while the contacts within this rank are computed.
    """
    send(halo, border, terms.viscous)
    _load(system.force, system.torque, system.lightness, terms.gravity, system.external, 0, system.position.shape[0])
    powers = _before_pairs(system, terms, step)
    pairs, image = system.start[system.position.shape[0]], image_numbers(system.cell)
    for at in range(0, pairs, WIDTH):
        pair_batch(system, terms, step, image, at, min(WIDTH, pairs - at))
    receive(halo, border, terms.viscous)
    _border_pairs(border, terms, step)
    _after_pairs(system, powers, step)


@njit(**MERGED)
def _evaluate_and_kick(system, terms, step, move, border, halo):
    """`evaluate`, then `kick` or (`move` = ONWARD) `kick_drift`, each block of rows at once when its last pair is done.

    Pairs go by their first row and have the larger one second, so that nothing needs a row again after its own pairs. Most of
    the rows are still in the cache then: memory is gone through once a step, not twice. Forces and torques come set
    to the loads (`_load`), and with `move` = ONWARD they are left so.
    """
    send(halo, border, terms.viscous)
    powers = _before_pairs(system, terms, step)
    end_wall_forces(system, terms, step, halo, None)
    receive(halo, border, terms.viscous)
    _border_pairs(border, terms, step)
    record_walls(system.records, system.walls, system.clock[TIME])
    set_flow(system.flow, system.position, system.cell, system.spin)
    count = system.position.shape[0]
    pairs, image = system.start[count], image_numbers(system.cell)
    at, ready, done, held, fastest = 0, 0, 0, 0, 0.0
    while done < count:
        if at < pairs:
            pair_batch(system, terms, step, image, at, min(WIDTH, pairs - at))
            at += WIDTH
        while ready < count and system.start[ready + 1] <= at:
            ready += 1
        while ready - done >= BLOCK or (ready == count and done < count):
            to = min(done + BLOCK, ready)
            fastest = max(fastest, _kick_block(system, system.spin, terms, step, move, done, to))
            held = _book_held(system, 0.5 * step * (1 + move), held, to)
            if move == ONWARD:
                _load(system.force, system.torque, system.lightness, terms.gravity, system.external, done, to)
            done = to
    _after_pairs(system, powers, step)
    _end_kick(system, terms, fastest, step, move)


@njit(**MERGED)
def moved(system, distance):
    """Tell the list that some rows may have moved by `distance` (m) more than the loops know."""
    system.clock[TRAVEL] += distance


@njit(**MERGED_STEPS)
def stale(system):
    """Whether the list must be rebuilt before the next `evaluate`: something moved by more than half the skin.

    The sum of largest speeds is looked at first, the true displacements only when that sum exceeds the limit. A list that
    turns out, some steps on, to reach much farther than is needed is done with as well (see `fitting_skin`).
    """
    return done_with(system, None)


@njit(**MERGED_STEPS)
def done_with(system, halo):
    """`stale` for lists that all ranks make together (collective): one of them is used up, or all reach too far."""
    state = highest(halo, _state_of(system))
    return state == WORN or state == WIDE


@njit(**MERGED)
def _state_of(system):
    clock = system.clock
    if clock[TRAVEL] <= clock[TRAVEL_LIMIT]:
        age = clock[AGE]
        if age != 8.0 and age != 64.0 and age != 512.0:
            return FITTING
        if system.position.shape[0] == 0:
            return EMPTY
        return WIDE if fitting_skin(clock) < clock[TRAVEL_LIMIT] else FITTING  # half of the present one
    clock[TRAVEL] = max(travelled(system.position, system.listed, system.cell), walls_travel(system.walls))
    return FITTING if clock[TRAVEL] <= clock[TRAVEL_LIMIT] else WORN


@njit(**STEPS)
def fitting_skin(clock):
    """Skin (m) with which lists and pairs in a gap together cost least, at the speed since the list was built.

    With the way v of the fastest particle in a step a list lasts s / 2v steps; if it costs as much as c steps of a pair for
    each particle, and a skin s brings g s pairs in a gap, the sum is least for s^2 = 2 c v / g (2 c / g: `SKIN_SCALE`, m).
    At rest, and with a skin of the caller: infinite.
    """
    if clock[SKIN_SCALE] == 0.0 or clock[TRAVEL] == 0.0 or clock[AGE] == 0.0:
        return np.inf
    return max(clock[LEAST_SKIN], math.sqrt(clock[SKIN_SCALE] * clock[TRAVEL] / clock[AGE]))


@njit(**STEPS)
def runaway(system, step):
    """Row of a particle that moves by more than the smallest radius in a step, or is not finite; -1 if there is none."""
    return _runaway(system.position, system.velocity, system.spin, system.clock[SMALLEST_RADIUS] ** 2, step)


@njit(**INNER)
def _runaway(position, velocity, spin, limit, step):
    for i in range(position.shape[0]):
        square = velocity[i, 0] * velocity[i, 0] + velocity[i, 1] * velocity[i, 1]
        surface = velocity[i, 2] * velocity[i, 2]
        if spin is not None:
            square += surface
            surface = spin[i, 0] * spin[i, 0] + spin[i, 1] * spin[i, 1] + spin[i, 2] * spin[i, 2]
        distance = step * step * (square + surface * position[i, RADIUS] * position[i, RADIUS])
        if not (distance <= limit and abs(position[i, 0] + position[i, 1] + position[i, 2]) < 1e300):
            return i
    return -1


@njit(**STEPS)
def advance(system, terms, steps, step, resume, border, halo):
    """Make `steps` steps of size `step` (s); none of them: forces and accelerations of the present state.

    Args:
        border, halo: contacts with particles of other ranks and the way to them; None on one rank (collective otherwise).

    Returns:
        Steps done and FINISHED; or STALE (drifted, not evaluated: rebuild the list and resume with the steps that are
        left); or UNSTABLE.
    """
    size = step if steps > 0 else 0.0
    if steps > 0 and not resume:
        drift(system, terms, step)
    _load(system.force, system.torque, system.lightness, terms.gravity, system.external, 0, system.position.shape[0])
    done = 0
    while True:
        if steps > 0 and done_with(system, halo):
            return done, STALE
        done += 1
        _evaluate_and_kick(system, terms, size, TO_END if done >= steps else ONWARD, border, halo)
        if steps == 0:
            return 0, FINISHED
        if done == steps or done % CHECK_INTERVAL == 0:
            if highest(halo, UNSTABLE if runaway(system, step) >= 0 else FINISHED) == UNSTABLE:
                return done, UNSTABLE
        if done == steps:
            return done, FINISHED
