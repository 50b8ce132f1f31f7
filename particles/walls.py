"""Rigid plates with prescribed motion: closest-point contact with faces and corners, reaction on the plate."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numba import njit

from particles.laws import LiChu
from particles.laws.touch import FLAT, Touch, respond, wall_law
from particles.system import (
    INNER,
    KERNEL,
    PLATE_DX,
    PLATE_DY,
    PLATE_FX,
    PLATE_FY,
    PLATE_MOMENT,
    PLATE_UX,
    PLATE_UY,
    PLATE_VX,
    PLATE_VY,
    PLATE_WORK,
    PLATE_X,
    PLATE_Y,
    RADIUS,
    SPENT,
    WALLS,
)  # fmt: skip
from particles.vectors import load, store

Velocity = Sequence[float] | np.ndarray | Callable[[float], Sequence[float]]


class Plate:
    """Rigid convex plate, moved as prescribed, in contact with discs by its faces and corners.

    Args:
        corners: (k, 2) convex polygon, counter-clockwise (m).
        velocity: (vx, vy) in m/s, or a function of time (s) that returns it (taken at the middle of each step).
        law: contact law with the discs; None means that of the discs (of a disc with itself where there are several
            materials). A mapping {material id: LiChu} gives one for each material.
        frictionless: no sliding and no rolling resistance.
        name: shown in messages.

    Raises:
        ValueError: the corners are no convex counter-clockwise polygon, or a velocity is not finite.
    """

    def __init__(
        self,
        corners: Any,
        velocity: Velocity = (0.0, 0.0),
        law: LiChu | dict[int, LiChu] | None = None,
        frictionless: bool = False,
        name: str = "plate",
    ) -> None:
        self.corners = np.array(corners, dtype=float)
        if self.corners.ndim != 2 or self.corners.shape[0] < 3 or self.corners.shape[1] != 2:
            raise ValueError(f"corners of shape {self.corners.shape} must have shape (k, 2) with k >= 3")
        if not np.isfinite(self.corners).all():
            raise ValueError("corners must be finite numbers (m)")
        edges = np.roll(self.corners, -1, axis=0) - self.corners
        following = np.roll(edges, -1, axis=0)
        turns = edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]
        if not (turns > 0.0).all():
            raise ValueError("corners must be those of a convex polygon in counter-clockwise order, no three in a line")
        self.law = law
        self.frictionless = frictionless
        self.name = name
        self.reference_point = self.corners.mean(axis=0)
        self.taken = False  # by an assembly
        self._row: np.ndarray = np.zeros(12)  # becomes a view of the assembly's plates
        self._row[PLATE_X : PLATE_Y + 1] = self.reference_point
        self._motion: Callable[[float], Sequence[float]] | None = None
        self.velocity = velocity

    @classmethod
    def rectangle(cls, lower: Sequence[float], upper: Sequence[float], **options: Any) -> Plate:
        """Plate with sides along the axes between two corners (floors, side walls, footings)."""
        (x0, y0), (x1, y1) = lower, upper
        if not (x0 < x1 and y0 < y1):
            raise ValueError(f"lower={tuple(lower)} must lie left of and below upper={tuple(upper)}")
        return cls([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], **options)

    @classmethod
    def box(cls, lower: Sequence[float], upper: Sequence[float], thickness: float, **options: Any) -> list[Plate]:
        """Floor, left and right wall and lid around a box, in this order; leave out what is not wanted."""
        (x0, y0), (x1, y1), t = lower, upper, thickness
        ends = [
            ((x0 - t, y0 - t), (x1 + t, y0)),
            ((x0 - t, y0), (x0, y1)),
            ((x1, y0), (x1 + t, y1)),
            ((x0 - t, y1), (x1 + t, y1 + t)),
        ]
        names = ["floor", "left wall", "right wall", "lid"]
        return [cls.rectangle(a, b, name=name, **options) for (a, b), name in zip(ends, names)]

    @property
    def velocity(self) -> np.ndarray:
        """Present velocity (2,), m/s; assign numbers or a function of time."""
        return self._row[PLATE_VX : PLATE_VY + 1].copy()

    @velocity.setter
    def velocity(self, velocity: Velocity) -> None:
        if callable(velocity):
            self._motion = velocity
            self._row[PLATE_VX : PLATE_VY + 1] = self.velocity_at(0.0)
        else:
            value = np.asarray(velocity, dtype=float)
            if value.shape != (2,) or not np.isfinite(value).all():
                raise ValueError(f"velocity={velocity!r} of {self.name} must be two finite numbers (m/s)")
            self._motion = None
            self._row[PLATE_VX : PLATE_VY + 1] = value

    def velocity_at(self, time: float) -> np.ndarray:
        """Prescribed velocity (2,) at a time (s)."""
        if self._motion is None:
            return self.velocity
        value = np.asarray(self._motion(time), dtype=float)
        if value.shape != (2,) or not np.isfinite(value).all():
            raise ValueError(f"velocity of {self.name} at {time:g} s must be two finite numbers (m/s), not {value}")
        return value

    @property
    def is_driven(self) -> bool:
        """Whether the velocity is a function of time."""
        return self._motion is not None

    @property
    def displacement(self) -> np.ndarray:
        """Displacement (2,) since the start, m."""
        return self._row[PLATE_UX : PLATE_UY + 1].copy()

    @property
    def force(self) -> np.ndarray:
        """Reaction on the plate (3,): force (N) and moment about its reference point (N m), last evaluation."""
        return self._row[PLATE_FX : PLATE_MOMENT + 1].copy()

    @property
    def work(self) -> float:
        """Work done on the particles by the plate's motion, J."""
        return float(self._row[PLATE_WORK])

    def laws(self, laws: dict[tuple[int, int], Any], materials: int) -> list[Any]:
        """Law of the plate against each material of the particles."""
        found = []
        for material in range(materials):
            law = self.law[material] if isinstance(self.law, dict) else self.law
            law = law or laws[material, material]
            found.append(law.without_friction() if self.frictionless else law)
        return found


@njit(cache=True)
def closest_point(corners, first, last, x, y):
    """Vector from (x, y) to the closest point of a convex polygon, signed distance, whether it is a corner.

    Inside the polygon the distance is negative and the vector points away from the nearest face, inwards.
    Returns the unit vector (nx, ny) from the point into the polygon, the distance (m) and the flag.
    """
    deepest = -1e300
    face_x = 0.0
    face_y = 0.0
    nearest = 1e300
    to_x = 0.0
    to_y = 0.0
    at_corner = False
    for k in range(first, last):
        following = k + 1 if k + 1 < last else first
        ax = corners[k, 0]
        ay = corners[k, 1]
        ex = corners[following, 0] - ax
        ey = corners[following, 1] - ay
        length = math.sqrt(ex * ex + ey * ey)
        outside = ((x - ax) * ey - (y - ay) * ex) / length
        if outside > deepest:
            deepest = outside
            face_x = -ey / length
            face_y = ex / length
        along = ((x - ax) * ex + (y - ay) * ey) / (length * length)
        share = min(1.0, max(0.0, along))
        px = ax + share * ex - x
        py = ay + share * ey - y
        square = px * px + py * py
        if square < nearest:
            nearest = square
            to_x = px
            to_y = py
            at_corner = along <= 0.0 or along >= 1.0
    if deepest <= 0.0 or nearest == 0.0:
        return face_x, face_y, deepest, False
    distance = math.sqrt(nearest)
    if not at_corner:
        return face_x, face_y, deepest, False
    return to_x / distance, to_y / distance, distance, True


@njit(**INNER)
def _book_plate(plates, k):
    """Half of the trapezoidal rule for the work of plate k on the particles over the step just moved."""
    plates[k, PLATE_WORK] -= 0.5 * (plates[k, PLATE_FX] * plates[k, PLATE_DX] + plates[k, PLATE_FY] * plates[k, PLATE_DY])


@njit(**KERNEL)
def _touch_of_plate(nx, ny, distance, corner, dx, dy, turn, rate, radius, mass):
    """Touch of a disc (i) and a plate (j) in the plane: lever arm and rolling radius are the distance.

    Args:
        nx, ny, distance: to the closest point of the plate.
        corner: whether that is a corner.
        dx, dy: displacement of the plate against the disc in the step, m; `turn` of the disc, rad.
        rate: relative velocity (x, y) of the plate and spin of the disc at the end of the step.
    """
    half = 0.5 * (dx * nx + dy * ny)
    mean = distance - half
    rx, ry, spin = rate
    if corner:
        bx, by = distance * nx, distance * ny
        ox, oy = bx - dx, by - dy
        mean = 0.5 * (distance + math.sqrt(ox * ox + oy * oy))
        slide = mean * (math.atan2(ox * by - oy * bx, ox * bx + oy * by) - turn)
    else:
        slide = dy * nx - dx * ny - mean * turn
    return Touch(
        radius - distance, rx * nx + ry * ny, (slide,), (ry * nx - rx * ny - distance * spin,), (turn,), (spin,), 0.0, 0.0,
        mean, distance, (nx, ny), distance, (radius, FLAT), mass, (),
    )  # fmt: skip


@njit(**INNER)
def _rates_of(predicted, i):
    if predicted is None:
        return 0.0, 0.0, 0.0
    return predicted[i, 0], predicted[i, 1], predicted[i, 2]


@njit(**INNER)
def _material_of(material, i):
    return 0 if material is None else material[i]


@njit(**INNER)
def wall_forces(system, terms, step):
    """Add plate contacts to the forces, set the reactions on the plates and book the plates' work.

    Each disc touches a plate at most once, at the plate's closest point. The plate's displacement increment of the step
    is that of its row (zero while it is held).
    """
    _plate_forces(system, system.walls, terms, step)


@njit(**INNER)
def _plate_forces(system, walls, terms, step):
    if walls is None:
        return
    plates, sums, position, velocity = walls.plates, system.sums, system.position, system.velocity
    stride = walls.history.shape[1]
    history = walls.history.reshape(walls.history.size)
    for k in range(plates.shape[0]):
        _book_plate(plates, k)
        plates[k, PLATE_FX] = 0.0
        plates[k, PLATE_FY] = 0.0
        plates[k, PLATE_MOMENT] = 0.0
    for contact in range(walls.row.size):
        i, k = walls.row[contact], walls.plate[contact]
        x = position[i, 0] - plates[k, PLATE_UX]
        y = position[i, 1] - plates[k, PLATE_UY]
        nx, ny, distance, corner = closest_point(walls.corners, walls.corner_start[k], walls.corner_start[k + 1], x, y)
        rx, ry, spin = _rates_of(system.predicted, i)
        touch = _touch_of_plate(
            nx, ny, distance, corner, plates[k, PLATE_DX] - step * velocity[i, 0], plates[k, PLATE_DY] - step * velocity[i, 1],
            step * velocity[i, 2], (plates[k, PLATE_VX] - rx, plates[k, PLATE_VY] - ry, spin), position[i, RADIUS],
            1.0 / system.lightness[i, 0],
        )  # fmt: skip
        law = wall_law(terms.law, walls.laws[k, _material_of(system.material, i)])
        response = respond(law, touch, load(history, contact, stride, terms.blank))
        store(history, contact, stride, response.history)
        for entry in range(SPENT):
            sums[entry] += response.spent[entry]
        normal, shear, couple = response.normal, response.tangential[0], response.couple[0]
        px = -normal * nx - shear * ny
        py = -normal * ny + shear * nx
        system.force[i, 0] += px
        system.force[i, 1] += py
        system.force[i, 2] += distance * shear + couple
        plates[k, PLATE_FX] -= px
        plates[k, PLATE_FY] -= py
        # contact point, from the plate's reference point
        cx = x + distance * nx - plates[k, PLATE_X]
        cy = y + distance * ny - plates[k, PLATE_Y]
        plates[k, PLATE_MOMENT] += cy * px - cx * py - couple
    total = 0.0
    for k in range(plates.shape[0]):
        _book_plate(plates, k)
        total += plates[k, PLATE_WORK]
    sums[WALLS] = total


@njit(**INNER)
def move_plates(walls, step):
    """Move the plates by one step (at the driven velocity where there is one); their largest speed, m/s."""
    if walls is None:
        return 0.0
    return _move_plates(walls.plates, walls.drive, walls.drive_step, step)


@njit(**INNER)
def _move_plates(plates, drive, drive_step, step):
    fastest = 0.0
    for k in range(plates.shape[0]):
        if drive is not None:
            row = min(drive_step[0], drive.shape[0] - 1)
            plates[k, PLATE_VX] = drive[row, k, 0]
            plates[k, PLATE_VY] = drive[row, k, 1]
        plates[k, PLATE_DX] = step * plates[k, PLATE_VX]
        plates[k, PLATE_DY] = step * plates[k, PLATE_VY]
        plates[k, PLATE_UX] += plates[k, PLATE_DX]
        plates[k, PLATE_UY] += plates[k, PLATE_DY]
        fastest = max(fastest, math.hypot(plates[k, PLATE_VX], plates[k, PLATE_VY]))
    drive_step[0] += 1
    return fastest


@njit(cache=True)
def hold_plates(walls):
    """Zero displacement increments of the plates (for an evaluation at a held time)."""
    if walls is not None:
        walls.plates[:, PLATE_DX] = 0.0
        walls.plates[:, PLATE_DY] = 0.0


@njit(cache=True)
def list_walls(position, plates, corner_start, corners, skin):
    """Discs within `skin` of a plate: rows and plates (int32), by plate and then row."""
    count = position.shape[0]
    near = np.zeros((plates.shape[0], count), dtype=np.bool_)
    for k in range(plates.shape[0]):
        first, last = corner_start[k], corner_start[k + 1]
        x0 = corners[first:last, 0].min() + plates[k, PLATE_UX]
        x1 = corners[first:last, 0].max() + plates[k, PLATE_UX]
        y0 = corners[first:last, 1].min() + plates[k, PLATE_UY]
        y1 = corners[first:last, 1].max() + plates[k, PLATE_UY]
        for i in range(count):
            reach = position[i, RADIUS] + skin
            x, y = position[i, 0], position[i, 1]
            if x < x0 - reach or x > x1 + reach or y < y0 - reach or y > y1 + reach:
                continue
            _, _, distance, _ = closest_point(corners, first, last, x - plates[k, PLATE_UX], y - plates[k, PLATE_UY])
            near[k, i] = distance < reach
    plate, row = np.nonzero(near)
    return row.astype(np.int32), plate.astype(np.int32)


@njit(cache=True)
def carry_wall_history(row, plate, history, old_row, old_plate, old_history, new_row_of):
    """Copy histories (columns, listed) of plate contacts from the old list; `new_row_of` maps old rows to new ones."""
    for k in range(plate.max() + 1 if plate.size else 0):
        where = np.full(new_row_of.size, -1, dtype=np.int32)
        for old in range(old_row.size):
            if old_plate[old] == k:
                where[new_row_of[old_row[old]]] = old
        for new in range(row.size):
            if plate[new] == k and where[row[new]] >= 0:
                history[:, new] = old_history[:, where[row[new]]]
