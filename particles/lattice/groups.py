"""Rows that one loop may take together: bonds of one stiffness around each, and the limits at which any of them may break."""

from __future__ import annotations

import numpy as np
from numba import njit

from particles.system import STEPS

MOST = 4096  # groups


@njit(**STEPS)
def _find(near, material, alike, limits, group, kinds, table):
    """Write the group of each row, and of each group the class of stiffness and the limits; the number of groups."""
    found = 0
    for i in range(len(group)):
        x, y = limits[material[i], 0], limits[material[i], 1]
        for k in range(near.shape[1]):
            if near[i, k] >= 0:
                x = min(x, limits[material[near[i, k]], 0])
                y = min(y, limits[material[near[i, k]], 1])
        q = 0
        while q < found and not (kinds[q] == alike[i] and table[q, 0] == x and table[q, 1] == y):
            q += 1
        if q == found:
            if found == len(kinds):
                return -1
            kinds[q], table[q, 0], table[q, 1] = alike[i], x, y
            found += 1
        group[i] = q
    return found


def groups(
    near: np.ndarray, material: np.ndarray, springs: np.ndarray, limits: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Class of stiffness (n,) of each row, its group (n,), and the smallest limits (groups, 2) of a row and its neighbours, m.

    Materials that differ by their limits alone are of one class.

    Args:
        near: (n, directions) int32, -1 where there is no neighbour.
        material: (n,) uint8.
        springs: (materials, 2) normal and shear stiffness, N/m.
        limits: (materials, 2) deformations at which bonds break, m, or None.

    Raises:
        ValueError: there are more groups than loops can tell apart.
    """
    alike = np.unique(springs, axis=0, return_inverse=True)[1].reshape(-1).astype(np.uint8)[material]
    if limits is None:
        return alike, alike.astype(np.uint16), None
    group, kinds, table = np.zeros(len(near), dtype=np.uint16), np.zeros(MOST, dtype=np.uint8), np.zeros((MOST, 2))
    found = _find(near, material, alike, limits, group, kinds, table)
    if found < 0:
        raise ValueError(f"material: limits of neighbours meet in more than {MOST} ways; take fewer materials of different limits")
    return alike, group, table[:found].copy()
