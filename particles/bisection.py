"""Parts of a cloud of weighted points by recursive coordinate bisection, points of one rank or of all together."""

from __future__ import annotations

from typing import Any

import numpy as np
from mpi4py import MPI

BINS, ROUNDS = 256, 3  # of a search for a plane: it is found to 1 / BINS^ROUNDS of the extent


def bisect(
    places: np.ndarray, parts: int, weights: np.ndarray | None = None, comm: Any = MPI.COMM_SELF, scale: Any = 1.0
) -> np.ndarray:
    """Boxes (parts, 2, axes) that fill space and hold shares of weight as even as planes allow (Berger & Bokhari 1987).

    The points are cut across the longest side of their box into shares of weight that go with the numbers of parts on either
    side, and so on. Points in one plane across that side stay together. The same on every rank (collective).

    Args:
        places: (n, axes), of this rank.
        parts: how many; some hold nothing where there are fewer points.
        weights: (n,), not negative; all alike by default.
        comm: the ranks that have points.
        scale: length of a unit along each axis, where units differ.

    Returns:
        Lower and upper corner of each box, infinite where nothing has been cut off; the upper faces belong to the next box.
    """
    places = np.asarray(places, dtype=float)
    weights = np.ones(len(places)) if weights is None else np.asarray(weights, dtype=float)
    boxes = np.empty((parts, 2, places.shape[1]))
    boxes[:, 0], boxes[:, 1] = -np.inf, np.inf
    _split(places, weights, np.asarray(scale, dtype=float), comm, boxes)
    return boxes


def part_of(boxes: np.ndarray, places: np.ndarray, default: int = 0) -> np.ndarray:
    """Number of the box (n,) that each place (n, axes) lies in; `default` for places that are no numbers."""
    found = np.full(len(places), default, dtype=np.int64)
    for part, (low, high) in enumerate(boxes):
        found[((places >= low) & (places < high)).all(axis=1)] = part
    return found


def _split(places: np.ndarray, weights: np.ndarray, scale: np.ndarray, comm: Any, boxes: np.ndarray) -> None:
    parts = len(boxes)
    if parts == 1:
        return
    extent = np.concatenate([-places.min(axis=0, initial=np.inf), places.max(axis=0, initial=-np.inf)])
    comm.Allreduce(MPI.IN_PLACE, extent, op=MPI.MAX)
    low, high = -extent[: places.shape[1]], extent[places.shape[1] :]
    axis = int(np.argmax((high - low) * scale))
    lower = parts // 2
    at = _plane(places[:, axis], weights, float(low[axis]), float(high[axis]), lower / parts, comm)
    boxes[:lower, 1, axis] = boxes[lower:, 0, axis] = at
    below = places[:, axis] < at
    _split(places[below], weights[below], scale, comm, boxes[:lower])
    _split(places[~below], weights[~below], scale, comm, boxes[lower:])


def _plane(values: np.ndarray, weights: np.ndarray, low: float, high: float, share: float, comm: Any) -> float:
    """Where to cut (the middle of a gap between points) so that about this share of the weight lies below."""
    edges: Any = np.array([low, high])
    sums: Any = np.zeros(2)
    target = 0.0
    for turn in range(ROUNDS):
        if not low < high:
            break
        edges = np.linspace(low, high, BINS + 1)
        place = np.searchsorted(edges, values, side="right")  # 0: below the edges, BINS + 1: at the last one or above
        found: np.ndarray = np.bincount(place, weights, minlength=BINS + 2)
        comm.Allreduce(MPI.IN_PLACE, found, op=MPI.SUM)
        sums = np.cumsum(found)[: BINS + 1]  # weight below each edge
        target = share * float(found.sum())
        k = min(max(int(np.searchsorted(sums, target)), 1), BINS)
        edges, sums = edges[k - 1 : k + 1], sums[k - 1 : k + 1]
        low, high = edges
    at = edges[int(np.argmin(np.abs(sums - target)))]
    gap = np.array([-values[values >= at].min(initial=np.inf), values[values < at].max(initial=-np.inf)])
    comm.Allreduce(MPI.IN_PLACE, gap, op=MPI.MAX)
    above, below = -gap[0], gap[1]
    return float(0.5 * (above + below)) if np.isfinite(gap).all() else float(above)
