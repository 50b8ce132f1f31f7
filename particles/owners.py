"""Which rank owns which particles: boxes that fill space, when particles are handed over, when boxes are cut anew."""

from __future__ import annotations

from typing import Any

import numpy as np

from particles.bisection import bisect, part_of

LIMIT = 0.2  # growth of the imbalance (busiest rank over the mean) at which the boxes are cut anew
STRAY = 2.0  # largest diameters beyond its rank's box at which a particle makes all ranks hand over what strays, or
PART = 0.2  # this share of the box's side where that is less
PAIR = 2.0  # cost of a listed pair, in that of moving a particle


class Owners:
    """The boxes of the ranks; methods are collective and give the same on every rank.

    Places are in units of their own along each axis: metres, or shares of a periodic cell's edge from 0 to 1.

    Args:
        comm: the ranks.
        limit: growth of the imbalance at which the boxes are cut anew.

    Raises:
        ValueError: a limit that is not positive.
    """

    def __init__(self, comm: Any, limit: float = LIMIT) -> None:
        if not limit > 0.0:
            raise ValueError(f"limit={limit} must be positive (growth of the imbalance)")
        self._comm, self._limit = comm, limit
        self._boxes = np.zeros((0, 2, 0))
        self._reached: float | None = None  # imbalance after the last cut
        self.cuts = self.handed = 0

    def state(self) -> dict[str, Any]:
        """Boxes and counts, to go on from."""
        reached = np.nan if self._reached is None else self._reached
        return {"boxes": self._boxes, "counts": np.array([self.cuts, self.handed]), "reached": reached}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state."""
        self._boxes, (self.cuts, self.handed) = np.array(state["boxes"]), (int(number) for number in state["counts"])
        self._reached = None if np.isnan(state["reached"]) else float(state["reached"])

    def cut(self, places: np.ndarray, weights: np.ndarray, scale: np.ndarray) -> None:
        """Cut the boxes anew.

        Args:
            places: (n, axes) of this rank, in units.
            weights: (n,) cost of each particle.
            scale: (axes,) length of a unit, m.
        """
        self._boxes = bisect(np.nan_to_num(places), self._comm.size, weights, self._comm, scale)
        self._reached = None
        self.cuts += 1

    def of(self, places: np.ndarray) -> np.ndarray:
        """Rank (n,) in whose box each place lies."""
        return part_of(self._boxes, places, self._comm.rank)

    def look(
        self, places: np.ndarray, weights: np.ndarray, scale: np.ndarray, periodic: np.ndarray, diameter: float
    ) -> np.ndarray | None:
        """Rank (n,) that is to own each particle from now on; None where all stay where they are.

        Args:
            places, weights, scale: as for `cut`.
            periodic: (axes,) where places go from 0 to 1 and on to 0.
            diameter: largest, m.
        """
        load = float(weights.sum())
        found = np.empty((self._comm.size, 2))
        self._comm.Allgather(np.array([self._beyond(places, scale, periodic, diameter), load]), found)
        imbalance = found[:, 1].max() * self._comm.size / max(found[:, 1].sum(), 1e-300) - 1.0
        if self._reached is None:
            self._reached = imbalance
        if imbalance > self._reached + self._limit:
            self.cut(places, weights, scale)
        elif not found[:, 0].max() > 1.0:
            return None
        self.handed += 1
        return self.of(places)

    def _beyond(self, places: np.ndarray, scale: np.ndarray, periodic: np.ndarray, diameter: float) -> float:
        """Largest distance of a particle from the box of this rank, over the distance allowed."""
        low, high = self._boxes[self._comm.rank]
        largest = 0.0
        for k, wraps in enumerate(periodic):
            a, b = (max(low[k], 0.0), min(high[k], 1.0)) if wraps else (low[k], high[k])
            away = np.maximum(a - places[:, k], places[:, k] - b)
            if wraps:  # the other way round may be nearer
                away = np.minimum(away, np.minimum(places[:, k] + 1.0 - b, a + 1.0 - places[:, k]))
            farthest = float(np.fmax.reduce(away, initial=0.0))
            if farthest > 0.0:
                largest = max(largest, farthest / min(STRAY * diameter / scale[k], PART * max(b - a, 1e-9)))
        return largest
