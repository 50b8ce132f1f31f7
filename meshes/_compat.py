"""What only `meshes` must know about versions of dolfinx (0.5 to 0.9)."""

from __future__ import annotations

import inspect

import numpy as np


def facet_vertices(mesh, facets: np.ndarray) -> np.ndarray:
    """Coordinates (n, 2, 2) of the end points of the given local facets (m).

    dolfinx.mesh.entities_to_geometry is C++-only before 0.9 and spelled differently in between, hence by
    connectivity and the vertices' places in the cells.
    """
    topology = mesh.topology
    for pair in ((1, 0), (2, 0)):
        topology.create_connectivity(*pair)
    vertices = vertex_coordinates(mesh)
    links = topology.connectivity(1, 0)
    ends = links.array.reshape(-1, 2)[facets]
    return vertices[ends]


def vertex_coordinates(mesh) -> np.ndarray:
    """Coordinates (n, 2) of the local vertices (m)."""
    topology = mesh.topology
    topology.create_connectivity(2, 0)
    cells = topology.connectivity(2, 0).array
    nodes = mesh.geometry.dofmap
    nodes = nodes.array if hasattr(nodes, "array") else np.asarray(nodes).ravel()  # AdjacencyList until 0.6
    index_map = topology.index_map(0)
    coordinates = np.full((index_map.size_local + index_map.num_ghosts, 2), np.nan)
    coordinates[cells] = mesh.geometry.x[nodes, :2]
    return coordinates


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
