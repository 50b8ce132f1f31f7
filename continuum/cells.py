"""Linear triangles and bilinear quadrilaterals in numpy: shape functions, maps and their inverse."""

from __future__ import annotations

import numpy as np

RING = {3: [0, 1, 2], 4: [0, 1, 3, 2]}  # nodes around a cell; dolfinx numbers quadrilaterals as a tensor product


def shape_functions(points: np.ndarray, nodes: int) -> np.ndarray:
    """Values (..., nodes) of the shape functions at reference points (..., 2) of the unit triangle or square."""
    x, y = points[..., 0], points[..., 1]
    if nodes == 3:
        return np.stack((1.0 - x - y, x, y), axis=-1)
    return np.stack(((1.0 - x) * (1.0 - y), x * (1.0 - y), (1.0 - x) * y, x * y), axis=-1)


def shape_gradients(points: np.ndarray, nodes: int) -> np.ndarray:
    """Derivatives (..., nodes, 2) of the shape functions by the reference coordinates."""
    x, y = points[..., 0], points[..., 1]
    one = np.ones_like(x)
    if nodes == 3:
        by_x, by_y = [-one, one, 0 * one], [-one, 0 * one, one]
    else:
        by_x, by_y = [y - 1.0, 1.0 - y, -y, y], [x - 1.0, -x, 1.0 - x, x]
    return np.stack((np.stack(by_x, axis=-1), np.stack(by_y, axis=-1)), axis=-1)


def jacobians(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """dx/dxi (..., 2, 2) of cells with corners (..., nodes, 2) at reference points (..., 2)."""
    return np.einsum("...ni,...nj->...ij", corners, shape_gradients(points, corners.shape[-2]))


def determinants(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Absolute value (...) of det dx/dxi."""
    return np.abs(np.linalg.det(jacobians(corners, points)))


def gradients(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Derivatives (..., nodes, 2) of the shape functions by x and y (1/m)."""
    reference = shape_gradients(points, corners.shape[-2])
    return np.einsum("...nj,...ji->...ni", reference, np.linalg.inv(jacobians(corners, points)))


def areas(corners: np.ndarray) -> np.ndarray:
    """Areas (cells,) in m2."""
    ring = corners[:, RING[corners.shape[1]]]
    after = np.roll(ring, -1, axis=1)
    return 0.5 * np.abs((ring[..., 0] * after[..., 1] - ring[..., 1] * after[..., 0]).sum(axis=1))


def reference_points(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Reference coordinates (k, 2) of points (k, 2), each in the cell with corners (k, nodes, 2).

    Exact for triangles; Newton's method for quadrilaterals (two or three iterations; one for parallelograms). Points far
    outside a distorted quadrilateral may not converge: they give NaN.
    """
    found = np.full(points.shape, 1.0 / 3.0 if corners.shape[-2] == 3 else 0.5)
    scale = np.abs(corners - corners.mean(axis=-2, keepdims=True)).max(axis=(-1, -2))
    with np.errstate(all="ignore"):
        for _ in range(20):
            place = np.einsum("kn,kni->ki", shape_functions(found, corners.shape[-2]), corners)
            matrix, miss = jacobians(corners, found), points - place
            det = matrix[:, 0, 0] * matrix[:, 1, 1] - matrix[:, 0, 1] * matrix[:, 1, 0]
            change = np.stack(
                (
                    matrix[:, 1, 1] * miss[:, 0] - matrix[:, 0, 1] * miss[:, 1],
                    matrix[:, 0, 0] * miss[:, 1] - matrix[:, 1, 0] * miss[:, 0],
                ),
                axis=-1,
            )
            found = found + change / det[:, None]
            if corners.shape[-2] == 3 or not np.any(np.abs(miss).max(axis=1) > 1e-15 * scale):
                break
        place = np.einsum("kn,kni->ki", shape_functions(found, corners.shape[-2]), corners)
        lost = ~(np.abs(points - place).max(axis=1) <= 1e-9 * scale)
    found[lost] = np.nan
    return found


def inside(reference: np.ndarray, nodes: int, tolerance: float) -> np.ndarray:
    """True (k,) where reference coordinates lie in the unit triangle or square, edge included."""
    with np.errstate(invalid="ignore"):
        low = np.all(reference >= -tolerance, axis=-1)
        high = reference.sum(axis=-1) <= 1 + tolerance if nodes == 3 else np.all(reference <= 1 + tolerance, axis=-1)
    return low & high
