"""Stretches of rows whose neighbours lie in rows one after the other, too, as far as they have any, and blocks of eight rows in them.

A row that lacks a neighbour where others of its stretch have one goes without it by its bits: all that counts is that the place, as far
on as theirs, is a row of the lattice.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from particles.lattice.lanes import WIDTH
from particles.lattice.state import BROKEN, BROKEN_BIT, EXPLICIT, INTACT_BIT, JOINED, JOINED_BIT, SPECIAL
from particles.system import INNER, STEPS

UNKNOWN = -(2**31)  # no row of a stretch has a neighbour in the direction yet


@njit(**INNER)
def _fits(near, alike, i, first, to):
    """Whether a row may go on with a stretch that began at row `first`; writes into `to` what it adds."""
    n, ways = near.shape
    for k in range(ways):
        j, on = near[i, k], to[k]
        if j >= 0 and (alike[j] != alike[i] or (on != UNKNOWN and j - i != on)):
            return False
        if j >= 0 and on == UNKNOWN and (first + j - i < 0 or first + j - i >= n):
            return False
        if j < 0 and on != UNKNOWN and (i + on < 0 or i + on >= n):
            return False
    for k in range(ways):
        if near[i, k] >= 0:
            to[k] = near[i, k] - i
    return True


@njit(**STEPS)
def find_stretches(near, alike, group, number, rows, on):
    """Find all stretches of at least `WIDTH` rows of one group, with bonds of one stiffness around each.

    Args:
        near: (n, directions) int32, -1 where there is no neighbour.
        alike, group: see `particles.lattice.groups`.
        number: (n,) int32 of each row's stretch, -1 for none; written.
        rows: (room, 2) int32 first row of each and the one after its last; written.
        on: (room + 1, directions) int32, how many rows on the neighbours lie; written.

    Returns:
        How many there are.
    """
    found, i, n = 0, 0, len(near)
    while i < n:
        first, to = i, on[found]
        to[:] = UNKNOWN
        while i < n and group[i] == group[first] and _fits(near, alike, i, first, to):
            i += 1
        if i - first >= WIDTH:
            number[first:i] = found
            rows[found, 0], rows[found, 1] = first, i
            for k in range(len(to)):
                to[k] = 0 if to[k] == UNKNOWN else to[k]
            found += 1
        else:
            number[first : max(i, first + 1)] = -1
        i = max(i, first + 1)
    return found


def stretches(near: np.ndarray, alike: np.ndarray, group: np.ndarray, wanted: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Number (n,) of each row's stretch or -1, first row and end (stretches, 2), and rows on to its neighbours (stretches, directions).

    There are none where `wanted` is False.
    """
    n, ways = near.shape
    room = n // WIDTH
    number, rows, on = (np.full(shape, -1, dtype=np.int32) for shape in (n, (room, 2), (room + 1, ways)))
    found = find_stretches(near, alike, group, number, rows, on) if wanted else 0
    return number, rows[:found].copy(), on[:found].copy()


@njit(**INNER)
def list_blocks(kind, number, stretch, first, last, blocks, rows, found, others):
    """Add blocks that hold all special rows from `first` to `last` in stretches, and the special rows elsewhere.

    Args:
        kind: (n,) uint8 of the rows.
        number, stretch: see `stretches`.
        blocks: (room, 2) int64 first row and number of the stretch; written from `found` on.
        rows: (n,) int64 special rows in no block; written from `others` on.

    Returns:
        How many blocks and rows there are.
    """
    i = first
    while i < last:
        if kind[i] != SPECIAL:
            i += 1
        elif number[i] < 0:
            rows[others] = i
            others += 1
            i += 1
        else:
            blocks[found, 0] = min(i, stretch[number[i], 1] - WIDTH)
            blocks[found, 1] = number[i]
            found += 1
            i = blocks[found - 1, 0] + WIDTH
    return found, others


@njit(**INNER)
def mask_of(bonds, i):
    """Bits of a row for what its bonds (n, directions) are."""
    word = np.int64(0)
    for k in range(bonds.shape[1]):
        flags = bonds[i, k]
        if flags & JOINED:
            word |= np.int64(1) << (JOINED_BIT + k)
        if flags & EXPLICIT:
            word |= np.int64(1) << ((BROKEN_BIT if flags & BROKEN else INTACT_BIT) + k)
    return word
