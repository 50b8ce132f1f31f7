"""Walls and tools as a driver script sees them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from particles.walls import shapes
from particles.walls.history import WallHistory, history_of
from particles.walls.motion import Free, Servo, fresh_body, kinetic, set_motion
from particles.walls.rows import (
    ACTION,
    DRIVEN,
    FRAME,
    GIVEN,
    LOAD,
    OWNER,
    PLACE,
    SMOOTH,
    SOLID,
    VELOCITY,
    WALL,
    WORK,
)  # fmt: skip
from particles.walls.shapes import Shape

Motion = Sequence[float] | np.ndarray | Callable[[float], Sequence[float]]
Spin = float | Sequence[float] | np.ndarray | Callable[[float], Any]


class Body:
    """Rigid motion of one or several walls: its row (a view of the assembly's once it has one) and prescribed velocities."""

    def __init__(self, centre: np.ndarray) -> None:
        self.row = fresh_body(centre)
        self.given: dict[str, Callable[[float], Any]] = {}  # functions of time
        self.taken = False  # by an assembly
        self.changed = True  # loads, since the accelerations were computed


class Wall:
    """Rigid wall of any shape (see `particles.walls.shapes`) with prescribed, controlled or free motion.

    Vectors have d = 2 or 3 components; rotations one in the plane, three in space.

    Args:
        shape: from `shapes.plane`, `polygon`, `polyline`, `box`, `mesh`, `read`, `cylinder`.
        velocity: of the centre (d,), m/s, or a function of time (s) that returns it.
        spin: angular velocity about the centre, rad/s, or a function of time.
        centre: (d,) that the wall turns about, m; it moves with the wall (default: mean of the vertices).
        motion: `Servo` or `Free`; None means as prescribed by `velocity` and `spin`.
        fixed_to: another wall: both are one rigid body, whose motion the other one says.
        law: contact law with the particles; None means that of the particles (of a particle with itself where there are
            several materials). A mapping {material id: law} gives one for each material.
        frictionless: no sliding and no rolling resistance.
        smooth: angle, degrees: of neighbouring faces that meet at less, only the nearest touches a particle, so that a
            drum made of many facets is round; a concave corner gives one contact a face.
        record: steps of `Assembly.advance` from one row of `history` to the next; 0 for none.
        name: shown in messages.

    Raises:
        ValueError: numbers that make no sense, a motion that does not go with `fixed_to`.
    """

    def __init__(
        self,
        shape: Shape,
        velocity: Motion | None = None,
        spin: Spin | None = None,
        centre: Sequence[float] | None = None,
        motion: Servo | Free | None = None,
        fixed_to: Wall | None = None,
        law: Any = None,
        frictionless: bool = False,
        smooth: float = 15.0,
        record: int = 0,
        name: str = "wall",
    ) -> None:
        if not isinstance(shape, Shape):
            raise ValueError(f"shape={shape!r} of {name} must come from particles.walls.shapes")
        self.shape, self.axes, self.name = shape, shape.axes, name
        self.law, self.frictionless = law, frictionless
        self.taken = False  # by an assembly
        self._rows: list[np.ndarray] = []
        self.record = record
        if not 0.0 <= smooth < 90.0:
            raise ValueError(f"smooth={smooth} of {name} must lie in [0, 90) (degrees)")
        if fixed_to is None:
            middle = shape.centre if centre is None else np.zeros(3)
            if centre is not None:
                middle[: self.axes] = self._vector("centre", centre, self.axes, "m")
            self._body = Body(middle)
            set_motion(self._body.row, motion, self.axes)
            self.velocity = np.zeros(self.axes) if velocity is None else velocity
            self.spin = np.zeros(2 * self.axes - 3) if spin is None else spin
        else:
            others = {"velocity": velocity, "spin": spin, "centre": centre, "motion": motion}
            for what, value in others.items():
                if value is not None:
                    raise ValueError(f"{what} of {name} is that of {fixed_to.name}, to which it is fixed: leave it out")
            if fixed_to.axes != self.axes:
                raise ValueError(f"{name} and {fixed_to.name} must both be walls in the plane, or both in space")
            self._body = fixed_to._body
        self._row = np.zeros(WALL)  # becomes a view of the assembly's walls
        self._row[SOLID], self._row[SMOOTH] = float(shape.solid), math.cos(math.radians(smooth))

    def _vector(self, what: str, value: Any, size: int, unit: str) -> np.ndarray:
        array = np.atleast_1d(np.asarray(value, dtype=float))
        if array.shape != (size,) or not np.isfinite(array).all():
            count = {1: "a finite number", 2: "two finite numbers", 3: "three finite numbers"}[size]
            raise ValueError(f"{what}={value!r} of {self.name} must be {count} ({unit})")
        return array

    def _moment_part(self, place: int | np.integer) -> slice:
        """Rotational components after the three translations from `place` on: one in the plane, three in space."""
        return slice(place + 5, place + 6) if self.axes == 2 else slice(place + 3, place + 6)

    # Motion ------------------------------------------------------------------------------------------------------------

    def _prescribe(self, what: str, value: Any, part: slice, unit: str) -> None:
        body = self._body
        size = part.stop - part.start
        before = kinetic(body.row[None])
        if callable(value):
            body.given[what] = lambda time: self._vector(f"{what} at {time:g} s", value(time), size, unit)
            body.row[part] = body.given[what](0.0)
        else:
            body.row[part] = self._vector(what, value, size, unit)
            body.given.pop(what, None)
        body.row[DRIVEN] = float(bool(body.given))
        body.row[GIVEN] += kinetic(body.row[None]) - before

    @property
    def velocity(self) -> np.ndarray:
        """Present velocity of the centre (d,), m/s; assign numbers or a function of time."""
        return self._body.row[VELOCITY : VELOCITY + self.axes].copy()

    @velocity.setter
    def velocity(self, value: Motion) -> None:
        self._prescribe("velocity", value, slice(VELOCITY, VELOCITY + self.axes), "m/s")

    @property
    def spin(self) -> Any:
        """Present angular velocity, rad/s, a number or (3,); assign numbers or a function of time."""
        return self._number_or_vector(self._moment_part(VELOCITY))

    @spin.setter
    def spin(self, value: Spin) -> None:
        self._prescribe("spin", value, self._moment_part(VELOCITY), "rad/s")

    def _number_or_vector(self, part: slice) -> Any:
        found = self._body.row[part].copy()
        return float(found[0]) if self.axes == 2 else found

    @property
    def is_driven(self) -> bool:
        """Whether a velocity is a function of time."""
        return bool(self._body.given)

    @property
    def load(self) -> np.ndarray:
        """Constant force and moment on the wall (3,) or (6,), N and N m; what a servo aims at. May be assigned."""
        row = self._body.row
        return np.concatenate([row[LOAD : LOAD + self.axes], row[self._moment_part(LOAD)]])

    @load.setter
    def load(self, values: Any) -> None:
        values = self._vector_of_load(values)
        self._body.row[LOAD : LOAD + self.axes] = values[: self.axes]
        self._body.row[self._moment_part(LOAD)] = values[self.axes :]
        self._body.changed = True

    def _vector_of_load(self, values: Any) -> np.ndarray:
        array = np.asarray(values, dtype=float)
        if array.shape != (3 * (self.axes - 1),) or not np.isfinite(array).all():
            raise ValueError(f"load={values!r} of {self.name} must be {3 * (self.axes - 1)} finite numbers (N, N m)")
        return array

    # Results -----------------------------------------------------------------------------------------------------------

    @property
    def centre(self) -> np.ndarray:
        """Present centre (d,), m."""
        return self.reference_point + self.displacement

    @property
    def reference_point(self) -> np.ndarray:
        """Centre at the start (d,), m."""
        return self._body.row[: self.axes].copy()

    @property
    def displacement(self) -> np.ndarray:
        """Displacement of the centre (d,) since the start, m."""
        return self._body.row[PLACE : PLACE + self.axes].copy()

    @property
    def rotation(self) -> np.ndarray:
        """Rotation matrix (d, d) from the start to now."""
        return self._body.row[FRAME : FRAME + 9].reshape(3, 3)[: self.axes, : self.axes].copy()

    @property
    def vertices(self) -> np.ndarray:
        """Present places of the shape's vertices (v, d), m."""
        return (self.shape.vertices[:, : self.axes] - self.reference_point) @ self.rotation.T + self.centre

    @property
    def force(self) -> np.ndarray:
        """Reaction on the wall (3,) or (6,): force (N) and moment about its centre (N m), last evaluation."""
        return np.concatenate([self._row[ACTION : ACTION + self.axes], self._row[self._moment_part(ACTION)]])

    @property
    def work(self) -> float:
        """Work done on the particles by the wall's motion, J."""
        return float(self._row[WORK])

    @property
    def record(self) -> int:
        """Steps of `Assembly.advance` from one row of `history` to the next, counted from the assignment; 0 for none."""
        return self._record

    @record.setter
    def record(self, steps: int) -> None:
        if int(steps) != steps or steps < 0:
            raise ValueError(f"record={steps} of {self.name} must be a whole number of steps, or 0 for none")
        self._record = self.until_record = int(steps)

    @property
    def history(self) -> WallHistory:
        """What `record` has written down so far: time, force, moment, position, rotation, work."""
        return history_of(self._rows, self.reference_point)

    # For the assembly --------------------------------------------------------------------------------------------------

    @property
    def body_taken(self) -> bool:
        """Whether the rigid body belongs to an assembly."""
        return self._body.taken

    @property
    def owner(self) -> int:
        """Row of the body in the assembly."""
        return int(self._row[OWNER])

    def keep_records(self, rows: np.ndarray, until: int) -> None:
        """Add rows of the history; the next one follows after `until` steps."""
        self._rows.append(rows)
        self.until_record = until

    @property
    def is_plane(self) -> bool:
        """Whether the wall is one infinite plane."""
        return bool((self.shape.corners[:, 1] < 0).all())

    def is_fixed_to(self, other: Wall) -> bool:
        """Whether both are one rigid body."""
        return self._body is other._body

    def has_new_load(self) -> bool:
        """Whether the load was assigned since this was last asked."""
        changed, self._body.changed = self._body.changed, False
        return changed

    def prescribed(self, times: np.ndarray) -> np.ndarray:
        """Velocities and spins (k, 6) in three components each at times (k,), s; those of now where they are constant."""
        found = np.tile(self._body.row[VELOCITY : VELOCITY + 6], (times.size, 1))
        places = {"velocity": slice(0, self.axes), "spin": self._moment_part(0)}
        for what, function in self._body.given.items():
            found[:, places[what]] = [function(time) for time in times]
        return found

    def laws(self, laws: dict[tuple[int, int], Any], materials: int) -> list[Any]:
        """Law of the wall against each material of the particles."""
        found = []
        for material in range(materials):
            law = self.law[material] if isinstance(self.law, dict) else self.law
            law = law or laws[material, material]
            found.append(law.without_friction() if self.frictionless else law)
        return found

    def attach(self, row: np.ndarray, body: np.ndarray, owner: int) -> None:
        """Work on these rows of an assembly from now on."""
        row[OWNER] = owner
        self._row, self._body.row = row, body
        self.taken = self._body.taken = True


class Plate(Wall):
    """Rigid convex plate in the plane: a solid polygon.

    Args:
        corners: (k, 2) convex polygon, counter-clockwise (m).
        velocity, law, frictionless, name, options: those of `Wall`.

    Raises:
        ValueError: the corners are no convex counter-clockwise polygon, or what `Wall` raises.
    """

    def __init__(
        self, corners: Any, velocity: Motion | None = None, law: Any = None, frictionless: bool = False, name: str = "plate",
        **options: Any,
    ) -> None:  # fmt: skip
        shape = shapes.polygon(corners)
        self.corners = shape.vertices[:, :2].copy()
        edges = np.roll(self.corners, -1, axis=0) - self.corners
        following = np.roll(edges, -1, axis=0)
        if not (edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0] > 0.0).all():
            raise ValueError(
                "corners must be those of a convex polygon in counter-clockwise order, no three in a line; for other shapes "
                "take Wall(shapes.polygon(corners))"
            )
        super().__init__(shape, velocity, law=law, frictionless=frictionless, name=name, **options)

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


def room(lower: Sequence[float], upper: Sequence[float], **options: Any) -> list[Wall]:
    """Infinite planes around a box, facing inwards: low and high x, y and (in space) z, in this order."""
    low, high = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    if low.shape != high.shape or low.size not in (2, 3) or not (low < high).all():
        raise ValueError(f"lower={tuple(lower)} must be less than upper={tuple(upper)} in every component")
    walls = []
    for k, letter in enumerate("xyz"[: low.size]):
        for side, place, sign in (("low", low, 1.0), ("high", high, -1.0)):
            name = f"{side} {letter}"
            walls.append(Wall(shapes.plane(tuple(place), tuple(sign * np.eye(low.size)[k])), name=name, **options))
    return walls
