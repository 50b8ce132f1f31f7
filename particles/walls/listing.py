"""Walls of an assembly as arrays, and the lists of particles near their facets."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from particles.dispatch import Direct
from particles.neighbours import Grid, sort_by_key
from particles.system import INNER, OUTER, RADIUS, STEPS, Walls
from particles.vectors import dot, minus, plus
from particles.walls.contact import closest, place_of
from particles.walls.motion import rotated, row_vector, to_reference
from particles.walls.rows import (
    BODY,
    CENTRE,
    EXTENT,
    FRAME,
    GIVEN,
    LISTED,
    NEAR,
    OWNER,
    PLACE,
    WALL,
)  # fmt: skip
from particles.walls.wall import Body, Wall

FAR = 1e300  # bounds of an infinite plane, m


def arranged(walls: list[Wall], numbers: np.ndarray, columns: int, old: Walls | None) -> Walls:
    """Arrays of all walls, which work on their rows from now on; lists and histories are those of `old`.

    Args:
        numbers: (walls, materials, numbers) constants of the laws.
        columns: of the contact history.
    """
    bodies: list[Body] = list({id(wall._body): wall._body for wall in walls}.values())
    body, rows = np.zeros((len(bodies), BODY)), np.zeros((len(walls), WALL))
    vertices, corners, normals = [], [], []
    shift = 0
    for b, one in enumerate(bodies):
        body[b] = one.row
        if not one.taken:
            body[b, GIVEN] = 0.0  # the energy that it comes with is imposed as a whole
    for k, wall in enumerate(walls):
        shape = wall.shape
        rows[k] = wall._row
        wall.attach(rows[k], body[bodies.index(wall._body)], bodies.index(wall._body))
        own = np.where(shape.corners >= 0, shape.corners + shift, -1)
        corners.append(np.column_stack([own, np.full(len(own), k)]))
        vertices.append(shape.vertices)
        normals.append(shape.normals)
        shift += len(shape.vertices)
    none = np.zeros(0, dtype=np.int32)
    return Walls(
        np.concatenate(vertices), np.ascontiguousarray(np.concatenate(corners), dtype=np.int32), np.concatenate(normals),
        numbers, np.zeros(1, dtype=np.int32) if old is None else old.start, none if old is None else old.row,
        none if old is None else old.facet, None if old is None else old.image, np.zeros((columns + 1, 0)) if old is None else old.history,
        np.zeros((1, NEAR)) if old is None else old.near, body, rows, None, np.zeros(1, dtype=np.int64),
    )  # fmt: skip


def driven(walls: list[Wall], arrays: Walls, start: float, step: float, steps: int) -> Walls:
    """The same arrays with the velocities of the coming steps where they are functions of time."""
    if not any(wall.is_driven for wall in walls):
        return arrays if arrays.drive is None else arrays._replace(drive=None)
    drive = np.zeros((steps, len(arrays.body), 12))
    for wall in {wall.owner: wall for wall in walls}.values():
        for half in (0, 1):
            times = start + step * (np.arange(steps) + 0.5 * (1 + half))
            drive[:, wall.owner, 6 * half : 6 * half + 6] = wall.prescribed(times)
    arrays.drive_step[0] = 0
    return arrays._replace(drive=drive)


def moving_arrays(walls: Walls) -> list[np.ndarray]:
    """What steps change in the walls, beside the histories."""
    return [walls.body, walls.wall, walls.drive_step]


def listed(
    walls: Walls, position: np.ndarray, axes: int, skin: float, old_row_of: np.ndarray, grid: Grid
) -> Walls:
    """The same walls with a list for the present positions, histories carried along.

    Args:
        position: (n, 4) new rows.
        skin: reach beyond contact, m.
        old_row_of: (n,) old row of each new one.
        grid: of the positions.
    """
    space = None if axes == 2 else 1
    row, facet = _near_facets(walls, position, space, grid, skin, walls.row.size + 64)
    by_row, _ = sort_by_key(row, len(position))
    row, facet = row[by_row], facet[by_row]
    start, history, largest = _carried(walls, row, facet, old_row_of)
    _set_reach(walls, position, space)
    near = np.zeros((max(1, largest), NEAR))
    return walls._replace(start=start, row=row, facet=facet, history=history, near=near)


@njit(**INNER)
def _box(walls, facet, reach, grid, first, last, lower, upper):
    """Box of a facet where it is now, wider by `reach` (m), and the first and last cell that it reaches along each axis."""
    plane = walls.corners[facet, 1] < 0
    b = int(walls.wall[walls.corners[facet, 3], OWNER])
    for k in range(3):
        lower[k], upper[k] = (-FAR, FAR) if plane else (FAR, -FAR)
    for k in range(3):
        vertex = int(walls.corners[facet, k])
        if plane or vertex < 0:
            continue
        place = row_vector(walls.body, b, PLACE)
        centre = row_vector(walls.body, b, CENTRE)
        point = rotated(walls.body, b, minus(row_vector(walls.vertices, vertex, 0), centre))
        for c in range(3):
            lower[c] = min(lower[c], point[c] + centre[c] + place[c] - reach)
            upper[c] = max(upper[c], point[c] + centre[c] + place[c] + reach)
    for c in range(3):
        end = grid.number[c] - 1
        first[c] = int(min(max((lower[c] - grid.low[c]) * grid.scale[c], 0.0), end))
        last[c] = int(min(max((upper[c] - grid.low[c]) * grid.scale[c], 0.0), end))


@njit(**OUTER)
def near_facets(walls, position, space, grid, skin, capacity):
    """Rows and facets (pairs,) closer than radius + skin, by facet.

    Args:
        space: None in the plane.
        capacity: room for pairs; grown on demand.
    """
    pairs = np.empty((2, capacity), dtype=np.int32)
    found, widest = 0, 0.0
    for i in range(position.shape[0]):
        widest = max(widest, position[i, RADIUS])
    first, last = np.zeros(3, dtype=np.int64), np.zeros(3, dtype=np.int64)
    lower, upper = np.zeros(3), np.zeros(3)
    for facet in range(walls.corners.shape[0] if position.shape[0] else 0):
        _box(walls, facet, widest + skin, grid, first, last, lower, upper)
        owner = int(walls.wall[walls.corners[facet, 3], OWNER])
        for layer in range(first[2], last[2] + 1):
            for line in range(first[1], last[1] + 1):
                row = (layer * grid.number[1] + line) * grid.number[0]
                for place in range(grid.start[row + first[0]], grid.start[row + last[0] + 1]):
                    i = int(grid.order[place])
                    reach = position[i, RADIUS] + skin
                    x = place_of(position, space, i)
                    if x[0] < lower[0] or x[1] < lower[1] or x[2] < lower[2]:
                        continue
                    if x[0] > upper[0] or x[1] > upper[1] or x[2] > upper[2]:
                        continue
                    before = to_reference(walls.body, owner, x)
                    point, _, _ = closest(walls.vertices, walls.corners, walls.normals, facet, before)
                    gap = minus(point, before)
                    if dot(gap, gap) < reach * reach:
                        if found == pairs.shape[1]:
                            grown = np.empty((2, 2 * found), dtype=np.int32)
                            grown[:, :found] = pairs
                            pairs = grown
                        pairs[0, found], pairs[1, found] = i, facet
                        found += 1
    return pairs[0, :found].copy(), pairs[1, :found].copy()


@njit(**OUTER)
def carried(walls, row, facet, old_row_of):
    """Where each group of one particle and one wall begins (groups + 1,); histories of pairs listed before; largest group."""
    start = np.empty(row.size + 1, dtype=np.int32)
    history = np.zeros((walls.history.shape[0], row.size))
    groups, largest = 0, 0
    for k in range(row.size):
        if k == 0 or row[k] != row[k - 1] or walls.corners[facet[k], 3] != walls.corners[facet[k - 1], 3]:
            start[groups] = k
            groups += 1
        largest = max(largest, k + 1 - start[groups - 1])
        old = old_row_of[row[k]]
        low, high = 0, walls.row.size  # the old list goes by row
        while low < high:
            middle = (low + high) // 2
            if walls.row[middle] < old:
                low = middle + 1
            else:
                high = middle
        while low < walls.row.size and walls.row[low] == old:
            if walls.facet[low] == facet[k]:
                for line in range(history.shape[0]):
                    history[line, k] = walls.history[line, low]
            low += 1
    start[groups] = row.size
    return start[: groups + 1].copy(), history, largest


@njit(**STEPS)
def set_reach(walls, position, space):
    """Remember where the bodies are, and how far their walls reach (planes: as far as there are particles)."""
    body = walls.body
    for b in range(body.shape[0]):
        for c in range(3):
            body[b, LISTED + c] = body[b, PLACE + c]
        for c in range(9):
            body[b, LISTED + 3 + c] = body[b, FRAME + c]
        body[b, EXTENT] = 0.0
    for facet in range(walls.corners.shape[0]):
        b = int(walls.wall[walls.corners[facet, 3], OWNER])
        centre = row_vector(body, b, CENTRE)
        square = 0.0
        for k in range(3):
            vertex = int(walls.corners[facet, k])
            if vertex >= 0:
                arm = minus(row_vector(walls.vertices, vertex, 0), centre)
                square = max(square, dot(arm, arm))
        if walls.corners[facet, 1] < 0:
            for i in range(position.shape[0]):
                arm = minus(place_of(position, space, i), plus(centre, row_vector(body, b, PLACE)))
                square = max(square, dot(arm, arm))
        body[b, EXTENT] = max(body[b, EXTENT], math.sqrt(square))


_near_facets, _carried, _set_reach = Direct(near_facets), Direct(carried), Direct(set_reach)
