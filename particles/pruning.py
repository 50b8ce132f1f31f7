"""Near pairs out of a list that reaches farther: lists with a thin skin for a fifth of the price of a search.

A neighbour list lasts until something has moved by half its skin, and pairs in a gap cost as much in every step as those that
touch. So two lists are kept (as in Pall & Hess 2013, section 2.5): an outer one by the cell grid, and the list that the
loops take, pruned from it as often as the motion asks for.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from particles.cell import image_in_plane, image_in_space, image_numbers
from particles.dispatch import Direct
from particles.neighbours import ROOM
from particles.system import OUTER, RADIUS, STEPS


class OuterList(NamedTuple):
    """Pairs within a wide skin (half list, partners in ascending order), and where the rows were when it was built."""

    ids: np.ndarray  # (n,) of the rows then, the very array: rows that are sorted anew get another
    start: np.ndarray  # (n + 1,) int32
    second: np.ndarray  # (pairs and some room,) int32
    skin: float  # m
    places: np.ndarray  # (n, axes) m
    cell: Any  # None or the periodic cell, `listed` as it was then


@Direct
@njit(**OUTER)
def prune(start, second, position, axes, skin, cell):
    """Pairs of a half list that are closer than r_i + r_j + skin now, in the same order.

    Args:
        start, second: (n + 1,) and (pairs and some room,) int32.
        position: (n, 4) rows; skin: m; cell: None or the periodic cell.

    Returns:
        start, first and second of the near ones, as of `particles.neighbours.list_pairs`.
    """
    count, image = position.shape[0], image_numbers(cell)
    first, partner = np.empty(start[count] + 1, dtype=np.int32), np.empty(start[count] + 1, dtype=np.int32)
    begin = np.zeros(count + 1, dtype=np.int32)
    found = 0
    for i in range(count):
        x, y, z, radius = position[i, 0], position[i, 1], position[i, 2], position[i, RADIUS]
        for k in range(start[i], start[i + 1]):
            j = second[k]
            bx, by, bz = position[j, 0] - x, position[j, 1] - y, position[j, 2] - z
            if axes == 2:
                bx, by, _, _ = image_in_plane(image, bx, by)
                bz = 0.0
            else:
                (bx, by, bz), _ = image_in_space(image, (bx, by, bz))
            limit = radius + position[j, RADIUS] + skin
            first[found], partner[found] = i, j
            found += int(bx * bx + by * by + bz * bz < limit * limit)
        begin[i + 1] = found
    room = (found + ROOM) // 8 * 8
    rows, partners = np.zeros(room, dtype=np.int32), np.zeros(room, dtype=np.int32)
    rows[:found], partners[:found] = first[:found], partner[:found]
    return begin, rows, partners


@Direct
@njit(**OUTER)
def near(pairs, position, axes, skin, cell):
    """Which pairs (2, k) of rows are closer than r_i + r_j + skin now: (k,) bools; the rest as for `prune`."""
    image = image_numbers(cell)
    found = np.empty(pairs.shape[1], dtype=np.bool_)
    for k in range(found.size):
        i, j = pairs[0, k], pairs[1, k]
        bx, by, bz = position[j, 0] - position[i, 0], position[j, 1] - position[i, 1], position[j, 2] - position[i, 2]
        if axes == 2:
            bx, by, _, _ = image_in_plane(image, bx, by)
            bz = 0.0
        else:
            (bx, by, bz), _ = image_in_space(image, (bx, by, bz))
        limit = position[i, RADIUS] + position[j, RADIUS] + skin
        found[k] = bx * bx + by * by + bz * bz < limit * limit
    return found


@njit(**OUTER)
def match(start, second, old_start, old_second):
    """Where each pair of a list is in another of the same rows, -1 for none (pairs,); partners ascend in both."""
    places = np.empty(start[-1], dtype=np.int32)
    for i in range(start.size - 1):
        old, last = old_start[i], old_start[i + 1]
        for k in range(start[i], start[i + 1]):
            while old < last and old_second[old] < second[k]:
                old += 1
            places[k] = old if old < last and old_second[old] == second[k] else -1
    return places


@njit(**STEPS)
def carry_along(places, history, old_history):
    """Copy contact histories (columns, pairs) from where `match` says."""
    for column in range(history.shape[0]):
        into, out = history[column], old_history[column]
        for k in range(places.size):
            old = places[k]
            into[k] = out[old] if old >= 0 else 0.0
