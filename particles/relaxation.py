"""Discs or spheres that push each other apart: neighbour list, harmonic contact forces, descent to equilibrium.

Unit stiffness, so that a force is an overlap (m). One source for two and three dimensions: `axes`, a tuple of as many
numbers as there are dimensions, makes the inner loops compile with their length known. Arrays are (n, axes).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

FAST = {"contract", "arcp", "nsz", "nnan", "ninf"}  # LLVM may contract and use reciprocals; there are no NaNs here
LONGEST_STEP, SHORTEST_STEP = 0.5, 0.02  # of FIRE; a unit mass on a dozen unit springs is stable below 0.58


class Planes(NamedTuple):
    """Tangent planes of the outline, for the particles near it: the overlap is normal . x - offset + radius."""

    row: Any  # (planes,) int32: particle
    normal: Any  # (planes, axes) outward unit normals
    offset: Any  # (planes,) m


@njit(cache=True)
def sort_by_cell(places, lower, upper, width, axes):
    """Cells of at least `width` (m) over a box, at most about four times as many as particles.

    Returns:
        Cells along each axis (3,), order of the particles by cell (n,) int32, where each cell begins in it.
    """
    count = places.shape[0]
    cells = np.ones(3, dtype=np.int64)
    total = 4.0 * count + 65.0
    while total > 4.0 * count + 64.0:
        total = 1.0
        for c in range(len(axes)):
            cells[c] = max(1, int((upper[c] - lower[c]) / width))
            total *= cells[c]
        width *= 1.2
    cell = np.empty(count, dtype=np.int32)
    for i in range(count):
        index = 0
        for c in range(len(axes) - 1, -1, -1):
            place = int((places[i, c] - lower[c]) / (upper[c] - lower[c]) * cells[c])
            index = index * cells[c] + min(max(place, 0), cells[c] - 1)
        cell[i] = index
    start = np.zeros(cells[0] * cells[1] * cells[2] + 1, dtype=np.int32)
    for i in range(count):
        start[cell[i] + 1] += 1
    for k in range(start.size - 1):
        start[k + 1] += start[k]
    free = start[:-1].copy()
    order = np.empty(count, dtype=np.int32)
    for i in range(count):
        order[free[cell[i]]] = i
        free[cell[i]] += 1
    return cells, order, start


@njit(cache=True)
def list_pairs(places, radii, cells, start, period, skin, axes):
    """Half list (CSR) of pairs closer than r_i + r_j + skin; the particles are sorted by cell.

    Args:
        cells, start: of `sort_by_cell`, cells at least 2 r_max + skin wide.
        period: (axes,) width of the periodic box (m), 0 where it is not periodic.

    Returns:
        first (n + 1,) int32 and second (pairs,) int32: partners of i are second[first[i]:first[i + 1]], each pair once.
    """
    count = places.shape[0]
    first = np.zeros(count + 1, dtype=np.int32)
    second = np.empty(8 * count + 64, dtype=np.int32)
    found = 0
    for home in range(start.size - 1):
        cx = home % cells[0]
        cy = home // cells[0] % cells[1]
        cz = home // (cells[0] * cells[1])
        for i in range(start[home], start[home + 1]):
            for shift in range(3 ** len(axes)):
                x = cx + shift % 3 - 1
                y = cy + shift // 3 % 3 - 1
                z = cz + (shift // 9 - 1 if len(axes) == 3 else 0)
                wrapped = True
                for c in range(len(axes)):
                    place = x if c == 0 else (y if c == 1 else z)
                    if place < 0 or place >= cells[c]:
                        wrapped = wrapped and period[c] > 0.0
                if not wrapped:
                    continue
                other = (z % cells[2] * cells[1] + y % cells[1]) * cells[0] + x % cells[0]
                for j in range(max(start[other], i + 1), start[other + 1]):
                    square = 0.0
                    for c in range(len(axes)):
                        b = abs(places[j, c] - places[i, c])
                        b = min(b, abs(period[c] - b)) if period[c] > 0.0 else b
                        square += b * b
                    reach = radii[i] + radii[j] + skin
                    if square < reach * reach:
                        if found == second.size:
                            grown = np.empty(2 * found, dtype=np.int32)
                            grown[:found] = second
                            second = grown
                        second[found] = j
                        found += 1
            first[i + 1] = found
    return first, second[:found].copy()


@njit(cache=True, fastmath=FAST)
def push_apart(force, places, radii, first, second, period, planes, axes):
    """Forces (n, axes) of overlapping pairs and planes; sum of overlaps (m) and number of contacts."""
    force[:] = 0.0
    overlaps = 0.0
    contacts = 0
    for i in range(places.shape[0]):
        for pair in range(first[i], first[i + 1]):
            j = second[pair]
            square = 0.0
            for c in range(len(axes)):
                b = places[j, c] - places[i, c]
                if period[c] > 0.0:
                    b -= period[c] * np.rint(b / period[c])
                square += b * b
            reach = radii[i] + radii[j]
            if square < reach * reach:
                distance = math.sqrt(square)
                push = (reach - distance) / distance
                overlaps += reach - distance
                contacts += 1
                for c in range(len(axes)):
                    b = places[j, c] - places[i, c]
                    if period[c] > 0.0:
                        b -= period[c] * np.rint(b / period[c])
                    force[i, c] -= push * b
                    force[j, c] += push * b
    for k in range(planes.row.size):
        i = planes.row[k]
        overlap = radii[i] - planes.offset[k]
        for c in range(len(axes)):
            overlap += planes.normal[k, c] * places[i, c]
        if overlap > 0.0:
            overlaps += overlap
            contacts += 1
            for c in range(len(axes)):
                force[i, c] -= overlap * planes.normal[k, c]
    return overlaps, contacts


@njit(cache=True, fastmath=FAST)
def _power(velocity, force):
    """Power, sum of squared forces, sum of squared velocities."""
    power = 0.0
    forces = 0.0
    speeds = 0.0
    for i in range(force.shape[0]):
        for c in range(force.shape[1]):
            power += force[i, c] * velocity[i, c]
            forces += force[i, c] * force[i, c]
            speeds += velocity[i, c] * velocity[i, c]
    return power, forces, speeds


@njit(cache=True, fastmath=FAST)
def _move(places, velocity, force, keep, push, step, axes):
    """Velocities become keep * v + push * F, the particles move on by `step`; largest speed."""
    fastest = 0.0
    for i in range(places.shape[0]):
        square = 0.0
        for c in range(len(axes)):
            velocity[i, c] = keep * velocity[i, c] + push * force[i, c]
            places[i, c] += step * velocity[i, c]
            square += velocity[i, c] * velocity[i, c]
        fastest = max(fastest, square)
    return math.sqrt(fastest)


@njit(cache=True)
def _farthest(places, listed, axes):
    """Largest distance (m) of a particle from where it was listed."""
    farthest = 0.0
    for i in range(places.shape[0]):
        square = 0.0
        for c in range(len(axes)):
            square += (places[i, c] - listed[i, c]) ** 2
        farthest = max(farthest, square)
    return math.sqrt(farthest)


@njit(cache=True)
def descend(
    places, velocity, force, radii, first, second, period, planes, control, reach, most, tolerance, loose, axes
):
    """FIRE (Bitzek et al. 2006) until the unbalanced force (root mean square) is `tolerance` times the mean contact force.

    Args:
        control: (3,) step, mixing and number of steps since the last turn of FIRE; kept between calls.
        reach: distance (m) that a particle may move before the list must be renewed.
        most: largest number of steps.
        loose: mean overlap of the contacts (m) below which there is no jam.

    Returns:
        Steps made, mean overlap of the contacts (m), whether it has settled or is loose.
    """
    listed = places.copy()
    travel = 0.0
    mean = 0.0
    for sweep in range(most):
        overlaps, contacts = push_apart(force, places, radii, first, second, period, planes, axes)
        mean = overlaps / max(contacts, 1)
        power, forces, speeds = _power(velocity, force)
        if forces <= places.shape[0] * (tolerance * mean) ** 2 or mean < loose:
            return sweep, mean, True
        step, mix = control[0], control[1]
        if power > 0.0:
            keep, push = 1.0 - mix, mix * math.sqrt(speeds / forces) + step
            control[2] += 1.0
            if control[2] > 5.0:
                control[0] = min(1.1 * step, LONGEST_STEP)
                control[1] *= 0.99
        else:
            keep, push = 0.0, step
            control[2] = 0.0
            control[0] = max(0.5 * step, SHORTEST_STEP)
            control[1] = 0.1
        travel += step * _move(places, velocity, force, keep, push, step, axes)
        if travel > reach:
            travel = _farthest(places, listed, axes)
        if travel > 0.8 * reach:
            return sweep + 1, mean, False
    return most, mean, False
