"""Which rank gets which cells: shares of even cost by recursive coordinate bisection."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.sparse as sparse

Costs = Callable[[np.ndarray], np.ndarray]


class Destinations(NamedTuple):
    """Ranks that know each cell: its owner first, then those that own a cell across one of its facets."""

    ranks: np.ndarray  # (some,) int32
    start: np.ndarray  # (cells + 1,)


def destinations(corners: np.ndarray, costs: Costs | None, ranks: int) -> Destinations:
    """Where to send each cell; arguments as for `ranks_of`."""
    owner = ranks_of(corners, costs, ranks)
    cells, nodes, axes = corners.shape
    vertex = np.unique(corners.reshape(-1, axes), axis=0, return_inverse=True)[1]
    at = sparse.csr_matrix((np.ones(cells * nodes), vertex.ravel(), np.arange(0, cells * nodes + 1, nodes)))
    common = sparse.coo_matrix(at @ at.T)  # corners that two cells share; a facet has one for each axis or more
    across = (common.data > axes - 0.5) & (owner[common.row] != owner[common.col])
    cell, other = np.unique(np.column_stack([common.row[across], owner[common.col[across]]]), axis=0).T
    cell, other = np.concatenate([np.arange(cells), cell]), np.concatenate([owner, other])
    order = np.argsort(cell, kind="stable")
    return Destinations(other[order].astype(np.int32), np.searchsorted(cell[order], np.arange(cells + 1)))


def ranks_of(corners: np.ndarray, costs: Costs | None, ranks: int) -> np.ndarray:
    """Rank (cells,) of each cell.

    Cells are sorted along the longest side of the box around their middles and cut where the costs on either side go best with the
    numbers of ranks there, and so on (Berger & Bokhari 1987). Those side by side are cut too, along the other axes: a few
    heavy cells, full of particles, are then shared out as evenly as whole cells can be.

    Args:
        corners: (cells, nodes a cell, axes), m.
        costs: function of the corners giving the cost (cells,) of each cell, not negative; None for cells that are all alike.
        ranks: how many; some get nothing where there are fewer cells.

    Raises:
        ValueError: the costs have another shape or are negative.
    """
    found = np.ones(len(corners)) if costs is None else np.asarray(costs(corners), dtype=float)
    if found.shape != (len(corners),) or not np.all((found >= 0.0) & np.isfinite(found)):
        raise ValueError(f"costs={costs} must give one number, zero or positive, for each of {len(corners)} cells")
    result = np.zeros(len(corners), dtype=np.int32)
    _split(corners.mean(axis=1), found, np.arange(len(corners)), 0, ranks, result)
    return result


def _split(middles: np.ndarray, costs: np.ndarray, cells: np.ndarray, first: int, ranks: int, result: np.ndarray) -> None:
    if ranks == 1 or not len(cells):
        result[cells] = first
        return
    places = middles[cells]
    extent = np.ptp(places, axis=0)
    places = np.round(places / (1e-6 * max(extent.max(), 1e-300)))  # middles in one line are so in spite of rounding
    cells = cells[np.lexsort(places[:, np.argsort(extent, kind="stable")].T)]
    lower = ranks // 2
    sums = np.concatenate([[0.0], np.cumsum(costs[cells])])
    at = int(np.argmin(np.abs(sums - lower / ranks * sums[-1])))
    _split(middles, costs, cells[:at], first, lower, result)
    _split(middles, costs, cells[at:], first + lower, ranks - lower, result)
