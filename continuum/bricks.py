"""Trilinear elements of a regular mesh (Hex8): strain matrix and stiffness of one brick for all.

Nodes are numbered as dolfinx does: x fastest, then y, then z.
"""

from __future__ import annotations

import numpy as np

from . import _compat, cells

DEGREE = 3  # of the quadrature: 2 x 2 x 2 points
NODES = 8


def shape_functions(points: np.ndarray) -> np.ndarray:
    """Values (k, 8) at points (k, 3) of the unit cube."""
    return cells.shape_functions(points, NODES)


def shape_gradients(points: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Gradients (k, 8, 3) in 1/m of the shape functions of a brick of a size (3,) in m at points (k, 3) of the unit cube."""
    return cells.shape_gradients(points, NODES) / np.asarray(size)


def strain_matrix(points: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Tensor strain (k, 6, 24) xx, yy, zz, yz, xz, xy by nodal displacements, node by node with three components."""
    by = shape_gradients(points, size)
    found = np.zeros((len(by), 6, 8, 3))
    for row in range(3):
        found[:, row, :, row] = by[:, :, row]
    for row, (a, b) in zip((3, 4, 5), ((1, 2), (0, 2), (0, 1))):
        found[:, row, :, a] = 0.5 * by[:, :, b]
        found[:, row, :, b] = 0.5 * by[:, :, a]
    return found.reshape(len(by), 6, 24)


def mass() -> np.ndarray:
    """Consistent mass (8, 8) in kg of a brick of mass one, the same for each component."""
    points, weights = _compat.quadrature_rule("hexahedron", DEGREE)
    shape = shape_functions(points)
    return np.einsum("q,qa,qb->ab", weights, shape, shape)


def stiffness(size: np.ndarray, young_modulus: float, poisson_ratio: float) -> np.ndarray:
    """Stiffness (24, 24) in N/m of an isotropic brick of a size (3,) in m, 2 x 2 x 2 points."""
    points, weights = _compat.quadrature_rule("hexahedron", DEGREE)
    strain = strain_matrix(points, size)
    e, nu = young_modulus, poisson_ratio
    double = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])  # tensor shear counts twice
    moduli = np.diag(double * e / (1.0 + nu))
    moduli[:3, :3] += e * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))
    volume = float(np.prod(size))
    return np.einsum("q,qra,rs,qsb->ab", weights * volume, strain, moduli, strain)
