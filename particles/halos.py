"""The halo of a rank: particles of other ranks within reach of its own, contacts across the border, messages to the neighbours."""

from __future__ import annotations

from typing import Any

import numpy as np
from mpi4py import MPI
from numba import njit

from particles import neighbours, pruning
from particles.assembly import Assembly
from particles.columns import WIDTH, aligned
from particles.contacts import SCRATCH
from particles.neighbours import ROOM
from particles.parts import Pairs, room_for_breaks
from particles.ranks import Halo, numbers
from particles.system import MASS, OUTER, RADIUS

TAG = 7
_PADDED = ("position", "velocity", "acceleration", "force", "spin", "angular", "torque", "lightness")


def _handle(of: Any) -> int:
    """What C calls by: the value of an MPI handle."""
    return MPI._handleof(of)


def halo_of(
    comm: Any, rows: list[np.ndarray], received: list[int], first: int, width: int, *, sums: int = 0,
    seconds: np.ndarray, tag: int = TAG,
) -> tuple[Halo, list[Any]]:  # fmt: skip
    """The way to other ranks for compiled loops, and the persistent messages that it stands on.

    Args:
        comm: the ranks.
        rows: own rows that each rank needs.
        received: number of rows that come from each rank.
        first: row of the first of them.
        width: numbers a row.
        sums: room for numbers that are summed.
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
        np.zeros(2), np.zeros((2, sums)), seconds,
    )  # fmt: skip
    return halo, requests


@njit(**OUTER)
def _box_of(places):
    """Lowest and highest coordinates (2, axes); the other way round where there are no places."""
    box = np.empty((2, places.shape[1]))
    box[0], box[1] = np.inf, -np.inf
    for i in range(places.shape[0]):
        for k in range(places.shape[1]):
            box[0, k] = min(box[0, k], places[i, k])
            box[1, k] = max(box[1, k], places[i, k])
    return box


@njit(**OUTER)
def _inside(places, middle, half, periodic):
    """Rows (k,) of the places within `half` (axes,) of a `middle`, along axes that repeat after 1 (`periodic`) by the nearest image."""
    found, count = np.empty(places.shape[0], dtype=np.int64), 0
    for i in range(places.shape[0]):
        within = True
        for k in range(places.shape[1]):
            away = places[i, k] - middle[k]
            if periodic[k]:
                away -= np.round(away)
            within = within and abs(away) <= half[k]
        if within:
            found[count] = i
            count += 1
    return found[:count].copy()


class Bordering:
    """The halo of `part` for its outer list, and the list of contacts across the border, pruned from those within the halo."""

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
    _halo_skin: float  # how far the halo reaches beyond both radii, m
    _within: np.ndarray  # (2, pairs) int32: lower and higher row of all pairs within the halo
    _listed: np.ndarray  # those of them that are listed
    _guests: np.ndarray  # (k, 10) what other ranks have told of the halo's rows
    _sent: np.ndarray  # (ranks,) rows that each rank needs
    _received: np.ndarray  # (ranks,) rows that come from each

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
        """Who needs which rows of whom; the arrays with room for the halo; the list of contacts across borders, histories from `_known`."""
        comm, part = self.comm, self.part
        self._halo_skin = comm.allreduce(part._outer.skin, op=MPI.MIN)  # type: ignore[union-attr]
        reach = 2.0 * part._largest_radius + self._halo_skin
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
        self._set_rows(guests[used])
        self._list_within(one, part.count + np.searchsorted(used, guest))
        self._set_messages(rows, [len(reply) for reply in replies])

    def _near_boxes(self, reach: float) -> list[np.ndarray]:
        """Own rows that lie in the boxes around the other ranks' particles, wider by `reach` (m); by rank."""
        comm = self.comm
        places, scale, periodic = self._units()
        widths = reach / scale
        boxes = np.empty((comm.size, 2, self.axes))
        comm.Allgather(_box_of(places), boxes)
        others = [low <= high if rank != comm.rank else False for rank, (low, high) in enumerate(boxes[:, :, 0])]
        return [
            _inside(places, 0.5 * (low + high), 0.5 * (high - low) + widths, periodic) if there else np.zeros(0, dtype=np.int64)
            for there, (low, high) in zip(others, boxes)
        ]

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
        """Pairs closer than both radii and the skin of the halo: own rows (k,) and guests (k,)."""
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
            grid, places, places[:, RADIUS].copy(), still, self._halo_skin, self.axes, 4 * len(places), part._system.cell
        )
        first, second = first[: start[-1]].astype(np.int64), second[: start[-1]].astype(np.int64)
        led = np.concatenate([part._ghost[part._ids[own]], guests[:, 9] > 0.0])  # the caller's ghosts have no pairs, either
        mixed = np.flatnonzero((second >= len(own)) & ~(led[first] & led[second]))  # guests are never first
        return own[first[mixed]], second[mixed] - len(own)

    def _set_rows(self, guests: np.ndarray) -> None:
        """Rows of the halo (k, 10), as `_rows_sent` has them, and two more far from each other, behind the own ones."""
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
        self._guests = guests
        self._numbers = np.concatenate([self.ids[part._ids], guests[:, 0].astype(np.int64)])  # of the rows, halo and all
        self._border = part._system._replace(
            scratch=aligned((SCRATCH,)), sums=self._border_sums, walls=None, records=None, held=None, external=None, **long
        )

    def _list_within(self, one: np.ndarray, other: np.ndarray) -> None:
        """The pairs (k,) of own rows and rows of the halo, and of these the list, with histories from `_known`."""
        exchanged = self._numbers[one] > self._numbers[other]
        first, second = np.where(exchanged, other, one), np.where(exchanged, one, other)
        order = np.argsort(one, kind="stable")
        self._within = np.array([first[order], second[order]], dtype=np.int32)
        history = np.zeros((len(self._signs), len(one)))
        self._known.of(self._numbers[self._within[0]], self._numbers[self._within[1]], history)
        self._list_border(history)

    def _list_border(self, known: np.ndarray) -> None:
        """List the pairs within the halo that are near now or bonded; `known` (columns, pairs) are their histories."""
        part, border = self.part, self._border
        near = pruning.near(self._within, border.position, self.axes, part.skin, border.cell)
        if part._laws.has_bonds:
            near |= known[0] > 0.5
        self._set_list(np.flatnonzero(near), known)

    def _set_list(self, listed: np.ndarray, known: np.ndarray) -> None:
        """List these of the pairs within the halo; `known` as for `_list_border`."""
        border, self._listed = self._border, listed
        count, rows = len(listed), len(border.position)
        whole = -(-count // WIDTH) * WIDTH
        lines = np.zeros((2, whole + ROOM), dtype=np.int32)
        lines[0, :whole], lines[1, :whole] = rows - 2, rows - 1
        lines[:, :count] = self._within[:, listed]
        history = aligned((len(known), whole + ROOM))
        history[:, :count] = known[:, listed]
        self._border = border._replace(
            start=np.array([0, count], dtype=np.int32), first=lines[0].copy(), second=lines[1].copy(), history=history,
            breaks=None if border.breaks is None else room_for_breaks(history),
        )  # fmt: skip

    def _border_histories(self) -> np.ndarray:
        """Histories (columns, pairs) of all pairs within the halo, zero for those that are not listed."""
        found = np.zeros((len(self._signs), self._within.shape[1]))
        found[:, self._listed] = self._border.history[:, : len(self._listed)]
        return found

    def _border_state(self) -> dict[str, Any]:
        """Halo and list of contacts across the border as named arrays: rows and pairs stay in their order."""
        return {
            "guests": self._guests, "within": self._within, "listed": self._listed, "history": self._border_histories(),
            "rows": self._halo.rows, "sent": self._sent, "received": self._received, "skin": self._halo_skin, "sums": self._border_sums,
        }  # fmt: skip

    def _restore_border(self, state: dict[str, Any]) -> None:
        """Put halo and list back; neighbours do the same."""
        self._halo_skin, self._within = float(state["skin"]), np.array(state["within"])
        self._set_rows(np.array(state["guests"]))
        self._set_list(np.array(state["listed"]), state["history"])
        self._border_sums[:] = state["sums"]
        self._set_messages(np.split(state["rows"], np.cumsum(state["sent"])[:-1]), state["received"].tolist())

    def _set_messages(self, rows: list[np.ndarray], received: list[int]) -> None:
        """Persistent messages to and from the neighbours."""
        comm, part = self.comm, self.part
        for request in self._requests:
            request.Free()
        width = numbers(self.axes == 3, part._laws.viscous is not None)
        self._sent, self._received = np.array([len(one) for one in rows]), np.array(received)
        walls = part._system.walls
        room = 0 if walls is None else 6 * len(walls.wall) + len(walls.body)
        self._halo, self._requests = halo_of(
            comm, rows, received, part.count, width, sums=room + self._room, seconds=self._seconds
        )

    def _border_pairs(self) -> Pairs:
        border = self._border
        count = int(border.start[-1])
        first, second = self._numbers[border.first[:count]], self._numbers[border.second[:count]]
        return Pairs(first, second, border.history[:, :count], self._signs, self.count)
