"""Broken bonds of an assembly and the pieces that are left."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components


class Cracks(NamedTuple):
    """Bonds that have broken, in the order of time."""

    time: np.ndarray  # (k,), s
    pairs: np.ndarray  # (k, 2) ids of the discs
    places: np.ndarray  # (k, 2), m
    normals: np.ndarray  # (k, 2) from disc to disc as they were bonded
    lengths: np.ndarray  # (k,) mean diameter of both, m
    energies: np.ndarray  # (k,), J

    @property
    def lines(self) -> np.ndarray:
        """Ends (k, 2, 2), m: across the bonds that were, as long as the mean diameter of their discs."""
        along = 0.5 * self.lengths[:, None] * np.column_stack([-self.normals[:, 1], self.normals[:, 0]])
        return np.stack([self.places - along, self.places + along], axis=1)


def cracks(soil: Any) -> Cracks:
    """Bonds of an assembly that have broken so far."""
    log = soil.breaks
    pairs = log[:, 1:3].astype(np.int64)
    branch = np.diff(soil.reference[pairs], axis=1)[:, 0]
    normals = branch / np.linalg.norm(branch, axis=1)[:, None]
    return Cracks(log[:, 0], pairs, log[:, 3:5], normals, soil.radii[pairs].sum(axis=1), log[:, 6])


def fragments(soil: Any) -> np.ndarray:
    """Number (n,) of the fragment that each disc belongs to over bonds that hold; 0 is the largest."""
    held, count = soil.bonds, soil.count
    links = sparse.coo_matrix((np.ones(len(held)), (held[:, 0], held[:, 1])), shape=(count, count))
    _, group = connected_components(links, directed=False)
    rank: Any = np.empty(group.max() + 1, dtype=np.int64)
    rank[np.argsort(-np.bincount(group), kind="stable")] = np.arange(group.max() + 1)
    return rank[group]
