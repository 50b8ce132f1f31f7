"""Cell grid and neighbour list: CSR half list over rows sorted by cell, with skin; histories carried along."""

from __future__ import annotations

import numpy as np
from numba import njit

from particles.cell import image_in_plane, image_in_space, image_numbers
from particles.columns import WIDTH
from particles.system import INNER, OUTER, RADIUS

ROOM = WIDTH + 8  # at least WIDTH pairs of unused room behind a list, for loops that work on whole batches


@njit(**INNER)
def _in_units_of(box, x, y, z):
    """Coordinates in units of the edges of a periodic cell (along other axes: lengths as they are)."""
    m = box.matrix
    c = z / m[2, 2]
    b = (y - m[1, 2] * c) / m[1, 1]
    return (x - m[0, 1] * b - m[0, 2] * c) / m[0, 0], b, c


@njit(**INNER)
def _coordinates(places, axes, box):
    """Where each particle lies along the axes (n, 3), m; in a periodic cell from 0 to 1 along the axes that repeat."""
    found = np.zeros((places.shape[0], 3))
    for i in range(places.shape[0]):
        if box is None:
            for k in range(axes):
                found[i, k] = places[i, k]
        else:
            parts = _in_units_of(box, places[i, 0], places[i, 1], places[i, 2] if axes == 3 else 0.0)
            for k in range(axes):
                whole = np.floor(parts[k]) if box.repeats[k] > 0.0 else 0.0
                found[i, k] = parts[k] - whole
    return found


@njit(**INNER)
def _wraps(box, k):
    if box is None:
        return False
    return box.repeats[k] > 0.0


@njit(**OUTER)
def cell_width(box, k):
    """Distance between the two sides of a periodic cell along axis k, m."""
    m = box.matrix
    x, y, z = _in_units_of(box, 1.0, 0.0, 0.0), _in_units_of(box, 0.0, 1.0, 0.0), _in_units_of(box, 0.0, 0.0, 1.0)
    return 1.0 / np.sqrt(x[k] ** 2 + y[k] ** 2 + z[k] ** 2) if m[k, k] > 0.0 else 0.0


@njit(**INNER)
def _reach_of(box, k):
    if box is None:
        return 1.0
    return cell_width(box, k)


@njit(**OUTER)
def cell_grid(places, width, axes, box):
    """Cells of at least `width` (m) over all particles, row-major, at most about four times as many as particles.

    Args:
        places: (n, >= axes) positions, m.
        axes: 2 or 3.
        box: None or the periodic cell.

    Returns:
        cell of each row (n,) int32; cells along each axis (3,) int64, one along an axis that is not there.
    """
    count = places.shape[0]
    at = _coordinates(places, axes, box)
    low, long = np.zeros(3), np.zeros(3)
    for k in range(axes):
        if _wraps(box, k):
            long[k] = _reach_of(box, k)
            continue
        low[k] = high = at[0, k]
        for i in range(count):
            low[k] = min(low[k], at[i, k])
            high = max(high, at[i, k])
        long[k] = high - low[k]
    while True:
        cells = 1.0
        for k in range(axes):
            cells *= 1.0 + long[k] / width
        if cells <= 4.0 * count + 64.0:
            break
        width *= 1.5
    number = np.ones(3, dtype=np.int64)
    scale = np.zeros(3)
    for k in range(axes):
        if _wraps(box, k):
            number[k] = max(3, int(long[k] / width))
            scale[k] = number[k]
        else:
            number[k] = int(long[k] / width) + 1
            scale[k] = 1.0 / width
    cell = np.empty(count, dtype=np.int32)
    for i in range(count):
        place = 0
        for k in range(axes - 1, -1, -1):
            place = place * number[k] + min(int((at[i, k] - low[k]) * scale[k]), number[k] - 1)
        cell[i] = place
    return cell, number


@njit(**OUTER)
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


@njit(**INNER)
def _square(places, i, j, axes, image):
    """Square of the distance of two particles (of the nearest image), m2."""
    x, y = places[j, 0] - places[i, 0], places[j, 1] - places[i, 1]
    if axes == 2:
        x, y, _, _ = image_in_plane(image, x, y)
        return x * x + y * y
    (x, y, z), _ = image_in_space(image, (x, y, places[j, 2] - places[i, 2]))
    return x * x + y * y + z * z


@njit(**INNER)
def _next_cell(place, step, number, wraps):
    """Neighbour of a cell along one axis; -1 beyond the ends of an axis that does not repeat."""
    other = place + step
    if wraps:
        return other % number
    return other if 0 <= other < number else -1


@njit(**OUTER)
def list_pairs(places, radii, ghost, width, skin, axes, capacity, box):
    """Half list of pairs closer than r_i + r_j + skin, without pairs of two ghosts.

    Args:
        places: (n, >= axes) rows, m.
        radii: (n,), m.
        ghost: (n,) bool.
        width: cell width, at least 2 r_max + skin (m).
        axes: 2 or 3.
        capacity: room for pairs; grown on demand.
        box: None or the periodic cell, at least three widths long.

    Returns:
        start (n + 1,) int32; first and second (pairs and some room,) int32, partners second > first.
    """
    count = places.shape[0]
    start = np.zeros(count + 1, dtype=np.int32)
    partner = np.empty(capacity, dtype=np.int32)
    found = 0
    image = image_numbers(box)
    if count > 0:
        cell, number = cell_grid(places, width, axes, box)
        order, cell_start = sort_by_cell(cell, number[0] * number[1] * number[2])
        # along x neighbouring cells follow each other: one run of three, or cell by cell where the axis repeats
        runs = 3 if _wraps(box, 0) else 1
        for i in range(count):
            reach = radii[i] + skin
            column = cell[i] % number[0]
            line = (cell[i] // number[0]) % number[1]
            layer = cell[i] // (number[0] * number[1])
            for up in range(-1, 2):
                above = _next_cell(layer, up, number[2], _wraps(box, 2))
                for along in range(-1, 2):
                    beside = _next_cell(line, along, number[1], _wraps(box, 1))
                    if above < 0 or beside < 0:
                        continue
                    row = (above * number[1] + beside) * number[0]
                    for run in range(runs):
                        left, right = max(column - 1, 0), min(column + 1, number[0] - 1)
                        if runs == 3:
                            left = right = (column + run - 1) % number[0]
                        for place in range(cell_start[row + left], cell_start[row + right + 1]):
                            j = order[place]
                            if j <= i:
                                continue
                            limit = reach + radii[j]
                            if _square(places, i, j, axes, image) < limit * limit and not (ghost[i] and ghost[j]):
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


@njit(**OUTER)
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


@njit(**OUTER)
def largest_distance(places, before):
    """Largest distance (m) of the rows' present positions from `before` (n, axes)."""
    largest = 0.0
    for i in range(before.shape[0]):
        square = 0.0
        for k in range(before.shape[1]):
            square += (places[i, k] - before[i, k]) ** 2
        largest = max(largest, square)
    return np.sqrt(largest)


@njit(**INNER)
def travelled(position, listed, box):
    """Largest distance (m) that a particle has moved since the list was built, beyond the deformation of a periodic cell."""
    if box is None:
        return largest_distance(position, listed)
    return _travelled_in(position, listed, box)


@njit(**INNER)
def _travelled_in(position, listed, box):
    """Positions against those of the list carried along by the cell; and what the deformation does to a pair in contact."""
    now, before = box.matrix, box.listed
    carry = now @ np.linalg.inv(before)
    axes = listed.shape[1]
    largest, widest = 0.0, 0.0
    for i in range(position.shape[0]):
        square = 0.0
        for a in range(axes):
            moved = position[i, a]
            for b in range(axes):
                moved -= carry[a, b] * listed[i, b]
            square += moved * moved
        largest = max(largest, square)
        widest = max(widest, position[i, RADIUS])
    strain = 0.0
    for a in range(3):
        for b in range(3):
            strain += abs(carry[a, b] - (1.0 if a == b else 0.0))
    return np.sqrt(largest) + strain * 1.5 * widest
