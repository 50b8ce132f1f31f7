"""Which cell a point lies in, and the shape functions there."""

from __future__ import annotations

from typing import Any

import numpy as np
from mpi4py import MPI

from . import _compat, cells

TOLERANCE = 1e-8  # of the cell's size: a point this far outside the mesh still belongs to the cell at its edge


def shape_functions(body: Any, points, gradients: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Shape functions of the mesh at points (collective; every rank gives its own points, perhaps none).

    A point on an edge goes to the cell that came first when the mesh was made, whatever the number of ranks. Set-up
    work: all points visit all ranks.

    Args:
        body: the Body.
        points: (k, axes) in m.
        gradients: also the derivatives by x, y (and z) (1/m), in that cell.

    Returns:
        Global node numbers (k, nodes a cell) int64, -1 where the point was not found; values (k, nodes a cell), or with
        gradients (k, nodes a cell, 1 + axes): value and derivatives, 0 there; found (k,) bool.
    """
    points = np.asarray(points, dtype=float)
    if points.size == 0:
        points = points.reshape(0, body.axes)
    if points.ndim != 2 or points.shape[1] < body.axes or not np.all(np.isfinite(points)):
        raise ValueError(f"points of shape {points.shape} must be finite with the shape (k, {body.axes})")
    counts = body.comm.allgather(len(points))
    everyone = np.concatenate(body.comm.allgather(np.ascontiguousarray(points[:, : body.axes])))
    order, nodes, values = _owned_cells(body, everyone, gradients)
    if body.comm.size > 1:
        best = np.empty_like(order)
        body.comm.Allreduce(order, best, op=MPI.MIN)
        lost = order != best
        nodes[lost], values[lost] = -1, 0.0
        for array, operation in ((nodes, MPI.MAX), (values, MPI.SUM)):
            total = np.empty_like(array)
            body.comm.Allreduce(array, total, op=operation)
            array[:] = total
        order = best
    mine = slice(sum(counts[: body.comm.rank]), sum(counts[: body.comm.rank + 1]))
    found = order[mine] < np.iinfo(np.int64).max
    return nodes[mine].copy(), values[mine].copy(), found


def owners(body: Any, points) -> np.ndarray:
    """Rank (k,) that owns the cell in which each point lies, -1 outside the mesh (collective; the same points on every rank).

    Points on edges go to the same cell as in `shape_functions`.

    Args:
        body: the Body.
        points: (k, axes) in m.
    """
    order = _owned_cells(body, np.asarray(points, dtype=float), False)[0]
    best = np.empty_like(order)
    body.comm.Allreduce(order, best, op=MPI.MIN)
    mine = np.where((order == best) & (order < np.iinfo(np.int64).max), body.comm.rank, -1)
    found = np.empty_like(mine)
    body.comm.Allreduce(mine, found, op=MPI.MAX)
    return found


def _owned_cells(body: Any, points: np.ndarray, gradients: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Original number of the containing cell owned here (int64 maximum: none), its global nodes and the values."""
    width = body._all_nodes.shape[1]
    order = np.full(len(points), np.iinfo(np.int64).max)
    nodes = np.full((len(points), width), -1, dtype=np.int64)
    values = np.zeros((len(points), width, 1 + body.axes) if gradients else (len(points), width))
    size = float(cells.length(cells.measures(body.cell_corners).max(), body.axes)) if len(body.cell_corners) else 1.0
    point, cell = _compat.cells_near(body.mesh, np.arange(len(body.cell_corners)), points, TOLERANCE * size)
    if len(point) == 0:
        return order, nodes, values
    reference = cells.reference_points(body.cell_corners[cell], points[point])
    hit = cells.inside(reference, width, TOLERANCE)
    point, cell, reference = point[hit], cell[hit], reference[hit]
    original = np.asarray(body.mesh.topology.original_cell_index)[cell]
    sequence = np.lexsort((original, point))
    point, cell, reference, original = (a[sequence] for a in (point, cell, reference, original))
    point, first = np.unique(point, return_index=True)
    order[point] = original[first]
    local = np.ascontiguousarray(body.cell_nodes[cell[first]].ravel().astype(np.int32))
    nodes[point] = body.space.dofmap.index_map.local_to_global(local).reshape(-1, width)
    found = cells.shape_functions(reference[first], width)
    if gradients:
        slope = cells.gradients(body.cell_corners[cell[first]], reference[first])
        found = np.concatenate((found[:, :, None], slope), axis=2)
    values[point] = found
    return order, nodes, values
