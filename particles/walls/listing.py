"""Walls of an assembly as arrays, and the lists of particles near their facets."""

from __future__ import annotations

import numpy as np
from numba import njit

from particles.neighbours import sort_by_cell
from particles.system import OUTER, RADIUS, Walls
from particles.walls.contact import closest, place_of
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
        none if old is None else old.facet, np.zeros((columns + 1, 0)) if old is None else old.history,
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


def _present(walls: Walls) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices and normals where they are now, and the body of each facet."""
    owner = walls.wall[walls.corners[:, 3], OWNER].astype(np.int64)
    frame = walls.body[:, FRAME : FRAME + 9].reshape(-1, 3, 3)
    centre = walls.body[:, CENTRE : CENTRE + 3]
    now = centre + walls.body[:, PLACE : PLACE + 3]
    facet, corner = np.nonzero(walls.corners[:, :3] >= 0)
    of_vertex = np.zeros(len(walls.vertices), dtype=np.int64)
    of_vertex[walls.corners[facet, corner]] = owner[facet]
    vertices = np.einsum("vij,vj->vi", frame[of_vertex], walls.vertices - centre[of_vertex]) + now[of_vertex]
    return vertices, np.einsum("fij,fj->fi", frame[owner], walls.normals), owner


def listed(walls: Walls, position: np.ndarray, axes: int, skin: float, old_row_of: np.ndarray) -> Walls:
    """The same walls with a list for the present positions, histories carried along.

    Args:
        position: (n, 4) new rows.
        skin: reach beyond contact, m.
        old_row_of: (n,) old row of each new one.
    """
    vertices, normals, owner = _present(walls)
    corners = walls.corners[:, :3]
    full = np.where(corners >= 0, corners, corners[:, :1])
    lower, upper = vertices[full].min(axis=1), vertices[full].max(axis=1)
    planes = corners[:, 1] < 0
    lower[planes], upper[planes] = -FAR, FAR
    row, facet = _near(walls, position, axes, skin, vertices, normals, lower, upper)
    group = row.astype(np.int64) * len(walls.wall) + walls.corners[facet, 3]
    start = np.append(np.flatnonzero(np.diff(group, prepend=-1)), row.size).astype(np.int32)
    history = np.zeros((walls.history.shape[0], row.size))
    _carry(walls, row, facet, history, old_row_of)
    _set_reach(walls, position, axes, vertices, owner, planes)
    near = np.zeros((max(1, int(np.diff(start).max(initial=0))), NEAR))
    return walls._replace(start=start, row=row, facet=facet, history=history, near=near)


def _near(walls, position, axes, skin, vertices, normals, lower, upper) -> tuple[np.ndarray, np.ndarray]:
    """Rows and facets closer than radius + skin, by row, then facet."""
    count = len(position)
    none = np.zeros(0, dtype=np.int32)
    if count == 0:
        return none, none
    places = np.zeros((count, 3))
    places[:, :axes] = position[:, :axes]
    low, reach = places.min(axis=0), position[:, RADIUS].max() + skin
    width = 2.0 * reach
    extent = np.ptp(places, axis=0)
    while np.prod(1.0 + extent / width) > 4.0 * count + 64.0:
        width *= 1.5
    number = (extent / width).astype(np.int64) + 1
    cell = ((places - low) / width).astype(np.int64) @ [1, number[0], number[0] * number[1]]
    order, start = sort_by_cell(cell.astype(np.int32), int(number.prod()))
    inside = [np.clip((bound + way * reach - low) / width, 0, number - 1) for bound, way in ((lower, -1.0), (upper, 1.0))]
    row, facet = near_facets(
        position, None if axes == 2 else 1, order, start, number, inside[0].astype(np.int64), inside[1].astype(np.int64),
        lower, upper, vertices, walls.corners, normals, skin, 4 * count + 64,
    )  # fmt: skip
    by_row, _ = sort_by_cell(row, count)
    return row[by_row], facet[by_row]


@njit(**OUTER)
def near_facets(
    position, space, order, start, number, first, last, lower, upper, vertices, corners, normals, skin, capacity
):
    """Pairs of a row and a facet closer than radius + skin, by facet.

    Args:
        space: None in the plane.
        order, start: rows by cell, and where each cell begins; `number` cells along each axis.
        first, last: (f, 3) cells that the box of each facet reaches.
        lower, upper: (f, 3) box of each facet, m.
        vertices, normals: where they are now.
        capacity: room for pairs; grown on demand.
    """
    pairs = np.empty((2, capacity), dtype=np.int32)
    found = 0
    for facet in range(corners.shape[0]):
        for layer in range(first[facet, 2], last[facet, 2] + 1):
            for line in range(first[facet, 1], last[facet, 1] + 1):
                at = (layer * number[1] + line) * number[0]
                for place in range(start[at + first[facet, 0]], start[at + last[facet, 0] + 1]):
                    i = int(order[place])
                    reach = position[i, RADIUS] + skin
                    x = place_of(position, space, i)
                    apart = False
                    for c in range(3):
                        apart |= x[c] < lower[facet, c] - reach or x[c] > upper[facet, c] + reach
                    if apart:
                        continue
                    point, _, _ = closest(vertices, corners, normals, facet, x)
                    square = (point[0] - x[0]) ** 2 + (point[1] - x[1]) ** 2 + (point[2] - x[2]) ** 2
                    if square < reach * reach:
                        if found == pairs.shape[1]:
                            grown = np.empty((2, 2 * found), dtype=np.int32)
                            grown[:, :found] = pairs
                            pairs = grown
                        pairs[0, found], pairs[1, found] = i, facet
                        found += 1
    return pairs[0, :found].copy(), pairs[1, :found].copy()


def _carry(walls: Walls, row: np.ndarray, facet: np.ndarray, history: np.ndarray, old_row_of: np.ndarray) -> None:
    """Copy histories of pairs that were listed before."""
    if walls.row.size == 0 or row.size == 0:
        return
    new_row_of = np.empty_like(old_row_of)
    new_row_of[old_row_of] = np.arange(old_row_of.size, dtype=old_row_of.dtype)
    facets = len(walls.corners)
    old = new_row_of[walls.row].astype(np.int64) * facets + walls.facet
    new = row.astype(np.int64) * facets + facet
    by_key = np.argsort(old)
    place = np.minimum(np.searchsorted(old, new, sorter=by_key), old.size - 1)
    same = old[by_key[place]] == new
    history[:, same] = walls.history[:, by_key[place[same]]]


def _set_reach(walls, position, axes, vertices, owner, planes) -> None:
    """Remember where the bodies are, and how far their walls reach (planes: as far as there are particles)."""
    for b, body in enumerate(walls.body):
        body[LISTED : LISTED + 3], body[LISTED + 3 : LISTED + 12] = body[PLACE : PLACE + 3], body[FRAME : FRAME + 9]
        centre = body[CENTRE : CENTRE + 3] + body[PLACE : PLACE + 3]
        own = walls.corners[owner == b, :3]
        reach = np.linalg.norm(vertices[np.unique(own[own >= 0])] - centre, axis=1).max()
        if planes[owner == b].any() and len(position):
            reach = max(reach, np.linalg.norm(position[:, :axes] - centre[:axes], axis=1).max())
        body[EXTENT] = reach
