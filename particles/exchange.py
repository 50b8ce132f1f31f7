"""Particles of one scene on several ranks: owners, halos, and what all ranks know together.

Every rank holds the particles that it owns as an `Assembly` of its own. Behind their rows lie those of the halo: particles of other
ranks near enough for a contact. A contact between an owned particle and one of the halo is computed on both sides, from the same
numbers in the same order, so that both ranks keep the same history to the bit and each takes its own force: one message to a
neighbour and step, none back. Energies of such a contact count half on either side. Who owns a particle is a matter of speed alone: halos
are found by where the particles are.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import llvmlite.binding as llvm
import numpy as np
from mpi4py import MPI

from particles import energies, listing, motion, neighbours, network
from particles.assembly import Assembly
from particles.bisection import bisect
from particles.columns import WIDTH, aligned
from particles.contacts import SCRATCH
from particles.dispatch import Direct
from particles.motion import FINISHED, Unstable
from particles.neighbours import ROOM
from particles.parts import ROWS, Pairs, all_pairs, cut, take_histories, wall_pairs
from particles.ranks import Halo, numbers
from particles.state import restore
from particles.system import MASS, RADIUS, SUMS, TRAVEL, TRAVEL_LIMIT, WALLS, Terms
from particles.walls.history import recorded, recording
from particles.walls.listing import driven
from particles.walls.rows import DASHPOT, STIFFNESS
from particles.walls.servo import set_contact_constants

llvm.load_library_permanently(MPI.__file__)  # the compiled loops call MPI by the names of its functions

TAG = 7
_PADDED = ("position", "velocity", "acceleration", "force", "spin", "angular", "torque", "lightness")
_advance, _evaluate, _stale, _runaway, _kick = map(
    Direct, (motion.advance, motion.evaluate_with, motion.stale, motion.runaway, motion.kick)
)


def _handle(of: Any) -> int:
    """What C calls by: the value of an MPI handle."""
    return MPI._handleof(of)


class SharedAssembly:
    """An assembly whose particles are spread over the ranks of a communicator; construction and methods are collective.

    Args:
        make: makes the whole scene, walls and all, the same on every rank; it must not have moved.
        comm: the ranks.
        weights: of the particles (n,), in the measure of their cost; all alike by default.
        room: numbers that loops of the caller sum over the ranks in a step.

    Attributes:
        part: the particles that this rank owns, an `Assembly` with ids of its own.
        ids: (owned,) numbers of these ids in the whole scene.
        whole: on rank 0 the whole scene, up to date after `collect`; None elsewhere.
    """

    def __init__(
        self, make: Callable[[], Assembly], comm: Any = MPI.COMM_WORLD, weights: np.ndarray | None = None, room: int = 0
    ) -> None:
        self.comm, self._make, self._weights, self._room = comm, make, weights, room
        self.whole = make() if comm.rank == 0 else None
        self._requests: list[Any] = []
        self._seconds = np.zeros(2)
        self.rebuilds = 0
        self._take_part(make())

    def _take_part(self, part: Assembly) -> None:
        """Leave of the whole scene what this rank owns."""
        comm = self.comm
        self.count, self.axes = part.count, part.axes
        owner = bisect(part.positions, comm.size, self._weights)
        self.ids = np.flatnonzero(owner == comm.rank)
        self.part, self._signs = part, part._laws.signs
        self._border: Any = None
        self._border_sums = np.zeros(SUMS)
        self._known = all_pairs(part, np.arange(self.count), self.count)
        if comm.rank > 0:  # what has been summed so far is rank 0's
            part._imposed = 0.0
            part._system.sums[:] = 0.0
        cut(part, self.ids)
        self.rebuild()

    def restore(self, state: dict[str, Any] | None) -> None:
        """Go on from a state of `particles.state.state_of` of the whole scene, which rank 0 has.

        Raises:
            ValueError: the particles, walls or contact laws are not the same.
        """
        state = self.comm.bcast(state, root=0)
        part = self._make()
        for soil in (part,) if self.whole is None else (part, self.whole):
            restore(soil, state)
        self._take_part(part)

    # Lists and halos ---------------------------------------------------------------------------------------------------

    def rebuild(self) -> None:
        """New lists on all ranks, new halos; contact histories are carried along.

        Raises:
            Unstable: a particle of any rank has no finite position or velocity.
        """
        part, clock = self.part, self.part._system.clock
        if self._border is not None:
            self._known = self._border_pairs()
        clock[TRAVEL] = self.comm.allreduce(clock[TRAVEL], op=MPI.MAX)  # one skin for all
        self._together(lambda: listing.rebuild(part))
        part._set_skin(self.comm.allreduce(part.skin, op=MPI.MAX))
        self._find_halo()
        if part._system.walls is not None:
            self._agree_on_servos()
        self.rebuilds += 1

    def refresh(self) -> None:
        """New lists, where a loop of the caller has found one used up on any rank; see `Assembly.refresh`.

        Raises:
            Unstable: on every rank, when particles of any rank blow up.
        """
        self._together(lambda: self.part._raise_runaway(self.part._step, ""))
        self.rebuild()

    @property
    def across(self) -> tuple[Any, Any]:
        """Border and halo for `particles.motion.evaluate_with`; of the present list."""
        return self._border, self._halo

    def _agree_on_servos(self) -> None:
        body = self.part._system.walls.body
        for column in (STIFFNESS, DASHPOT):
            found = np.ascontiguousarray(body[:, column])
            self.comm.Allreduce(MPI.IN_PLACE, found, op=MPI.MAX)
            body[:, column] = found

    def _together(self, work: Callable[[], Any]) -> None:
        """Do something on every rank; particles that blow up on one of them are an error of all."""
        problem = None
        try:
            work()
        except Unstable as unstable:
            problem = str(unstable)
        problems = [words for words in self.comm.allgather(problem) if words is not None]
        if problems:
            raise Unstable(problems[0])

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
        comm, part = self.comm, self.part
        places, widths = part._system.position[:, : self.axes], np.full(self.axes, reach)
        periodic = np.zeros(self.axes, dtype=bool)
        if part.cell is not None:
            periodic = part.cell.periodic
            units = np.linalg.solve(part.cell.matrix, places.T).T
            places = np.where(periodic, units - np.floor(units), places)
            for k in np.flatnonzero(periodic):
                widths[k] = reach / neighbours.cell_width(part.cell.arrays, int(k))
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
            scratch=aligned((SCRATCH,)), sums=self._border_sums, walls=None, records=None, held=None, breaks=None, external=None,
            **long,
        )  # fmt: skip

    def _set_messages(self, rows: list[np.ndarray], received: list[int]) -> None:
        """Persistent messages to and from the neighbours."""
        comm, part = self.comm, self.part
        for request in self._requests:
            request.Free()
        width = numbers(self.axes == 3, part._laws.viscous is not None)
        counts = [len(one) for one in rows]
        out, into = np.zeros((sum(counts), width)), np.zeros((sum(received), width))
        self._requests, at = [], 0
        for other, count in enumerate(received):
            if count:
                self._requests.append(comm.Recv_init([into[at : at + count], MPI.DOUBLE], other, TAG))
            at += count
        at = 0
        for other, count in enumerate(counts):
            if count:
                self._requests.append(comm.Send_init([out[at : at + count], MPI.DOUBLE], other, TAG))
            at += count
        walls = part._system.walls
        room = 0 if walls is None else 6 * len(walls.wall) + len(walls.body)
        handles = [_handle(one) for one in (comm, MPI.DOUBLE, MPI.MAX, MPI.SUM)]
        self._halo = Halo(
            np.concatenate([np.zeros(0, dtype=np.int64), *rows]).astype(np.int64), np.array([part.count]), out, into,
            np.array([_handle(request) for request in self._requests], dtype=np.int64), np.array(handles, dtype=np.int64),
            np.zeros(2), np.zeros((2, room)), np.zeros((2, self._room)), self._seconds,
        )  # fmt: skip

    def _border_pairs(self) -> Pairs:
        border = self._border
        count = int(border.start[-1])
        first, second = self._numbers[border.first[:count]], self._numbers[border.second[:count]]
        return Pairs(first, second, border.history[:, :count], self._signs, self.count)

    # Stepping ----------------------------------------------------------------------------------------------------------

    def prepare(self, step: float, steps: int = 1, **loads: Any) -> Terms:
        """Make ready for steps; see `Assembly.prepare`."""
        part = self.part
        terms = part.terms(**loads)
        part._step = step
        clock = part._system.clock
        worn = not clock[TRAVEL] <= clock[TRAVEL_LIMIT] and _stale(part._system)
        if self.comm.allreduce(bool(worn), op=MPI.LOR):
            self.rebuild()
        set_contact_constants(part)
        if part._system.walls is not None:
            self._agree_on_servos()
        loaded = [wall.has_new_load() for wall in part.plates]
        if part._primed != (terms[5:],) or any(loaded):
            network.hold(part._system.walls)
            if part.cell is not None:
                part.cell.arrays.rate[:] = part.cell.arrays.gradient @ part.cell.arrays.matrix
            _evaluate(part._system, terms, 0.0, self._border, self._halo)
            _kick(part._system, terms, 0.0)
            part._primed = (terms[5:],)
        walls = part._system.walls
        if walls is not None and (driving := driven(part.plates, walls, part.time, step, steps)) is not walls:
            part._system = part._system._replace(walls=driving)
        return terms

    def advance(self, steps: int, step: float, **loads: Any) -> None:
        """Make `steps` steps of size `step` (s); see `Assembly.advance`.

        Raises:
            Unstable: on every rank, when particles of any rank blow up.
        """
        if steps == 0:
            return
        part, terms = self.part, self.prepare(step, steps, **loads)
        part._system = recording(part.plates, part._system, int(steps))
        left, resume = int(steps), False
        try:
            while True:
                done, code = _advance(part._system, terms, left, step, resume, self._border, self._halo)
                left -= done
                if code == FINISHED:
                    return
                self._together(lambda: part._raise_runaway(step, f" in step {steps - left}"))
                self.rebuild()
                resume = True
        finally:
            part._system = recorded(part.plates, part._system)

    # Results -----------------------------------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """Time since the start, s."""
        return self.part.time

    @property
    def halo(self) -> int:
        """Particles of other ranks that this one needs."""
        return len(self._halo.into)

    @property
    def seconds(self) -> dict[str, float]:
        """Time of this rank in exchanging rows (waiting for others included) and in agreeing on numbers, s."""
        return {"exchange": float(self._seconds[0]), "agreement": float(self._seconds[1])}

    def own_energies(self) -> dict[str, float]:
        """This rank's part of the energies, J, which sum up to those of all particles."""
        part = self.part
        own = part._system
        part._system = own._replace(sums=self._sums())
        terms = energies.table(part)
        part._system = own
        if part.count and int(self._border.start[-1]):
            view = copy.copy(part)
            view._system, view.count = self._border, len(self._border.position)
            view._ids = view._rows = np.arange(view.count)
            view._radii = self._border.position[:, RADIUS].copy()
            found = network.contacts(view, with_forces=False)
            for name, energy in network.stored(view, found).items():
                terms[f"elastic_{name}"] = terms.get(f"elastic_{name}", 0.0) + 0.5 * energy
        if self.comm.rank > 0:  # bodies of walls move on all ranks alike
            terms["kinetic_walls"] = terms["imposed"] = 0.0
        return terms

    def energies(self) -> dict[str, float]:
        """Energies of all particles by term, J; see `Assembly.energies`."""
        terms = self.own_energies()
        return dict(zip(terms, self.comm.allreduce(np.array(list(terms.values()))).tolist()))

    def energy_balance(self) -> float:
        """Absolute imbalance, J; see `Assembly.energy_balance`."""
        return energies.balance_of(self.energies())

    def _sums(self) -> np.ndarray:
        """Energy sums of this rank, contacts across borders by half; of what all ranks sum alike, rank 0's."""
        sums = self.part._system.sums + 0.5 * self._border_sums
        if self.comm.rank > 0:
            sums[WALLS] = 0.0
        return sums

    def gather(self, values: np.ndarray) -> np.ndarray | None:
        """Values (owned, ...) in the order of the part's ids as (all, ...) in that of the whole scene, on rank 0."""
        parts = self.comm.gather((self.ids, values), root=0)
        if parts is None:
            return None
        found = np.zeros((self.count, *values.shape[1:]), dtype=values.dtype)
        for ids, some in parts:
            found[ids] = some
        return found

    def collect(self) -> Assembly | None:
        """The whole scene as it is now on rank 0, with all contacts and energies; None elsewhere."""
        part, comm, whole = self.part, self.comm, self.whole
        system = part._system
        own = {name: getattr(system, name) for name in ROWS if getattr(system, name) is not None}
        inner, border = all_pairs(part, self.ids, self.count), self._border_pairs()
        lower = np.isin(border.key // self.count, self.ids)
        pairs = np.concatenate([inner.key, border.key[lower]]), np.hstack([inner.history, border.history[:, lower]])
        walls = None if system.walls is None else (self.ids[part._ids[system.walls.row]], *wall_pairs(system.walls))
        parts = comm.gather((self.ids[part._ids], own, pairs, walls, self._sums()), root=0)
        if whole is None:
            return None
        for numbers_of, rows, *_ in parts:
            places = whole._rows[numbers_of]
            for name, values in rows.items():
                getattr(whole._system, name)[places] = values
        whole._system.clock[:] = system.clock
        whole.skin = part.skin
        if part.cell is not None and whole.cell is not None:
            for name in ("matrix", "gradient", "rate", "anchor"):
                getattr(whole.cell.arrays, name)[:] = getattr(part.cell.arrays, name)
        if system.walls is not None:
            for name in ("body", "wall"):
                getattr(whole._system.walls, name)[:] = getattr(system.walls, name)
            for mine, theirs in zip(whole.plates, part.plates):
                mine._rows, mine.until_record = list(theirs._rows), theirs.until_record
        whole._system.history[:] = 0.0
        whole._system.clock[TRAVEL] = 0.0
        listing.rebuild(whole)
        whole._system.sums[:] = sum(sums for *_, sums in parts)
        take_histories(whole, [pairs for _, _, pairs, _, _ in parts], [walls for *_, walls, _ in parts])
        whole._primed = part._primed
        return whole
