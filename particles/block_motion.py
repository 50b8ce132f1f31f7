"""Motion of a block of rows in one step, with damping and what it takes, as flat lists of numbers.

Four numbers a row, as in `particles.system.System`; the same code for translations and, in space, rotations. What the scene
lacks is None. `flow` is the velocity of a deforming cell at each place: damping acts on the velocity beyond it.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from particles.system import CELL, INLINE, INNER, KERNEL, LOCAL_DAMPING, MASS_DAMPING, STEADY

TO_END, ONWARD = np.int64(0), np.int64(1)  # kick to the end of the step, or on to the middle of the next, and drift (`move`)
LEVEL = {**INLINE, "fastmath": STEADY}
SMOOTH = {**INNER, "fastmath": STEADY | {"reassoc"}, "error_model": "numpy"}  # sums may be taken in any order


@njit(**LEVEL)
def _speed(velocity, flow, lightness, e):
    """Velocity beyond that of a deforming cell (`flow`, None without one), which is what is damped; 0 where held."""
    if flow is not None:
        return velocity[e] - flow[e] if lightness[e] > 0.0 else 0.0
    return velocity[e] if lightness[e] > 0.0 else 0.0


@njit(**LEVEL)
def _pull(force, lightness, e):
    """Force on a free component."""
    return force[e] if lightness[e] > 0.0 else 0.0


@njit(**LEVEL)
def _mass(lightness, e):
    """Mass or inertia of a free component."""
    return 1.0 / lightness[e] if lightness[e] > 0.0 else 0.0


@njit(**SMOOTH)
def _accelerate(acceleration, force, lightness, velocity, flow, mass_damping, local_damping, step):
    """Acceleration with damping (M9: mass damping at the end of the step; local damping against the velocity)."""
    for e in range(acceleration.size):
        total, speed = force[e], _speed(velocity, flow, lightness, e)
        if local_damping is not None:
            total -= local_damping * abs(total) * np.sign(speed)
        total *= lightness[e]
        if mass_damping is not None:
            total = (total - mass_damping * speed) / (1.0 + 0.5 * mass_damping * step)
        acceleration[e] = total


@njit(**SMOOTH)
def _resist(acceleration, force, lightness, velocity, flow, vector, turning, mass_damping, step, plane):
    """Take local damping against the vectors of velocity and spin off new accelerations (Rojek & Onate 2007, eqs 25-26).

    -alpha |F| v / |v|, zero at rest; in the plane the third number of a row is the rotation, by itself (`turning`).
    """
    share = 1.0 if mass_damping is None else 1.0 / (1.0 + 0.5 * mass_damping * step)
    for e in range(0, velocity.size, 4):
        fx, fy, fz = _pull(force, lightness, e), _pull(force, lightness, e + 1), _pull(force, lightness, e + 2)
        vx, vy = _speed(velocity, flow, lightness, e), _speed(velocity, flow, lightness, e + 1)
        vz = _speed(velocity, flow, lightness, e + 2)
        if plane is not None:
            acceleration[e + 2] -= turning * abs(fz) * np.sign(vz) * lightness[e + 2] * share
            fz = vz = 0.0
        speed = math.sqrt(vx * vx + vy * vy + vz * vz)
        if speed > 0.0:
            size = vector * math.sqrt(fx * fx + fy * fy + fz * fz) / speed * share
            acceleration[e] -= size * vx * lightness[e]
            acceleration[e + 1] -= size * vy * lightness[e + 1]
            if plane is None:
                acceleration[e + 2] -= size * vz * lightness[e + 2]


@njit(**SMOOTH)
def _vector_loss(velocity, flow, acceleration, force, lightness, half, vector, turning, plane):
    """Sum of alpha |F| (v / |v|) . w: v before the level, w the mean velocity around it."""
    total = 0.0
    for e in range(0, velocity.size, 4):
        fx, fy, fz = _pull(force, lightness, e), _pull(force, lightness, e + 1), _pull(force, lightness, e + 2)
        vx, vy = _speed(velocity, flow, lightness, e), _speed(velocity, flow, lightness, e + 1)
        vz = _speed(velocity, flow, lightness, e + 2)
        ax, ay, az = acceleration[e], acceleration[e + 1], acceleration[e + 2]
        if plane is not None:
            total += turning * abs(fz) * np.sign(vz) * (vz + half * az)
            fz = vz = 0.0
        speed = math.sqrt(vx * vx + vy * vy + vz * vz)
        if speed > 0.0:
            along = vx * (vx + half * ax) + vy * (vy + half * ay) + vz * (vz + half * az)
            total += vector * math.sqrt(fx * fx + fy * fy + fz * fz) * along / speed
    return total


@njit(**SMOOTH)
def _mass_loss(velocity, flow, acceleration, lightness, half, move):
    """Sum of v M w: v at the level `half` after `velocity`, w the mean velocity around it (`velocity` at an end)."""
    total = 0.0
    for e in range(velocity.size):
        speed = _speed(velocity, flow, lightness, e)
        level = speed + half * acceleration[e]
        total += level * (level if move == ONWARD else speed) * _mass(lightness, e)
    return total


@njit(**SMOOTH)
def _start_loss(velocity, flow, acceleration, lightness, half):
    """The same at the start of a run: v is `velocity`, w that of the half step that follows."""
    total = 0.0
    for e in range(velocity.size):
        speed = _speed(velocity, flow, lightness, e)
        total += speed * (speed + half * acceleration[e]) * _mass(lightness, e)
    return total


@njit(**SMOOTH)
def _local_loss(velocity, flow, acceleration, force, lightness, half):
    """Sum of |F| sgn(v) w: v before the level, w the mean velocity around it."""
    total = 0.0
    for e in range(velocity.size):
        speed = _speed(velocity, flow, lightness, e)
        total += abs(force[e]) * np.sign(speed) * (speed + half * acceleration[e])
    return total


@njit(**SMOOTH)
def _carrying_power(flow, acceleration, force, lightness):
    """Power of the damping forces, m a - F, along the flow: what the deforming cell does by them."""
    total = 0.0
    if flow is not None:
        for e in range(force.size):
            total += flow[e] * (acceleration[e] * _mass(lightness, e) - _pull(force, lightness, e))
    return total


@njit(**INNER)
def set_flow(flow, position, cell, space):
    """Write the velocity of a deforming cell at the present places into `flow`."""
    if flow is not None:
        _flow_at(flow, position, cell.gradient, cell.anchor, space)


@njit(**INNER)
def _flow_at(flow, position, gradient, anchor, space):
    for i in range(flow.shape[0]):
        x, y = position[i, 0] - anchor[0, 0], position[i, 1] - anchor[0, 1]
        z = 0.0 if space is None else position[i, 2] - anchor[0, 2]
        flow[i, 0] = anchor[1, 0] + gradient[0, 0] * x + gradient[0, 1] * y + gradient[0, 2] * z
        flow[i, 1] = anchor[1, 1] + gradient[1, 1] * y + gradient[1, 2] * z
        flow[i, 2] = anchor[1, 2] + gradient[2, 2] * z


@njit(**SMOOTH)
def _add(values, factor, rates):
    """values += factor rates."""
    for e in range(values.size):
        values[e] += factor * rates[e]


@njit(**KERNEL)
def fastest_of(velocity, plane):
    """Largest speed squared among rows (n, 4); in the plane the third component is a spin."""
    fastest = 0.0
    for i in range(velocity.shape[0]):
        square = velocity[i, 0] * velocity[i, 0] + velocity[i, 1] * velocity[i, 1]
        if plane is None:
            square += velocity[i, 2] * velocity[i, 2]
        fastest = max(fastest, square)
    return fastest


@njit(**INNER)
def part_of(rows, a, b):
    """Rows a to b as a flat list of numbers; None stays None."""
    if rows is None:
        return None
    return rows[a:b].reshape(4 * (b - a))


@njit(**INNER)
def drift_rows(
    place, velocity, flow, acceleration, force, lightness, sums, mass_damping, local_damping, vector, turning, plane,
    step,
):
    """First half kick and drift of one kind of motion."""
    half = 0.5 * step
    if mass_damping is not None:
        sums[MASS_DAMPING] += half * mass_damping * _start_loss(velocity, flow, acceleration, lightness, half)
    if local_damping is not None:
        sums[LOCAL_DAMPING] += half * local_damping * _local_loss(velocity, flow, acceleration, force, lightness, half)
    if vector is not None:
        sums[LOCAL_DAMPING] += half * _vector_loss(velocity, flow, acceleration, force, lightness, half, vector, turning, plane)
    if mass_damping is not None or local_damping is not None or vector is not None:
        sums[CELL] += half * _carrying_power(flow, acceleration, force, lightness)
    _add(velocity, half, acceleration)
    _add(place, step, velocity)


@njit(**INNER)
def kick_rows(
    place, velocity, flow, acceleration, force, lightness, sums, mass_damping, local_damping, vector, turning, plane,
    step, move,
):
    """New accelerations; velocities to the end of the step, or (`move` = ONWARD) on to the middle of the next, and drift."""
    half = 0.5 * step
    onward = half + move * half
    _accelerate(acceleration, force, lightness, velocity, flow, mass_damping, local_damping, step)
    if vector is not None:
        _resist(acceleration, force, lightness, velocity, flow, vector, turning, mass_damping, step, plane)
    if mass_damping is not None:
        sums[MASS_DAMPING] += onward * mass_damping * _mass_loss(velocity, flow, acceleration, lightness, half, move)
    if local_damping is not None:
        sums[LOCAL_DAMPING] += onward * local_damping * _local_loss(velocity, flow, acceleration, force, lightness, move * half)
    if vector is not None:
        sums[LOCAL_DAMPING] += onward * _vector_loss(
            velocity, flow, acceleration, force, lightness, move * half, vector, turning, plane
        )
    if mass_damping is not None or local_damping is not None or vector is not None:
        sums[CELL] += onward * _carrying_power(flow, acceleration, force, lightness)
    _add(velocity, onward, acceleration)
    if move == ONWARD:
        _add(place, step, velocity)
