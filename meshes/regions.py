"""Regions in two and three dimensions: where things are. Combine them with `|` (either), `&` (both), `-` (without)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

RELATIVE_TOLERANCE = 1e-9  # a point this close to the edge, relative to the region's size, counts as inside


AXES = {2: "(x, y)", 3: "(x, y, z)"}


def _points(points, axes: int) -> np.ndarray:
    """Points as an (n, axes) array of floats; further columns are left out."""
    array = np.asarray(points, dtype=float)
    if array.ndim == 1 and array.size == 0:
        array = array.reshape(0, axes)
    if array.ndim != 2 or array.shape[1] < axes:
        raise ValueError(f"points of shape {array.shape} must have the shape (n, {axes})")
    return array[:, :axes]


def _vector(name: str, value, axes: tuple[int, ...] = (2, 3)) -> tuple[float, ...]:
    """Two or three finite numbers, or a ValueError that names the argument."""
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        array = np.zeros(0)
    if array.shape not in [(n,) for n in axes] or not np.all(np.isfinite(array)):
        names = " or ".join(f"{('two', 'three')[n - 2]} finite numbers {AXES[n]}" for n in axes)
        raise ValueError(f"{name}={value} must be {names} in m")
    return tuple(float(c) for c in array)


def _positive(name: str, value: float) -> None:
    if not (np.isfinite(value) and value > 0):
        raise ValueError(f"{name}={value} must be positive (m)")


class Region:
    """Base of all regions; a region has `distance` (signed, m) and `bounds`."""

    def distance(self, points) -> np.ndarray:
        """Signed distance (n,) in m to the edge, negative inside.

        Exact for Box, Disc, HalfPlane and Cylinder; for combinations a bound of the distance with the right sign.
        """
        raise NotImplementedError

    @property
    def bounds(self) -> np.ndarray:
        """Bounding box ((x_min, y_min), (x_max, y_max)), in 3D with z, in m; infinite where the region is."""
        raise NotImplementedError

    @property
    def axes(self) -> int:
        """Number of dimensions, 2 or 3."""
        return self.bounds.shape[1]

    @property
    def size(self) -> float:
        """Largest finite extent of the bounding box (m); 1 where none is finite."""
        extent = self.bounds[1] - self.bounds[0]
        extent = extent[np.isfinite(extent)]
        return float(extent.max()) if len(extent) and extent.max() > 0 else 1.0

    @property
    def measure(self) -> float:
        """Area in m2 or volume in m3; for combinations from samples of the bounding box (about 0.1 % and 0.3 %)."""
        lower, upper = self.bounds
        if not np.all(np.isfinite([lower, upper])):
            return np.inf
        count = {2: 1024, 3: 160}[self.axes]
        ticks = [low + (np.arange(count) + 0.5) * (high - low) / count for low, high in zip(lower, upper)]
        slab = np.stack(np.meshgrid(*ticks[:-1], indexing="ij"), axis=-1).reshape(-1, self.axes - 1)
        levels = (np.column_stack((slab, np.full(len(slab), level))) for level in ticks[-1])
        inside = sum(int(np.count_nonzero(self.contains(points))) for points in levels)
        return float(np.prod(upper - lower)) * inside / count**self.axes

    @property
    def area(self) -> float:
        """Area of a plane region in m2."""
        if self.axes != 2:
            raise ValueError("area: a region in 3D has a volume; use `measure`")
        return self.measure

    def contains(self, points, tolerance: float | None = None) -> np.ndarray:
        """True (n,) where a point lies inside or on the edge.

        Args:
            points: (n, 2) or (n, 3) in m.
            tolerance: distance (m) beyond the edge that still counts; 1e-9 of the region's size by default.
        """
        return self.distance(points) <= (RELATIVE_TOLERANCE * self.size if tolerance is None else tolerance)

    def __or__(self, other: Region) -> Region:
        return Combined(self, other, "or")

    def __and__(self, other: Region) -> Region:
        return Combined(self, other, "and")

    def __sub__(self, other: Region) -> Region:
        return Combined(self, other, "without")


@dataclass(frozen=True)
class Box(Region):
    """Axis-parallel rectangle or cuboid from its lowest to its highest corner (m)."""

    lower: tuple[float, ...]
    upper: tuple[float, ...]

    def __post_init__(self):
        object.__setattr__(self, "lower", _vector("lower", self.lower))
        object.__setattr__(self, "upper", _vector("upper", self.upper, (len(self.lower),)))
        if not np.all(np.less(self.lower, self.upper)):
            raise ValueError(f"lower={self.lower} must lie below and left of upper={self.upper}")

    def distance(self, points) -> np.ndarray:
        """Signed distance (n,) in m to the edge, negative inside."""
        points = _points(points, len(self.lower))
        beyond = np.maximum(np.asarray(self.lower) - points, points - np.asarray(self.upper))
        return np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)

    @property
    def bounds(self) -> np.ndarray:
        """Lowest and highest corner, (2, axes) in m."""
        return np.array([self.lower, self.upper])

    @property
    def corners(self) -> np.ndarray:
        """Corners (4, 2) in m, counter-clockwise from the lower left; in 3D (8, 3), the lower four first."""
        (left, bottom), (right, top) = self.lower[:2], self.upper[:2]
        plane = np.array([(left, bottom), (right, bottom), (right, top), (left, top)])
        if self.axes == 2:
            return plane
        return np.concatenate([np.column_stack((plane, np.full(4, z))) for z in (self.lower[2], self.upper[2])])

    @property
    def measure(self) -> float:
        """Area in m2 or volume in m3."""
        return float(np.prod(self.bounds[1] - self.bounds[0]))


@dataclass(frozen=True)
class Disc(Region):
    """Disc or sphere (by the components of its centre) of a radius (m)."""

    centre: tuple[float, ...]
    radius: float

    def __post_init__(self):
        object.__setattr__(self, "centre", _vector("centre", self.centre))
        _positive("radius", self.radius)

    def distance(self, points) -> np.ndarray:
        """Signed distance (n,) in m to the edge, negative inside."""
        return np.linalg.norm(_points(points, len(self.centre)) - np.asarray(self.centre), axis=1) - self.radius

    @property
    def bounds(self) -> np.ndarray:
        """Lowest and highest corner of the bounding box, (2, axes) in m."""
        return np.array([np.subtract(self.centre, self.radius), np.add(self.centre, self.radius)])

    @property
    def measure(self) -> float:
        """Area in m2 or volume in m3."""
        return float(np.pi * self.radius**2 if self.axes == 2 else 4.0 / 3.0 * np.pi * self.radius**3)


@dataclass(frozen=True)
class HalfPlane(Region):
    """All points on the side of a straight edge (in 3D of a plane) that its outward normal points away from."""

    point: tuple[float, ...]
    normal: tuple[float, ...]

    def __post_init__(self):
        object.__setattr__(self, "point", _vector("point", self.point))
        normal = np.array(_vector("normal", self.normal, (len(self.point),)))
        if not np.linalg.norm(normal) > 0:
            raise ValueError(f"normal={self.normal} must not be zero")
        object.__setattr__(self, "normal", tuple(float(c) for c in normal / np.linalg.norm(normal)))

    def distance(self, points) -> np.ndarray:
        """Signed distance (n,) in m to the edge, negative inside."""
        return (_points(points, len(self.point)) - np.asarray(self.point)) @ np.asarray(self.normal)

    @property
    def bounds(self) -> np.ndarray:
        """Bounding box (2, axes) in m; finite only where the edge is parallel to the axes."""
        bounds = np.array([np.full(len(self.point), -np.inf), np.full(len(self.point), np.inf)])
        axis = int(np.argmax(np.abs(self.normal)))
        if np.abs(np.delete(self.normal, axis)).max() < 1e-15:
            bounds[int(self.normal[axis] > 0), axis] = self.point[axis]
        return bounds


@dataclass(frozen=True)
class Cylinder(Region):
    """Circular cylinder in 3D with flat ends, from the centre of one end to that of the other, of a radius (m)."""

    start: tuple[float, ...]
    end: tuple[float, ...]
    radius: float

    def __post_init__(self):
        object.__setattr__(self, "start", _vector("start", self.start, (3,)))
        object.__setattr__(self, "end", _vector("end", self.end, (3,)))
        _positive("radius", self.radius)
        if self.start == self.end:
            raise ValueError(f"end={self.end} must differ from start={self.start}")

    @property
    def length(self) -> float:
        """Distance of the ends (m)."""
        return float(np.linalg.norm(np.subtract(self.end, self.start)))

    def distance(self, points) -> np.ndarray:
        """Signed distance (n,) in m to the surface, negative inside."""
        axis = np.subtract(self.end, self.start) / self.length
        arm = _points(points, 3) - np.asarray(self.start)
        along = arm @ axis
        across = np.linalg.norm(arm - along[:, None] * axis, axis=1)
        beyond = np.column_stack((across - self.radius, np.abs(along - 0.5 * self.length) - 0.5 * self.length))
        return np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)

    @property
    def bounds(self) -> np.ndarray:
        """Lowest and highest corner of the bounding box, (2, 3) in m."""
        axis = np.subtract(self.end, self.start) / self.length
        reach = self.radius * np.sqrt(np.maximum(1.0 - axis**2, 0.0))  # of a disc across the axis
        return np.array([np.minimum(self.start, self.end) - reach, np.maximum(self.start, self.end) + reach])

    @property
    def measure(self) -> float:
        """Volume in m3."""
        return float(np.pi * self.radius**2 * self.length)


Sphere, HalfSpace = Disc, HalfPlane  # the names in 3D


@dataclass(frozen=True)
class Combined(Region):
    """Two regions joined by "or" (either), "and" (both) or "without" (first, but not second)."""

    first: Region
    second: Region
    how: str

    def __post_init__(self):
        if self.first.axes != self.second.axes:
            raise ValueError(f"{self.first} and {self.second} must both be plane or both be in 3D to be combined")

    def distance(self, points) -> np.ndarray:
        """Signed bound (n,) of the distance in m, negative inside (exact sign; see `Region.distance`)."""
        first, second = self.first.distance(points), self.second.distance(points)
        if self.how == "or":
            return np.minimum(first, second)
        return np.maximum(first, second if self.how == "and" else -second)

    @property
    def bounds(self) -> np.ndarray:
        """Bounding box (2, axes) in m, not always the tightest."""
        first, second = self.first.bounds, self.second.bounds
        if self.how == "or":
            return np.array([np.minimum(first[0], second[0]), np.maximum(first[1], second[1])])
        if self.how == "and":
            return np.array([np.maximum(first[0], second[0]), np.minimum(first[1], second[1])])
        return first
