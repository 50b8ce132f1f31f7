"""Stretches of rows whose neighbours lie in rows one after the other, too, as far as they have any, and blocks of eight rows in them.

A row that lacks a neighbour where others of its stretch have one goes without it by its bits: all that counts is that the place, as far
on as theirs, is a row of the lattice. A row whose neighbour lies elsewhere has a stray, which its bits leave out, too, and which is added by itself.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from particles.lattice.lanes import WIDTH
from particles.lattice.state import BROKEN, BROKEN_BIT, EXPLICIT, INTACT_BIT, JOINED, JOINED_BIT, SPECIAL
from particles.system import INNER, STEPS

UNKNOWN = -(2**31)  # no row of a stretch has a neighbour in the direction yet


@njit(**INNER)
def _fits(near, alike, later, i, first, to, beside):
    """Whether a row may go on with a stretch that began at row `first`; writes into `to` and `beside` what it adds.

    Neighbours that lie in the other part of the order (see `geometry.order`) may be elsewhere: they are strays.
    """
    n, ways = near.shape
    if alike[i] != alike[first]:
        return False
    for k in range(ways):
        j, on = near[i, k], to[k]
        if j < 0 or (later[j] != later[i] and on != UNKNOWN):
            on = on if on != UNKNOWN else 0
            if i + on < 0 or i + on >= n:
                return False
        else:
            tied = on != UNKNOWN and later[beside[k]] == later[i]
            if tied and (j - i != on or alike[j] != alike[beside[k]]):
                return False
            if not tied and (first + j - i < 0 or first + j - i >= n):
                return False
    for k in range(ways):
        j = near[i, k]
        if j >= 0 and (to[k] == UNKNOWN or (later[beside[k]] != later[i] and later[j] == later[i])):
            to[k], beside[k] = j - i, j
    return True


@njit(**STEPS)
def find_stretches(near, alike, group, later, number, rows, on, beside):
    """Find all stretches of at least `WIDTH` rows of one group, with bonds of one stiffness in each direction.

    Args:
        near: (n, directions) int32, -1 where there is no neighbour.
        alike, group: see `particles.lattice.groups`.
        later: (n,) bool, see `geometry.order`.
        number: (n,) int32 of each row's stretch, -1 for none; written.
        rows: (room, 2) int32 first row of each and the one after its last; written.
        on: (room + 1, directions) int32, how many rows on the neighbours lie; written.
        beside: (room + 1, directions) int32, a neighbour in each direction, -1 for none; written.

    Returns:
        How many there are.
    """
    found, i, n = 0, 0, len(near)
    while i < n:
        first, to = i, on[found]
        to[:], beside[found, :] = UNKNOWN, -1
        while i < n and group[i] == group[first] and later[i] == later[first] and _fits(near, alike, later, i, first, to, beside[found]):
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


@njit(**STEPS)
def find_strays(near, alike, number, on, beside, stray):
    """Write a bit for each neighbour of a row in a stretch that lies elsewhere than those of the stretch, or has another stiffness."""
    for i in range(len(near)):
        stray[i] = 0
        if number[i] >= 0:
            for k in range(near.shape[1]):
                j = near[i, k]
                if j >= 0 and (j - i != on[number[i], k] or alike[j] != alike[beside[number[i], k]]):
                    stray[i] |= 1 << k


class Stretches(NamedTuple):
    """Stretches of the rows of a lattice."""

    number: np.ndarray  # (n,) int32 of each row's stretch, -1 for none
    rows: np.ndarray  # (stretches, 2) int32 first row, and the one after the last
    on: np.ndarray  # (stretches, directions) int32, how many rows on the neighbours lie
    pairs: np.ndarray  # (2, stretches, directions) materials of a row and of its neighbours
    stray: np.ndarray  # (n,) int32, a bit for each neighbour that lies elsewhere


def stretches(near: np.ndarray, material: np.ndarray, alike: np.ndarray, group: np.ndarray, later: np.ndarray, wanted: bool) -> Stretches:
    """Stretches of rows; there are none where `wanted` is False. Arguments as for `find_stretches`."""
    n, ways = near.shape
    room = n // WIDTH
    number, rows, on, beside = (np.full(shape, -1, dtype=np.int32) for shape in (n, (room, 2), (room + 1, ways), (room + 1, ways)))
    found, stray = 0, np.zeros(n, dtype=np.int32)
    if wanted:
        found = find_stretches(near, alike, group, later, number, rows, on, beside)
        find_strays(near, alike, number, on, beside, stray)
    own = np.broadcast_to(material[rows[:found, :1]], (found, ways))
    there = np.where(beside[:found] >= 0, material[beside[:found]], own)
    return Stretches(number, rows[:found].copy(), on[:found].copy(), np.stack((own, there)), stray)


def springs(stiffness: np.ndarray, pairs: np.ndarray, spacing: float) -> np.ndarray:
    """Stiffnesses (stretches, 2, 18) of the bonds of stretches as the loops over blocks want them: normal ones, those of oblique bonds half,
    and d/2 times shear ones.

    Args:
        stiffness: (materials, 2) normal and shear, N/m.
        pairs: materials of both ends, see `stretches`.
    """
    mean = 0.5 * (stiffness[pairs[0]] + stiffness[pairs[1]]).transpose(0, 2, 1)
    mean[:, 0, 6:] *= 0.5
    mean[:, 1] *= 0.5 * spacing
    return np.ascontiguousarray(mean)


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
def mask_of(bonds, stray, i):
    """Bits of a row for what its bonds (n, directions) are, without strays."""
    word = np.int64(0)
    for k in range(bonds.shape[1]):
        flags = 0 if stray[i] >> k & 1 else bonds[i, k]
        if flags & JOINED:
            word |= np.int64(1) << (JOINED_BIT + k)
        if flags & EXPLICIT:
            word |= np.int64(1) << ((BROKEN_BIT if flags & BROKEN else INTACT_BIT) + k)
    return word
