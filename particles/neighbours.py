"""Cell grid and neighbour list: CSR half list over rows sorted by cell, with skin; histories carried along."""

from __future__ import annotations

import numpy as np
from numba import njit

from particles.columns import WIDTH

ROOM = WIDTH + 8  # at least WIDTH pairs of unused room behind a list, for loops that work on whole batches


@njit(cache=True)
def cell_grid(places, width, axes):
    """Cells of at least `width` (m) over all particles, row-major, at most about four times as many as particles.

    Args:
        places: (n, >= axes) positions, m.
        axes: 2 or 3.

    Returns:
        cell of each row (n,) int32; cells along each axis (3,) int64, one along an axis that is not there.
    """
    count = places.shape[0]
    low, high = np.zeros(3), np.zeros(3)
    for k in range(axes):
        low[k] = high[k] = places[0, k]
        for i in range(count):
            low[k] = min(low[k], places[i, k])
            high[k] = max(high[k], places[i, k])
    while True:
        cells = 1.0
        for k in range(axes):
            cells *= 1.0 + (high[k] - low[k]) / width
        if cells <= 4.0 * count + 64.0:
            break
        width *= 1.5
    number = np.ones(3, dtype=np.int64)
    for k in range(axes):
        number[k] = int((high[k] - low[k]) / width) + 1
    cell = np.empty(count, dtype=np.int32)
    for i in range(count):
        at = 0
        for k in range(axes - 1, -1, -1):
            at = at * number[k] + int((places[i, k] - low[k]) / width)
        cell[i] = at
    return cell, number


@njit(cache=True)
def sort_by_cell(cell, cells):
    """Rows in order of their cells (stable), and where each cell begins."""
    start = np.zeros(cells + 1, dtype=np.int32)
    for i in range(cell.size):
        start[cell[i] + 1] += 1
    for k in range(cells):
        start[k + 1] += start[k]
    place = start[:-1].copy()
    order = np.empty(cell.size, dtype=np.int32)
    for i in range(cell.size):
        order[place[cell[i]]] = i
        place[cell[i]] += 1
    return order, start


@njit(cache=True)
def list_pairs(places, radii, ghost, width, skin, axes, capacity):
    """Half list of pairs closer than r_i + r_j + skin, without pairs of two ghosts.

    Args:
        places: (n, >= axes) rows, m.
        radii: (n,), m.
        ghost: (n,) bool.
        width: cell width, at least 2 r_max + skin (m).
        axes: 2 or 3.
        capacity: room for pairs; grown on demand.

    Returns:
        start (n + 1,) int32; first and second (pairs and some room,) int32, partners second > first.
    """
    count = places.shape[0]
    start = np.zeros(count + 1, dtype=np.int32)
    partner = np.empty(capacity, dtype=np.int32)
    found = 0
    if count > 0:
        cell, number = cell_grid(places, width, axes)
        order, cell_start = sort_by_cell(cell, number[0] * number[1] * number[2])
        for i in range(count):
            reach = radii[i] + skin
            column = cell[i] % number[0]
            line = (cell[i] // number[0]) % number[1]
            layer = cell[i] // (number[0] * number[1])
            left, right = max(column - 1, 0), min(column + 1, number[0] - 1)
            for above in range(max(layer - 1, 0), min(layer + 2, number[2])):
                for other in range(max(line - 1, 0), min(line + 2, number[1])):
                    row = (above * number[1] + other) * number[0]
                    for place in range(cell_start[row + left], cell_start[row + right + 1]):
                        j = order[place]
                        if j <= i:
                            continue
                        square = 0.0
                        for k in range(axes):
                            square += (places[j, k] - places[i, k]) ** 2
                        limit = reach + radii[j]
                        if square < limit * limit and not (ghost[i] and ghost[j]):
                            if found == partner.size:
                                grown = np.empty(2 * found + 16, dtype=np.int32)
                                grown[:found] = partner
                                partner = grown
                            partner[found] = j
                            found += 1
            start[i + 1] = found
    room = (found + ROOM) // 8 * 8
    first = np.zeros(room, dtype=np.int32)
    second = np.zeros(room, dtype=np.int32)
    second[:found] = partner[:found]
    for i in range(count):
        first[start[i] : start[i + 1]] = i
    return start, first, second


@njit(cache=True)
def carry_history(start, second, history, old_start, old_second, old_history, old_row_of, signs):
    """Copy contact histories (columns, pairs) from the old list.

    Args:
        old_row_of: (n,) old row of each new row.
        signs: (columns,) factor for a pair whose order was exchanged.
    """
    for i in range(start.size - 1):
        old_i = old_row_of[i]
        for pair in range(start[i], start[i + 1]):
            old_j = old_row_of[second[pair]]
            low, high = min(old_i, old_j), max(old_i, old_j)
            for old in range(old_start[low], old_start[low + 1]):
                if old_second[old] == high:
                    for column in range(history.shape[0]):
                        sign = 1.0 if low == old_i else signs[column]
                        history[column, pair] = sign * old_history[column, old]
                    break


@njit(cache=True)
def largest_distance(places, before):
    """Largest distance (m) of the rows' present positions from `before` (n, axes)."""
    largest = 0.0
    for i in range(before.shape[0]):
        square = 0.0
        for k in range(before.shape[1]):
            square += (places[i, k] - before[i, k]) ** 2
        largest = max(largest, square)
    return np.sqrt(largest)
