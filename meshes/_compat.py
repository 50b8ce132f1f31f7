"""What only `meshes` must know about versions of dolfinx (0.5 to 0.9)."""

from __future__ import annotations

import inspect
from typing import Any

import basix
import dolfinx
import numpy as np


def facet_vertices(mesh, facets: np.ndarray) -> np.ndarray:
    """Coordinates (n, corners a facet, axes) of the corners of the given local facets (m).

    dolfinx.mesh.entities_to_geometry is C++-only before 0.9 and spelled differently in between, hence by
    connectivity and the vertices' places in the cells.
    """
    topology, of_facets = mesh.topology, mesh.topology.dim - 1
    topology.create_connectivity(of_facets, 0)
    width = len(basix.topology(getattr(basix.CellType, topology.cell_name()))[of_facets][0])
    return vertex_coordinates(mesh)[topology.connectivity(of_facets, 0).array.reshape(-1, width)[facets]]


def vertex_coordinates(mesh) -> np.ndarray:
    """Coordinates (n, axes) of the local vertices (m)."""
    topology, axes = mesh.topology, mesh.topology.dim
    topology.create_connectivity(axes, 0)
    cells = topology.connectivity(axes, 0).array
    nodes = mesh.geometry.dofmap
    nodes = nodes.array if hasattr(nodes, "array") else np.asarray(nodes).ravel()  # AdjacencyList until 0.6
    index_map = topology.index_map(0)
    coordinates = np.full((index_map.size_local + index_map.num_ghosts, axes), np.nan)
    coordinates[cells] = mesh.geometry.x[nodes, :axes]
    return coordinates


def partitioner(known_by: Any) -> Any:
    """What dolfinx calls to spread cells, from `partition.Destinations` of all cells in the order of input, on every rank."""

    def destinations(comm, parts, kind, cells, *ghosting):
        if hasattr(cells, "num_nodes"):  # 0.5 to 0.7: a list of the corners of each cell
            count = cells.num_nodes
        else:  # since: an array of all corners for each kind of cell
            count = sum(len(some) // corners(one.name) for one, some in zip(kind, cells))
        first = comm.exscan(count) or 0
        start = known_by.start[first : first + count + 1]
        ranks = known_by.ranks[start[0] : start[-1]]
        return dolfinx.cpp.graph.AdjacencyList_int32(np.ascontiguousarray(ranks), (start - start[0]).astype(np.int32))

    return destinations


def corners(cell_name: str) -> int:
    """Number of corners of a kind of cell."""
    return len(basix.topology(getattr(basix.CellType, cell_name))[0])


def cell_corners(mesh) -> np.ndarray:
    """Corners (cells, nodes a cell, axes) of a mesh of one rank in the order of input (m)."""
    topology = mesh.topology
    topology.create_connectivity(topology.dim, 0)
    of_cells = topology.connectivity(topology.dim, 0).array.reshape(-1, corners(topology.cell_name()))
    found = np.empty((*of_cells.shape, topology.dim))
    found[np.asarray(topology.original_cell_index)] = vertex_coordinates(mesh)[of_cells]
    return found


def model_to_mesh(gmshio, model, comm, axes: int, known_by: Any) -> tuple[Any, Any, Any]:
    """`gmshio.model_to_mesh` of rank 0's model; `known_by` as for `partitioner`, None on one rank."""
    if known_by is None:
        return gmshio.model_to_mesh(model, comm, 0, gdim=axes)
    if "partitioner" in inspect.signature(gmshio.model_to_mesh).parameters:  # since 0.6
        return gmshio.model_to_mesh(model, comm, 0, gdim=axes, partitioner=partitioner(known_by))
    create = gmshio.create_mesh  # the way in that 0.5 has not: what it calls is lent the partitioner meanwhile
    gmshio.create_mesh = lambda *given: create(*given, partitioner=partitioner(known_by))
    try:
        return gmshio.model_to_mesh(model, comm, 0, gdim=axes)
    finally:
        gmshio.create_mesh = create


def gmsh_cell_corners(gmshio, model, axes: int) -> np.ndarray:
    """Corners (cells, nodes a cell, axes) of the cells of a gmsh model in the order in which gmshio hands them on (m)."""
    places, found = gmshio.extract_geometry(model), gmshio.extract_topology_and_markers(model)
    kind = next(one for one in found if model.mesh.getElementProperties(one)[1] == axes)
    return places[np.asarray(found[kind]["topology"]), :axes]


def open_gmsh(gmsh) -> bool:
    """Initialise gmsh unless it is already open (True where this call did it).

    No configuration files and no signal handlers; gmsh before 4.9 (Debian 12) has neither `isInitialized` nor the
    `interruptible` option, and needs none: its Python handler came later.
    """
    if hasattr(gmsh, "isInitialized"):
        already = bool(gmsh.isInitialized())
    else:
        try:
            already = gmsh.option.getString("General.Version") != ""  # empty before the first `initialize`
        except Exception:  # a bare Exception after `finalize`
            already = False
    if already:
        return False
    options = {"readConfigFiles": False}
    if "interruptible" in inspect.signature(gmsh.initialize).parameters:
        options["interruptible"] = False
    gmsh.initialize(**options)
    return True
