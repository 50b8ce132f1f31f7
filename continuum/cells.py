"""Linear simplices and tensor-product cells of first order in numpy: shape functions, maps and their inverse.

Triangles and quadrilaterals in the plane, tetrahedra and hexahedra in space. Points have as many coordinates as there are
axes; a cell with one node more than axes is a simplex.
"""

from __future__ import annotations

from functools import reduce

import numpy as np

from . import _compat

RING = {3: [0, 1, 2], 4: [0, 1, 3, 2]}  # nodes around a cell; dolfinx numbers quadrilaterals as a tensor product


def shape_functions(points: np.ndarray, nodes: int) -> np.ndarray:
    """Values (..., nodes) of the shape functions at reference points (..., axes) of the unit simplex or cube."""
    along = np.moveaxis(points, -1, 0)
    if simplex(nodes, len(along)):
        return np.stack((reduce(np.subtract, along, 1.0), *along), axis=-1)
    return np.stack(_products([(1.0 - x, x) for x in along]), axis=-1)


def shape_gradients(points: np.ndarray, nodes: int) -> np.ndarray:
    """Derivatives (..., nodes, axes) of the shape functions by the reference coordinates."""
    along = np.moveaxis(points, -1, 0)
    axes, one = len(along), np.ones(points.shape[:-1])
    if simplex(nodes, axes):
        columns = [[-one, *((one if i == axis else 0.0 * one) for i in range(axes))] for axis in range(axes)]
    else:
        columns = [
            _products([(-one, one) if i == axis else (1.0 - x, x) for i, x in enumerate(along)]) for axis in range(axes)
        ]
    return np.stack([np.stack(column, axis=-1) for column in columns], axis=-1)


def _products(pairs: list[tuple[np.ndarray, np.ndarray]]) -> list[np.ndarray]:
    """Products of one member of each pair, the first pair running fastest, as dolfinx numbers the nodes."""
    found = list(pairs[0])
    for low, high in pairs[1:]:
        found = [one * low for one in found] + [one * high for one in found]
    return found


def simplex(nodes: int, axes: int) -> bool:
    """Whether cells of that many nodes are triangles or tetrahedra."""
    return nodes == axes + 1


def name(nodes: int, axes: int) -> str:
    """Name of the cells, as dolfinx has it."""
    return {(3, 2): "triangle", (4, 2): "quadrilateral", (4, 3): "tetrahedron", (8, 3): "hexahedron"}[nodes, axes]


def middle(nodes: int, axes: int) -> np.ndarray:
    """Reference coordinates (axes,) of the centre."""
    return np.full(axes, 1.0 / nodes if simplex(nodes, axes) else 0.5)


def jacobians(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """dx/dxi (..., axes, axes) of cells with corners (..., nodes, axes) at reference points (..., axes)."""
    return np.matmul(np.swapaxes(corners, -1, -2), shape_gradients(points, corners.shape[-2]))


def determinants(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Absolute value (...) of det dx/dxi."""
    rows = np.moveaxis(jacobians(corners, points), (-2, -1), (0, 1))  # written out: by elimination it takes three times as long
    if len(rows) == 2:
        (a, b), (c, d) = rows
        return np.abs(a * d - b * c)
    (a, b, c), (d, e, f), (g, h, i) = rows
    return np.abs(a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g))


def gradients(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Derivatives (..., nodes, axes) of the shape functions by x, y (and z) (1/m)."""
    reference = shape_gradients(points, corners.shape[-2])
    return np.einsum("...nj,...ji->...ni", reference, np.linalg.inv(jacobians(corners, points)))


def areas(corners: np.ndarray) -> np.ndarray:
    """Areas (cells,) of plane cells in m2."""
    ring = corners[:, RING[corners.shape[1]]]
    after = np.roll(ring, -1, axis=1)
    return 0.5 * np.abs((ring[..., 0] * after[..., 1] - ring[..., 1] * after[..., 0]).sum(axis=1))


def measures(corners: np.ndarray) -> np.ndarray:
    """Areas (cells,) in m2 or volumes in m3."""
    nodes, axes = corners.shape[1:]
    if axes == 2:
        return areas(corners)
    points, weights = _compat.quadrature_rule(name(nodes, axes), 1 if simplex(nodes, axes) else 3)
    return determinants(corners[:, None], points) @ weights


def length(measure, axes: int):
    """Edge (m) of a square or cube of a measure."""
    return np.sqrt(measure) if axes == 2 else np.cbrt(measure)


def reference_points(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Reference coordinates (k, axes) of points (k, axes), each in the cell with corners (k, nodes, axes).

    Exact for simplices; Newton's method for the others (two or three iterations; one for parallelograms). Points far
    outside a distorted cell may not converge: they give NaN.
    """
    nodes, axes = corners.shape[-2:]
    found = np.tile(middle(nodes, axes), (len(points), 1))
    scale = np.abs(corners - corners.mean(axis=-2, keepdims=True)).max(axis=(-1, -2))
    with np.errstate(all="ignore"):
        for _ in range(20):
            place = np.einsum("kn,kni->ki", shape_functions(found, nodes), corners)
            matrix, miss = jacobians(corners, found), points - place
            found = found + _solve(matrix, miss)
            if simplex(nodes, axes) or not np.any(np.abs(miss).max(axis=1) > 1e-15 * scale):
                break
        place = np.einsum("kn,kni->ki", shape_functions(found, nodes), corners)
        lost = ~(np.abs(points - place).max(axis=1) <= 1e-9 * scale)
    found[lost] = np.nan
    return found


def _solve(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solutions (k, axes) of small systems by Cramer's rule: infinite or NaN, but no error, where one is singular."""
    if matrix.shape[-1] == 2:
        det = matrix[:, 0, 0] * matrix[:, 1, 1] - matrix[:, 0, 1] * matrix[:, 1, 0]
        change = np.stack(
            (
                matrix[:, 1, 1] * right[:, 0] - matrix[:, 0, 1] * right[:, 1],
                matrix[:, 0, 0] * right[:, 1] - matrix[:, 1, 0] * right[:, 0],
            ),
            axis=-1,
        )
        return change / det[:, None]
    first, second, third = np.moveaxis(matrix, -1, 0)
    normals = np.stack((np.cross(second, third), np.cross(third, first), np.cross(first, second)), axis=1)
    return np.einsum("kai,ki->ka", normals, right) / np.einsum("ki,ki->k", first, normals[:, 0])[:, None]


def inside(reference: np.ndarray, nodes: int, tolerance: float) -> np.ndarray:
    """True (k,) where reference coordinates lie in the unit simplex or cube, edge included."""
    with np.errstate(invalid="ignore"):
        low = np.all(reference >= -tolerance, axis=-1)
        if simplex(nodes, reference.shape[-1]):
            high = reference.sum(axis=-1) <= 1 + tolerance
        else:
            high = np.all(reference <= 1 + tolerance, axis=-1)
    return low & high
