"""Plane meshes with named parts: structured rectangles, graded gmsh meshes, a user's own .msh file.

Needs dolfinx, and gmsh where it meshes or reads. All functions are collective; rank 0 builds, dolfinx distributes.
"""

from __future__ import annotations

import contextlib
import os
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from dolfinx import mesh as dmesh
from mpi4py import MPI

from . import _compat
from .regions import RELATIVE_TOLERANCE

CELL_TYPES = {"triangle": dmesh.CellType.triangle, "quadrilateral": dmesh.CellType.quadrilateral}
SOIL, REGION = 1, 2  # cell tags of the meshes made here
LEFT, RIGHT, BOTTOM, TOP, PLATE = 1, 2, 3, 4, 5  # facet tags; PLATE is a part of "top"
FACET_NAMES = {"left": (LEFT,), "right": (RIGHT,), "bottom": (BOTTOM,), "top": (TOP, PLATE), "plate": (PLATE,)}
GMSH_OPTIONS = [  # set here
    "General.Terminal",
    "Mesh.MeshSizeExtendFromBoundary",
    "Mesh.MeshSizeFromPoints",
    "Mesh.MeshSizeFromCurvature",
    "Mesh.Algorithm",
    "Mesh.RecombineAll",
    "Mesh.RecombinationAlgorithm",
    "Mesh.RandomSeed",
]


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
        """((x_min, y_min), (x_max, y_max)) of the whole mesh in m (collective)."""
        points = self.mesh.geometry.x[:, :2]
        lower = points.min(axis=0) if len(points) else np.full(2, np.inf)
        upper = points.max(axis=0) if len(points) else np.full(2, -np.inf)
        comm = self.mesh.comm
        return np.array([[comm.allreduce(v, MPI.MIN) for v in lower], [comm.allreduce(v, MPI.MAX) for v in upper]])


def _tagged(tags, names: dict[str, tuple[int, ...]], name: str, kind: str) -> np.ndarray:
    if name not in names:
        known = ", ".join(sorted(names)) or "none"
        raise ValueError(f'{kind} "{name}" are unknown in this mesh; known: {known}')
    return np.sort(tags.indices[np.isin(tags.values, names[name])]).astype(np.int32)


def rectangle(
    lower, upper, cells=(18, 9), cell="quadrilateral", plate: float | None = None, comm=MPI.COMM_WORLD
) -> Domain:
    """Structured rectangle of equal cells; facets are called left, right, bottom, top (and plate).

    Args:
        lower: lower left corner (m).
        upper: upper right corner (m).
        cells: number of cells along x and y.
        cell: "quadrilateral" or "triangle" (two a rectangle).
        plate: width (m) of the strip in the middle of the top called "plate"; only facets wholly under it count.
        comm: MPI communicator.
    """
    lower, upper = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    if (
        lower.shape != (2,)
        or upper.shape != (2,)
        or not np.all(lower < upper)
        or not np.all(np.isfinite(upper - lower))
    ):
        raise ValueError(f"lower={lower} must lie below and left of upper={upper}, both (x, y) in m")
    counts = np.asarray(cells)
    if counts.shape != (2,) or counts.dtype.kind not in "iu" or np.any(counts < 1):
        raise ValueError(f"cells={cells} must be two positive whole numbers (along x, along y)")
    _check_cell(cell)
    mesh = dmesh.create_rectangle(comm, [lower, upper], [int(n) for n in counts], CELL_TYPES[cell])
    middle = 0.5 * (lower[0] + upper[0])
    span = None
    if plate is not None:
        if not 0 < plate <= upper[0] - lower[0]:
            raise ValueError(f"plate={plate} must be positive and not wider than the rectangle (m)")
        span = (middle - 0.5 * plate, middle + 0.5 * plate)
    return _named(mesh, lower, upper, span)


def foundation(
    width: float = 18.0,
    depth: float = 9.0,
    plate: float = 2.0,
    size: float = 1.0,
    size_near: float = 0.25,
    region=None,
    cell: str = "triangle",
    comm=MPI.COMM_WORLD,
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
        comm: MPI communicator.
    """
    for name, value in (("width", width), ("depth", depth), ("plate", plate), ("size", size), ("size_near", size_near)):
        if not (np.isfinite(value) and value > 0):
            raise ValueError(f"{name}={value} must be positive (m)")
    if plate >= width:
        raise ValueError(f"plate={plate} must be narrower than width={width} (m)")
    _check_cell(cell)
    corners = None
    if region is not None:
        if not hasattr(region, "corners"):
            raise ValueError(f"region={region} must be a Box (or have corners) so that the mesh can follow its outline")
        corners = np.asarray(region.corners, dtype=float)
        slack = RELATIVE_TOLERANCE * max(width, depth)
        if np.any(corners < -slack) or np.any(corners > np.array([width, depth]) + slack):
            raise ValueError(f"region={region} must lie inside the soil (0, 0)-({width}, {depth})")

    def build(gmsh):
        _foundation_geometry(gmsh, width, depth, plate, corners)
        _grade(gmsh, width, depth, plate, size, size_near, cell)
        gmsh.model.mesh.generate(2)

    mesh, cell_tags = _from_gmsh(build, comm)[:2]
    half = 0.5 * plate
    named = _named(mesh, np.zeros(2), np.array([width, depth]), (0.5 * width - half, 0.5 * width + half))
    names: dict[str, tuple[int, ...]] = {"soil": (SOIL, REGION)}
    if corners is not None:
        names["region"] = (REGION,)
    return Domain(mesh, cell_tags, named.facet_tags, names, named.facet_names)


def read(path, comm=MPI.COMM_WORLD) -> Domain:
    """A user's own gmsh mesh (.msh) of plane triangles or quadrilaterals.

    Physical groups give the names of cells and facets; left, right, bottom and top are added by position where the
    file does not name them. ValueError with one sentence where the file is missing, unreadable, empty or not plane.
    """
    path = os.fspath(path)
    found: dict[str, dict[str, tuple[int, ...]]] = {}

    def build(gmsh):
        if not os.path.isfile(path):
            raise ValueError(f"mesh={path} does not exist")
        try:
            gmsh.merge(path)
        except Exception as error:  # gmsh raises bare Exception
            raise ValueError(f"mesh={path} cannot be read by gmsh ({error})") from None
        _check_plane(gmsh, path)
        found["cells"], found["facets"] = _physical_names(gmsh)

    mesh, cell_tags, facet_tags = _from_gmsh(build, comm)
    found = comm.bcast(found, root=0)
    named = Domain(mesh, cell_tags, facet_tags, found["cells"], found["facets"])
    lower, upper = named.bounds
    sides = _named(mesh, lower, upper, None)
    missing = {name: tags for name, tags in sides.facet_names.items() if name not in named.facet_names}
    if not missing:
        return named
    # sides get tags of their own, above those of the file
    offset = 1 + comm.allreduce(int(facet_tags.values.max(initial=0)), MPI.MAX)
    free = ~np.isin(sides.facet_tags.indices, facet_tags.indices)
    indices = np.concatenate((facet_tags.indices, sides.facet_tags.indices[free]))
    values = np.concatenate((facet_tags.values, sides.facet_tags.values[free] + offset)).astype(np.int32)
    order = np.argsort(indices)
    tags = dmesh.meshtags(mesh, 1, indices[order].astype(np.int32), values[order])
    names = dict(named.facet_names)
    for name, side_tags in missing.items():
        on_side = np.isin(sides.facet_tags.values, side_tags)
        overlapped = facet_tags.values[np.isin(facet_tags.indices, sides.facet_tags.indices[on_side])]
        shared = set().union(*comm.allgather(set(int(v) for v in overlapped)))
        if not shared:  # a side that the file names in part keeps to the file's names
            names[name] = tuple(t + offset for t in side_tags)
    return Domain(mesh, cell_tags, tags, named.cell_names, names)


def _check_cell(cell: str) -> None:
    if cell not in CELL_TYPES:
        raise ValueError(f'cell="{cell}" must be "triangle" or "quadrilateral"')


def _named(mesh, lower, upper, span) -> Domain:
    """Domain of one kind of cells, with the sides of its bounding box named; span = x range of the plate."""
    mesh.topology.create_connectivity(1, 2)
    slack = 1e-9 * float(np.max(upper - lower))
    sides = [(LEFT, 0, lower[0]), (RIGHT, 0, upper[0]), (BOTTOM, 1, lower[1]), (TOP, 1, upper[1])]
    facets, values = [], []
    for tag, axis, level in sides:
        on_side = dmesh.locate_entities_boundary(mesh, 1, lambda x, a=axis, v=level: np.abs(x[a] - v) <= slack)
        tags = np.full(len(on_side), tag)
        if tag == TOP and span is not None:
            ends = _compat.facet_vertices(mesh, on_side)[:, :, 0]
            tags[(ends.min(axis=1) >= span[0] - slack) & (ends.max(axis=1) <= span[1] + slack)] = PLATE
        facets.append(on_side)
        values.append(tags)
    facets, values = np.concatenate(facets), np.concatenate(values)
    order = np.argsort(facets, kind="stable")
    facet_tags = dmesh.meshtags(mesh, 1, facets[order].astype(np.int32), values[order].astype(np.int32))
    count = mesh.topology.index_map(2).size_local
    cell_tags = dmesh.meshtags(mesh, 2, np.arange(count, dtype=np.int32), np.full(count, SOIL, dtype=np.int32))
    names = {name: tags for name, tags in FACET_NAMES.items() if span is not None or name != "plate"}
    return Domain(mesh, cell_tags, facet_tags, {"soil": (SOIL,)}, names)


@contextlib.contextmanager
def _gmsh_session():
    """gmsh with an empty model of its own; silent, without signal handlers.

    Finalised afterwards, unless it was open before: then it is left as it was found.
    """
    import gmsh

    opened = _compat.open_gmsh(gmsh)
    previous = None if opened else gmsh.model.getCurrent()
    options = {name: gmsh.option.getNumber(name) for name in GMSH_OPTIONS}
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add("grainbridge")
        yield gmsh
    finally:
        if opened:
            gmsh.finalize()
        else:
            gmsh.model.mesh.removeSizeCallback()
            gmsh.model.remove()
            gmsh.model.setCurrent(previous)
            for name, value in options.items():
                gmsh.option.setNumber(name, value)


def _from_gmsh(build, comm):
    """Mesh, cell tags and facet tags of the model that `build(gmsh)` makes on rank 0; its ValueError on every rank."""
    try:
        from dolfinx.io import gmshio
    except ImportError:
        raise ValueError("this dolfinx has no gmshio; install python3-gmsh or use a structured mesh") from None
    error = None
    with contextlib.ExitStack() as stack:
        gmsh = None
        if comm.rank == 0:
            try:
                gmsh = stack.enter_context(_gmsh_session())
                build(gmsh)
            except ModuleNotFoundError:
                error = "gmsh is not installed; install python3-gmsh or use a structured mesh"
            except Exception as failure:  # ours, or a bare Exception of gmsh: every rank must hear of it
                error = str(failure) if isinstance(failure, ValueError) else f"gmsh failed: {failure}"
        error = comm.bcast(error, root=0)
        if error is not None:
            raise ValueError(error)
        return gmshio.model_to_mesh(None if gmsh is None else gmsh.model, comm, 0, gdim=2)


def _foundation_geometry(gmsh, width, depth, plate, corners) -> None:
    """Soil cut along the region's outline, with the plate's ends as points of the surface; physical groups of cells."""
    occ = gmsh.model.occ
    soil = (2, occ.addRectangle(0.0, 0.0, 0.0, width, depth))
    tools = [(0, occ.addPoint(x, depth, 0.0)) for x in (0.5 * (width - plate), 0.5 * (width + plate))]
    if corners is not None:
        points = [occ.addPoint(*corner, 0.0) for corner in corners]
        lines = [occ.addLine(points[i - 1], points[i]) for i in range(len(points))]
        tools.append((2, occ.addPlaneSurface([occ.addCurveLoop(lines)])))
    occ.fragment([soil], tools)
    occ.synchronize()
    surfaces = {SOIL: [tag for _, tag in gmsh.model.getEntities(2)], REGION: []}
    if corners is not None:
        (x0, y0), (x1, y1), slack = corners.min(axis=0), corners.max(axis=0), 1e-5 * depth
        box = (x0 - slack, y0 - slack, -slack, x1 + slack, y1 + slack, slack)
        surfaces[REGION] = [tag for _, tag in gmsh.model.getEntitiesInBoundingBox(*box, 2)]
        surfaces[SOIL] = [tag for tag in surfaces[SOIL] if tag not in surfaces[REGION]]
    for tag, members in surfaces.items():
        if members:
            gmsh.model.addPhysicalGroup(2, members, tag)


def _grade(gmsh, width, depth, plate, size, size_near, cell) -> None:
    """Element size: size_near at the plate, growing linearly to size at half the depth from it."""

    def element_size(dim, tag, x, y, z, *later) -> float:  # gmsh 4.9 added the size so far as a last argument
        distance = np.hypot(max(abs(x - 0.5 * width) - 0.5 * plate, 0.0), depth - y)
        return size_near + (size - size_near) * min(distance / (0.5 * depth), 1.0)

    gmsh.model.mesh.setSizeCallback(element_size)
    for option in ("MeshSizeExtendFromBoundary", "MeshSizeFromPoints", "MeshSizeFromCurvature"):
        gmsh.option.setNumber(f"Mesh.{option}", 0)
    gmsh.option.setNumber("Mesh.Algorithm", 6)  # frontal Delaunay
    if cell == "quadrilateral":
        gmsh.option.setNumber("Mesh.RecombineAll", 1)
        gmsh.option.setNumber("Mesh.RecombinationAlgorithm", 3)  # blossom, quadrilaterals only
    gmsh.option.setNumber("Mesh.RandomSeed", 1)


def _check_plane(gmsh, path: str) -> None:
    """One kind of plane first-order elements with consecutive node numbers, or a ValueError."""
    types = [int(t) for t in gmsh.model.mesh.getElementTypes(2)]
    if gmsh.model.mesh.getElementTypes(3).size:
        raise ValueError(f"mesh={path} must be plane, but it holds volume elements")
    if not types:
        raise ValueError(f"mesh={path} holds no plane elements; mesh the surfaces before saving (gmsh -2)")
    if types not in ([2], [3]):
        names = ", ".join(gmsh.model.mesh.getElementProperties(t)[0] for t in types)
        raise ValueError(f"mesh={path} must hold 3-node triangles or 4-node quadrilaterals, not {names}")
    height = gmsh.model.mesh.getNodes()[1].reshape(-1, 3)[:, 2]
    if np.ptp(height) > 1e-9 * max(1.0, float(np.abs(height).max())):
        raise ValueError(f"mesh={path} must lie in a plane z = constant")
    gmsh.model.mesh.renumberNodes()


def _physical_names(gmsh) -> tuple[dict[str, tuple[int, ...]], dict[str, tuple[int, ...]]]:
    """Names of the physical groups of cells and facets; surfaces outside all groups become "soil"."""
    names: tuple[dict, dict] = ({}, {})
    for dim, found in ((2, names[0]), (1, names[1])):
        for _, tag in gmsh.model.getPhysicalGroups(dim):
            name = gmsh.model.getPhysicalName(dim, tag) or f"{'cells' if dim == 2 else 'facets'}_{tag}"
            found[name] = (*found.get(name, ()), int(tag))
    grouped = {e for _, tag in gmsh.model.getPhysicalGroups(2) for e in gmsh.model.getEntitiesForPhysicalGroup(2, tag)}
    rest = [e for _, e in gmsh.model.getEntities(2) if e not in grouped]
    if rest:
        tag = gmsh.model.addPhysicalGroup(2, rest)
        name = "soil" if "soil" not in names[0] else f"cells_{tag}"
        names[0][name] = (int(tag),)
    if "soil" not in names[0]:
        names[0]["soil"] = tuple(sorted({t for tags in names[0].values() for t in tags}))
    return names
