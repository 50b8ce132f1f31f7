"""Particles of one scene on several ranks: owners, halos, and what all ranks know together.

Every rank holds the particles that it owns as an `Assembly` of its own. Behind their rows lie those of the halo: particles of other
ranks near enough for a contact. A contact between an owned particle and one of the halo is computed on both sides, from the same
numbers in the same order, so that both ranks keep the same history to the bit and each takes its own force: one message to a
neighbour and step, none back. Energies of such a contact count half on either side. Who owns a particle is a matter of speed alone: halos
are found by where the particles are.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import llvmlite.binding as llvm
import numpy as np
from mpi4py import MPI

from particles import listing, stepping
from particles.assembly import Assembly
from particles.dispatch import Direct, compiled_seconds
from particles.gathered import Gathered
from particles.motion import FINISHED, Unstable, done_with
from particles.owners import LIMIT, PAIR, Owners
from particles.parts import all_pairs, loaded, unload
from particles.ranks import renew
from particles.state import State, restore, state_of, without_ranks
from particles.system import SKIN_SCALE, SUMS, TRAVEL, Terms
from particles.walls.history import recorded, recording
from particles.walls.listing import driven
from particles.walls.rows import DASHPOT, DRIVEN, GIVEN, LOAD, STIFFNESS, VELOCITY
from particles.walls.servo import set_contact_constants

llvm.load_library_permanently(MPI.__file__)  # the compiled loops call MPI by the names of its functions

CALLING = 15e4  # what lists and halos of all ranks cost beside the particles, in steps of a pair (`particles.listing.skin_scale`)


_renew, _done_with = Direct(renew), Direct(done_with)
_ASSIGNED = [*range(VELOCITY, VELOCITY + 6), *range(LOAD, LOAD + 6), GIVEN, DRIVEN]  # columns of a body


def of_as_many(state: State | None, size: int) -> State | None:
    """The states of ranks in a state of a whole scene, where there are as many."""
    ranks: State | None = None if state is None else state.get("ranks")
    return ranks if ranks is not None and len(ranks) == size else None


class SharedAssembly(Gathered):
    """An assembly whose particles are spread over the ranks of a communicator; construction and methods are collective.

    Args:
        make: makes the whole scene, walls and all, the same on every rank.
        comm: the ranks.
        room: numbers that loops of the caller sum over the ranks in a step.
        limit: growth of the imbalance (work of the busiest rank over the mean) at which the work is shared out anew.
        owner: (n,) the rank that each particle, by id, belongs to for good; shared out by work when None.
        whole: what `make` makes, where rank 0 has it already.
        ranks: on rank 0 `states` of a run of as many ranks, to go on from; `whole` has the same state.

    Attributes:
        part: the particles that this rank owns, an `Assembly` with ids of its own.
        ids: (owned,) numbers of these ids in the whole scene.
        whole: on rank 0 the whole scene, up to date after `collect`; None elsewhere.
    """

    def __init__(
        self, make: Callable[[], Assembly], comm: Any = MPI.COMM_WORLD, room: int = 0, limit: float = LIMIT,
        owner: np.ndarray | None = None, whole: Assembly | None = None, ranks: State | None = None,
    ) -> None:  # fmt: skip
        self.comm, self._make, self._room, self._limit, self._owner = comm, make, room, limit, owner
        self.whole = make() if comm.rank == 0 and whole is None else whole
        self._requests: list[Any] = []
        self._seconds = np.zeros(2)
        self._stepping = 0.0
        self.rebuilds = 0
        self._take_part(make(), ranks)

    def _take_part(self, part: Assembly, ranks: State | None) -> None:
        """Leave of the whole scene what this rank owns, or owned in a state of as many ranks, which rank 0 has."""
        comm = self.comm
        known = comm.scatter([None] * comm.size if ranks is None else [ranks[str(rank)] for rank in range(comm.size)])
        self.count, self.axes = part.count, part.axes
        self.part, self._signs = part, part._laws.signs
        self._border: Any = None
        self._border_sums = np.zeros(SUMS)
        self._breaks = [part.breaks] if comm.rank == 0 else []
        part._breaks = []
        if comm.rank > 0:  # what has been summed so far is rank 0's
            part._imposed = 0.0
            part._system.sums[:] = 0.0
        self.owners = Owners(MPI.COMM_SELF if comm.size == 1 else comm, self._limit)
        self.ids = np.arange(self.count)
        self._known = all_pairs(part, self.ids, self.count)
        if known is None:
            owner = self._shared_out() if self._owner is None else self._owner
            own = np.flatnonzero(owner == comm.rank)
        else:
            own = known["ids"]
        self.ids, self._known = unload(part, [loaded(part, self.ids, own, self._known)], self.count)
        part._calling = CALLING
        if known is None:
            self.rebuild()
        else:
            self._go_on(known)

    def _go_on(self, state: State) -> None:
        """Put the state of this rank back, of `states`."""
        restore(self.part, state["part"])
        self._restore_border(state["border"])
        self.owners.restore(state["owners"])
        self._breaks, self.rebuilds = [np.array(state["breaks"])], int(state["rebuilds"])
        _renew(self._halo, self._border, self.part._laws.viscous)

    def states(self) -> State | None:
        """What every rank has, to go on from to the same bits on as many ranks; complete on rank 0, after `collect` (collective)."""
        own = {
            "ids": self.ids, "part": state_of(self.part), "border": self._border_state(), "owners": self.owners.state(),
            "breaks": self._breaks[0], "rebuilds": self.rebuilds,
        }  # fmt: skip
        found = self.comm.gather(own)
        return None if found is None else {str(rank): one for rank, one in enumerate(found)}

    def state(self) -> State:
        """State of the whole scene as of `particles.state.state_of` with those of the ranks, on rank 0; empty elsewhere (collective)."""
        whole, ranks = self.collect(), self.states()
        return {} if whole is None else state_of(whole) | {"ranks": ranks}

    def _shared_out(self) -> np.ndarray:
        """Rank (n,) of each particle by id, where all ranks have all of them: boxes of even work."""
        places, scale, _ = self._units()
        mine = slice(None) if self.comm.rank == 0 else slice(0)
        self.owners.cut(places[mine], self._weights()[mine], scale)
        return self.owners.of(places)[self.part._rows]

    def restore(self, state: State | None) -> None:
        """Go on from a `state`, or one of `particles.state.state_of` of the whole scene, which rank 0 has.

        As many ranks as have written it go on to the same bits; others share the particles out anew.

        Raises:
            ValueError: the particles, walls or contact laws are not the same.
        """
        ranks = of_as_many(state, self.comm.size)
        state = self.comm.bcast(None if state is None else without_ranks(state), root=0)
        part = self._make()
        for soil in (part,) if self.whole is None else (part, self.whole):
            restore(soil, state)
        self._take_part(part, ranks)

    # Lists and halos ---------------------------------------------------------------------------------------------------

    def rebuild(self) -> None:
        """New lists on all ranks, new halos; contact histories are carried along.

        Raises:
            Unstable: a particle of any rank has no finite position or velocity.
        """
        part, clock = self.part, self.part._system.clock
        common = np.array([clock[TRAVEL], clock[SKIN_SCALE]])  # and so one skin for all
        self.comm.Allreduce(MPI.IN_PLACE, common, op=MPI.MAX)
        clock[TRAVEL], clock[SKIN_SCALE] = common
        listing.fit(part)
        if self._border is None or not self._pruned():
            self._search()
        if part._system.walls is not None:
            self._agree_on_servos()
        self.rebuilds += 1

    def _pruned(self) -> bool:
        """Make the lists out of the outer ones and the halo as it is; whether these reach far enough, on all ranks."""
        part, comm = self.part, self.comm
        if comm.allreduce(not listing.holds(part, self._halo_skin), op=MPI.LOR):
            return False
        _renew(self._halo, self._border, part._laws.viscous)
        known = self._border_histories()
        if self._border.breaks is not None:
            self._file_breaks()
        if any(self._together(lambda: listing.build(part, False))):  # bonds have asked for more
            return False
        self._list_border(known)
        return True

    def _search(self) -> None:
        """Outer lists and halos anew, on all ranks."""
        part, comm = self.part, self.comm
        if self._border is not None:
            self._file_breaks()
            self._known = self._border_pairs()
            if self._owner is None and comm.size > 1:
                self._hand_over()
        while True:
            self._together(lambda: listing.build(part, True))
            skins = np.array([part.skin, -part.skin])
            comm.Allreduce(MPI.IN_PLACE, skins, op=MPI.MAX)
            if skins[0] == -skins[1]:
                break
            part._set_skin(skins[0])  # bonds of one rank have asked for more
        self._find_halo()

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

    def refresh(self) -> None:
        """New lists where one is used up on any rank; see `Assembly.refresh`.

        Raises:
            Unstable: on every rank, when particles of any rank blow up.
        """
        if _done_with(self.part._system, self._halo):
            self._together(lambda: stepping.raise_runaway(self.part, self.part._step, ""))
            self.rebuild()

    @property
    def across(self) -> tuple[Any, Any]:
        """Border and halo for `particles.motion.evaluate`; of the present list."""
        return self._border, self._halo

    def _agree_on_servos(self) -> None:
        body = self.part._system.walls.body
        for column in (STIFFNESS, DASHPOT):
            found = np.ascontiguousarray(body[:, column])
            self.comm.Allreduce(MPI.IN_PLACE, found, op=MPI.MAX)
            body[:, column] = found

    def _together(self, work: Callable[[], Any]) -> list[Any]:
        """Do something on every rank, what it returned on each; what goes wrong on one of them is an error of all."""
        try:
            result = work()
        except (Unstable, ValueError) as failure:
            result = failure
        results: list[Any] = self.comm.allgather(result)
        for problem in results:
            if isinstance(problem, Exception):
                problem.on_all_ranks = True  # type: ignore[attr-defined]
                raise problem
        return results

    # Stepping ----------------------------------------------------------------------------------------------------------

    def prepare(self, step: float, steps: int = 1, **loads: Any) -> Terms:
        """Make ready for steps; see `Assembly.prepare`."""
        part = self.part
        terms = part.terms(**loads)
        part._step = step
        if self.comm.allreduce(stepping.is_worn(part), op=MPI.LOR):
            self.rebuild()
        set_contact_constants(part)
        if part._system.walls is not None:
            self._agree_on_servos()
        if stepping.needs_start(part, terms):
            stepping.start(part, terms, step, self.comm.allreduce(stepping.is_led(part), op=MPI.LOR), self._border, self._halo)
        walls = part._system.walls
        if walls is not None and (walls.drive is not None or (walls.body[:, DRIVEN] > 0.0).any()):
            # functions of time may be known on rank 0 alone
            found: list[Any] = []
            self._together(lambda: found.append(None if self.comm.rank else driven(part.plates, walls, part.time, step, steps).drive))
            part._system = part._system._replace(walls=walls._replace(drive=self.comm.bcast(found[0], root=0)))
            walls.drive_step[0] = 0
        return terms

    def advance(self, steps: int, step: float, **loads: Any) -> None:
        """Make `steps` steps of size `step` (s); see `Assembly.advance`.

        Raises:
            Unstable: on every rank, when particles of any rank blow up.
        """
        if steps == 0:
            return
        start, before = time.perf_counter(), compiled_seconds()
        try:
            self._advance(steps, step, self.prepare(step, steps, **loads))
        finally:
            self._stepping += time.perf_counter() - start - (compiled_seconds() - before)

    def _advance(self, steps: int, step: float, terms: Terms) -> None:
        part = self.part
        part._system = recording(part.plates, part._system, int(steps))
        left, resume = int(steps), False
        try:
            while True:
                done, code = stepping.advance(part._system, terms, left, step, resume, self._border, self._halo)
                left -= done
                if code == FINISHED:
                    return
                self._together(lambda: stepping.raise_runaway(part, step, f" in step {steps - left}"))
                self.rebuild()
                resume = True
        finally:
            part._system = recorded(part.plates, part._system)

    def deform(self, velocity_gradient: Any) -> None:
        """Deform the periodic cell; see `Assembly.deform`."""
        part = self.part
        moments = np.append(part.masses @ part.positions, part.masses.sum())
        self.comm.Allreduce(MPI.IN_PLACE, moments, op=MPI.SUM)
        part._deform(velocity_gradient, moments[:-1] / moments[-1] if self.count else moments[:-1])

    def release(self) -> None:
        """Give back what MPI holds for messages; the assembly can no longer be moved."""
        for request in self._requests:
            request.Free()
        self._requests = []

    # Walls of a script that has the whole ----------------------------------------------------------------------------------

    def news_of_walls(self) -> Any:
        """On rank 0: what a script has assigned to the walls of the whole since the ranks were told last; None for nothing."""
        whole, part = self.whole, self.part
        if whole is None or part._system.walls is None or whole._system.walls is None:
            return None
        body = whole._system.walls.body[:, _ASSIGNED]
        loaded = [wall.has_new_load() for wall in whole.plates]
        records = [(wall.record, wall.until_record) for wall in whole.plates]
        if not any(loaded) and np.array_equal(body, part._system.walls.body[:, _ASSIGNED]):
            if records == [(wall.record, wall.until_record) for wall in part.plates]:
                return None
        return body, any(loaded), records

    def hear_of_walls(self, news: Any) -> None:
        """Take over news of the walls."""
        body, loaded, records = news
        self.part._system.walls.body[:, _ASSIGNED] = body
        for wall, (every, until) in zip(self.part.plates, records):
            wall.record = every
            wall.until_record = until
        if loaded:
            self.part._primed = None

    # Results -----------------------------------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """Time since the start, s."""
        return self.part.time

    @property
    def seconds(self) -> dict[str, float]:
        """Time of this rank in exchanging rows (waiting for others included) and in agreeing on numbers, s."""
        return {"exchange": float(self._seconds[0]), "agreement": float(self._seconds[1])}
