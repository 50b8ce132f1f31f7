"""Parts of an assembly, and contact histories by the numbers of the particles: what moves between ranks."""

from __future__ import annotations

from typing import Any

import numpy as np

from particles import holding
from particles.assembly import Assembly
from particles.columns import aligned
from particles.neighbours import ROOM

ROWS = (
    "position", "velocity", "acceleration", "force", "spin", "angular", "torque", "lightness", "rotation", "nimbleness",
)  # fmt: skip


class Pairs:
    """Contact histories by the numbers of their particles in the whole scene: key = lower * count + higher."""

    def __init__(self, one: np.ndarray, other: np.ndarray, history: np.ndarray, signs: np.ndarray, count: int) -> None:
        low, high = np.minimum(one, other).astype(np.int64), np.maximum(one, other).astype(np.int64)
        key = low * count + high
        order = np.argsort(key, kind="stable")
        turned = np.where((one > other)[None, :], signs[:, None], 1.0)
        self.key, self.history = key[order], (turned * history)[:, order]
        self._signs, self._count = signs, count

    def of(self, one: np.ndarray, other: np.ndarray, history: np.ndarray) -> None:
        """Write the histories of pairs (k,) that are known into `history` (columns, k or more)."""
        if not len(self.key) or not len(one):
            return
        low, high = np.minimum(one, other).astype(np.int64), np.maximum(one, other).astype(np.int64)
        place = np.minimum(np.searchsorted(self.key, low * self._count + high), len(self.key) - 1)
        known = np.flatnonzero(self.key[place] == low * self._count + high)
        turned = np.where((one > other)[None, known], self._signs[:, None], 1.0)
        history[:, known] = turned * self.history[:, place[known]]


def all_pairs(soil: Assembly, numbers_of: np.ndarray, count: int) -> Pairs:
    """Listed pairs of an assembly; `numbers_of` its ids (n,) are the numbers in a scene of `count` particles."""
    system = soil._system
    pairs = int(system.start[-1])
    first, second = (numbers_of[soil._ids[rows[:pairs]]] for rows in (system.first, system.second))
    return Pairs(first, second, system.history[:, :pairs], soil._laws.signs, count)


def wall_pairs(walls: Any) -> tuple[Any, ...]:
    """Facets, a number for the periodic image, and histories of the pairs of particle and facet that are listed."""
    image = np.zeros(len(walls.row)) if walls.image is None else walls.image @ [1.0, 3.0, 9.0]
    return walls.facet, image, walls.history


def take_histories(whole: Assembly, pairs: list[Any], walls: list[Any]) -> None:
    """Write gathered histories into the lists of the whole scene."""
    system = whole._system
    known = Pairs.__new__(Pairs)
    key, history = np.concatenate([key for key, _ in pairs]), np.hstack([values for _, values in pairs])
    order = np.argsort(key, kind="stable")
    known.key, known.history, known._signs, known._count = key[order], history[:, order], whole._laws.signs, whole.count
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


def cut(soil: Assembly, ids: np.ndarray) -> None:
    """Leave these particles (ascending ids) in an assembly alone; they get the ids 0, 1, ...; histories among them stay."""
    system = soil._system
    rows = np.sort(soil._rows[ids])
    place = np.full(soil.count, -1, dtype=np.int32)
    place[rows] = np.arange(len(rows), dtype=np.int32)
    changed: dict[str, Any] = {}
    for name in ROWS:
        if getattr(system, name) is not None:
            changed[name] = aligned((len(rows), 4))
            changed[name][:] = getattr(system, name)[rows]
    for name in ("material", "external", "share", "listed"):
        if getattr(system, name) is not None:
            changed[name] = np.ascontiguousarray(getattr(system, name)[rows])
    if system.flow is not None:
        changed["flow"] = aligned((len(rows), 4))
    pairs = int(system.start[-1])
    first, second = place[system.first[:pairs]], place[system.second[:pairs]]
    kept = np.flatnonzero((first >= 0) & (second >= 0))
    none = np.zeros(ROOM, dtype=np.int32)
    changed["first"], changed["second"] = (np.concatenate([some[kept], none]) for some in (first, second))
    changed["start"] = np.searchsorted(first[kept], np.arange(len(rows) + 1)).astype(np.int32)
    changed["history"] = aligned((len(system.history), len(kept) + ROOM))
    changed["history"][:, : len(kept)] = system.history[:, kept]
    if system.walls is not None:
        near = place[system.walls.row]
        own = np.flatnonzero(near >= 0)
        image = None if system.walls.image is None else np.ascontiguousarray(system.walls.image[own])
        changed["walls"] = system.walls._replace(
            start=np.zeros(1, dtype=np.int32), row=near[own], facet=system.walls.facet[own], image=image,
            history=np.ascontiguousarray(system.walls.history[:, own]),
        )  # fmt: skip
    soil._held = {int(np.searchsorted(ids, one)): free for one, free in soil._held.items() if place[soil._rows[one]] >= 0}
    soil._ids = np.searchsorted(ids, soil._ids[rows]).astype(np.int32)
    soil._rows = np.empty_like(soil._ids)
    soil._rows[soil._ids] = np.arange(len(rows), dtype=np.int32)
    for name in ("_reference", "_radii", "_masses", "_inertias", "_ghost", "_sorted_at", "_external"):
        values = getattr(soil, name)
        if values is not None:
            setattr(soil, name, values[ids].copy())
    soil.count, soil._system = len(rows), system._replace(**changed)
    holding.compose(soil)
