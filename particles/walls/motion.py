"""Motion of the rigid bodies that carry the walls: prescribed, servo-controlled, or free.

Explicit central difference in step with the particles (see `particles.motion`). A component of the motion is prescribed
(its velocity is a constant or a function of time), driven by a servo (its velocity follows the difference between the
wanted and the present force), or free (it accelerates by Newton's and Euler's equations).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba import njit

from particles.kinematics import tangent_ratio
from particles.system import INLINE, INNER, KERNEL, OUTER, WALLS, Walls
from particles.vectors import cross, dot, minus, moved, plus, scaled, store
from particles.walls.rows import (
    ACCELERATION,
    ACTION,
    AGENT,
    BODY,
    CAYLEY,
    CENTRE,
    DAMPING,
    DASHPOT,
    DRIVEN,
    EXTENT,
    FASTEST,
    FRAME,
    GAIN,
    INCREMENT,
    INERTIA,
    LIGHTNESS,
    LISTED,
    LOAD,
    NIMBLENESS,
    OWNER,
    PLACE,
    PREDICTED,
    STIFFNESS,
    TOUCHING,
    VELOCITY,
    WORK,
)  # fmt: skip


def _positive(name: str, value: Any, unit: str, zero: bool = False) -> float:
    number = float(value)
    if not (math.isfinite(number) and (number > 0.0 or (zero and number == 0.0))):
        raise ValueError(f"{name}={value} must be {'zero or ' if zero else ''}positive ({unit})")
    return number


@dataclass(frozen=True)
class Servo:
    """Velocity control of chosen components until the particles answer a wanted force.

    v = gain (F + F_wanted) / (h N k + N c) with the reaction F on the wall and N contacts of stiffness k and dashpot c (those
    of the stiffest contact when the run is prepared or a list is built), never above `fastest` (Itasca's PFC does the same).
    The error falls by a share of about the gain in each step where the contacts are all that gives way. Other components
    move as the wall's `velocity` and `spin` say.

    Args:
        force: {"x": N, ...}: load on the wall, which the reaction on it balances in the end.
        fastest: largest speed of each controlled component, m/s.
        gain: above 0, below 1.
    """

    force: Mapping[str, float]
    fastest: float
    gain: float = 0.5

    def __post_init__(self) -> None:
        if not self.force or set(self.force) - set("xyz") or not np.isfinite(list(self.force.values())).all():
            raise ValueError(f"force={dict(self.force)!r} must map letters x, y, z to finite numbers (N)")
        _positive("fastest", self.fastest, "m/s")
        if not 0.0 < self.gain < 1.0:
            raise ValueError(f"gain={self.gain} must lie in (0, 1)")

    @classmethod
    def confining(cls, direction: str, stress: float, area: float, fastest: float, gain: float = 0.5) -> Servo:
        """A wall that presses with a stress (Pa) on an area (m2; in the plane a length, m).

        Args:
            direction: the way it pushes, such as "-z".
        """
        sign, letter = (direction[:1], direction[1:]) if direction[:1] in ("+", "-") else ("+", direction)
        if letter not in ("x", "y", "z"):
            raise ValueError(f"direction={direction!r} must be an axis with a sign, such as '-z'")
        load = _positive("stress", stress, "Pa", zero=True) * _positive("area", area, "m2, in the plane m")
        return cls({letter: -load if sign == "-" else load}, fastest, gain)


@dataclass(frozen=True)
class Free:
    """A rigid body that moves by the forces on it: contacts, gravity of the run, a constant load, damping.

    Args:
        mass: kg (in the plane per metre of thickness).
        inertia: about the centre, kg m2: a number (in space: for all axes), in space also (3, 3) in reference axes; None
            with no "r" in `free`.
        free: letters of the components that are free ("r" = all rotations); others move as `velocity` and `spin` say.
            None: all that have an inertia.
        load: {"x": N, ..., "r": N m in the plane, or three numbers}: constant load.
        damping: c in 1/s: force -c m v, moment -c I w.
    """

    mass: float
    inertia: Any = None
    free: str | None = None
    load: Mapping[str, Any] = field(default_factory=dict)
    damping: float = 0.0

    def __post_init__(self) -> None:
        _positive("mass", self.mass, "kg")
        _positive("damping", self.damping, "1/s", zero=True)
        if self.free is not None and "r" in self.free and self.inertia is None:
            raise ValueError(f"free={self.free!r} lets the wall rotate: give its inertia (kg m2), or leave out the 'r'")


def checked_letters(name: str, letters: Any, axes: int, rotations: bool) -> None:
    """Raise ValueError for letters of axes that are not there."""
    allowed = "xyz"[:axes] + ("r" if rotations else "")
    if set(letters) - set(allowed):
        raise ValueError(f"{name}={''.join(letters)!r} must be made of the letters {', '.join(allowed)}")


def set_motion(body: np.ndarray, motion: Servo | Free | None, axes: int) -> None:
    """Write a motion into a body's row (BODY,)."""
    if isinstance(motion, Servo):
        checked_letters("force", motion.force, axes, rotations=False)
        for letter, force in motion.force.items():
            k = "xyz".index(letter)
            body[GAIN + k], body[LOAD + k] = motion.gain, force
        body[FASTEST] = motion.fastest
    elif isinstance(motion, Free):
        _set_free(body, motion, axes)
    elif motion is not None:
        raise ValueError(f"motion={motion!r} must be a Servo, a Free or None (prescribed velocity)")


def _set_free(body: np.ndarray, motion: Free, axes: int) -> None:
    letters = ("xyz"[:axes] + ("r" if motion.inertia is not None else "")) if motion.free is None else motion.free
    checked_letters("free", letters, axes, rotations=True)
    checked_letters("load", motion.load, axes, rotations=True)
    for k, letter in enumerate("xyz"):
        body[LIGHTNESS + k] = 1.0 / motion.mass if letter in letters else 0.0
        body[LOAD + k] = motion.load.get(letter, 0.0)
    moment = np.atleast_1d(np.asarray(motion.load.get("r", 0.0), dtype=float))
    body[LOAD + 6 - moment.size : LOAD + 6] = moment
    if not np.isfinite(body[LOAD : LOAD + 6]).all():
        raise ValueError(f"load={dict(motion.load)!r} must be finite numbers (N, N m)")
    if "r" in letters:
        inertia = np.asarray(motion.inertia, dtype=float)
        inertia = inertia * np.eye(3) if inertia.ndim == 0 else inertia
        if inertia.shape != (3, 3) or not np.allclose(inertia, inertia.T) or not (np.linalg.eigvalsh(inertia) > 0.0).all():
            raise ValueError(f"inertia={motion.inertia} must be a positive number or a symmetric positive (3, 3) tensor (kg m2)")
        inverse = np.linalg.inv(inertia)
        if axes == 2:
            inertia, inverse = np.diag([0.0, 0.0, inertia[2, 2]]), np.diag([0.0, 0.0, 1.0 / inertia[2, 2]])
        body[INERTIA : INERTIA + 9], body[NIMBLENESS : NIMBLENESS + 9] = inertia.ravel(), inverse.ravel()
    body[DAMPING] = motion.damping


def kinetic(body: np.ndarray) -> float:
    """Kinetic energy of the free components of all bodies (b, BODY), J."""
    light = body[:, LIGHTNESS : LIGHTNESS + 3]
    moving = light > 0.0
    velocity = body[:, VELOCITY : VELOCITY + 3]
    frame, inertia = body[:, FRAME : FRAME + 9].reshape(-1, 3, 3), body[:, INERTIA : INERTIA + 9].reshape(-1, 3, 3)
    spin = np.einsum("bji,bj->bi", frame, body[:, VELOCITY + 3 : VELOCITY + 6])
    twice = np.sum(velocity[moving] ** 2 / light[moving]) + np.einsum("bi,bij,bj->", spin, inertia, spin)
    return float(0.5 * twice)


def lightness_of(walls: Walls) -> np.ndarray:
    """One over the mass of each wall's body (walls,), 1/kg, as a contact sees it: the largest of all axes; 0 where prescribed."""
    owner = walls.wall[:, OWNER].astype(np.int64)
    found: np.ndarray = walls.body[owner, LIGHTNESS : LIGHTNESS + 3].max(axis=1)
    return found


def fresh_body(centre: np.ndarray) -> np.ndarray:
    """Row of a body at rest with its centre (3,) at the reference position."""
    body = np.zeros(BODY)
    body[CENTRE : CENTRE + 3] = centre
    body[FRAME : FRAME + 9] = np.eye(3).ravel()
    return body


# ------------------------------------------------------------------------------------------------------------ kernels


@njit(**INLINE)
def row_vector(rows, i, place):
    """Three numbers of row i from a place on."""
    return rows[i, place], rows[i, place + 1], rows[i, place + 2]


@njit(**INLINE)
def turned_by(cayley, vector):
    """(Q - 1) vector, Q the rotation with the Cayley vector tan(angle / 2) axis: without cancellation for small angles."""
    half = cross(cayley, vector)
    factor = 2.0 / (1.0 + dot(cayley, cayley))
    return moved(scaled(factor, half), factor, cross(cayley, half))


@njit(**INLINE)
def rotated(body, b, vector):
    """A vector of the reference position in the present axes of body b."""
    return (
        dot(row_vector(body, b, FRAME), vector), dot(row_vector(body, b, FRAME + 3), vector),
        dot(row_vector(body, b, FRAME + 6), vector),
    )  # fmt: skip


@njit(**INLINE)
def rotated_back(body, b, vector):
    x, y, z = vector
    return plus(
        plus(scaled(x, row_vector(body, b, FRAME)), scaled(y, row_vector(body, b, FRAME + 3))),
        scaled(z, row_vector(body, b, FRAME + 6)),
    )


@njit(**INLINE)
def to_reference(body, b, x):
    """Where a point that is now at x was in the reference position of body b."""
    centre = row_vector(body, b, CENTRE)
    return plus(centre, rotated_back(body, b, minus(x, plus(centre, row_vector(body, b, PLACE)))))


@njit(**INLINE)
def _product(body, b, place, vector):
    """Matrix in the body's row (by rows, from a place on) times vector."""
    return (
        dot(row_vector(body, b, place), vector), dot(row_vector(body, b, place + 3), vector),
        dot(row_vector(body, b, place + 6), vector),
    )  # fmt: skip


@njit(**KERNEL)
def book(body, wall, sums):
    """Half of the trapezoidal rule over the step just moved: works of walls on particles, of agents on bodies."""
    for k in range(wall.shape[0]):
        b = int(wall[k, OWNER])
        for c in range(6):
            wall[k, WORK] -= 0.5 * wall[k, ACTION + c] * body[b, INCREMENT + c]
    for b in range(body.shape[0]):
        for c in range(6):
            sums[WALLS] += 0.5 * body[b, AGENT + c] * body[b, INCREMENT + c]


@njit(**KERNEL)
def balance(body, wall, gravity, step):
    """Accelerations of the free components from the reactions just computed, and what the agents must do for the motion.

    The agents' force is that which the bodies' momentum takes minus the contacts' (for a prescribed component minus the
    reaction, for a free one its load, gravity and damping).
    """
    for b in range(body.shape[0]):
        damping = body[b, DAMPING]
        damper = 1.0 / (1.0 + 0.5 * damping * step)
        for c in range(6):
            body[b, AGENT + c] = 0.0
        for k in range(wall.shape[0]):
            if int(wall[k, OWNER]) == b:
                for c in range(6):
                    body[b, AGENT + c] -= wall[k, ACTION + c]
        for c in range(3):
            light = body[b, LIGHTNESS + c]
            if light > 0.0:
                pull = light * (body[b, LOAD + c] - body[b, AGENT + c])
                if gravity is not None:
                    pull += gravity[c]
                body[b, ACCELERATION + c] = damper * (pull - damping * body[b, VELOCITY + c])
                body[b, AGENT + c] += body[b, ACCELERATION + c] / light
        # Euler's equations in the axes of the body; without inertia nothing is added
        moment = minus(row_vector(body, b, LOAD + 3), row_vector(body, b, AGENT + 3))
        spin = rotated_back(body, b, row_vector(body, b, PREDICTED + 3))
        gyroscopic = cross(spin, _product(body, b, INERTIA, spin))
        pull = _product(body, b, NIMBLENESS, minus(rotated_back(body, b, moment), gyroscopic))
        if body[b, NIMBLENESS + 8] > 0.0:
            pull = scaled(damper, moved(pull, -damping, rotated_back(body, b, row_vector(body, b, VELOCITY + 3))))
        needed = rotated(body, b, plus(_product(body, b, INERTIA, pull), gyroscopic))
        store(body[b], ACCELERATION + 3, 1, rotated(body, b, pull))
        for c in range(3):
            body[b, AGENT + 3 + c] += needed[c]


@njit(**INNER)
def move_walls(walls, step, weight):
    """New velocities (accelerations act for the time `weight`) and one step of motion; largest speed of a point, m/s."""
    if walls is None:
        return 0.0
    return _move(walls.body, walls.wall, walls.drive, walls.drive_step, step, weight)


@njit(**KERNEL)
def _servo_speed(body, b, c, step):
    """Velocity of a controlled component; between two contacts and none the speed is limited only by `FASTEST`."""
    contacts = max(body[b, TOUCHING], 1.0)
    excess = body[b, LOAD + c] - body[b, AGENT + c]
    speed = body[b, GAIN + c] * excess / (contacts * (step * body[b, STIFFNESS] + body[b, DASHPOT]))
    return min(max(speed, -body[b, FASTEST]), body[b, FASTEST])


@njit(**KERNEL)
def _move(body, wall, drive, drive_step, step, weight):
    fastest = 0.0
    for b in range(body.shape[0]):
        for c in range(6):
            old = body[b, VELOCITY + c]
            new = old + weight * body[b, ACCELERATION + c]
            predicted = new + 0.5 * step * body[b, ACCELERATION + c]
            free = body[b, LIGHTNESS + c] > 0.0 if c < 3 else body[b, NIMBLENESS + 8] > 0.0
            if c < 3 and body[b, GAIN + c] > 0.0:
                new = _servo_speed(body, b, c, step)
                predicted = 1.5 * new - 0.5 * old
            elif drive is not None and not free and body[b, DRIVEN] > 0.0:
                row = min(drive_step[0], drive.shape[0] - 1)
                new, predicted = drive[row, b, c], drive[row, b, 6 + c]
            body[b, VELOCITY + c], body[b, PREDICTED + c] = new, predicted
            body[b, INCREMENT + c] = step * new
            body[b, PLACE + c] += step * new
        velocity, spin = row_vector(body, b, VELOCITY), row_vector(body, b, VELOCITY + 3)
        _turn_frame(body, b, row_vector(body, b, INCREMENT + 3))
        fastest = max(fastest, math.sqrt(dot(velocity, velocity)) + body[b, EXTENT] * math.sqrt(dot(spin, spin)))
    drive_step[0] += 1
    return fastest


@njit(**KERNEL)
def _turn_frame(body, b, turn):
    cayley = scaled(0.5 * tangent_ratio(0.25 * dot(turn, turn)), turn)
    store(body[b], CAYLEY, 1, cayley)
    for c in range(3):
        column = body[b, FRAME + c], body[b, FRAME + 3 + c], body[b, FRAME + 6 + c]
        store(body[b], FRAME + c, 3, plus(column, turned_by(cayley, column)))


@njit(**INNER)
def end_walls(walls, weight):
    """Velocities of free components on to the end of the step."""
    if walls is not None:
        for b in range(walls.body.shape[0]):
            for c in range(6):
                walls.body[b, VELOCITY + c] += weight * walls.body[b, ACCELERATION + c]


@njit(**OUTER)
def hold_walls(walls):
    """No increments of the bodies' motion, velocities as they are (for an evaluation at a held time)."""
    if walls is not None:
        for b in range(walls.body.shape[0]):
            for c in range(6):
                walls.body[b, INCREMENT + c] = 0.0
                walls.body[b, PREDICTED + c] = walls.body[b, VELOCITY + c]
            for c in range(3):
                walls.body[b, CAYLEY + c] = 0.0


@njit(**INNER)
def walls_travel(walls):
    """Largest distance (m) that a point of a wall may be from where it was when the list was built."""
    if walls is None:
        return 0.0
    largest = 0.0
    for b in range(walls.body.shape[0]):
        shift, turn = 0.0, 0.0
        for c in range(3):
            shift += (walls.body[b, PLACE + c] - walls.body[b, LISTED + c]) ** 2
        for c in range(9):
            turn += (walls.body[b, FRAME + c] - walls.body[b, LISTED + 3 + c]) ** 2
        # |R - R'| r <= |R - R'|_F r / sqrt(2) for rotations: both singular values are 2 sin(angle / 2)
        largest = max(largest, math.sqrt(shift) + math.sqrt(0.5 * turn) * walls.body[b, EXTENT])
    return largest
