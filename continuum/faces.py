"""Integrals of the shape functions over the facets of cells in space."""

from __future__ import annotations

import numpy as np

from . import _compat, cells, shares


def loads(corners: np.ndarray, share: shares.Share | None) -> np.ndarray:
    """Integrals (nodes,) in m2 of the shape functions, times the share where there is one, over a facet.

    Args:
        corners: of a triangle or quadrilateral (nodes, 3) in m, in the order of dolfinx.
        share: function of points (n, 3) giving the part that counts, or None for all.
    """
    nodes = len(corners)
    points, weights = _rule(nodes) if share is None else shares.composite(nodes, 2)
    shape = cells.shape_functions(points, nodes)
    tangents = np.einsum("ni,qnj->qij", corners, cells.shape_gradients(points, nodes))
    measure = weights * np.linalg.norm(np.cross(tangents[..., 0], tangents[..., 1]), axis=1)
    if share is not None:
        measure = measure * shares.values(share, shape @ corners)
    return shape.T @ measure


def _rule(nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Exact on plane facets: linear on triangles, of degree 2 in each direction (the area of quadrilaterals is linear)."""
    return _compat.quadrature_rule(cells.name(nodes, 2), 1 if nodes == 3 else 3)
