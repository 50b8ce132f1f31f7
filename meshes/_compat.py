"""What only `meshes` must know about versions of dolfinx (0.5 to 0.9)."""

from __future__ import annotations

import inspect

import basix
import numpy as np


def facet_vertices(mesh, facets: np.ndarray) -> np.ndarray:
    """Coordinates (n, corners a facet, axes) of the corners of the given local facets (m).

    dolfinx.mesh.entities_to_geometry is C++-only before 0.9 and spelled differently in between, hence by
    connectivity and the vertices' places in the cells.
    """
    topology, of_facets = mesh.topology, mesh.topology.dim - 1
    topology.create_connectivity(of_facets, 0)
    corners = len(basix.topology(getattr(basix.CellType, topology.cell_name()))[of_facets][0])
    return vertex_coordinates(mesh)[topology.connectivity(of_facets, 0).array.reshape(-1, corners)[facets]]


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
