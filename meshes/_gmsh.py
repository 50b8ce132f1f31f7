"""The gmsh side of `domains`: sessions, the foundation's geometry and grading, checks of files."""

from __future__ import annotations

import contextlib

import numpy as np

from . import _compat, partition

SOIL, REGION = 1, 2  # cell tags of the meshes made here
OPTIONS = [  # set here
    "General.Terminal",
    "Mesh.MeshSizeExtendFromBoundary",
    "Mesh.MeshSizeFromPoints",
    "Mesh.MeshSizeFromCurvature",
    "Mesh.Algorithm",
    "Mesh.RecombineAll",
    "Mesh.RecombinationAlgorithm",
    "Mesh.RandomSeed",
]


@contextlib.contextmanager
def session():
    """gmsh with an empty model of its own; silent, without signal handlers.

    Finalised afterwards, unless it was open before: then it is left as it was found.
    """
    import gmsh

    opened = _compat.open_gmsh(gmsh)
    previous = None if opened else gmsh.model.getCurrent()
    options = {name: gmsh.option.getNumber(name) for name in OPTIONS}
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


def mesh_of(build, comm, costs):
    """Mesh, cell tags and facet tags of the model that `build(gmsh)` makes on rank 0; its ValueError on every rank.

    `build` returns the number of dimensions; `costs` as for `domains.rectangle`.
    """
    try:
        from dolfinx.io import gmshio
    except ImportError:
        raise ValueError("this dolfinx has no gmshio; install python3-gmsh or use a structured mesh") from None
    error, axes, known_by = None, 2, None
    with contextlib.ExitStack() as stack:
        gmsh = None
        if comm.rank == 0:
            try:
                gmsh = stack.enter_context(session())
                axes = build(gmsh)
                if comm.size > 1:
                    corners = _compat.gmsh_cell_corners(gmshio, gmsh.model, axes)
                    known_by = partition.destinations(corners, costs, comm.size)
            except ModuleNotFoundError:
                error = "gmsh is not installed; install python3-gmsh or use a structured mesh"
            except Exception as failure:  # ours, or a bare Exception of gmsh: every rank must hear of it
                error = str(failure) if isinstance(failure, ValueError) else f"gmsh failed: {failure}"
        error, axes, known_by = comm.bcast((error, axes, known_by), root=0)
        if error is not None:
            raise ValueError(error)
        return _compat.model_to_mesh(gmshio, None if gmsh is None else gmsh.model, comm, axes, known_by)


def foundation_geometry(gmsh, width, depth, plate, corners) -> None:
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


def grade(gmsh, width, depth, plate, size, size_near, cell) -> None:
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


CELLS = {  # gmsh's numbers of the elements of first order, by axes
    2: ([2], [3], "plane elements", "3-node triangles or 4-node quadrilaterals"),
    3: ([4], [5], "volume elements", "4-node tetrahedra or 8-node hexahedra"),
}


def checked_axes(gmsh, path: str) -> int:
    """Dimensions of a mesh of one kind of first-order elements, its nodes then numbered consecutively, or a ValueError."""
    axes = 3 if len(gmsh.model.mesh.getElementTypes(3)) else 2
    types = [int(t) for t in gmsh.model.mesh.getElementTypes(axes)]
    *allowed, kind, wanted = CELLS[axes]
    if not types:
        raise ValueError(f"mesh={path} holds no {kind} nor volumes; mesh the geometry before saving (gmsh -2, gmsh -3)")
    if types not in allowed:
        names = ", ".join(gmsh.model.mesh.getElementProperties(t)[0] for t in types)
        raise ValueError(f"mesh={path} must hold {wanted}, not {names}")
    height = gmsh.model.mesh.getNodes()[1].reshape(-1, 3)[:, 2]
    used = np.unique(gmsh.model.mesh.getElementsByType(types[0])[1])
    if axes == 3 and len(used) < len(height):  # model_to_mesh ends the process
        raise ValueError(f"mesh={path} has nodes outside its volumes: delete points, curves and surfaces that bound none")
    if axes == 2 and np.ptp(height) > 1e-9 * max(1.0, float(np.abs(height).max())):
        raise ValueError(f"mesh={path} of plane elements must lie in a plane z = constant")
    gmsh.model.mesh.renumberNodes()
    return axes


def physical_names(gmsh, axes: int) -> tuple[dict[str, tuple[int, ...]], dict[str, tuple[int, ...]]]:
    """Names of the physical groups of cells and facets; cells outside all groups become "soil"."""
    names: tuple[dict, dict] = ({}, {})
    for dim, found in ((axes, names[0]), (axes - 1, names[1])):
        for _, tag in gmsh.model.getPhysicalGroups(dim):
            name = gmsh.model.getPhysicalName(dim, tag) or f"{'cells' if dim == axes else 'facets'}_{tag}"
            found[name] = (*found.get(name, ()), int(tag))
    groups = [int(tag) for _, tag in gmsh.model.getPhysicalGroups(axes)]
    grouped = {e for tag in groups for e in gmsh.model.getEntitiesForPhysicalGroup(axes, tag)}
    rest = [e for _, e in gmsh.model.getEntities(axes) if e not in grouped]
    if rest:
        tag = gmsh.model.addPhysicalGroup(axes, rest)
        name = "soil" if "soil" not in names[0] else f"cells_{tag}"
        names[0][name] = (int(tag),)
    if "soil" not in names[0]:
        names[0]["soil"] = tuple(sorted({t for tags in names[0].values() for t in tags}))
    return names
