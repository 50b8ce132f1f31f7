"""Shapes of walls: planes, polygons and polylines in the plane, triangle meshes in space.

A shape is a set of facets (infinite planes, segments or triangles) that know their corners. Facets of a solid have an
inside, on the left of a segment's direction and below a counter-clockwise triangle; others are touched from both sides.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

WELD = 1e-9  # corners nearer than this share of the size of a shape are one
THIN = 1e-10  # smallest area of a triangle, in squares of its longest edge


class Shape(NamedTuple):
    """Facets of a wall in its reference position; made by the functions of this module."""

    axes: int  # 2 or 3
    vertices: np.ndarray  # (v, 3) m, in the plane with z = 0
    corners: np.ndarray  # (f, 3) int32 rows of `vertices`; -1 for what a segment or a plane does not have
    normals: np.ndarray  # (f, 3) unit, out of a solid
    solid: bool

    @property
    def centre(self) -> np.ndarray:
        """Mean of the vertices (3,), m."""
        return self.vertices.mean(axis=0)


def _numbers(name: str, values: Any, columns: Sequence[int]) -> np.ndarray:
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be an array of numbers (m), not {values!r}") from None
    if array.ndim != 2 or array.shape[1] not in columns:
        wanted = " or ".join(f"(k, {c})" for c in columns)
        raise ValueError(f"{name} of shape {array.shape} must have shape {wanted}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite numbers (m); row {np.argwhere(~np.isfinite(array))[0, 0]} is not")
    return array


def _vector(name: str, value: Any, axes: Sequence[int] = (2, 3)) -> np.ndarray:
    return _numbers(name, [value], axes)[0]


def _padded(points: np.ndarray) -> np.ndarray:
    return np.hstack([points, np.zeros((len(points), 3 - points.shape[1]))])


def plane(point: Sequence[float], normal: Sequence[float]) -> Shape:
    """Infinite plane (in the plane a line) through a point (m); particles are on the side to which the normal points."""
    at = _vector("point", point)
    out = _vector("normal", normal, (at.size,))
    length = np.linalg.norm(out)
    if length == 0.0:
        raise ValueError(f"normal={tuple(out)} must have a length: give the direction towards the particles")
    return Shape(at.size, _padded(at[None]), np.array([[0, -1, -1]], dtype=np.int32), _padded(out[None] / length), True)


def polyline(points: Any, closed: bool = False) -> Shape:
    """Chain of segments in the plane (chute, hopper), touched from both sides.

    Args:
        points: (k, 2), m.
        closed: whether the last point is joined with the first.
    """
    return _chain(_numbers("points", points, (2,)), closed, solid=False)


def polygon(corners: Any) -> Shape:
    """Solid polygon in the plane, convex or not.

    Args:
        corners: (k, 2) counter-clockwise, m; sides may not cross.
    """
    places = _numbers("corners", corners, (2,))
    if len(places) < 3:
        raise ValueError(f"corners of shape {places.shape} must have shape (k, 2) with k >= 3")
    following = np.roll(places, -1, axis=0)
    area = 0.5 * np.sum(places[:, 0] * following[:, 1] - following[:, 0] * places[:, 1])
    if not area > 0.0:
        raise ValueError(f"corners enclose the area {area:g} m2: give them in counter-clockwise order")
    return _chain(places, True, solid=True)


def _chain(places: np.ndarray, closed: bool, solid: bool) -> Shape:
    if len(places) < 2:
        raise ValueError(f"points of shape {places.shape} must have shape (k, 2) with k >= 2")
    first = np.arange(len(places) if closed else len(places) - 1)
    second = (first + 1) % len(places)
    way = places[second] - places[first]
    length = np.linalg.norm(way, axis=1)
    if not (length > WELD * np.ptp(places, axis=0).max()).all():
        raise ValueError(f"points {first[length.argmin()]} and {second[length.argmin()]} are the same; leave one out")
    out = np.column_stack([way[:, 1], -way[:, 0]]) / length[:, None]
    corners = np.column_stack([first, second, np.full(first.size, -1)]).astype(np.int32)
    return Shape(2, _padded(places), corners, _padded(out), solid)


def mesh(vertices: Any, triangles: Any, solid: bool = False, name: str = "triangles") -> Shape:
    """Triangles in space; vertices at the same place become one.

    Args:
        vertices: (v, 3), m.
        triangles: (f, 3) rows of `vertices`.
        solid: the triangles enclose a body and are counter-clockwise from outside; else both sides are touched.
        name: shown in messages.

    Raises:
        ValueError: numbers that make no sense, triangles without area, a solid that is not closed or inside out.
    """
    places = _numbers("vertices", vertices, (3,))
    corners = np.array(triangles)
    if corners.ndim != 2 or corners.shape[1] != 3 or corners.dtype.kind not in "iu" or not corners.size:
        raise ValueError(f"{name} of shape {corners.shape} must be whole numbers of shape (f, 3) with f >= 1")
    if corners.min() < 0 or corners.max() >= len(places):
        raise ValueError(f"{name} must name rows of the {len(places)} vertices, from 0 upwards")
    grid = np.round((places - places.min(axis=0)) / max(WELD * np.ptp(places, axis=0).max(), 1e-300))
    _, kept, place = np.unique(grid, axis=0, return_index=True, return_inverse=True)
    places, corners = places[kept], place.reshape(-1)[corners].astype(np.int32)
    sides = np.roll(places[corners], -1, axis=1) - places[corners]
    out = np.cross(sides[:, 0], sides[:, 1])
    twice = np.linalg.norm(out, axis=1)
    flat = np.flatnonzero(~(0.5 * twice > THIN * (sides**2).sum(axis=2).max(axis=1)))
    if flat.size:
        raise ValueError(f"{name} have no area, the first of them number {flat[0]}: leave them out or mend the mesh")
    if solid:
        _check_solid(places, corners, name)
    return Shape(3, places, corners, out / twice[:, None], solid)


def _check_solid(places: np.ndarray, corners: np.ndarray, name: str) -> None:
    edges = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2).astype(np.int64)
    forward, backward = edges @ [len(places), 1], edges @ [1, len(places)]
    if np.unique(forward).size < forward.size or not np.isin(forward, backward).all():
        raise ValueError(f"{name} of a solid must close a surface and all turn the same way: mend the mesh or take solid=False")
    a, b, c = (places[corners[:, k]] for k in range(3))
    volume = np.sum(a * np.cross(b, c)) / 6.0
    if volume <= 0.0:
        raise ValueError(f"{name} enclose the volume {volume:g} m3: reverse the corners of each, so that normals point outwards")


def read(path: str | Path, solid: bool = False, scale: float = 1.0) -> Shape:
    """Triangles of a mesh file in any format that meshio reads (STL, Gmsh's .msh, ...).

    Args:
        solid: see `mesh`.
        scale: metres in a unit of the file.
    """
    import meshio

    if not (np.isfinite(scale) and scale > 0.0):
        raise ValueError(f"scale={scale} must be positive (metres in a unit of the file)")
    try:
        found = meshio.read(path)
        triangles = [block.data for block in found.cells if block.type == "triangle"]
    except (Exception, SystemExit) as error:  # meshio leaves some bad files by sys.exit
        raise ValueError(f"path={str(path)!r} cannot be read as a mesh ({error}): check that it is there and whole") from None
    if not triangles:
        raise ValueError(f"path={str(path)!r} has no triangles: write the surface, not only lines or volumes")
    points = np.asarray(found.points, dtype=float) * scale
    return mesh(_padded(points), np.concatenate(triangles), solid, f"triangles of {path}")


def box(lower: Sequence[float], upper: Sequence[float]) -> Shape:
    """Solid box between two corners, in the plane a rectangle (m)."""
    low = _vector("lower", lower)
    high = _vector("upper", upper, (low.size,))
    if not (low < high).all():
        raise ValueError(f"lower={tuple(lower)} must be less than upper={tuple(upper)} in every component")
    if low.size == 2:
        return polygon([low, (high[0], low[1]), high, (low[0], high[1])])
    places = np.array([[(low, high)[k >> c & 1][c] for c in range(3)] for k in range(8)])
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return mesh(places, [t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))], solid=True)


def cylinder(
    start: Sequence[float], end: Sequence[float], radius: float, sides: int = 64, solid: bool = True
) -> Shape:
    """Cylinder in space as a prism whose corners lie on the circle: a closed roller, or (not solid) an open drum.

    Args:
        start, end: (3,) ends of the axis, m.
        radius: m.
        sides: facets around; the surface lies up to radius (1 - cos(pi / sides)) inside the circle.
    """
    a, b = _vector("start", start, (3,)), _vector("end", end, (3,))
    axis = b - a
    if not np.linalg.norm(axis) > 0.0:
        raise ValueError(f"start={tuple(start)} and end={tuple(end)} must be two places (m)")
    if not (np.isfinite(radius) and radius > 0.0) or sides < 3:
        raise ValueError(f"radius={radius} must be positive (m) and sides={sides} at least 3")
    axis /= np.linalg.norm(axis)
    u = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    u /= np.linalg.norm(u)
    angle = 2.0 * np.pi * np.arange(sides) / sides
    ring = radius * (np.cos(angle)[:, None] * u + np.sin(angle)[:, None] * np.cross(axis, u))
    k, n = np.arange(sides), (np.arange(sides) + 1) % sides
    triangles = [np.column_stack([k, n, sides + n]), np.column_stack([k, sides + n, sides + k])]
    if solid:
        triangles += [np.column_stack([n, k, k * 0 + 2 * sides]), np.column_stack([sides + k, sides + n, k * 0 + 2 * sides + 1])]
    return mesh(np.vstack([a + ring, b + ring, a, b]), np.concatenate(triangles), solid)
