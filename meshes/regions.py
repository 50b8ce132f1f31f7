"""Plane regions: where things are. Combine them with `|` (either), `&` (both) and `-` (without)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

RELATIVE_TOLERANCE = 1e-9  # a point this close to the edge, relative to the region's size, counts as inside


def _points(points) -> np.ndarray:
    """Points as an (n, 2) array of floats."""
    array = np.asarray(points, dtype=float)
    if array.ndim == 1 and array.size == 0:
        array = array.reshape(0, 2)
    if array.ndim != 2 or array.shape[1] < 2:
        raise ValueError(f"points of shape {array.shape} must have the shape (n, 2)")
    return array[:, :2]


def _pair(name: str, value) -> tuple[float, float]:
    """Two finite numbers, or a ValueError that names the argument."""
    array = np.asarray(value, dtype=float)
    if array.shape != (2,) or not np.all(np.isfinite(array)):
        raise ValueError(f"{name}={value} must be two finite numbers (x, y) in m")
    return float(array[0]), float(array[1])


class Region:
    """Base of all regions; a region has `distance` (signed, m) and `bounds`."""

    def distance(self, points) -> np.ndarray:
        """Signed distance (n,) in m to the edge, negative inside.

        Exact for Box, Disc and HalfPlane; for combinations a bound of the distance with the right sign.
        """
        raise NotImplementedError

    @property
    def bounds(self) -> np.ndarray:
        """Bounding box ((x_min, y_min), (x_max, y_max)) in m; infinite where the region is."""
        raise NotImplementedError

    @property
    def size(self) -> float:
        """Largest finite extent of the bounding box (m); 1 where none is finite."""
        extent = self.bounds[1] - self.bounds[0]
        extent = extent[np.isfinite(extent)]
        return float(extent.max()) if len(extent) and extent.max() > 0 else 1.0

    @property
    def area(self) -> float:
        """Area in m2; for combinations from 1024 x 1024 samples of the bounding box (about 0.1 %)."""
        lower, upper = self.bounds
        if not np.all(np.isfinite([lower, upper])):
            return np.inf
        count = 1024
        x, y = (low + (np.arange(count) + 0.5) * (high - low) / count for low, high in zip(lower, upper))
        inside = sum(int(np.count_nonzero(self.contains(np.column_stack((x, np.full(count, level)))))) for level in y)
        return float(np.prod(upper - lower)) * inside / count**2

    def contains(self, points, tolerance: float | None = None) -> np.ndarray:
        """True (n,) where a point lies inside or on the edge.

        Args:
            points: (n, 2) in m.
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
    """Axis-parallel rectangle from its lower left to its upper right corner (m)."""

    lower: tuple[float, float]
    upper: tuple[float, float]

    def __post_init__(self):
        object.__setattr__(self, "lower", _pair("lower", self.lower))
        object.__setattr__(self, "upper", _pair("upper", self.upper))
        if not (self.lower[0] < self.upper[0] and self.lower[1] < self.upper[1]):
            raise ValueError(f"lower={self.lower} must lie below and left of upper={self.upper}")

    def distance(self, points) -> np.ndarray:
        """Signed distance (n,) in m to the edge, negative inside."""
        points = _points(points)
        beyond = np.maximum(np.asarray(self.lower) - points, points - np.asarray(self.upper))
        return np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)

    @property
    def bounds(self) -> np.ndarray:
        """((x_min, y_min), (x_max, y_max)) in m."""
        return np.array([self.lower, self.upper])

    @property
    def corners(self) -> np.ndarray:
        """The four corners (4, 2) in m, counter-clockwise from the lower left."""
        (left, bottom), (right, top) = self.lower, self.upper
        return np.array([(left, bottom), (right, bottom), (right, top), (left, top)])

    @property
    def area(self) -> float:
        """Area in m2."""
        return float(np.prod(self.bounds[1] - self.bounds[0]))


@dataclass(frozen=True)
class Disc(Region):
    """Disc of a centre and a radius (m)."""

    centre: tuple[float, float]
    radius: float

    def __post_init__(self):
        object.__setattr__(self, "centre", _pair("centre", self.centre))
        if not (np.isfinite(self.radius) and self.radius > 0):
            raise ValueError(f"radius={self.radius} must be positive (m)")

    def distance(self, points) -> np.ndarray:
        """Signed distance (n,) in m to the edge, negative inside."""
        return np.linalg.norm(_points(points) - np.asarray(self.centre), axis=1) - self.radius

    @property
    def bounds(self) -> np.ndarray:
        """((x_min, y_min), (x_max, y_max)) in m."""
        return np.array([np.subtract(self.centre, self.radius), np.add(self.centre, self.radius)])

    @property
    def area(self) -> float:
        """Area in m2."""
        return float(np.pi * self.radius**2)


@dataclass(frozen=True)
class HalfPlane(Region):
    """All points on the side of a straight edge that its outward normal points away from."""

    point: tuple[float, float]
    normal: tuple[float, float]

    def __post_init__(self):
        object.__setattr__(self, "point", _pair("point", self.point))
        normal = np.array(_pair("normal", self.normal))
        if not np.linalg.norm(normal) > 0:
            raise ValueError(f"normal={self.normal} must not be zero")
        object.__setattr__(self, "normal", tuple(float(c) for c in normal / np.linalg.norm(normal)))

    def distance(self, points) -> np.ndarray:
        """Signed distance (n,) in m to the edge, negative inside."""
        return (_points(points) - np.asarray(self.point)) @ np.asarray(self.normal)

    @property
    def bounds(self) -> np.ndarray:
        """((x_min, y_min), (x_max, y_max)) in m; finite only where the edge is parallel to an axis."""
        bounds = np.array([(-np.inf, -np.inf), (np.inf, np.inf)])
        for axis in (0, 1):
            if abs(self.normal[1 - axis]) < 1e-15:
                bounds[int(self.normal[axis] > 0), axis] = self.point[axis]
        return bounds


@dataclass(frozen=True)
class Combined(Region):
    """Two regions joined by "or" (either), "and" (both) or "without" (first, but not second)."""

    first: Region
    second: Region
    how: str

    def distance(self, points) -> np.ndarray:
        """Signed bound (n,) of the distance in m, negative inside (exact sign; see `Region.distance`)."""
        first, second = self.first.distance(points), self.second.distance(points)
        if self.how == "or":
            return np.minimum(first, second)
        return np.maximum(first, second if self.how == "and" else -second)

    @property
    def bounds(self) -> np.ndarray:
        """((x_min, y_min), (x_max, y_max)) in m, not always the tightest."""
        first, second = self.first.bounds, self.second.bounds
        if self.how == "or":
            return np.array([np.minimum(first[0], second[0]), np.maximum(first[1], second[1])])
        if self.how == "and":
            return np.array([np.maximum(first[0], second[0]), np.minimum(first[1], second[1])])
        return first
