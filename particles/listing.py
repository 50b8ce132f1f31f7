"""A new neighbour list for an assembly: pruned from one that reaches farther as long as that holds (`particles.pruning`).

Rows are sorted by place when that has become worth it, histories carried along.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from particles import holding, neighbours, pruning
from particles.cell import PeriodicCell, reduce_tilt
from particles.columns import aligned
from particles.dispatch import Direct
from particles.motion import Unstable, fitting_skin
from particles.system import AGE, LEAST_SKIN, RADIUS, ROWS, SKIN_SCALE, TRAVEL
from particles.walls.listing import listed
from particles.walls.periodic import listed_in_cell
from particles.walls.servo import set_contact_constants

if TYPE_CHECKING:
    from particles.assembly import Assembly

WIDEST = 0.3  # widest skin that is chosen here, as a share of the largest radius
OUTER, OUTER_WIDEST = 10.0, 0.45  # skin of the outer list, as a multiple of the skin; but not beyond this share of the mean radius
OUTER_LEAST = 3.0  # or this multiple of the skin, where that is more: so many lists from one search
PRUNING, CALLING = 4.0, 15000.0  # what a pruned list costs, in steps of a pair: for each particle, and whatever their number
GAPS = {2: 3.0, 3: 7.5}  # pairs for each particle that a skin of a radius would bring, before those of a packing are known


_travelled = Direct(neighbours.travelled)


def rebuild(soil: Assembly) -> None:
    """Build the list anew, with a skin that fits.

    Raises:
        Unstable: a particle has no finite position or velocity.
    """
    fit(soil)
    build(soil, not holds(soil))


def build(soil: Assembly, anew: bool) -> bool:
    """Build the list with the present skin, or a wider one that bonds ask for.

    Args:
        anew: Search the outer list anew, and sort the rows when particles have moved by about a cell since the last sort.

    Returns:
        Whether an outer list was searched.

    Raises:
        Unstable: a particle has no finite position or velocity.
    """
    system, axes = soil._system, soil.axes
    row = neighbours.first_bad(system.position, system.velocity)
    if row >= 0:
        raise Unstable(f"particle {soil._label(row)} has no finite position or velocity at t={soil.time:g} s")
    largest = soil._largest_radius
    if soil.cell is not None:
        check_room(soil.cell, 2.0 * largest + soil.skin)
    old_row_of: np.ndarray | None = None
    changed: dict[str, Any] = {}
    if anew:
        old_row_of = _sort_if_worth_it(soil, changed)
    position = changed.get("position", system.position)
    outer = soil._outer
    if anew or outer is None:
        outer = _search(soil, position)
    found = _pruned(soil, outer, position, old_row_of)
    while bonds_in(soil, found["history"]) < bonds_in(soil, system.history) and soil.skin < 2.0 * largest:
        # a bond must stay in the list for as long as it holds, however far it stretches (up to a diameter; and pairs of
        # two ghosts, which the caller moves, are no longer listed)
        soil._widen(1.5 * soil.skin)
        outer, anew = _search(soil, position), True
        found = _pruned(soil, outer, position, old_row_of)
    changed |= found
    changed["listed"] = position[:, :axes].copy()
    if system.walls is not None:
        rows_before = np.arange(soil.count, dtype=np.int32) if old_row_of is None else old_row_of
        if soil.cell is None:
            grid = neighbours.grid_of(position, 2.0 * largest + soil.skin, axes, None)
            changed["walls"] = listed(system.walls, position, axes, soil.skin, rows_before, grid)
        else:
            changed["walls"] = listed_in_cell(system.walls, position, axes, soil.skin, rows_before, soil.cell)
    system.clock[TRAVEL] = system.clock[AGE] = 0.0
    if system.cell is not None:
        system.cell.listed[:] = system.cell.matrix
    soil._system = system._replace(**changed)
    soil.rebuilds += 1
    set_contact_constants(soil)
    if old_row_of is not None:
        holding.place(soil)
    return anew


def skin_scale(count: int, more: float, calling: float = CALLING) -> float:
    """Length (m) that `particles.motion.fitting_skin` takes, with as many pairs `more` for each metre of skin (1/m)."""
    return 2.0 * (PRUNING * count + calling) / more


def fit(soil: Assembly) -> None:
    """Before a list is built: choose the skin where the caller gave none, if anything has moved since the last; reduce a cell's tilt."""
    clock, largest = soil._system.clock, soil._largest_radius
    if soil.cell is not None:
        reduce_tilt(soil.cell)
    fitting = fitting_skin(clock)
    if not np.isfinite(fitting):
        return
    skin = max(clock[LEAST_SKIN], min(fitting, WIDEST * largest))
    if soil.cell is not None:  # which must be at least three cells of the search wide
        skin = min(skin, max(clock[LEAST_SKIN], _narrowest(soil.cell) / 3.0 - 2.0 * largest))
    soil._set_skin(skin)


def holds(soil: Assembly, most: float = np.inf) -> bool:
    """Whether the outer list still has all pairs within the skin; `most` (m): as if it reached no farther than that."""
    outer = soil._outer
    if outer is None or outer.ids is not soil._ids or (widest := min(outer.skin, most)) < soil.skin:
        return False
    travel = _travelled(soil._system.position, outer.places, outer.cell)
    return bool(soil.skin + 2.0 * travel <= widest)


def _sort_if_worth_it(soil: Assembly, changed: dict[str, Any]) -> np.ndarray | None:
    """The old row of each new one, with the sorted arrays in `changed`; None where the rows stay as they are."""
    position, width = soil._system.position, 2.0 * soil._largest_radius + soil.skin
    if soil.count and (
        soil._sorted_at is None or neighbours.largest_distance(position, soil._sorted_at[soil._ids]) > width
    ):
        return _sort(soil, width, changed)
    return None


def _search(soil: Assembly, position: np.ndarray) -> pruning.OuterList:
    """A new outer list: all pairs within its skin."""
    cell, axes, largest = soil._system.cell, soil.axes, soil._largest_radius
    skin = max(min(OUTER * soil.skin, OUTER_WIDEST * soil._mean_radius), OUTER_LEAST * soil.skin)
    if soil.cell is not None:
        skin = min(skin, _narrowest(soil.cell) / 3.0 - 2.0 * largest)
    skin = max(skin, soil.skin)
    grid = neighbours.grid_of(position, 2.0 * largest + skin, axes, cell)
    start, _, second = neighbours.list_pairs(
        grid, position, position[:, RADIUS].copy(), soil._ghost[soil._ids], skin, axes, 4 * soil.count, cell
    )
    then = None if cell is None else cell._replace(listed=cell.matrix.copy())
    soil._outer = pruning.OuterList(soil._ids, start, second, skin, position[:, :axes].copy(), then)
    return soil._outer


def _pruned(
    soil: Assembly, outer: pruning.OuterList, position: np.ndarray, old_row_of: np.ndarray | None
) -> dict[str, np.ndarray]:
    """Start, first, second of the new list and the histories carried into it; finds what a wider skin would bring."""
    system = soil._system
    start, first, second = pruning.prune(outer.start, outer.second, position, soil.axes, soil.skin, system.cell)
    history = aligned((len(soil._laws.columns), first.size))
    if old_row_of is None:
        pruning.carry_along(pruning.match(start, second, system.start, system.second), history, system.history)
    else:
        neighbours.carry_history(
            start, second, history, system.start, system.second, system.history, old_row_of, soil._laws.signs
        )
    if system.clock[SKIN_SCALE] and outer.skin > 2.0 * soil.skin:
        more = (outer.start[-1] - start[-1]) / (outer.skin - soil.skin)  # pairs for each metre of skin
        system.clock[SKIN_SCALE] = skin_scale(soil.count, max(more, max(soil.count, 1) / soil._mean_radius), soil._calling)
    return {"start": start, "first": first, "second": second, "history": history}


def bonds_in(soil: Assembly, history: np.ndarray) -> int:
    """Number of bonds that hold in a history (columns, pairs)."""
    return int(np.count_nonzero(history[0] > 0.5)) if soil._laws.has_bonds else 0


def _narrowest(cell: PeriodicCell) -> float:
    """Least width of a periodic cell along the axes that repeat, m."""
    return min(neighbours.cell_width(cell.arrays, int(k)) for k in np.flatnonzero(cell.periodic))


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
    for name in ROWS:
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
