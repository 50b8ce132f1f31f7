"""Elements of a regular mesh, trilinear in space (Hex8), bilinear in the plane (Q4): strain matrix and stiffness of one brick for all.

Nodes are numbered as dolfinx does: x fastest, then y, then z. In the plane there are four nodes with two components, per metre of
thickness.
"""

from __future__ import annotations

import numpy as np

from . import _compat, cells

DEGREE = 3  # of the quadrature: two points along each axis


def shape_functions(points: np.ndarray) -> np.ndarray:
    """Values (k, nodes) at points (k, axes) of the unit cube."""
    return cells.shape_functions(points, 2 ** points.shape[1])


def shape_gradients(points: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Gradients (k, nodes, axes) in 1/m of the shape functions of a brick of a size (axes,) in m at points of the unit cube."""
    return cells.shape_gradients(points, 2 ** points.shape[1]) / np.asarray(size)


def strain_matrix(points: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Tensor strain (k, 6, dofs) xx, yy, zz, yz, xz, xy by nodal displacements, node by node with a component for each axis."""
    axes = points.shape[1]
    by = shape_gradients(points, size)
    found = np.zeros((len(by), 6, 2**axes, axes))
    for row in range(axes):
        found[:, row, :, row] = by[:, :, row]
    for row, (a, b) in zip((3, 4, 5), ((1, 2), (0, 2), (0, 1))):
        if b < axes:
            found[:, row, :, a] = 0.5 * by[:, :, b]
            found[:, row, :, b] = 0.5 * by[:, :, a]
    return found.reshape(len(by), 6, -1)


def mass(axes: int = 3) -> np.ndarray:
    """Consistent mass (corners, corners) in kg of a brick of mass one, the same for each component."""
    points, weights = _compat.quadrature_rule("hexahedron" if axes == 3 else "quadrilateral", DEGREE)
    shape = shape_functions(points)
    return np.einsum("q,qa,qb->ab", weights, shape, shape)


def stiffness(size: np.ndarray, young_modulus: float, poisson_ratio: float, plane: str = "strain") -> np.ndarray:
    """Stiffness (dofs, dofs) in N/m of an isotropic brick of a size (axes,) in m, two points along each axis.

    In the plane, for plane "strain" or "stress".
    """
    points, weights = _compat.quadrature_rule("hexahedron" if len(size) == 3 else "quadrilateral", DEGREE)
    strain = strain_matrix(points, size)
    e, nu = young_modulus, poisson_ratio
    double = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])  # tensor shear counts twice
    moduli = np.diag(double * e / (1.0 + nu))
    free = len(size) == 2 and plane == "stress"
    moduli[:3, :3] += e * nu / ((1.0 + nu) * (1.0 - nu if free else 1.0 - 2.0 * nu))
    volume = float(np.prod(size))
    return np.einsum("q,qra,rs,qsb->ab", weights * volume, strain, moduli, strain)
