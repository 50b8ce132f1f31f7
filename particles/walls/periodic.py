"""Walls in a periodic cell: they repeat with it, so that a particle meets them through all its images.

A wall may reach across the faces of the cell, end there, or lie on one of them; where it meets or covers its own images it is
one surface, and a contact counts once. What is infinite must look the same from all images: planes lie along the edges.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from particles import neighbours
from particles.cell import PeriodicCell
from particles.images import images_near
from particles.system import RADIUS, Walls
from particles.walls.listing import near_facets, set_reach
from particles.walls.rows import CENTRE, FRAME, NEAR, NIMBLENESS, OWNER, PLACE, VELOCITY

if TYPE_CHECKING:
    from particles.walls.wall import Wall

ALONG = 1e-9  # sine of the angle between a plane and an edge of the cell that is taken for none


def check_deformation(walls: list[Wall]) -> None:
    """Raise a ValueError unless walls go with a cell that deforms: rigid ones do only where nothing holds on to them."""
    for wall in walls:
        if not (wall.is_plane and wall.frictionless):
            raise ValueError(
                f"velocity_gradient does not go with {wall.name}: a rigid wall in a deforming cell must be a frictionless plane "
                "along the periodic edges (shapes.plane, frictionless=True), so that particles slide past it as the cell stretches"
            )


def listed_in_cell(
    walls: Walls, position: np.ndarray, axes: int, skin: float, old_row_of: np.ndarray, cell: PeriodicCell
) -> Walls:
    """The same walls with a list for the present positions and all images near facets; see `particles.walls.listing.listed`.

    Raises:
        ValueError: a plane is not parallel to the edges of the cell, or turns.
    """
    plane = walls.corners[:, 1] < 0
    _check_planes(walls.normals[plane], walls.body[walls.wall[walls.corners[plane, 3], OWNER].astype(np.int64)], cell)
    reach = float(position[:, RADIUS].max(initial=0.0)) + skin
    nowhere = np.zeros((0,), dtype=np.int64), np.zeros((0,), dtype=np.int64), np.zeros((0, axes))
    parts = [nowhere]
    if plane.any():
        home = -np.where(cell.periodic, np.floor(position[:, :axes] @ np.linalg.inv(cell.matrix).T), 0.0)
        every = np.arange(len(position)), position[:, :axes] + home @ cell.matrix.T, home
        parts.append(_near(walls, position, axes, skin, every, plane))
    if not plane.all():
        lower, upper = _extent(walls, ~plane, axes)
        parts.append(_near(walls, position, axes, skin, images_near(cell, position[:, :axes], lower, upper, reach), ~plane))
    row, facet, image = (np.concatenate(part) for part in zip(*parts))
    order = np.lexsort((*image.T, facet, row))
    row, facet, image = row[order].astype(np.int32), facet[order].astype(np.int32), image[order]
    numbers = np.zeros((len(row), 3))
    numbers[:, :axes] = image
    group = row.astype(np.int64) * len(walls.wall) + walls.corners[facet, 3]
    start = np.append(np.flatnonzero(np.diff(group, prepend=-1)), row.size).astype(np.int32)
    history = _carried(walls, row, facet, numbers, old_row_of)
    set_reach(walls, position, None if axes == 2 else 1)
    near = np.zeros((max(1, int(np.diff(start).max(initial=0))), NEAR))
    return walls._replace(start=start, row=row, facet=facet, history=history, near=near, image=numbers)


def check_planes(walls: list[Wall], cell: PeriodicCell) -> None:
    """Raise a ValueError where a plane is not parallel to the edges of a cell, or turns."""
    for wall in walls:
        if wall.is_plane:
            _check_planes(wall.shape.normals, wall._body.row[None], cell)


def _check_planes(normals: np.ndarray, body: np.ndarray, cell: PeriodicCell) -> None:
    """The same for normals (k, 3) in the reference position and rows of their bodies (k, BODY)."""
    normal = np.einsum("fij,fj->fi", body[:, FRAME : FRAME + 9].reshape(-1, 3, 3), normals)
    edges = cell.matrix[:, cell.periodic]
    across = np.abs(normal[:, : cell.axes] @ edges) / np.linalg.norm(edges, axis=0)
    if (across > ALONG).any():
        raise ValueError(
            "a plane in a periodic cell must be parallel to the edges that repeat; take a polyline, box or mesh for a wall that "
            "repeats with the cell"
        )
    if body[:, VELOCITY + 3 : VELOCITY + 6].any() or body[:, NIMBLENESS : NIMBLENESS + 9].any():
        raise ValueError("a plane in a periodic cell must not turn: leave out its spin, and the inertia of a Free body")


def _extent(walls: Walls, finite: np.ndarray, axes: int) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the box around some facets where they are now, m."""
    facet, corner = np.nonzero((walls.corners[:, :3] >= 0) & finite[:, None])
    body = walls.body[walls.wall[walls.corners[facet, 3], OWNER].astype(np.int64)]
    centre = body[:, CENTRE : CENTRE + 3]
    frame = body[:, FRAME : FRAME + 9].reshape(-1, 3, 3)
    vertices = np.einsum("vij,vj->vi", frame, walls.vertices[walls.corners[facet, corner]] - centre)
    places = (vertices + centre + body[:, PLACE : PLACE + 3])[:, :axes]
    return places.min(axis=0), places.max(axis=0)


def _near(walls, position, axes, skin, images, wanted) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows, facets and numbers of edges (k, axes) of images closer than radius + skin, for the wanted facets (f,)."""
    row, places, numbers = images
    there = position[row].copy()
    there[:, :axes] = places
    grid = neighbours.grid_of(there, 2.0 * (there[:, RADIUS].max(initial=0.0) + skin), axes, None)
    place, facet = near_facets(walls, there, None if axes == 2 else 1, grid, skin, walls.row.size + 64)
    place, facet = place[wanted[facet]], facet[wanted[facet]]
    return row[place], facet, numbers[place]


def _carried(walls: Walls, row, facet, image, old_row_of: np.ndarray) -> np.ndarray:
    """Histories of pairs that were listed before, for the same image (any of a plane, which sees one)."""
    history = np.zeros((walls.history.shape[0], row.size))
    if walls.image is None or walls.row.size == 0 or row.size == 0:
        return history
    by_row = np.empty_like(old_row_of)
    by_row[old_row_of] = np.arange(old_row_of.size, dtype=old_row_of.dtype)

    def keys(rows: np.ndarray, facets: np.ndarray, images: np.ndarray) -> np.ndarray:
        finite = walls.corners[facets, 1] >= 0
        return np.column_stack([rows, facets, images * finite[:, None]]).astype(np.int64)

    old, new = keys(by_row[walls.row], walls.facet, walls.image), keys(row, facet, image)
    _, number = np.unique(np.vstack([old, new]), axis=0, return_inverse=True)
    number = number.reshape(-1)
    place = np.full(number.max() + 1, -1)
    place[number[: len(old)]] = np.arange(len(old))
    source = place[number[len(old) :]]
    history[:, source >= 0] = walls.history[:, source[source >= 0]]
    return history
