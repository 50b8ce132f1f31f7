"""A rank's part of a lattice: the rows of a slab, which it moves, and the rows of others that these feel.

Every rank knows the whole lattice, its bonds and which of them are broken; only displacements near the cuts pass between ranks in
a step. Rows of other ranks are carried rows here (see `particles.lattice.arrangement`): their neighbours are known, so that
their strains are those that their own rank has. Bonds that fail are announced, and all ranks break them.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from particles.crew import Crew
from particles.dispatch import Direct
from particles.lattice import breaking, motion
from particles.lattice.arrangement import arrange, needed
from particles.lattice.state import BREAKING, BROKEN_BONDS, SPECIAL, SUMS, Drive, State, Terms

IRREGULAR = 8  # work of a row in neither run nor block, in rows of one
MOTION = {"displacement": 3, "velocity": 3, "force": 3, "strain": 6}  # arrays that rank 0 takes over, and their components
SECONDS = ("stepping", "exchange", "agreement")
_kick, _feel, _act = Direct(motion.kick_points), Direct(motion.feel), Direct(motion.act_on)
_failing, _break_all = Direct(breaking.failing), Direct(breaking.break_all)
touched, cut_all = Direct(breaking.touched), Direct(breaking.cut_all)



def owners(state: State, free: np.ndarray, along: np.ndarray, ranks: int) -> np.ndarray:
    """Rank (n,) of each row: slabs of whole planes across an axis, with about equal work of free rows.

    Args:
        free: (n,) bool.
        along: (n,) place along the axis.
    """
    _, plane = np.unique(np.round(along - along.min(), 12), return_inverse=True)
    alone = (state.force_kind == SPECIAL) & (state.stretch_of < 0)
    work = np.bincount(plane, free * np.where(alone, IRREGULAR, 1))
    middle = np.cumsum(work) - 0.5 * work
    return np.minimum(ranks * middle / max(1.0, work.sum()), ranks - 1).astype(np.int64)[plane]


class Part:
    """The part of one rank (collective).

    Args:
        comm: the ranks.
        state, terms: of the whole lattice, as rank 0 has them.
        along: (n,) place of each row along the longest axis.
        free, carried: (n,) bool, see `particles.lattice.arrangement`.
    """

    def __init__(self, comm: Any, state: State, terms: Terms, along: np.ndarray, free: np.ndarray, carried: np.ndarray) -> None:
        self.comm, self.terms = comm, terms
        self._owner = owners(state, free, along, comm.size)
        inside = self._owner == comm.rank
        self.own, self._others = free & inside, free & ~inside
        self.state: State = State._make(None if values is None else values.copy() for values in state)
        self.state.force[:, ~self.own] = 0.0
        self.state.sums[:] = 0.0
        arrange(self.state, terms, self.own, carried | self._others, np.arange(len(free)))
        self.needed = needed(self.state, self.own)
        self._asked = np.ascontiguousarray(~self._others).view(np.uint8)  # rows whose bonds this rank counts, where they have a force here
        self._meet(np.flatnonzero(self.needed & self._others))
        self.seconds = dict.fromkeys(SECONDS, 0.0)
        self._drive: tuple[Drive, Drive] | None = None
        self._broken: list[np.ndarray] = [np.empty((0, 2), dtype=np.int64)]

    def release(self) -> None:
        """Give the messages back."""
        for request in self._requests:
            request.Free()

    def _meet(self, wanted: np.ndarray) -> None:
        """Learn which rows go to whom in each step.

        Args:
            wanted: rows of other ranks whose displacements are needed here.
        """
        comm = self.comm
        from_each = [wanted[self._owner[wanted] == rank] for rank in range(comm.size)]
        to_each = comm.alltoall(from_each)
        self._from = [(rank, rows, np.empty((3, len(rows)))) for rank, rows in enumerate(from_each) if len(rows)]
        self._to = [(rank, rows, np.empty((3, len(rows)))) for rank, rows in enumerate(to_each) if len(rows)]
        self._requests = [comm.Recv_init(room, source=rank) for rank, _, room in self._from]
        self._requests += [comm.Send_init(room, dest=rank) for rank, _, room in self._to]

    def exchange(self) -> None:
        """Displacements of the rows near the cuts, from the ranks that move them (collective)."""
        start = time.perf_counter()
        moved = self.state.displacement
        for _, rows, room in self._to:
            room[:] = moved[:, rows]
        for request in self._requests:
            request.Start()
        for request in self._requests:
            request.Wait()
        for _, rows, room in self._from:
            moved[:, rows] = room
        self.seconds["exchange"] += time.perf_counter() - start

    def mine(self, drive: Drive) -> Drive:
        """What acts on the rows of this rank."""
        if self._drive is None or self._drive[0].loaded is not drive.loaded:
            loaded, held, absorbing = (self.own[rows] for rows in (drive.loaded, drive.held, drive.absorbing))
            self._drive = drive, drive._replace(
                loaded=drive.loaded[loaded], load=drive.load[loaded], load_group=drive.load_group[loaded], held=drive.held[held],
                held_axis=drive.held_axis[held], held_group=drive.held_group[held], absorbing=drive.absorbing[absorbing],
                dashpot=drive.dashpot[absorbing],
            )  # fmt: skip
        return self._drive[1]._replace(load_factor=drive.load_factor, held_velocity=drive.held_velocity)

    # steps

    def advance(self, drive: Drive, steps: int, h: float) -> Any:
        """Whole steps, from and to displacements, velocities and forces of one time (collective); see `collect`."""
        start, drive, state = time.perf_counter(), self.mine(drive), self.state
        _kick(state, 0.5 * h, h)
        for s in range(steps):
            self.exchange()
            self.feel(h)
            _act(state, self.terms, drive, s, h)
            _kick(state, *((h, h) if s < steps - 1 else (0.5 * h, 0.0)))
        self.seconds["stepping"] += time.perf_counter() - start
        return self.collect()

    def feel(self, h: float) -> None:
        """Forces of the bonds at the displacements of now, once more where bonds fail under them (collective)."""
        state, terms = self.state, self.terms
        _feel(state, terms)
        if terms.limits is None:
            return
        found = _failing(state, terms, terms.limits, self._asked)
        start = time.perf_counter()
        total = self.comm.allreduce(len(found))
        self.seconds["agreement"] += time.perf_counter() - start
        if total == 0:
            return
        broken = np.concatenate(self.comm.allgather(found))
        broken = np.ascontiguousarray(broken[np.lexsort(broken.T[::-1])])
        ends, around = touched(state, broken)
        before = state.force.copy()
        state.sums[BREAKING] += _break_all(state, terms, broken, ends, around, self._asked)
        state.sums[BROKEN_BONDS] += len(found)
        _feel(state, terms)
        change = (before - state.force) * ~self._others
        state.sums[BREAKING] += 0.5 * h * float((state.velocity * change).sum())
        self._broken.append(broken)

    def collect(self) -> Any:
        """What rank 0 takes over: rows, their motion (15, rows), energy sums and the bonds that broke since it last did (collective)."""
        comm, state = self.comm, self.state
        broken, self._broken = self._broken, [np.empty((0, 2), dtype=np.int64)]
        rows = np.flatnonzero(self.own)
        parts, sums = comm.gather((rows, np.concatenate([getattr(state, name)[:, rows] for name in MOTION]))), comm.reduce(state.sums)
        state.sums[:] = 0.0
        return None if parts is None else (*(np.concatenate(ones, axis=-1) for ones in zip(*parts)), sums, np.concatenate(broken))

    def parallel(self) -> dict[str, Any]:
        """Rows and seconds of every rank, and how much longer than the mean the busiest computes (collective)."""
        seconds = self.seconds | {"stepping": self.seconds["stepping"] - self.seconds["exchange"] - self.seconds["agreement"]}
        halo = sum(len(rows) for _, rows, _ in self._from)
        found = self.comm.gather({"particles": int(self.own.sum()), "halo": halo, "seconds": seconds})
        if found is None:
            return {}
        busy = [one["seconds"]["stepping"] for one in found]
        return {"ranks": found, "imbalance": max(busy) / max(1e-300, sum(busy) / len(busy)) - 1.0}


class Parts:
    """The parts of a lattice on all ranks, as rank 0 sees them.

    Args:
        crew: the ranks.
        kind: `Part`, or what is made of it.
        whole: lattice whose state the parts start from.
        more: further arguments of `kind`.
    """

    def __init__(self, crew: Crew, kind: type[Part], whole: Any, *more: Any) -> None:
        self._crew, self._number, self._whole = crew, crew.new(), whole
        along = whole.reference[:, int(np.ptp(whole.places, axis=0).argmax())]
        crew.place(self._number, kind, whole._state, whole._terms, along, whole.free, whole.carried, *more)

    def __del__(self) -> None:
        self._crew.forget(self._number)

    def order(self, name: str, *arguments: Any) -> Any:
        """Let all ranks do something; what rank 0 found."""
        return self._crew.order(self._number, name, *arguments)

    def take_over(self, found: Any) -> None:
        """Give the lattice what `Part.collect` found."""
        rows, moved, sums, broken = found
        state = self._whole._state
        first = 0
        for name, components in MOTION.items():
            getattr(state, name)[:, rows] = moved[first : first + components]
            first += components
        state.sums[:] += sums[:SUMS]
        if len(broken):
            cut_all(state, self._whole._terms, broken, touched(state, broken)[0])
