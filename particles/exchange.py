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

from particles import energies, listing, motion, network
from particles.assembly import Assembly
from particles.dispatch import Direct
from particles.halos import Bordering
from particles.motion import FINISHED, Unstable
from particles.owners import LIMIT, PAIR, Owners
from particles.parts import ROWS, all_pairs, loaded, take_histories, unload, wall_pairs
from particles.state import restore
from particles.system import RADIUS, SUMS, TRAVEL, TRAVEL_LIMIT, WALLS, Terms
from particles.walls.history import recorded, recording
from particles.walls.listing import driven
from particles.walls.rows import DASHPOT, STIFFNESS
from particles.walls.servo import set_contact_constants

llvm.load_library_permanently(MPI.__file__)  # the compiled loops call MPI by the names of its functions

_advance, _evaluate, _stale, _runaway, _kick = map(
    Direct, (motion.advance, motion.evaluate_with, motion.stale, motion.runaway, motion.kick)
)


class SharedAssembly(Bordering):
    """An assembly whose particles are spread over the ranks of a communicator; construction and methods are collective.

    Args:
        make: makes the whole scene, walls and all, the same on every rank; it must not have moved.
        comm: the ranks.
        room: numbers that loops of the caller sum over the ranks in a step.
        limit: growth of the imbalance (work of the busiest rank over the mean) at which the work is shared out anew; None
            keeps all particles where they are.

    Attributes:
        part: the particles that this rank owns, an `Assembly` with ids of its own.
        ids: (owned,) numbers of these ids in the whole scene.
        whole: on rank 0 the whole scene, up to date after `collect`; None elsewhere.
    """

    def __init__(
        self, make: Callable[[], Assembly], comm: Any = MPI.COMM_WORLD, room: int = 0, limit: float | None = LIMIT
    ) -> None:
        self.comm, self._make, self._room, self._limit = comm, make, room, limit
        self.whole = make() if comm.rank == 0 else None
        self._requests: list[Any] = []
        self._seconds = np.zeros(2)
        self.rebuilds = 0
        self._take_part(make())

    def _take_part(self, part: Assembly) -> None:
        """Leave of the whole scene what this rank owns."""
        comm = self.comm
        self.count, self.axes = part.count, part.axes
        self.part, self._signs = part, part._laws.signs
        self._border: Any = None
        self._border_sums = np.zeros(SUMS)
        self._breaks = [part.breaks] if comm.rank == 0 else []
        part._breaks = []
        if comm.rank > 0:  # what has been summed so far is rank 0's
            part._imposed = 0.0
            part._system.sums[:] = 0.0
        self.owners = Owners(MPI.COMM_SELF if comm.size == 1 else comm, self._limit or LIMIT)
        self.ids = np.arange(self.count)
        self._known = all_pairs(part, self.ids, self.count)
        places, scale, _ = self._units()
        mine = slice(None) if comm.rank == 0 else slice(0)  # of the particles that all ranks have
        self.owners.cut(places[mine], self._weights()[mine], scale)
        owner = self.owners.of(places)
        own = loaded(part, self.ids, np.flatnonzero(owner[part._rows] == comm.rank), self._known)
        self.ids, self._known = unload(part, [own], self.count)
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
        clock[TRAVEL] = self.comm.allreduce(clock[TRAVEL], op=MPI.MAX)  # one skin for all
        if self._border is not None:
            self._file_breaks()
            self._known = self._border_pairs()
            if self._limit is not None and self.comm.size > 1:
                self._hand_over()
        self._together(lambda: listing.rebuild(part))
        part._set_skin(self.comm.allreduce(part.skin, op=MPI.MAX))
        self._find_halo()
        if part._system.walls is not None:
            self._agree_on_servos()
        self.rebuilds += 1

    def _weights(self) -> np.ndarray:
        """Cost of each row (n,), in that of moving a particle: half of the listed pairs of each."""
        part, degree = self.part, np.zeros(self.part.count)
        lists = [part._system] if self._border is None else [part._system, self._border]
        for one in lists:
            for rows in (one.first, one.second):
                degree += np.bincount(rows[: one.start[-1]], minlength=part.count)[: part.count]
        return 1.0 + 0.5 * PAIR * degree

    def _hand_over(self) -> None:
        """Give particles to the ranks that are to own them, with their histories, where it is time to."""
        part, comm = self.part, self.comm
        places, scale, periodic = self._units()
        owner = self.owners.look(places, self._weights(), scale, periodic, 2.0 * part._largest_radius)
        if owner is None:
            return
        known = all_pairs(part, self.ids, self.count).joined(self._known.some())  # across the border, too
        receiver = owner[part._rows]
        cargos = [loaded(part, self.ids, np.flatnonzero(receiver == rank), known) for rank in range(comm.size)]
        arrived = comm.alltoall([None if rank == comm.rank else cargo for rank, cargo in enumerate(cargos)])
        arrived[comm.rank] = cargos[comm.rank]
        self.ids, self._known = unload(part, arrived, self.count)

    def _file_breaks(self) -> None:
        """Keep the logged breaks with the particles' numbers; one across a border belongs to the owner of the lower number."""
        part, log = self.part, self._border.breaks
        inside = part.breaks
        inside[:, 1:3] = self.ids[inside[:, 1:3].astype(np.int64)]
        self._breaks.append(inside)
        part._breaks = []
        if log is not None:
            across = log.log[: log.count[0]].copy()
            across[:, 1:3] = self._numbers[across[:, 1:3].astype(np.int64)]
            self._breaks.append(across[np.isin(across[:, 1:3].min(axis=1), self.ids)])
            log.count[0] = 0

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
        self._file_breaks()
        self._breaks = [np.concatenate(self._breaks)]
        parts = comm.gather((self.ids[part._ids], own, pairs, walls, self._sums(), self._breaks[0]), root=0)
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
        whole._system.sums[:] = sum(sums for *_, sums, _ in parts)
        take_histories(whole, [pairs for _, _, pairs, *_ in parts], [walls for *_, walls, _, _ in parts])
        broken = np.concatenate([breaks for *_, breaks in parts])
        whole._file_breaks()
        whole._breaks = [broken[np.lexsort((*np.sort(broken[:, 1:3], axis=1).T, broken[:, 0]))]]
        whole._primed = part._primed
        return whole
