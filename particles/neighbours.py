"""Cell grid and neighbour list: CSR half list over rows sorted by cell, with skin; histories carried along."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def cell_grid(state, width):
    """Cells of at least `width` (m) over all discs, row-major, at most about four times as many as discs.

    Returns:
        cell of each row (n,) int32, number of columns, number of cells.
    """
    count = state.shape[0]
    x0 = x1 = state[0, 0]
    y0 = y1 = state[0, 1]
    for i in range(count):
        x0 = min(x0, state[i, 0])
        x1 = max(x1, state[i, 0])
        y0 = min(y0, state[i, 1])
        y1 = max(y1, state[i, 1])
    while (1.0 + (x1 - x0) / width) * (1.0 + (y1 - y0) / width) > 4.0 * count + 64.0:
        width *= 1.5
    columns = int((x1 - x0) / width) + 1
    lines = int((y1 - y0) / width) + 1
    cell = np.empty(count, dtype=np.int32)
    for i in range(count):
        cell[i] = int((state[i, 1] - y0) / width) * columns + int((state[i, 0] - x0) / width)
    return cell, columns, columns * lines


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
def list_pairs(state, ghost, width, skin, capacity):
    """Half list of pairs closer than r_i + r_j + skin, without pairs of two ghosts.

    Args:
        state: (n, 8) rows.
        ghost: (n,) bool.
        width: cell width, at least 2 r_max + skin (m).
        capacity: room for pairs; grown on demand.

    Returns:
        start (n + 1,) int32, neighbour (pairs,) int32, partners j > i, ascending by cell.
    """
    count = state.shape[0]
    start = np.zeros(count + 1, dtype=np.int32)
    neighbour = np.empty(capacity, dtype=np.int32)
    if count == 0:
        return start, neighbour[:0].copy()
    cell, columns, cells = cell_grid(state, width)
    order, cell_start = sort_by_cell(cell, cells)
    lines = cells // columns
    found = 0
    for i in range(count):
        x = state[i, 0]
        y = state[i, 1]
        reach = state[i, 5] + skin
        column = cell[i] % columns
        line = cell[i] // columns
        left = max(column - 1, 0)
        right = min(column + 1, columns - 1)
        for other in range(max(line - 1, 0), min(line + 2, lines)):
            for place in range(cell_start[other * columns + left], cell_start[other * columns + right + 1]):
                j = order[place]
                if j <= i:
                    continue
                dx = state[j, 0] - x
                dy = state[j, 1] - y
                limit = reach + state[j, 5]
                if dx * dx + dy * dy < limit * limit and not (ghost[i] and ghost[j]):
                    if found == neighbour.size:
                        grown = np.empty(2 * found + 16, dtype=np.int32)
                        grown[:found] = neighbour
                        neighbour = grown
                    neighbour[found] = j
                    found += 1
        start[i + 1] = found
    return start, neighbour[:found].copy()


@njit(cache=True)
def carry_history(start, neighbour, history, old_start, old_neighbour, old_history, old_row_of, columns_that_turn):
    """Copy contact histories from the old list.

    Args:
        old_row_of: (n,) old row of each new row.
        columns_that_turn: (channels,) factor for a pair whose order was exchanged: 1 for sliding (the tangent turns with
            the normal), -1 for rolling force and moment.
    """
    for i in range(start.size - 1):
        old_i = old_row_of[i]
        for pair in range(start[i], start[i + 1]):
            old_j = old_row_of[neighbour[pair]]
            first = min(old_i, old_j)
            second = max(old_i, old_j)
            for old in range(old_start[first], old_start[first + 1]):
                if old_neighbour[old] == second:
                    for column in range(history.shape[1]):
                        turn = 1.0 if first == old_i else columns_that_turn[column]
                        history[pair, column] = turn * old_history[old, column]
                    break


@njit(cache=True)
def largest_distance(state, positions):
    """Largest distance (m) of the rows' present positions from `positions` (n, 2)."""
    largest = 0.0
    for i in range(state.shape[0]):
        dx = state[i, 0] - positions[i, 0]
        dy = state[i, 1] - positions[i, 1]
        largest = max(largest, dx * dx + dy * dy)
    return np.sqrt(largest)
