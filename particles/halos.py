"""The halo of a rank: particles of other ranks within reach of its own, contacts across the border, messages to the neighbours."""

from __future__ import annotations

from typing import Any

import numpy as np
from mpi4py import MPI

from particles import neighbours
from particles.assembly import Assembly
from particles.columns import WIDTH, aligned
from particles.contacts import SCRATCH
from particles.neighbours import ROOM
from particles.parts import Pairs, room_for_breaks
from particles.ranks import Halo, numbers
from particles.system import MASS, RADIUS

TAG = 7
_PADDED = ("position", "velocity", "acceleration", "force", "spin", "angular", "torque", "lightness")


def _handle(of: Any) -> int:
    """What C calls by: the value of an MPI handle."""
    return MPI._handleof(of)


def halo_of(
    comm: Any, rows: list[np.ndarray], received: list[int], first: int, width: int, *, reactions: int = 0, sums: int = 0,
    seconds: np.ndarray, tag: int = TAG,
) -> tuple[Halo, list[Any]]:  # fmt: skip
    """The way to other ranks for compiled loops, and the persistent messages that it stands on.

    Args:
        comm: the ranks.
        rows: own rows that each rank needs.
        received: number of rows that come from each rank.
        first: row of the first of them.
        width: numbers a row.
        reactions, sums: room for numbers that are summed.
        seconds: (2,) where the time of exchanges and agreements is added up.
        tag: of the messages.
    """
    counts = [len(one) for one in rows]
    out, into = np.zeros((sum(counts), width)), np.zeros((sum(received), width))
    requests: list[Any] = []
    for room, numbers_of, make in ((into, received, comm.Recv_init), (out, counts, comm.Send_init)):
        at = 0
        for other, count in enumerate(numbers_of):
            if count:
                requests.append(make([room[at : at + count], MPI.DOUBLE], other, tag))
            at += count
    handles = [_handle(one) for one in (comm, MPI.DOUBLE, MPI.MAX, MPI.SUM)]
    halo = Halo(
        np.concatenate([np.zeros(0, dtype=np.int64), *rows]).astype(np.int64), np.array([first]), out, into,
        np.array([_handle(request) for request in requests], dtype=np.int64), np.array(handles, dtype=np.int64),
        np.zeros(2), np.zeros((2, reactions)), np.zeros((2, sums)), seconds,
    )  # fmt: skip
    return halo, requests


class Bordering:
    """Finds the halo of `part` for its present list, on all ranks together; histories across the border come from `_known`."""

    comm: Any
    part: Assembly
    ids: np.ndarray  # (owned,) numbers of the part's ids in the whole scene
    count: int  # particles of the whole scene
    axes: int
    _known: Pairs
    _signs: np.ndarray
    _room: int
    _seconds: np.ndarray
    _requests: list[Any]
    _border: Any
    _border_sums: np.ndarray

    def _units(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Places of the rows (n, axes), along periodic axes as shares of the edge; length of a unit (axes,), m; which axes repeat."""
        part = self.part
        places: np.ndarray = part._system.position[:, : self.axes]
        scale: np.ndarray = np.ones(self.axes)
        periodic: np.ndarray = np.zeros(self.axes, dtype=bool)
        if part.cell is not None:
            periodic = part.cell.periodic
            units = np.linalg.solve(part.cell.matrix, places.T).T
            places = np.where(periodic, units - np.floor(units), places)
            for k in np.flatnonzero(periodic):
                scale[k] = neighbours.cell_width(part.cell.arrays, int(k))
        return places, scale, periodic

    def _find_halo(self) -> None:
        """Who needs which rows of whom; the list of contacts across borders; the arrays with room for the halo."""
        comm, part = self.comm, self.part
        reach = 2.0 * part._largest_radius + part.skin
        wanted = self._near_boxes(reach)
        sent = [self._rows_sent(rows) if other != comm.rank else None for other, rows in enumerate(wanted)]
        offered = comm.alltoall(sent)
        sizes = [0 if rows is None else len(rows) for rows in offered]
        guests = np.concatenate([np.zeros((0, 10)), *(rows for rows in offered if rows is not None)])
        own = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *wanted]))
        one, guest = self._pairs_with(guests, own, reach)
        used = np.unique(guest)
        bounds = np.cumsum([0, *sizes])
        replies = [used[(used >= a) & (used < b)] - a for a, b in zip(bounds[:-1], bounds[1:])]
        asked = comm.alltoall(replies)
        rows = [wanted[other][asked[other]] for other in range(comm.size)]
        self._set_arrays(guests[used], one, np.searchsorted(used, guest))
        self._set_messages(rows, [len(reply) for reply in replies])

    def _near_boxes(self, reach: float) -> list[np.ndarray]:
        """Own rows that lie in the boxes around the other ranks' particles, wider by `reach` (m); by rank."""
        comm = self.comm
        places, scale, periodic = self._units()
        widths = reach / scale
        empty = not len(places)
        box = np.zeros((2, self.axes)) if empty else np.array([places.min(axis=0), places.max(axis=0)])
        boxes = comm.allgather((empty, box))
        found: list[np.ndarray] = []
        for rank, (none, (low, high)) in enumerate(boxes):
            if rank == comm.rank or none or empty:
                found.append(np.zeros(0, dtype=np.int64))
                continue
            away = places - 0.5 * (low + high)
            away[:, periodic] -= np.round(away[:, periodic])
            found.append(np.flatnonzero((np.abs(away) <= 0.5 * (high - low) + widths).all(axis=1)))
        return found

    def _rows_sent(self, rows: np.ndarray) -> np.ndarray:
        """What others need to know once of these rows (k, 10): number, place, radius, mass, material, shares, ghost."""
        part, system = self.part, self.part._system
        found = np.zeros((len(rows), 10))
        found[:, 0], found[:, 1:5] = self.ids[part._ids[rows]], system.position[rows]
        if self.axes == 2:
            found[:, 3] = 0.0
        found[:, 5] = system.lightness[rows, MASS]
        found[:, 6] = 0 if system.material is None else system.material[rows]
        found[:, 7:9] = 1.0 if system.share is None else system.share[rows]
        found[:, 9] = part._ghost[part._ids[rows]]
        return found

    def _pairs_with(self, guests: np.ndarray, own: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
        """Pairs closer than both radii and the skin: own rows (k,) and guests (k,)."""
        part = self.part
        none = np.zeros(0, dtype=np.int64)
        if not len(guests) or not len(own):
            return none, none
        places = aligned((len(own) + len(guests), 4))
        places[: len(own)], places[len(own) :] = part._system.position[own], guests[:, 1:5]
        if self.axes == 2:
            places[:, 2] = 0.0
        still = np.zeros(len(places), dtype=bool)
        still[len(own) :] = True
        grid = neighbours.grid_of(places, reach, self.axes, part._system.cell)
        start, first, second = neighbours.list_pairs(
            grid, places, places[:, RADIUS].copy(), still, part.skin, self.axes, 4 * len(places), part._system.cell
        )
        first, second = first[: start[-1]].astype(np.int64), second[: start[-1]].astype(np.int64)
        led = np.concatenate([part._ghost[part._ids[own]], guests[:, 9] > 0.0])  # the caller's ghosts have no pairs, either
        mixed = np.flatnonzero((second >= len(own)) & ~(led[first] & led[second]))  # guests are never first
        return own[first[mixed]], second[mixed] - len(own)

    def _set_arrays(self, guests: np.ndarray, one: np.ndarray, guest: np.ndarray) -> None:
        """Rows of the halo, and two more far from each other, behind the own ones; the list of pairs across the border."""
        part, system = self.part, self.part._system
        count, more = part.count, len(guests)
        long: dict[str, Any] = {}
        for name in _PADDED:
            rows = getattr(system, name)
            if rows is not None:
                long[name] = aligned((count + more + 2, 4))
                long[name][:count] = rows
        long["position"][count : count + more, :3], long["position"][count : count + more, RADIUS] = guests[:, 1:4], guests[:, 4]
        long["position"][count + more :, RADIUS] = 1e-9 * max(part._largest_radius, 1e-300)
        apart = 10.0 * part._largest_radius if part.cell is None else 0.4 * part.cell.matrix[0, 0]
        long["position"][count + more + 1, 0] = max(apart, 1.0 if part.cell is None else 0.0)
        long["lightness"][count:] = 1.0
        long["lightness"][count : count + more, MASS] = guests[:, 5]
        part._system = system._replace(**{name: rows[:count] for name, rows in long.items()})
        if system.material is not None:
            long["material"] = np.concatenate([system.material, guests[:, 6].astype(np.int32), np.zeros(2, dtype=np.int32)])
        if system.share is not None:
            long["share"] = np.concatenate([system.share, guests[:, 7:9], np.ones((2, 2))])
        self._numbers = np.concatenate([self.ids[part._ids], guests[:, 0].astype(np.int64)])  # of the rows, halo and all
        other = count + guest
        exchanged = self._numbers[one] > self._numbers[other]
        first, second = np.where(exchanged, other, one), np.where(exchanged, one, other)
        order = np.argsort(one, kind="stable")
        whole = -(-len(one) // WIDTH) * WIDTH
        lines = np.zeros((2, whole + ROOM), dtype=np.int32)
        lines[0, :whole], lines[1, :whole] = count + more, count + more + 1
        lines[:, : len(one)] = first[order], second[order]
        history = aligned((len(self._signs), whole + ROOM))
        self._known.of(self._numbers[lines[0, : len(one)]], self._numbers[lines[1, : len(one)]], history)
        self._border = part._system._replace(
            start=np.array([0, len(one)], dtype=np.int32), first=lines[0].copy(), second=lines[1].copy(), history=history,
            scratch=aligned((SCRATCH,)), sums=self._border_sums, walls=None, records=None, held=None, external=None,
            breaks=None if system.breaks is None else room_for_breaks(history), **long,
        )  # fmt: skip

    def _set_messages(self, rows: list[np.ndarray], received: list[int]) -> None:
        """Persistent messages to and from the neighbours."""
        comm, part = self.comm, self.part
        for request in self._requests:
            request.Free()
        width = numbers(self.axes == 3, part._laws.viscous is not None)
        walls = part._system.walls
        room = 0 if walls is None else 6 * len(walls.wall) + len(walls.body)
        self._halo, self._requests = halo_of(
            comm, rows, received, part.count, width, reactions=room, sums=self._room, seconds=self._seconds
        )

    def _border_pairs(self) -> Pairs:
        border = self._border
        count = int(border.start[-1])
        first, second = self._numbers[border.first[:count]], self._numbers[border.second[:count]]
        return Pairs(first, second, border.history[:, :count], self._signs, self.count)
