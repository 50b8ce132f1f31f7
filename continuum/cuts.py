"""Cells that a region covers wholly, partly or not at all, and quadrature over the part left uncovered.

A partly covered cell keeps the points of a standard rule; each point gets a weight such that the rule is exact on the
uncovered part (moment fitting; Mueller, Kummer & Oberlack 2013, eq. 11, here with an orthonormal basis, so that
nothing is solved). The element energy of bilinear quadrilaterals and hexahedra is g / det J^2 with g of degree 4 a direction, that of
linear simplices is of degree 2: both are integrated exactly, so a cut element never has negative energy.
"""

from __future__ import annotations

import math
from functools import reduce
from itertools import combinations_with_replacement

import numpy as np

from . import _compat, cells, pieces

CUT_DEGREE = {"triangle": 4, "quadrilateral": 8, "tetrahedron": 4, "hexahedron": 8}  # degree of the rule on cut cells
PIECE_DEGREE = 20  # on straight pieces: exact for parallelograms (8 would do), to 1e-11 for distorted quadrilaterals
SUBCELLS = 16  # a side, for regions without straight edges
TINY = 1e-9  # a smaller uncovered (covered) fraction counts as none (all)


def uncovered(corners: np.ndarray, region) -> tuple[np.ndarray, dict[int, np.ndarray]]:
    """Uncovered fraction of each cell and the weights of the partly covered ones.

    In the plane exact where the region has `corners` (k, 2), a convex polygon counter-clockwise; else by 16 x 16 (x 16) sub-cells,
    whole where `contains` is False at their middle.

    Args:
        corners: cell corners (cells, nodes, axes) in m.
        region: object with `contains(points)`, perhaps with `corners`.

    Returns:
        Fractions (cells,) in [0, 1], and for each cut cell the factors (q,) of the points of the rule of CUT_DEGREE.
    """
    if corners.shape[2] == 2 and hasattr(region, "corners"):
        fractions, parts = _by_polygon(corners, np.asarray(region.corners, dtype=float))
    else:
        fractions, parts = _by_subcells(corners, region)
    fractions = np.where(fractions < TINY, 0.0, np.where(fractions > 1.0 - TINY, 1.0, fractions))
    cut = [cell for cell in parts if 0.0 < fractions[cell] < 1.0]
    return fractions, {cell: _fitted(corners[cell], *parts[cell]) for cell in cut}


class Fit:
    """Measures on the reference cell as factors on the points of the rule of CUT_DEGREE, for any cell of one kind.

    Args:
        nodes, axes: of the cells.
        places: reference coordinates (j, axes) of the measures' points.
    """

    def __init__(self, nodes: int, axes: int, places: np.ndarray) -> None:
        name = cells.name(nodes, axes)
        self._points, weights = _compat.quadrature_rule(name, CUT_DEGREE[name])
        self._at_points, self._at_places = (_orthonormal(at, nodes, self._points, weights) for at in (self._points, places))

    def weights(self, corners: np.ndarray, masses: np.ndarray, determinants: np.ndarray) -> np.ndarray:
        """Factors (q,) that reproduce a measure on one cell.

        Args:
            corners: (nodes, axes) in m.
            masses: weights (j,) of the measure's points in m2 or m3.
            determinants: |det dx/dxi| (j,) there.
        """
        moments = self._at_places.T @ (masses / determinants**2)
        return cells.determinants(corners, self._points) * (self._at_points @ moments)


def _fitted(corners: np.ndarray, places: np.ndarray, masses: np.ndarray) -> np.ndarray:
    """Factors of one cell (nodes, axes) for a measure with weights (j,) at places (j, axes) of its own."""
    nodes, axes = corners.shape
    return Fit(nodes, axes, places).weights(corners, masses, cells.determinants(corners, places))


def _orthonormal(places, nodes, points, weights) -> np.ndarray:
    """Orthonormal polynomials at `places` (j, n): degree 2 on simplices, 4 in each direction on squares and cubes."""
    if not cells.simplex(nodes, places.shape[1]):
        scale = np.sqrt(2.0 * np.arange(5) + 1.0)
        along = [np.polynomial.legendre.legvander(2.0 * x - 1.0, 4) * scale for x in places.T]
        return reduce(lambda found, more: np.einsum("ja,jb->jab", found, more).reshape(len(places), -1), along)

    def monomials(at):
        along = at.T
        second = [x * y for x, y in combinations_with_replacement(along, 2)]
        return np.column_stack((np.ones(len(at)), *along, *second))

    values = monomials(points)
    factor = np.linalg.cholesky(values.T @ (weights[:, None] * values))
    return np.linalg.solve(factor, monomials(places).T).T


def _by_polygon(corners: np.ndarray, polygon: np.ndarray):
    """Fractions, and the uncovered measure of the cells that the polygon's outline crosses; exact."""
    edge = np.roll(polygon, -1, axis=0) - polygon
    outward = np.column_stack((edge[:, 1], -edge[:, 0])) / np.linalg.norm(edge, axis=1)[:, None]
    beyond = np.einsum("cnk,ek->cne", corners, outward) - np.einsum("ek,ek->e", polygon, outward)
    slack = 1e-12 * np.abs(polygon - polygon.mean(axis=0)).max()
    outside = np.any(np.all(beyond >= -slack, axis=1), axis=1)
    covered = np.all(beyond <= slack, axis=(1, 2))
    fractions, parts = np.where(covered, 0.0, 1.0), {}
    nodes = corners.shape[1]
    points, weights = _compat.quadrature_rule("triangle", PIECE_DEGREE)
    whole = cells.areas(corners)
    for cell in np.flatnonzero(~outside & ~covered):
        rest, outside_parts = corners[cell, cells.RING[nodes]], []
        for start, normal in zip(polygon, outward):
            outside_parts.append(_clip(rest, start, -normal))
            rest = _clip(rest, start, normal)
        triangles = [(p[0], p[i], p[i + 1]) for p in outside_parts for i in range(1, len(p) - 1)]
        if not triangles:
            fractions[cell] = 0.0
            continue
        corner = np.array(triangles)
        places = np.einsum("qn,tni->tqi", cells.shape_functions(points, 3), corner).reshape(-1, 2)
        masses = (2.0 * cells.areas(corner)[:, None] * weights).ravel()
        fractions[cell] = masses.sum() / whole[cell]
        reference = cells.reference_points(np.broadcast_to(corners[cell], (len(places), nodes, 2)), places)
        parts[int(cell)] = (reference, masses)
    return fractions, parts


def _clip(polygon: np.ndarray, start: np.ndarray, outward: np.ndarray) -> np.ndarray:
    """Part of a convex polygon (n, 2) on the inner side of a line (Sutherland & Hodgman 1974)."""
    kept = []
    height = (polygon - start) @ outward if len(polygon) else ()
    for i, point in enumerate(polygon):
        before = polygon[i - 1]
        if (height[i] <= 0) != (height[i - 1] <= 0):
            kept.append(before + (point - before) * (height[i - 1] / (height[i - 1] - height[i])))
        if height[i] <= 0:
            kept.append(point)
    return np.array(kept).reshape(-1, 2)


def _by_subcells(corners: np.ndarray, region):
    """Fractions, and the uncovered measure of the cells with both kinds of sub-cells."""
    nodes, axes = corners.shape[1:]
    middles, sizes = _subcells(nodes, axes)
    shape = cells.shape_functions(middles, nodes)
    fractions, parts = np.ones(len(corners)), {}
    for cell, corner in enumerate(corners):
        free = ~np.asarray(region.contains(shape @ corner), dtype=bool)
        if free.all():
            continue
        masses = sizes * cells.determinants(corner, middles)
        fractions[cell] = masses[free].sum() / masses.sum()
        if free.any():
            parts[cell] = (middles[free], masses[free])
    return fractions, parts


def _subcells(nodes: int, axes: int) -> tuple[np.ndarray, np.ndarray]:
    """Middles (j, axes) and measures (j,) of the sub-cells of the reference cell."""
    corner = pieces.lattice(SUBCELLS, axes)
    if not cells.simplex(nodes, axes):
        middles = corner + 0.5
    elif axes == 2:
        upward, downward = (corner[corner.sum(axis=1) < SUBCELLS - k] for k in (0, 1))
        middles = np.concatenate((upward + 1 / 3, downward + 2 / 3))
    else:
        middles = pieces.tetrahedra(SUBCELLS).mean(axis=1)
    whole = 1.0 / math.factorial(axes) if cells.simplex(nodes, axes) else 1.0
    return middles / SUBCELLS, np.full(len(middles), whole / SUBCELLS**axes)


def segment_loads(ends: np.ndarray, region) -> np.ndarray:
    """Integrals (2,) in m of the two linear shape functions over the part of a segment that no region covers.

    Exact where the region has `corners` (a segment on the outline counts as covered); else by 64 sub-cells.
    """
    length = float(np.linalg.norm(ends[1] - ends[0]))
    if region is None:
        return np.full(2, 0.5 * length)
    if hasattr(region, "corners"):
        low, high = _covered_interval(ends, np.asarray(region.corners, dtype=float))
        second = 0.5 * (1.0 - high**2 + low**2)
        return length * np.array([1.0 - (high - low) - second, second])
    middle = (np.arange(64) + 0.5) / 64
    free = ~np.asarray(region.contains(ends[0] + middle[:, None] * (ends[1] - ends[0])), dtype=bool)
    return length / 64 * np.array([np.sum(1.0 - middle[free]), np.sum(middle[free])])


def _covered_interval(ends: np.ndarray, polygon: np.ndarray) -> tuple[float, float]:
    """Part (low, high) of a segment, as fractions of its length, inside a convex polygon; (0, 0) where there is none."""
    low, high = 0.0, 1.0
    edge = np.roll(polygon, -1, axis=0) - polygon
    outward = np.column_stack((edge[:, 1], -edge[:, 0])) / np.linalg.norm(edge, axis=1)[:, None]
    slack = TINY * np.abs(polygon - polygon.mean(axis=0)).max()
    for start, normal in zip(polygon, outward):
        first, last = (ends - start) @ normal
        if first > slack and last > slack:
            return 0.0, 0.0
        if first > slack:
            low = max(low, first / (first - last))
        elif last > slack:
            high = min(high, first / (first - last))
    return (low, high) if high > low else (0.0, 0.0)
