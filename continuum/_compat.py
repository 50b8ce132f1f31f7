"""The one place that knows a dolfinx version: 0.5 (Debian 12) and 0.9 (Debian 13)."""

from __future__ import annotations

import contextlib
import logging
import warnings

import basix
import dolfinx
import dolfinx.fem.petsc  # noqa: F401  (0.9 does not import it by itself)
import numpy as np
import ufl
from dolfinx import fem, geometry

try:  # 0.6 and later describe elements with basix.ufl, 0.5 with ufl itself
    import basix.ufl

    _HAS_BASIX_UFL = hasattr(basix.ufl, "quadrature_element")
except ImportError:
    _HAS_BASIX_UFL = False


@contextlib.contextmanager
def _quiet():
    """Keep the just-in-time compiler's build log (level INFO), and its advice against 125 points a cell, away from the user."""
    logging.disable(logging.INFO)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Number of integration points")
            yield
    finally:
        logging.disable(logging.NOTSET)


def _space(mesh, element):
    with _quiet():
        if hasattr(fem, "functionspace"):  # since 0.7
            return fem.functionspace(mesh, element)
        return fem.FunctionSpace(mesh, element)


def nodal_space(mesh, components: int):
    """Continuous (bi)linear space with `components` values a node, blocked."""
    if _HAS_BASIX_UFL:
        return _space(mesh, basix.ufl.element("Lagrange", mesh.basix_cell(), 1, shape=(components,)))
    return _space(mesh, ufl.VectorElement("Lagrange", mesh.ufl_cell(), 1, components))


def broken_space(mesh, components: int):
    """As `nodal_space`, but every cell has nodes of its own: its matrices are block diagonal."""
    if _HAS_BASIX_UFL:
        return _space(mesh, basix.ufl.element("DG", mesh.basix_cell(), 1, shape=(components,)))
    return _space(mesh, ufl.VectorElement(_broken_family(mesh), mesh.ufl_cell(), 1, components))


def cell_space(mesh):
    """One value a cell."""
    if _HAS_BASIX_UFL:
        return _space(mesh, basix.ufl.element("DG", mesh.basix_cell(), 0))
    return _space(mesh, ufl.FiniteElement(_broken_family(mesh), mesh.ufl_cell(), 0))


def _broken_family(mesh) -> str:
    """Name of the discontinuous family in ufl (until 0.6)."""
    return "DQ" if mesh.ufl_cell().cellname() in ("quadrilateral", "hexahedron") else "DG"


def quadrature_space(mesh, degree: int):
    """One value a point of the default quadrature rule of this degree."""
    if _HAS_BASIX_UFL:
        return _space(mesh, basix.ufl.quadrature_element(mesh.basix_cell(), degree=degree, scheme="default"))
    return _space(mesh, ufl.FiniteElement("Quadrature", mesh.ufl_cell(), degree, quad_scheme="default"))


def quadrature_rule(cell_name: str, degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (q, axes) and weights (q,) of the default rule on the reference cell."""
    cell = getattr(basix.CellType, cell_name)
    if hasattr(basix, "MixedElement") or not _HAS_BASIX_UFL:  # until 0.5 the rule's type came first
        try:
            points, weights = basix.make_quadrature(basix.QuadratureType.Default, cell, degree)
            return np.asarray(points), np.asarray(weights)
        except (AttributeError, TypeError):
            pass
    points, weights = basix.make_quadrature(cell, degree)
    return np.asarray(points), np.asarray(weights)


def cell_nodes(space) -> np.ndarray:
    """Local node numbers (cells, nodes per cell) of a space, ghost cells included."""
    return _table(space.dofmap.list, space.dofmap.dof_layout.num_dofs)


def geometry_nodes(mesh) -> np.ndarray:
    """Rows of `mesh.geometry.x` (cells, nodes per cell), ghost cells included."""
    return _table(mesh.geometry.dofmap, len(basix.topology(getattr(basix.CellType, mesh.topology.cell_name()))[0]))


def facet_corners(cell_name: str) -> list[list[int]]:
    """Corners of each facet of a cell, in the order of the reference cell."""
    return basix.topology(getattr(basix.CellType, cell_name))[-2]


def _table(links, width: int) -> np.ndarray:
    """Links of the cells as a table: an AdjacencyList until 0.6, an array since."""
    array = links.array if hasattr(links, "array") else np.asarray(links)
    return array.reshape(-1, width)


def form(expression):
    """Compile a UFL form."""
    with _quiet():
        return fem.form(expression)


def scatter_add(function) -> None:
    """Add ghost values to their owners (collective)."""
    modes = getattr(dolfinx.cpp.la, "InsertMode", None) or dolfinx.cpp.la.ScatterMode  # renamed in 0.6
    function.x.scatter_reverse(modes.add)


def assemble_matrix(compiled):
    """PETSc matrix of a bilinear form, finished (collective)."""
    matrix = fem.petsc.assemble_matrix(compiled)
    matrix.assemble()
    return matrix


def assemble_into(function, compiled) -> None:
    """Assemble a linear form into a function's values, ghosts added to their owners (collective)."""
    function.x.array[:] = 0.0
    fem.assemble_vector(function.x.array, compiled)
    scatter_add(function)


def cells_near(mesh, cells: np.ndarray, points: np.ndarray, padding: float) -> tuple[np.ndarray, np.ndarray]:
    """Pairs (point, cell) whose bounding boxes, widened by `padding` (m), meet; local, not collective."""
    if len(cells) == 0 or len(points) == 0:
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    places = np.zeros((len(points), 3))
    places[:, : points.shape[1]] = points
    cells = np.asarray(cells, dtype=np.int32)
    if hasattr(geometry, "bb_tree"):  # since 0.7
        tree = geometry.bb_tree(mesh, mesh.topology.dim, entities=cells, padding=padding)
        links = geometry.compute_collisions_points(tree, places)
    else:
        tree = geometry.BoundingBoxTree(mesh, mesh.topology.dim, cells, padding)
        links = geometry.compute_collisions(tree, places)
    return np.repeat(np.arange(len(points)), np.diff(links.offsets)), links.array.astype(np.int64)
