"""Equal pieces of reference cells."""

from __future__ import annotations

from itertools import permutations

import numpy as np


def lattice(count: int, axes: int) -> np.ndarray:
    """Whole numbers (count^axes, axes) from 0 on."""
    return np.column_stack([a.ravel() for a in np.meshgrid(*axes * [np.arange(count)], indexing="ij")])


def tetrahedra(split: int) -> np.ndarray:
    """Corners (split^3, 4, 3) of equal tetrahedra that fill the one with edges of `split` along the axes.

    The six tetrahedra of every unit cube around its diagonal fill {x >= y >= z}, which a linear map takes to the reference cell.
    """
    steps = np.eye(3)[list(permutations(range(3)))]
    paths = np.concatenate((np.zeros((6, 1, 3)), np.cumsum(steps, axis=1)), axis=1)  # from a corner to the opposite one
    pieces = (lattice(split, 3)[:, None, None] + paths).reshape(-1, 4, 3)
    middle = pieces.mean(axis=1)
    inside = (split > middle[:, 0]) & (middle[:, 0] > middle[:, 1]) & (middle[:, 1] > middle[:, 2])
    x, y, z = np.moveaxis(pieces[inside], -1, 0)
    return np.stack((x - y, y - z, z), axis=-1)
