"""The whole state of an assembly as named arrays, and back into one of the same scene: a run goes on bit for bit.

What a scene makes anew is not kept: contact laws, shapes of walls and their velocities as functions of time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from particles import holding
from particles.columns import aligned
from particles.pruning import OuterList
from particles.system import ROWS
from particles.walls.history import ROW
from particles.walls.rows import NEAR

if TYPE_CHECKING:
    from particles.assembly import Assembly

State = dict[str, Any]  # arrays, numbers, or states by name

_OF_ROWS = ("material", "share", "listed")  # more that goes by rows, without the padding
_LIST = ("start", "first", "second", "history")
_WALL_LIST = ("start", "row", "facet", "image", "history")
_CELL = ("matrix", "listed", "gradient", "rate", "anchor")
_OWN = ("_ids", "_rows", "_masses", "_inertias", "_ghost", "_external", "_sorted_at")
_ABSENT = np.nan  # a term that the scene lacks


def state_of(soil: Assembly) -> State:
    """Arrays and numbers by name, those of walls and cell in states of their own; they may be views of the assembly's."""
    system = soil._system
    soil._file_breaks()
    found: State = {name: getattr(system, name) for name in (*ROWS, *_OF_ROWS, *_LIST, "sums", "clock")}
    found |= {name.strip("_"): getattr(soil, name) for name in _OWN}
    found |= {
        "reference": soil._reference, "radii": soil._radii, "skin": soil.skin, "generation": soil.generation,
        "rebuilds": soil.rebuilds, "imposed": soil._imposed, "step": soil._step, "primed": _numbers(soil._primed),
        "held": soil.held, "free": np.array([soil._held[int(one)] for one in soil.held]).reshape(-1, soil.freedoms),
        "breaks": soil.breaks, "walls": _walls_of(soil), "cell": None, "outer": _outer_of(soil),
    }  # fmt: skip
    if soil.cell is not None:
        found["cell"] = {name: getattr(soil.cell.arrays, name) for name in _CELL} | {"whole": soil.cell._whole}
    return {name: value for name, value in found.items() if value is not None}


def without_ranks(state: State) -> State:
    """A state of a whole scene without those of the ranks, each of which is for one of them alone."""
    return {name: one for name, one in state.items() if name != "ranks"}


def restore(soil: Assembly, state: State) -> None:
    """Put a state of `state_of` into an assembly that was made, walls and all, as the one it was taken from.

    Raises:
        ValueError: the particles, walls or contact laws are not the same.
    """
    _check_same(soil, state)
    system = soil._system
    changed: State = {name: _rows(state.get(name)) for name in ROWS}
    changed |= {name: _own(state.get(name)) for name in (*_OF_ROWS, *_LIST)}
    history = aligned(state["history"].shape)  # as the loops want it
    history[:] = state["history"]
    changed["history"] = history
    system.sums[:], system.clock[:] = state["sums"], state["clock"]
    for name in _OWN:
        setattr(soil, name, _own(state.get(name.strip("_"))))
    changed["external"] = None if soil._external is None else soil._external[soil._ids]
    soil.skin, soil._imposed, soil._step = float(state["skin"]), float(state["imposed"]), float(state["step"])
    soil.generation, soil.rebuilds = int(state["generation"]), int(state["rebuilds"])
    if system.walls is not None:
        changed["walls"] = _restored_walls(soil, state["walls"])
    if soil.cell is not None:
        for name in _CELL:
            getattr(soil.cell.arrays, name)[:] = state["cell"][name]
        soil.cell._whole[:] = state["cell"]["whole"]
    soil._system = system._replace(**changed)
    soil._outer = _restored_outer(soil, state["outer"]) if "outer" in state else None
    soil._breaks = [_own(state["breaks"])]
    soil._held = dict(zip((int(one) for one in state["held"]), np.array(state["free"])))
    holding.compose(soil)
    soil._loads, soil._primed = None, _primed(state["primed"])
    for wall in soil.plates:
        wall.has_new_load()  # the accelerations belong to the loads


def _check_same(soil: Assembly, state: State) -> None:
    for name, mine in (("radii", soil._radii), ("reference", soil._reference)):
        if np.shape(state[name]) != mine.shape or not np.array_equal(state[name], mine):
            raise ValueError(
                f"state holds {len(state[name])} particles that are not the {soil.count} of this scene (their {name} differ): "
                "make the scene with the same parameters and the same version"
            )
    if len(state["history"]) != len(soil._laws.columns) or len(state["sums"]) != len(soil._system.sums):
        raise ValueError("state was written with another contact law: make the scene with the same law")
    bodies = 0 if soil._system.walls is None else len(soil._system.walls.body)
    if bodies != (len(state["walls"]["body"]) if "walls" in state else 0) or (soil.cell is None) != ("cell" not in state):
        raise ValueError("state has other walls or another periodic cell than the scene: make the same scene")


def _own(values: Any) -> Any:
    return None if values is None else np.array(values)


def _rows(values: Any) -> Any:
    """Rows of four as the loops want them: aligned."""
    if values is None:
        return None
    rows = aligned(values.shape)
    rows[:] = values
    return rows


def _numbers(primed: tuple | None) -> np.ndarray:
    """Gravity (3), mass, local, vector and spin damping of the last evaluation; empty where it no longer counts."""
    if primed is None:
        return np.zeros(0)
    gravity, *dampings = primed[0]
    return np.array([*((_ABSENT,) * 3 if gravity is None else gravity), *(_ABSENT if d is None else d for d in dampings)])


def _primed(numbers: Any) -> tuple | None:
    values = [None if np.isnan(number) else float(number) for number in numbers]
    if not values:
        return None
    return ((None if values[0] is None else tuple(values[:3]), *values[3:]),)


def _outer_of(soil: Assembly) -> State | None:
    """The outer list, where lists may be pruned from it."""
    outer = soil._outer
    if outer is None or outer.ids is not soil._ids:
        return None
    found = {name: getattr(outer, name) for name in ("start", "second", "skin", "places")}
    return found if outer.cell is None else found | {"cell": outer.cell.listed}


def _restored_outer(soil: Assembly, state: State) -> OuterList:
    cell = None if soil.cell is None else soil.cell.arrays._replace(listed=_own(state["cell"]))
    start, second, places = (_own(state[name]) for name in ("start", "second", "places"))
    return OuterList(soil._ids, start, second, float(state["skin"]), places, cell)


def _walls_of(soil: Assembly) -> State | None:
    walls = soil._system.walls
    if walls is None:
        return None
    found = {name: getattr(walls, name) for name in (*_WALL_LIST, "body", "wall", "drive_step")}
    found["room"] = len(walls.near)
    for k, wall in enumerate(soil.plates):
        found[f"record_{k}"] = np.concatenate([np.zeros((0, ROW)), *wall._rows])
        found[f"until_{k}"] = np.array([wall._record, wall.until_record])
    return {name: value for name, value in found.items() if value is not None}


def _restored_walls(soil: Assembly, state: State) -> Any:
    walls = soil._system.walls
    for name in ("body", "wall", "drive_step"):  # walls look at their rows
        getattr(walls, name)[:] = state[name]
    for k, wall in enumerate(soil.plates):
        wall._rows = [_own(state[f"record_{k}"])]
        wall._record, wall.until_record = (int(number) for number in state[f"until_{k}"])
    near = np.zeros((int(state["room"]), NEAR))
    return walls._replace(near=near, drive=None, **{name: _own(state.get(name)) for name in _WALL_LIST})
