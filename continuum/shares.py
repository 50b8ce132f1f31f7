"""Quadrature for a body that carries only a share of everything, where particles carry the rest."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from . import _compat, cells, cuts

SPLIT = 8  # pieces along an edge of a cell in which the share varies: a kink of the share is met to 1e-3 of the cell
LOOK = 4  # points along an edge at which a cell is looked at first
Share = Callable[[np.ndarray], np.ndarray]


def weighted(corners: np.ndarray, share: Share) -> tuple[np.ndarray, dict[int, np.ndarray]]:
    """Mean share of each cell and the weights of those in which it is not all or nothing.

    Exact where the share is linear in a cell that is a triangle or parallelogram.

    Args:
        corners: cell corners (cells, nodes, 2) in m.
        share: function of points (n, 2) giving numbers (n,) from 0 to 1.

    Returns:
        Mean shares (cells,), and for each cell with a weight the factors (q,) of the points of the rule of CUT_DEGREE.

    Raises:
        ValueError: the share has another shape or leaves [0, 1].
    """
    nodes = corners.shape[1]
    look = cells.shape_functions(_grid(nodes), nodes)
    seen = _values(share, np.einsum("qn,cnk->cqk", look, corners).reshape(-1, 2)).reshape(len(corners), -1)
    fractions = np.where(seen.min(axis=1, initial=1.0) > 0.5, 1.0, 0.0)
    weights = {}
    points, areas = _composite(nodes)
    shape = cells.shape_functions(points, nodes)
    for cell in np.flatnonzero(np.any((seen > cuts.TINY) & (seen < 1.0 - cuts.TINY), axis=1) | (np.ptp(seen, axis=1) > 0.5)):
        masses = areas * cells.determinants(corners[cell], points)
        carried = masses * _values(share, shape @ corners[cell])
        fractions[cell] = carried.sum() / masses.sum()
        if cuts.TINY < fractions[cell] < 1.0 - cuts.TINY:
            weights[int(cell)] = cuts.point_weights(corners[cell], points, carried)
        else:
            fractions[cell] = round(fractions[cell])
    return fractions, weights


def segment_loads(ends: np.ndarray, share: Share) -> np.ndarray:
    """Integrals (2,) in m of the share times the two linear shape functions over a segment (ends (2, 2) in m)."""
    place, weight = np.polynomial.legendre.leggauss(4)
    along = ((np.arange(SPLIT)[:, None] + 0.5 * (1.0 + place)) / SPLIT).ravel()
    weight = np.tile(0.5 * weight / SPLIT, SPLIT) * _values(share, ends[0] + along[:, None] * (ends[1] - ends[0]))
    return float(np.linalg.norm(ends[1] - ends[0])) * np.array([weight @ (1.0 - along), weight @ along])


def _values(share: Share, points: np.ndarray) -> np.ndarray:
    values = np.asarray(share(points), dtype=float)
    if values.shape != (len(points),) or not np.all((values >= 0.0) & (values <= 1.0)):
        raise ValueError(f"share={share} must give one number from 0 to 1 for each point (n, 2)")
    return values


def _grid(nodes: int) -> np.ndarray:
    """Reference points (q, 2) on a grid over the cell, corners included."""
    x, y = (a.ravel() for a in np.meshgrid(*2 * [np.arange(LOOK + 1) / LOOK], indexing="ij"))
    kept = x + y <= 1.0 if nodes == 3 else x >= 0.0
    return np.column_stack((x[kept], y[kept]))


def _composite(nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (q, 2) and weights (q,) of the rule of CUT_DEGREE on each of SPLIT x SPLIT pieces of the reference cell."""
    points, weights = _compat.quadrature_rule("triangle" if nodes == 3 else "quadrilateral", cuts.CUT_DEGREE[nodes])
    x, y = (a.ravel() for a in np.meshgrid(np.arange(SPLIT), np.arange(SPLIT), indexing="ij"))
    corner = np.column_stack((x, y))
    if nodes == 3:
        upward, downward = corner[x + y < SPLIT], corner[x + y < SPLIT - 1]
        pieces = np.concatenate((upward[:, None] + points, downward[:, None] + 1.0 - points))
    else:
        pieces = corner[:, None] + points
    return pieces.reshape(-1, 2) / SPLIT, np.tile(weights / SPLIT**2, len(pieces))
