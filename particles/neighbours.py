"""Cell grid and neighbour list: CSR half list over rows sorted by cell, with skin; histories carried along."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from particles.columns import WIDTH
from particles.dispatch import Direct
from particles.system import INNER, KERNEL, OUTER, RADIUS, STEPS

ROOM = WIDTH + 8  # at least WIDTH pairs of unused room behind a list, for loops that work on whole batches


class Grid(NamedTuple):
    """Cells over all particles, numbered along x, then y, then z: a place lies in cell (place - low) scale along each axis."""

    order: Any  # (n,) int32: rows by cell, in their order within a cell
    start: Any  # (cells + 1,) int32: where each cell begins in `order`
    number: Any  # (3,) int64: cells along each axis, one along an axis that is not there
    low: Any  # (3,) m; zero along an axis that repeats
    scale: Any  # (3,) cells per metre, along an axis that repeats cells per period


@njit(**INNER)
def _in_units_of(box, x, y, z):
    """Coordinates in units of the edges of a periodic cell (along other axes: lengths as they are)."""
    m = box.matrix
    c = z / m[2, 2]
    b = (y - m[1, 2] * c) / m[1, 1]
    return (x - m[0, 1] * b - m[0, 2] * c) / m[0, 0], b, c


@njit(**INNER)
def _coordinates(places, i, axes, box):
    """Where a row lies along the axes, m; from 0 to 1 along the axes of a periodic cell that repeat."""
    x, y, z = places[i, 0], places[i, 1], places[i, 2] if axes == 3 else 0.0
    if box is None:
        return x, y, z
    x, y, z = _in_units_of(box, x, y, z)
    repeats = box.repeats
    return x - repeats[0] * np.floor(x), y - repeats[1] * np.floor(y), z - repeats[2] * np.floor(z)


@njit(**INNER)
def _wraps(box, k):
    if box is None:
        return False
    return box.repeats[k] > 0.0


@njit(**STEPS)
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


@njit(**INNER)
def _place_of(coordinate, low, scale, number):
    return min(int((coordinate - low) * scale), number - 1)


@njit(**OUTER)
def grid_of(places, width, axes, box):
    """Grid of cells of at least `width` (m) over all particles, of at most about four times as many cells as particles.

    Args:
        places: (n, >= axes) positions, finite, m.
        axes: 2 or 3.
        box: None or the periodic cell, at least three widths long where it repeats.
    """
    count = places.shape[0]
    low, long = np.zeros(3), np.zeros(3)
    for k in range(axes):
        if _wraps(box, k):
            long[k] = _reach_of(box, k)
        elif count > 0:
            least = greatest = places[0, k]
            for i in range(count):
                least, greatest = min(least, places[i, k]), max(greatest, places[i, k])
            low[k], long[k] = least, greatest - least
    while True:
        cells = 1.0
        for k in range(axes):
            cells *= 1.0 + long[k] / width
        if cells <= 4.0 * count + 64.0:
            break
        width *= 1.5
    number, scale = np.ones(3, dtype=np.int64), np.zeros(3)
    for k in range(axes):
        if _wraps(box, k):
            number[k] = max(3, int(long[k] / width))
            scale[k] = number[k]
        else:
            number[k] = int(long[k] / width) + 1
            scale[k] = 1.0 / width
    cell = np.empty(count, dtype=np.int32)
    for i in range(count):
        x, y, z = _coordinates(places, i, axes, box)
        layer = _place_of(z, low[2], scale[2], number[2])
        line = layer * number[1] + _place_of(y, low[1], scale[1], number[1])
        cell[i] = line * number[0] + _place_of(x, low[0], scale[0], number[0])
    order, start = sort_by_key(cell, number[0] * number[1] * number[2])
    return Grid(order, start, number, low, scale)


@njit(**OUTER)
def sort_by_key(key, keys):
    """Rows in the order of their keys (n,), whole numbers below `keys`; stable; and where each key begins (keys + 1,)."""
    start = np.zeros(keys + 1, dtype=np.int32)
    for i in range(key.size):
        start[key[i] + 1] += 1
    for k in range(keys):
        start[k + 1] += start[k]
    place = start[:-1].copy()
    order = np.empty(key.size, dtype=np.int32)
    for i in range(key.size):
        order[place[key[i]]] = i
        place[key[i]] += 1
    return order, start


@njit(**INNER)
def _next_cell(place, step, number, wraps):
    """Neighbour of a cell along one axis (-1 beyond the ends of an axis that does not repeat), periods that it is off by."""
    other = place + step
    if 0 <= other < number:
        return other, 0
    off = -1 if other < 0 else 1
    return (other - off * number, off) if wraps else (-1, 0)


@njit(**INNER)
def _add_run(runs, shifts, found, first, last, box, x, y, z):
    """One more run of places in the order, and where its particles are seen from here: x, y, z periods away."""
    runs[found, 0], runs[found, 1] = first, last
    if box is not None:
        away = x != 0 or y != 0 or z != 0
        for c in range(3):
            shifts[found, c] = x * box.matrix[c, 0] + y * box.matrix[c, 1] + z * box.matrix[c, 2] if away else 0.0
    return found + 1


@njit(**INNER)
def _forward(grid, box, column, line, layer, runs, shifts):
    """Where in the order the cells after this one lie that touch it, as `runs` (some, 2) from, to; their number.

    Each pair of touching cells is met from one of them only. Along x neighbouring cells follow each other. The cell to the
    right is among the runs only at the end of an axis that repeats: elsewhere it follows the cell itself. In a periodic cell
    `shifts` (some, 3) are added to the places of a run, m.
    """
    start, wide, found = grid.start, grid.number[0], 0
    if column == wide - 1 and _wraps(box, 0):
        first = (layer * grid.number[1] + line) * wide
        found = _add_run(runs, shifts, 0, start[first], start[first + 1], box, 1, 0, 0)
    for up in range(2):
        above, z = _next_cell(layer, up, grid.number[2], _wraps(box, 2))
        for along in range(-1 if up else 1, 2):
            beside, y = _next_cell(line, along, grid.number[1], _wraps(box, 1))
            if above < 0 or beside < 0:
                continue
            first = (above * grid.number[1] + beside) * wide
            left, right = first + max(column - 1, 0), first + min(column + 1, wide - 1)
            found = _add_run(runs, shifts, found, start[left], start[right + 1], box, 0, y, z)
            if _wraps(box, 0) and column == 0:
                found = _add_run(runs, shifts, found, start[first + wide - 1], start[first + wide], box, -1, y, z)
            if _wraps(box, 0) and column == wide - 1:
                found = _add_run(runs, shifts, found, start[first], start[first + 1], box, 1, y, z)
    return found


@njit(**INNER)
def _home(places, i, axes, box):
    """Where a row is in the periodic cell itself, m."""
    x, y, z = _coordinates(places, i, axes, box)
    if box is None:
        return x, y, z
    m = box.matrix
    return m[0, 0] * x + m[0, 1] * y + m[0, 2] * z, m[1, 1] * y + m[1, 2] * z, m[2, 2] * z


@njit(**KERNEL)
def _add_near(at, still, a, low, high, x, y, z, reach, partner, found):
    """Write those of the rows low, low + 1, ... behind the partners found so far that are near to (x, y, z), m.

    Near: closer than the sum of their reaches, and not both still.
    """
    for b in range(low, high):
        dx, dy, dz = at[b, 0] - x, at[b, 1] - y, at[b, 2] - z
        limit = reach + at[b, 3]
        partner[found] = b
        found += int(dx * dx + dy * dy + dz * dz < limit * limit) & (1 - (still[a] & still[b]))
    return found


@njit(**OUTER)
def _partners(grid, at, still, skin, capacity, box):
    """For each place in the order: where its partners, later places, begin (n + 1,); the partners (some,)."""
    count = at.shape[0]
    begin = np.zeros(count + 1, dtype=np.int32)
    partner = np.empty(capacity, dtype=np.int32)
    runs = np.empty((14, 2), dtype=np.int64)
    shifts = np.zeros((14, 3))
    found, cell, wide = 0, 0, grid.number[0]
    for layer in range(grid.number[2]):
        for line in range(grid.number[1]):
            for column in range(wide):
                first, last = int(grid.start[cell]), int(grid.start[cell + 1])
                cell += 1
                if first == last:
                    continue
                own = int(grid.start[cell + 1]) if column < wide - 1 else last
                forward = _forward(grid, box, column, line, layer, runs, shifts)
                most = own - first
                for r in range(forward):
                    most += runs[r, 1] - runs[r, 0]
                for a in range(first, last):
                    if found + most > partner.size:
                        grown = np.empty(2 * partner.size + most, dtype=np.int32)
                        grown[:found] = partner[:found]
                        partner = grown
                    x, y, z, reach = at[a, 0], at[a, 1], at[a, 2], at[a, 3] + skin
                    found = _add_near(at, still, a, a + 1, own, x, y, z, reach, partner, found)
                    for r in range(forward):
                        found = _add_near(
                            at, still, a, runs[r, 0], runs[r, 1], x - shifts[r, 0], y - shifts[r, 1], z - shifts[r, 2], reach,
                            partner, found,
                        )  # fmt: skip
                    begin[a + 1] = found
    return begin, partner


@Direct
@njit(**OUTER)
def list_pairs(grid, places, radii, ghost, skin, axes, capacity, box):
    """Half list of pairs closer than r_i + r_j + skin, without pairs of two ghosts.

    Args:
        grid: of the places, with cells of at least 2 r_max + skin (m).
        places: (n, >= axes) rows, m.
        radii: (n,), m.
        ghost: (n,) bool.
        axes: 2 or 3.
        capacity: pairs that there may be; room grows on demand.
        box: None or the periodic cell.

    Returns:
        start (n + 1,) int32; first and second (pairs and some room,) int32, partners second > first, ascending.
    """
    count, order = places.shape[0], grid.order
    at, still = np.zeros((count, 4)), np.empty(count, dtype=np.int8)
    for a in range(count):
        i = order[a]
        at[a, 0], at[a, 1], at[a, 2] = _home(places, i, axes, box)
        at[a, 3] = radii[i]
        still[a] = ghost[i]
    begin, partner = _partners(grid, at, still, skin, capacity, box)
    found = begin[count]
    start = np.zeros(count + 1, dtype=np.int32)
    for a in range(count):
        for k in range(begin[a], begin[a + 1]):
            start[min(order[a], order[partner[k]]) + 1] += 1
    for i in range(count):
        start[i + 1] += start[i]
    room = (found + ROOM) // 8 * 8
    first, second = np.zeros(room, dtype=np.int32), np.zeros(room, dtype=np.int32)
    place = start[:-1].copy()
    for a in range(count):
        for k in range(begin[a], begin[a + 1]):
            i, j = min(order[a], order[partner[k]]), max(order[a], order[partner[k]])
            at = place[i]  # partners in ascending order, whatever the cells were
            while at > start[i] and second[at - 1] > j:
                second[at] = second[at - 1]
                at -= 1
            second[at] = j
            first[place[i]] = i
            place[i] += 1
    return start, first, second


@njit(**STEPS)
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


@njit(**STEPS)
def first_bad(position, velocity):
    """First row whose position or velocity is not finite, -1 if there is none."""
    for i in range(position.shape[0]):
        total = 0.0
        for k in range(position.shape[1]):
            total += 0.0 * (position[i, k] + velocity[i, k])
        if total != 0.0:
            return i
    return -1


@njit(**STEPS)
def largest_distance(places, before):
    """Largest distance (m) of the rows' present positions from `before` (n, axes)."""
    largest = 0.0
    for i in range(before.shape[0]):
        square = 0.0
        for k in range(before.shape[1]):
            square += (places[i, k] - before[i, k]) ** 2
        largest = max(largest, square)
    return np.sqrt(largest)


@njit(**STEPS)
def travelled(position, listed, box):
    """Largest distance (m) that a particle has moved since the list was built, beyond the deformation of a periodic cell."""
    if box is None:
        return largest_distance(position, listed)
    return _travelled_in(position, listed, box)


@njit(**OUTER)
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
