"""Parts of an assembly with all that belongs to them, known by the particles' numbers in the whole scene: what ranks hand over."""

from __future__ import annotations

import copy
import pickle
from typing import Any, NamedTuple

import numpy as np

from particles import holding
from particles.assembly import Assembly
from particles.columns import aligned
from particles.contacts import SCRATCH
from particles.neighbours import ROOM
from particles.system import ROWS, Breaks
from particles.walls.rows import OWNER

_OF_ROWS = ("material", "external", "share")  # more that goes by rows, without the padding
_OF_IDS = ("_reference", "_radii", "_masses", "_inertias", "_ghost", "_external")


class Pairs:
    """Contact histories by the numbers of their particles in the whole scene: key = lower * count + higher."""

    def __init__(self, one: np.ndarray, other: np.ndarray, history: np.ndarray, signs: np.ndarray, count: int) -> None:
        low, high = np.minimum(one, other).astype(np.int64), np.maximum(one, other).astype(np.int64)
        self._signs, self._count = signs, count
        self._set(low * count + high, np.where((one > other)[None, :], signs[:, None], 1.0) * history)

    def _set(self, key: np.ndarray, history: np.ndarray) -> None:
        self.key, first = np.unique(key, return_index=True)
        self.history = history[:, first]

    def of(self, one: np.ndarray, other: np.ndarray, history: np.ndarray) -> None:
        """Write the histories of pairs (k,) that are known into `history` (columns, k or more)."""
        if not len(self.key) or not len(one):
            return
        low, high = np.minimum(one, other).astype(np.int64), np.maximum(one, other).astype(np.int64)
        place = np.minimum(np.searchsorted(self.key, low * self._count + high), len(self.key) - 1)
        known = np.flatnonzero(self.key[place] == low * self._count + high)
        turned = np.where((one > other)[None, known], self._signs[:, None], 1.0)
        history[:, known] = turned * self.history[:, place[known]]

    @property
    def numbers(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and higher number of each pair (k,)."""
        return self.key // self._count, self.key % self._count

    def some(self, these: Any = slice(None)) -> tuple[np.ndarray, np.ndarray]:
        """Keys and histories of some of them, as `joined` takes them."""
        return self.key[these], self.history[:, these]

    def joined(self, *more: tuple[np.ndarray, np.ndarray]) -> Pairs:
        """These and more in one, each pair once."""
        found = Pairs.__new__(Pairs)
        found._signs, found._count = self._signs, self._count
        keys, histories = zip((self.key, self.history), *more)
        found._set(np.concatenate(keys), np.hstack(histories))
        return found


def all_pairs(soil: Assembly, numbers_of: np.ndarray, count: int) -> Pairs:
    """Listed pairs of an assembly; `numbers_of` its ids (n,) are the numbers in a scene of `count` particles."""
    system = soil._system
    pairs = int(system.start[-1])
    first, second = (numbers_of[soil._ids[rows[:pairs]]] for rows in (system.first, system.second))
    return Pairs(first, second, system.history[:, :pairs], soil._laws.signs, count)


def no_pairs(soil: Assembly, count: int) -> Pairs:
    """None at all, of the kind of an assembly's."""
    none = np.zeros(0, dtype=np.int64)
    return Pairs(none, none, np.zeros((len(soil._laws.signs), 0)), soil._laws.signs, count)


def wall_pairs(walls: Any) -> tuple[Any, ...]:
    """Facets, a number for the periodic image, and histories of the pairs of particle and facet that are listed."""
    image = np.zeros(len(walls.row)) if walls.image is None else walls.image @ [1.0, 3.0, 9.0]
    return walls.facet, image, walls.history


def take_histories(whole: Assembly, pairs: list[Any], walls: list[Any]) -> None:
    """Write gathered histories into the lists of the whole scene."""
    system = whole._system
    known = no_pairs(whole, whole.count).joined(*pairs)
    count = int(system.start[-1])
    known.of(whole._ids[system.first[:count]], whole._ids[system.second[:count]], system.history)
    if system.walls is None:
        return
    listed = {}
    for numbers_of, facet, image, values in walls:
        listed.update({one: values[:, k] for k, one in enumerate(zip(numbers_of.tolist(), facet.tolist(), image.tolist()))})
    facet, image, values = wall_pairs(system.walls)
    for k, one in enumerate(zip(whole._ids[system.walls.row].tolist(), facet.tolist(), image.tolist())):
        if one in listed:
            values[:, k] = listed[one]


def sent(comm: Any, soil: Assembly | None) -> Assembly:
    """A copy of rank 0's assembly on every rank; walls that are driven by functions of time know them on rank 0 alone (collective)."""
    part: Assembly = pickle.loads(comm.bcast(None if soil is None else pickle.dumps(_without_functions(soil)), root=0))
    system = part._system
    if system.walls is not None:
        for wall, row in zip(part.plates, system.walls.wall):
            owner = int(row[OWNER])
            wall.attach(row, system.walls.body[owner], owner)
    part._system = system._replace(scratch=aligned((SCRATCH,)))
    if soil is not None:
        for mine, theirs in zip(part.plates, soil.plates):
            mine._body.given = theirs._body.given
    return part


def _without_functions(soil: Assembly) -> Assembly:
    """The same assembly with what cannot be sent left out: functions of time of walls, what is made anew."""
    found = copy.copy(soil)
    bodies: dict[int, Any] = {}
    found.plates, found._loads = [], None
    for wall in soil.plates:
        body = bodies.setdefault(id(wall._body), copy.copy(wall._body))
        body.given = {}
        found.plates.append(copy.copy(wall))
        found.plates[-1]._body = body
    walls = soil._system.walls
    found._system = soil._system._replace(records=None, walls=None if walls is None else walls._replace(drive=None))
    return found


class Cargo(NamedTuple):
    """Particles with all that belongs to them."""

    numbers: np.ndarray  # (k,) in the whole scene
    rows: dict[str, np.ndarray]  # (k, ...) arrays of the system, in the order of the numbers
    own: dict[str, np.ndarray]  # (k, ...) what the assembly knows of each
    held: dict[int, np.ndarray]  # free components by number
    pairs: tuple[np.ndarray, np.ndarray]  # keys and histories of their contacts, those with other particles too
    walls: tuple[Any, ...]  # number, facet, image and history of what is listed near walls; empty without walls


def loaded(soil: Assembly, numbers_of: np.ndarray, ids: np.ndarray, known: Pairs) -> Cargo:
    """Some particles of an assembly.

    Args:
        numbers_of: (n,) numbers of its ids in the whole scene.
        ids: (k,) the particles.
        known: contacts of all of them.
    """
    system, rows, numbers = soil._system, soil._rows[ids], numbers_of[ids]
    chosen = np.zeros(soil.count, dtype=bool)
    chosen[ids] = True
    named = {name: getattr(system, name) for name in (*ROWS, *_OF_ROWS)}
    own = {name: getattr(soil, name) for name in _OF_IDS}
    low, high = known.numbers
    walls: tuple[Any, ...] = ()
    if system.walls is not None:
        near = np.flatnonzero(chosen[soil._ids[system.walls.row]])
        image = None if system.walls.image is None else system.walls.image[near]
        of = numbers_of[soil._ids[system.walls.row[near]]]
        walls = of, system.walls.facet[near], image, system.walls.history[:, near]
    return Cargo(
        numbers, {name: values[rows] for name, values in named.items() if values is not None},
        {name: values[ids] for name, values in own.items() if values is not None},
        {int(numbers_of[one]): free for one, free in soil._held.items() if chosen[one]},
        known.some(np.flatnonzero(np.isin(low, numbers) | np.isin(high, numbers))), walls,
    )  # fmt: skip


def unload(soil: Assembly, cargos: list[Cargo], whole: int) -> tuple[np.ndarray, Pairs]:
    """Leave these particles in an assembly alone, in the order of their numbers; a new list must be built.

    Args:
        whole: particles of the whole scene.

    Returns:
        Numbers (n,) of the ids 0, 1, ..., and the contacts of these particles, those with others too.
    """
    numbers = np.concatenate([cargo.numbers for cargo in cargos])
    order = np.argsort(numbers)
    numbers, count = numbers[order], len(numbers)
    system, changed = soil._system, {}
    for name in cargos[0].rows:
        values = np.concatenate([cargo.rows[name] for cargo in cargos])[order]
        changed[name] = values
        if name in ROWS:
            changed[name] = aligned((count, 4))
            changed[name][:] = values
    if system.flow is not None:
        changed["flow"] = aligned((count, 4))
    changed["listed"] = changed["position"][:, : soil.axes].copy()
    known = no_pairs(soil, whole).joined(*(cargo.pairs for cargo in cargos))
    low, high = known.numbers
    inner = np.flatnonzero(np.isin(low, numbers) & np.isin(high, numbers))
    first, second = np.searchsorted(numbers, low[inner]), np.searchsorted(numbers, high[inner])
    none = np.zeros(ROOM, dtype=np.int64)
    changed["first"], changed["second"] = (np.concatenate([some, none]).astype(np.int32) for some in (first, second))
    changed["start"] = np.searchsorted(first, np.arange(count + 1)).astype(np.int32)
    changed["history"] = aligned((len(system.history), len(inner) + ROOM))
    changed["history"][:, : len(inner)] = known.history[:, inner]
    if system.walls is not None:
        changed["walls"] = _walls_near(system.walls, [cargo.walls for cargo in cargos], numbers)
    if system.breaks is not None:
        changed["breaks"] = room_for_breaks(changed["history"])
    for name in cargos[0].own:
        setattr(soil, name, np.concatenate([cargo.own[name] for cargo in cargos])[order])
    soil._held = {int(np.searchsorted(numbers, one)): free for cargo in cargos for one, free in cargo.held.items()}
    soil._ids = np.arange(count, dtype=np.int32)
    soil._rows = np.arange(count, dtype=np.int32)
    soil._sorted_at = soil._outer = None
    soil.count, soil._system = count, system._replace(**changed)
    soil._labels = numbers
    soil.generation += 1
    holding.compose(soil)
    return numbers, known


def _walls_near(walls: Any, listed: list[tuple[Any, ...]], numbers: np.ndarray) -> Any:
    """Walls with a list of what was listed near them, by row."""
    of, facet, image, history = zip(*listed)
    row = np.searchsorted(numbers, np.concatenate(of))
    order = np.argsort(row, kind="stable")
    return walls._replace(
        start=np.zeros(1, dtype=np.int32), row=row[order].astype(np.int32), facet=np.concatenate(facet)[order],
        image=None if walls.image is None else np.concatenate(image)[order],
        history=np.ascontiguousarray(np.hstack(history)[:, order]),
    )  # fmt: skip


def room_for_breaks(history: np.ndarray) -> Breaks:
    """An empty log for all bonds that hold in a history (columns, pairs)."""
    return Breaks(np.zeros((int(np.count_nonzero(history[0] > 0.5)), 7)), np.zeros(1, dtype=np.int64))
