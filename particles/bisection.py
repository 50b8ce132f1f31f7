"""Parts of a cloud of points with equal weights, by recursive coordinate bisection."""

from __future__ import annotations

import numpy as np


def bisect(places: np.ndarray, parts: int, weights: np.ndarray | None = None) -> np.ndarray:
    """Number of the part (n,) that each point belongs to, 0 to parts - 1 (Berger & Bokhari 1987).

    The points are cut along the longest side of their box into shares of weight that go with the numbers of parts on either
    side, and so on. Points in one place along that side go by their order: every point has one part on every rank.

    Args:
        places: (n, axes), m.
        parts: how many; some stay empty where there are fewer points.
        weights: (n,), not negative; all alike by default.
    """
    found = np.zeros(len(places), dtype=np.int64)
    weights = np.ones(len(places)) if weights is None else np.asarray(weights, dtype=float)
    _split(np.asarray(places, dtype=float), weights, np.arange(len(places)), 0, parts, found)
    return found


def _split(places: np.ndarray, weights: np.ndarray, some: np.ndarray, first: int, parts: int, found: np.ndarray) -> None:
    if parts == 1 or not len(some):
        found[some] = first
        return
    axis = int(np.argmax(np.ptp(places[some], axis=0)))
    some = some[np.argsort(places[some, axis], kind="stable")]
    lower = parts // 2
    sums = np.cumsum(weights[some])
    cut = int(np.searchsorted(sums - 0.5 * weights[some], sums[-1] * lower / parts))
    _split(places, weights, some[:cut], first, lower, found)
    _split(places, weights, some[cut:], first + lower, parts - lower, found)
