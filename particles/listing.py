"""A new neighbour list for an assembly: rows sorted by place when that has become worth it, histories carried along."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from particles import holding, neighbours
from particles.cell import PeriodicCell, reduce_tilt
from particles.columns import aligned
from particles.motion import Unstable, fitting_skin
from particles.system import AGE, LEAST_SKIN, RADIUS, TRAVEL
from particles.walls.listing import listed
from particles.walls.periodic import listed_in_cell
from particles.walls.servo import set_contact_constants

if TYPE_CHECKING:
    from particles.assembly import Assembly

WIDEST = 0.3  # widest skin that is chosen here, as a share of the largest radius
_ROWS = (
    "position", "velocity", "acceleration", "force", "lightness", "rotation", "spin", "angular", "torque", "nimbleness",
)  # fmt: skip


def rebuild(soil: Assembly) -> None:
    """Build the list anew; sort the rows when particles have moved by about a cell since the last sort.

    Raises:
        Unstable: a particle has no finite position or velocity.
    """
    system, axes = soil._system, soil.axes
    row = neighbours.first_bad(system.position, system.velocity)
    if row >= 0:
        raise Unstable(f"particle {soil._ids[row]} has no finite position or velocity at t={soil.time:g} s")
    largest = soil._largest_radius
    _fit_skin(soil)
    width = 2.0 * largest + soil.skin
    if soil.cell is not None:
        reduce_tilt(soil.cell)
        check_room(soil.cell, width)
    old_row_of = np.arange(soil.count, dtype=np.int32)
    changed: dict[str, Any] = {}
    if soil.count and (
        soil._sorted_at is None or neighbours.largest_distance(system.position, soil._sorted_at[soil._ids]) > width
    ):
        old_row_of = _sort(soil, width, changed)
    position = changed.get("position", system.position)
    grid, start, first, second, history = _listed(soil, position, width, old_row_of)
    while bonds_in(soil, history) < bonds_in(soil, system.history) and soil.skin < 2.0 * largest:
        # a bond must stay in the list for as long as it holds, however far it stretches (up to a diameter; and pairs of
        # two ghosts, which the caller moves, are no longer listed)
        soil._widen(1.5 * soil.skin)
        width = 2.0 * largest + soil.skin
        grid, start, first, second, history = _listed(soil, position, width, old_row_of)
    changed.update(start=start, first=first, second=second, history=history, listed=position[:, :axes].copy())
    if system.walls is not None:
        if soil.cell is None:
            changed["walls"] = listed(system.walls, position, axes, soil.skin, old_row_of, grid)
        else:
            changed["walls"] = listed_in_cell(system.walls, position, axes, soil.skin, old_row_of, soil.cell)
    system.clock[TRAVEL] = system.clock[AGE] = 0.0
    if system.cell is not None:
        system.cell.listed[:] = system.cell.matrix
    soil._system = system._replace(**changed)
    soil.rebuilds += 1
    set_contact_constants(soil)
    holding.place(soil)


def _fit_skin(soil: Assembly) -> None:
    """Choose the skin anew where the caller gave none, if anything has moved since the last list."""
    clock, largest = soil._system.clock, soil._largest_radius
    fit = fitting_skin(clock)
    if not np.isfinite(fit):
        return
    skin = max(clock[LEAST_SKIN], min(fit, WIDEST * largest))
    if soil.cell is not None:  # which must be at least three cells of the search wide
        widths = [neighbours.cell_width(soil.cell.arrays, int(k)) for k in np.flatnonzero(soil.cell.periodic)]
        skin = min(skin, max(clock[LEAST_SKIN], min(widths) / 3.0 - 2.0 * largest))
    soil._set_skin(skin)


def _listed(soil: Assembly, position: np.ndarray, width: float, old_row_of: np.ndarray) -> tuple[Any, ...]:
    """Grid, start, first, second of a new list and the histories carried into it."""
    system = soil._system
    capacity = int(1.1 * system.first.size) + 3 * soil.count
    grid = neighbours.grid_of(position, width, soil.axes, system.cell)
    start, first, second = neighbours.list_pairs(
        grid, position, position[:, RADIUS].copy(), soil._ghost[soil._ids], soil.skin, soil.axes, capacity, system.cell
    )
    history = aligned((len(soil._laws.columns), first.size))
    neighbours.carry_history(
        start, second, history, system.start, system.second, system.history, old_row_of, soil._laws.signs
    )
    return grid, start, first, second, history


def bonds_in(soil: Assembly, history: np.ndarray) -> int:
    """Number of bonds that hold in a history (columns, pairs)."""
    return int(np.count_nonzero(history[0] > 0.5)) if soil._laws.has_bonds else 0


def check_room(cell: PeriodicCell, width: float) -> None:
    """Raise a ValueError where a periodic cell is less than three widths (m) of the neighbour search long."""
    for k in np.flatnonzero(cell.periodic):
        length = neighbours.cell_width(cell.arrays, int(k))
        if length < 3.0 * width:
            raise ValueError(
                f"cell is {length:.3g} m wide along axis {k}; a periodic axis must be at least three times the largest "
                f"diameter and the skin, {3.0 * width:.3g} m: take a larger cell or a smaller skin"
            )


def _sort(soil: Assembly, width: float, changed: dict[str, Any]) -> np.ndarray:
    """Sort the rows by cell; the old row of each new one."""
    system = soil._system
    soil._file_breaks()
    order = neighbours.grid_of(system.position, width, soil.axes, system.cell).order
    for name in _ROWS:
        rows = getattr(system, name)
        if rows is not None:
            changed[name] = aligned(rows.shape)
            changed[name][:] = rows[order]
    for name in ("material", "external", "share"):
        values = getattr(system, name)
        if values is not None:
            changed[name] = np.ascontiguousarray(values[order])
    soil._ids = soil._ids[order]
    soil._rows = np.empty_like(soil._ids)
    soil._rows[soil._ids] = np.arange(soil.count, dtype=np.int32)
    soil._sorted_at = np.ascontiguousarray(changed["position"][soil._rows, : soil.axes])
    soil.generation += 1
    return order
