"""Quadrature for a body that carries only a share of everything, where particles carry the rest."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from . import _compat, cells, cuts, pieces

SPLIT = {2: 8, 3: 4}  # pieces along an edge of a cell in which the share varies, by axes: in the plane a kink of the share is
# met to 1e-3 of the cell
LOOK = 4  # points along an edge at which a cell is looked at first
Share = Callable[[np.ndarray], np.ndarray]


def weighted(corners: np.ndarray, share: Share) -> tuple[np.ndarray, dict[int, np.ndarray]]:
    """Mean share of each cell and the weights of those in which it is not all or nothing.

    Exact where the share is linear in a cell that is a simplex, a parallelogram or a parallelepiped.

    Args:
        corners: cell corners (cells, nodes, axes) in m.
        share: function of points (n, axes) giving numbers (n,) from 0 to 1.

    Returns:
        Mean shares (cells,), and for each cell with a weight the factors (q,) of the points of the rule of CUT_DEGREE.

    Raises:
        ValueError: the share has another shape or leaves [0, 1].
    """
    nodes, axes = corners.shape[1:]
    look = cells.shape_functions(_grid(nodes, axes), nodes)
    seen = values(share, np.einsum("qn,cnk->cqk", look, corners).reshape(-1, axes)).reshape(-1, len(look))
    fractions = np.where(seen.min(axis=1, initial=1.0) > 0.5, 1.0, 0.0)
    weights = {}
    points, sizes = composite(nodes, axes)
    shape, fit = cells.shape_functions(points, nodes), cuts.Fit(nodes, axes, points)
    for cell in np.flatnonzero(np.any((seen > cuts.TINY) & (seen < 1.0 - cuts.TINY), axis=1) | (np.ptp(seen, axis=1) > 0.5)):
        determinants = cells.determinants(corners[cell], points)
        masses = sizes * determinants
        carried = masses * values(share, shape @ corners[cell])
        fractions[cell] = carried.sum() / masses.sum()
        if cuts.TINY < fractions[cell] < 1.0 - cuts.TINY:
            weights[int(cell)] = fit.weights(corners[cell], carried, determinants)
        else:
            fractions[cell] = round(fractions[cell])
    return fractions, weights


def segment_loads(ends: np.ndarray, share: Share) -> np.ndarray:
    """Integrals (2,) in m of the share times the two linear shape functions over a segment (ends (2, 2) in m)."""
    place, weight = np.polynomial.legendre.leggauss(4)
    split = SPLIT[2]
    along = ((np.arange(split)[:, None] + 0.5 * (1.0 + place)) / split).ravel()
    weight = np.tile(0.5 * weight / split, split) * values(share, ends[0] + along[:, None] * (ends[1] - ends[0]))
    return float(np.linalg.norm(ends[1] - ends[0])) * np.array([weight @ (1.0 - along), weight @ along])


def values(share: Share, points: np.ndarray) -> np.ndarray:
    """The share at points, checked."""
    found = np.asarray(share(points), dtype=float)
    if found.shape != (len(points),) or not np.all((found >= 0.0) & (found <= 1.0)):
        raise ValueError(f"share={share} must give one number from 0 to 1 for each point (n, {points.shape[1]})")
    return found


def _grid(nodes: int, axes: int) -> np.ndarray:
    """Reference points (q, axes) on a grid over the cell, corners included."""
    grid = pieces.lattice(LOOK + 1, axes) / LOOK
    return grid[grid.sum(axis=1) <= 1.0] if cells.simplex(nodes, axes) else grid


def composite(nodes: int, axes: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (q, axes) and weights (q,) of the rule of CUT_DEGREE on each of SPLIT^axes pieces of the reference cell."""
    name, split = cells.name(nodes, axes), SPLIT[axes]
    points, weights = _compat.quadrature_rule(name, cuts.CUT_DEGREE[name])
    corner = pieces.lattice(split, axes)
    if name == "triangle":
        upward, downward = corner[corner.sum(axis=1) < split], corner[corner.sum(axis=1) < split - 1]
        parts = np.concatenate((upward[:, None] + points, downward[:, None] + 1.0 - points))
    elif name == "tetrahedron":
        parts = np.einsum("qn,tni->tqi", cells.shape_functions(points, 4), pieces.tetrahedra(split))
    else:
        parts = corner[:, None] + points
    return parts.reshape(-1, axes) / split, np.tile(weights / split**axes, len(parts))
