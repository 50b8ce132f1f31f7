"""Meshes with named parts: structured rectangles and boxes, graded gmsh meshes, a user's own .msh file.

Needs dolfinx, and gmsh where it meshes or reads. All functions are collective; rank 0 builds, dolfinx distributes: all cells alike,
or by what the caller says that they cost; the same on each start, as the bits of a resumed run need (the graph partitioners of dolfinx
give other parts from call to call).
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from dolfinx import mesh as dmesh
from mpi4py import MPI

from . import _compat, _gmsh, partition
from ._gmsh import REGION, SOIL
from .regions import RELATIVE_TOLERANCE

CELL_NAMES = {2: ("triangle", "quadrilateral"), 3: ("tetrahedron", "hexahedron")}
LEFT, RIGHT, BOTTOM, TOP, PLATE, FRONT, BACK = range(1, 8)  # facet tags; PLATE is a part of "top"
FACET_NAMES: dict[int, dict[str, tuple[int, ...]]] = {
    2: {"left": (LEFT,), "right": (RIGHT,), "bottom": (BOTTOM,), "top": (TOP, PLATE), "plate": (PLATE,)},
    3: {"left": (LEFT,), "right": (RIGHT,), "front": (FRONT,), "back": (BACK,), "bottom": (BOTTOM,), "top": (TOP,)},
}
SIDES = {2: ((LEFT, RIGHT), (BOTTOM, TOP)), 3: ((LEFT, RIGHT), (FRONT, BACK), (BOTTOM, TOP))}  # low and high, by axis


@dataclass(frozen=True)
class Domain:
    """A distributed mesh and the names of its parts.

    `cell_names` and `facet_names` map a name to the tags that it unites.
    """

    mesh: Any
    cell_tags: Any
    facet_tags: Any
    cell_names: dict[str, tuple[int, ...]] = field(default_factory=dict)
    facet_names: dict[str, tuple[int, ...]] = field(default_factory=dict)

    def cells(self, name: str) -> np.ndarray:
        """Local indices (int32, sorted) of the cells called `name`; ValueError for an unknown name."""
        return _tagged(self.cell_tags, self.cell_names, name, "cells")

    def facets(self, name: str) -> np.ndarray:
        """Local indices (int32, sorted) of the facets called `name`; ValueError for an unknown name."""
        return _tagged(self.facet_tags, self.facet_names, name, "facets")

    @property
    def bounds(self) -> np.ndarray:
        """((x_min, y_min), (x_max, y_max)), in space with z, of the whole mesh in m (collective)."""
        axes = self.mesh.topology.dim
        points = self.mesh.geometry.x[:, :axes]
        lower = points.min(axis=0) if len(points) else np.full(axes, np.inf)
        upper = points.max(axis=0) if len(points) else np.full(axes, -np.inf)
        comm = self.mesh.comm
        return np.array([[comm.allreduce(v, MPI.MIN) for v in lower], [comm.allreduce(v, MPI.MAX) for v in upper]])


def _tagged(tags, names: dict[str, tuple[int, ...]], name: str, kind: str) -> np.ndarray:
    if name not in names:
        known = ", ".join(sorted(names)) or "none"
        raise ValueError(f'{kind} "{name}" are unknown in this mesh; known: {known}')
    return np.sort(tags.indices[np.isin(tags.values, names[name])]).astype(np.int32)


def rectangle(
    lower,
    upper,
    cells=(18, 9),
    cell="quadrilateral",
    plate: float | None = None,
    comm=MPI.COMM_WORLD,
    costs: partition.Costs | None = None,
) -> Domain:
    """Structured rectangle of equal cells; facets are called left, right, bottom, top (and plate).

    Args:
        lower: lower left corner (m).
        upper: upper right corner (m).
        cells: number of cells along x and y.
        cell: "quadrilateral" or "triangle" (two a rectangle).
        plate: width (m) of the strip in the middle of the top called "plate"; only facets wholly under it count.
        comm: MPI communicator.
        costs: function of the corners (cells, nodes, axes) of all cells (m) giving their costs (cells,), particles and all (all
            alike by default); the ranks get cells of even cost, side by side. Called on rank 0.
    """
    lower, upper, counts = _structure(lower, upper, cells, cell, 2)

    def make(comm, **spread):
        return dmesh.create_rectangle(comm, [lower, upper], counts, getattr(dmesh.CellType, cell), **spread)

    mesh = _spread(make, comm, costs)
    middle = 0.5 * (lower[0] + upper[0])
    span = None
    if plate is not None:
        if not 0 < plate <= upper[0] - lower[0]:
            raise ValueError(f"plate={plate} must be positive and not wider than the rectangle (m)")
        span = (middle - 0.5 * plate, middle + 0.5 * plate)
    return _named(mesh, lower, upper, span)


def _spread(make, comm, costs: partition.Costs | None):
    """The mesh that `make` gives on a communicator, its cells shared out by their costs."""
    if comm.size == 1:
        return make(comm)
    known_by, error = None, None
    if comm.rank == 0:
        try:
            known_by = partition.destinations(_compat.cell_corners(make(MPI.COMM_SELF)), costs, comm.size)
        except ValueError as failure:
            error = str(failure)
    known_by, error = comm.bcast((known_by, error), root=0)
    if error is not None:
        raise ValueError(error)
    return make(comm, partitioner=_compat.partitioner(known_by))


def box(
    lower, upper, cells=(10, 10, 10), cell="hexahedron", comm=MPI.COMM_WORLD, costs: partition.Costs | None = None
) -> Domain:
    """Structured box of equal cells; facets are called left, right (x), front, back (y), bottom, top (z).

    Args:
        lower: corner with the smallest coordinates (m).
        upper: the opposite corner (m).
        cells: number of cells along x, y and z.
        cell: "hexahedron" or "tetrahedron" (six a box).
        comm, costs: as for `rectangle`.
    """
    lower, upper, counts = _structure(lower, upper, cells, cell, 3)

    def make(comm, **spread):
        return dmesh.create_box(comm, [lower, upper], counts, getattr(dmesh.CellType, cell), **spread)

    return _named(_spread(make, comm, costs), lower, upper, None)


def _structure(lower, upper, cells, cell: str, axes: int) -> tuple[np.ndarray, np.ndarray, list[int]]:
    """Corners and numbers of cells of a structured mesh, or a ValueError."""
    low, high, counts = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float), np.asarray(cells)
    proper = low.shape == high.shape == (axes,)
    if not (proper and np.all(low < high) and np.all(np.isfinite(high - low))):
        letters = {2: "(x, y)", 3: "(x, y, z)"}[axes]
        raise ValueError(f"lower={lower} must lie below and left of upper={upper}, both {letters} in m")
    if counts.shape != (axes,) or counts.dtype.kind not in "iu" or np.any(counts < 1):
        numbers = {2: "two positive whole numbers (along x, along y)", 3: "three positive whole numbers (along x, y, z)"}
        raise ValueError(f"cells={cells} must be {numbers[axes]}")
    _check_cell(cell, axes)
    return low, high, [int(n) for n in counts]


def foundation(
    width: float = 18.0,
    depth: float = 9.0,
    plate: float = 2.0,
    size: float = 1.0,
    size_near: float = 0.25,
    region=None,
    cell: str = "triangle",
    comm=MPI.COMM_WORLD,
    costs: partition.Costs | None = None,
) -> Domain:
    """Soil (0, 0)-(width, depth) under a centred strip plate, meshed by gmsh and graded towards the plate.

    Args:
        width: width of the soil (m).
        depth: depth of the soil (m); its free surface is y = depth.
        plate: width of the plate (m), an edge of the mesh called "plate".
        size: element size far from the plate (m).
        size_near: element size at the plate (m).
        region: convex region with `corners` (a Box) whose outline no element crosses; its cells are called "region".
        cell: "triangle" or "quadrilateral".
        comm, costs: as for `rectangle`.
    """
    for name, value in (("width", width), ("depth", depth), ("plate", plate), ("size", size), ("size_near", size_near)):
        if not (np.isfinite(value) and value > 0):
            raise ValueError(f"{name}={value} must be positive (m)")
    if plate >= width:
        raise ValueError(f"plate={plate} must be narrower than width={width} (m)")
    _check_cell(cell, 2)
    corners = None
    if region is not None:
        if not hasattr(region, "corners"):
            raise ValueError(f"region={region} must be a Box (or have corners) so that the mesh can follow its outline")
        corners = np.asarray(region.corners, dtype=float)
        slack = RELATIVE_TOLERANCE * max(width, depth)
        if np.any(corners < -slack) or np.any(corners > np.array([width, depth]) + slack):
            raise ValueError(f"region={region} must lie inside the soil (0, 0)-({width}, {depth})")

    def build(gmsh):
        _gmsh.foundation_geometry(gmsh, width, depth, plate, corners)
        _gmsh.grade(gmsh, width, depth, plate, size, size_near, cell)
        gmsh.model.mesh.generate(2)
        return 2

    mesh, cell_tags = _gmsh.mesh_of(build, comm, costs)[:2]
    half = 0.5 * plate
    named = _named(mesh, np.zeros(2), np.array([width, depth]), (0.5 * width - half, 0.5 * width + half))
    names: dict[str, tuple[int, ...]] = {"soil": (SOIL, REGION)}
    if corners is not None:
        names["region"] = (REGION,)
    return Domain(mesh, cell_tags, named.facet_tags, names, named.facet_names)


def read(path, comm=MPI.COMM_WORLD, costs: partition.Costs | None = None) -> Domain:
    """A user's own gmsh mesh (.msh) of plane triangles or quadrilaterals, or of tetrahedra or hexahedra.

    Physical groups give the names of cells and facets; left, right, bottom and top (in space also front and back) are added by
    position where the file does not name them. Where it holds volume elements, plane ones only name facets. `costs` as for
    `rectangle`. ValueError with one sentence where the file is missing, unreadable, empty or has other elements.
    """
    if not isinstance(path, (str, os.PathLike)):
        raise ValueError(f"mesh={path!r} must be the path of a .msh file")
    path = os.fspath(path)
    found: dict[str, dict[str, tuple[int, ...]]] = {}

    def build(gmsh):
        if not os.path.isfile(path):
            raise ValueError(f"mesh={path} does not exist")
        try:
            gmsh.merge(path)
        except Exception as error:  # gmsh raises bare Exception
            raise ValueError(f"mesh={path} cannot be read by gmsh ({error})") from None
        axes = _gmsh.checked_axes(gmsh, path)
        found["cells"], found["facets"] = _gmsh.physical_names(gmsh, axes)
        return axes

    mesh, cell_tags, facet_tags = _gmsh.mesh_of(build, comm, costs)
    found = comm.bcast(found, root=0)
    named = Domain(mesh, cell_tags, facet_tags, found["cells"], found["facets"])
    lower, upper = named.bounds
    sides = _named(mesh, lower, upper, None)
    return _with_sides(named, sides)


def _with_sides(named: Domain, sides: Domain) -> Domain:
    """The sides of a user's mesh by position, added under tags of their own where the file does not name them."""
    comm, tags, side_tags = named.mesh.comm, named.facet_tags, sides.facet_tags
    offset = 1 + comm.allreduce(int(tags.values.max(initial=0)), MPI.MAX)
    free = ~np.isin(side_tags.indices, tags.indices)
    indices = np.concatenate((tags.indices, side_tags.indices[free]))
    values = np.concatenate((tags.values, side_tags.values[free] + offset)).astype(np.int32)
    order = np.argsort(indices)
    names = dict(named.facet_names)
    for name, members in sides.facet_names.items():
        taken = int(np.isin(side_tags.indices[np.isin(side_tags.values, members)], tags.indices).sum())
        if (
            name not in names and comm.allreduce(taken) == 0
        ):  # a side that the file names in part keeps the file's names
            names[name] = tuple(tag + offset for tag in members)
    both = dmesh.meshtags(named.mesh, tags.dim, indices[order].astype(np.int32), values[order])
    return Domain(named.mesh, named.cell_tags, both, named.cell_names, names)


def _check_cell(cell: str, axes: int) -> None:
    if cell not in CELL_NAMES[axes]:
        raise ValueError(f'cell="{cell}" must be ' + " or ".join(f'"{name}"' for name in CELL_NAMES[axes]))


def _named(mesh, lower, upper, span) -> Domain:
    """Domain of one kind of cells, with the sides of its bounding box named; span = x range of the plate."""
    axes = mesh.topology.dim
    mesh.topology.create_connectivity(axes - 1, axes)
    slack = 1e-9 * float(np.max(upper - lower))
    sides = [side for axis, tags in enumerate(SIDES[axes]) for side in zip(tags, (axis, axis), (lower[axis], upper[axis]))]
    facets, values = [], []
    for tag, axis, level in sides:
        on_side = dmesh.locate_entities_boundary(mesh, axes - 1, lambda x, a=axis, v=level: np.abs(x[a] - v) <= slack)
        tags = np.full(len(on_side), tag)
        if tag == TOP and span is not None:
            ends = _compat.facet_vertices(mesh, on_side)[:, :, 0]
            tags[(ends.min(axis=1) >= span[0] - slack) & (ends.max(axis=1) <= span[1] + slack)] = PLATE
        facets.append(on_side)
        values.append(tags)
    facets, values = np.concatenate(facets), np.concatenate(values)
    order = np.argsort(facets, kind="stable")
    facet_tags = dmesh.meshtags(mesh, axes - 1, facets[order].astype(np.int32), values[order].astype(np.int32))
    count = mesh.topology.index_map(axes).size_local
    cell_tags = dmesh.meshtags(mesh, axes, np.arange(count, dtype=np.int32), np.full(count, SOIL, dtype=np.int32))
    names = {name: tags for name, tags in FACET_NAMES[axes].items() if span is not None or name != "plate"}
    return Domain(mesh, cell_tags, facet_tags, {"soil": (SOIL,)}, names)
