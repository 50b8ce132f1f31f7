"""A rank's part of a lattice: the rows of a slab, which it moves, and the rows of others that these feel.

Every rank knows the whole lattice, its bonds and which of them are broken; only displacements near the cuts pass between ranks in
a step. Rows of other ranks that are felt here lend their strains: their neighbours are known, so that these are those that their own
rank finds; their forces are left to it. Bonds that fail are announced, and all ranks break them.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from mpi4py import MPI

from particles.crew import Crew
from particles.dispatch import Direct
from particles.lattice import breaking, motion
from particles.lattice.arrangement import arrange, needed, without_forces
from particles.lattice.geometry import slow_first
from particles.lattice.state import BREAKING, BROKEN_BONDS, SPECIAL, SUMS, Drive, State, Terms

IRREGULAR = 16  # work of a row in neither run nor block, in rows of one
MOTION = ("displacement", "velocity", "force", "strain")  # arrays that rank 0 takes over, the last where it is asked for
SECONDS = ("stepping", "exchange", "agreement")
_kick, _feel, _act = Direct(motion.kick_points), Direct(motion.feel), Direct(motion.act_on)
_failing, _break_together = Direct(breaking.failing), Direct(breaking.break_together)
_fastest = Direct(motion.fastest)
touched, cut_all = Direct(breaking.touched), Direct(breaking.cut_all)
PLANES = 8  # that a rank must at least get of an axis which is not the longest
LISTED = ("loaded", "load", "load_group", "held", "held_axis", "held_group", "absorbing", "dashpot")  # of a drive, from step to step the same


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


def cut_axis(places: np.ndarray, free: np.ndarray, ranks: int) -> int:
    """The axis across which slabs are cut: the one along which rows lie farthest apart in memory, if there are planes enough.

    Rows of a rank, and those that it lends, are then one after the other, but for the two parts of `geometry.order`; across the
    longest axis cuts would be smaller, but go through every stretch of rows.

    Args:
        places: (n, 3) of whole numbers.
        free: (n,) bool.
    """
    wide = np.ptp(places[free], axis=0) + 1 if free.any() else np.ones(3, dtype=np.int64)
    return next((int(axis) for axis in slow_first(places) if wide[axis] >= PLANES * ranks), int(wide.argmax()))


def _consecutive(rows: np.ndarray) -> Any:
    """Rows one after the other as a slice, which is copied sooner; others as they are."""
    whole = len(rows) > 0 and rows[-1] - rows[0] == len(rows) - 1
    return slice(int(rows[0]), int(rows[-1]) + 1) if whole else rows


class Part:
    """The part of one rank (collective).

    Args:
        comm: the ranks.
        state, terms: of the whole lattice, as rank 0 has them.
        owner: (n,) rank of each row, see `owners`.
        free, carried: (n,) bool, see `particles.lattice.arrangement`.
    """

    def __init__(self, comm: Any, state: State, terms: Terms, owner: np.ndarray, free: np.ndarray, carried: np.ndarray) -> None:
        self.comm, self.terms, self._owner = comm, terms, owner
        inside = self._owner == comm.rank
        self.own, self._others = free & inside, free & ~inside
        self.state: State = State._make(None if values is None else values.copy() for values in state)
        self.state.force[:, ~self.own] = 0.0
        self.state.velocity[:, self._others] = 0.0
        self.state.sums[:] = 0.0
        arrange(self.state, terms, self.own, carried | self._others, np.arange(len(free)))
        self.needed = needed(self.state, self.own)
        without_forces(self.state, self._others)
        self._asked = np.ascontiguousarray(~self._others).view(np.uint8)  # rows whose bonds this rank counts, where they have a force here
        self._meet(np.flatnonzero(self.needed & self._others))
        self.seconds = dict.fromkeys(SECONDS, 0.0)
        self._failed = np.zeros(1, dtype=np.int64)
        self._told: dict[int, Drive] = {}
        self._mine: tuple[Any, Drive] | None = None
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
        self.halo = len(wanted)
        self._from = [(rank, _consecutive(rows), np.empty((3, len(rows)))) for rank, rows in enumerate(from_each) if len(rows)]
        self._to = [(rank, _consecutive(rows), np.empty((3, len(rows)))) for rank, rows in enumerate(to_each) if len(rows)]
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

    def told(self, place: int, drive: Drive) -> Drive:
        """A drive with the rows that were told before, where it comes without (see `Parts.order`)."""
        if drive.loaded is None:
            drive = self._told[place]._replace(load_factor=drive.load_factor, held_velocity=drive.held_velocity)
        else:
            self._told[place] = drive
        return drive

    def mine(self, drive: Drive) -> Drive:
        """What acts on the rows of this rank; `drive` is the first argument of an order."""
        drive = self.told(0, drive)
        if self._mine is None or self._mine[0] is not drive.loaded:
            loaded, held, absorbing = (self.own[rows] for rows in (drive.loaded, drive.held, drive.absorbing))
            self._mine = drive.loaded, drive._replace(
                loaded=drive.loaded[loaded], load=drive.load[loaded], load_group=drive.load_group[loaded], held=drive.held[held],
                held_axis=drive.held_axis[held], held_group=drive.held_group[held], absorbing=drive.absorbing[absorbing],
                dashpot=drive.dashpot[absorbing],
            )  # fmt: skip
        return self._mine[1]._replace(load_factor=drive.load_factor, held_velocity=drive.held_velocity)

    # steps

    def advance(self, drive: Drive, steps: int, h: float) -> float:
        """Whole steps, from and to displacements, velocities and forces of one time (collective).

        Returns:
            Largest velocity component, m/s; infinite where any is not finite.
        """
        start, drive, state = time.perf_counter(), self.mine(drive), self.state
        _kick(state, 0.5 * h, h)
        for s in range(steps):
            self.exchange()
            self.feel(h)
            _act(state, self.terms, drive, s, h)
            _kick(state, *((h, h) if s < steps - 1 else (0.5 * h, 0.0)))
        fastest = float(self.comm.allreduce(_fastest(state), op=MPI.MAX))
        self.seconds["stepping"] += time.perf_counter() - start
        return fastest

    def feel(self, h: float) -> None:
        """Forces of the bonds at the displacements of now, once more where bonds fail under them (collective)."""
        state, terms = self.state, self.terms
        _feel(state, terms)
        if terms.limits is None:
            return
        found = _failing(state, terms, terms.limits, self._asked)
        start = time.perf_counter()
        self._failed[0] = len(found)
        self.comm.Allreduce(MPI.IN_PLACE, self._failed)
        self.seconds["agreement"] += time.perf_counter() - start
        if self._failed[0] == 0:
            return
        broken = np.concatenate(self.comm.allgather(found))
        broken = np.ascontiguousarray(broken[np.lexsort(broken.T[::-1])])
        state.sums[BREAKING] += _break_together(state, terms, broken, self._asked, 0.5 * h)
        state.sums[BROKEN_BONDS] += len(found)
        self._broken.append(broken)

    def collect(self, strains: bool = False) -> Any:
        """What rank 0 takes over (collective): rows and motion (9, rows; with strains 15) of each rank, energy sums, bonds broken since."""
        comm, state = self.comm, self.state
        broken, self._broken = self._broken, [np.empty((0, 2), dtype=np.int64)]
        rows = np.flatnonzero(self.own)
        names = MOTION if strains else MOTION[:-1]
        sums, counts = comm.reduce(state.sums), comm.gather(len(rows))
        state.sums[:] = 0.0
        moved = np.ascontiguousarray(np.concatenate([getattr(state, name)[:, rows] for name in names]))  # by rows, as it is received
        if counts is None:
            comm.Send(rows, dest=0)
            comm.Send(moved, dest=0)
            return None
        parts = [(rows, moved)]
        for rank, count in enumerate(counts[1:], start=1):
            parts.append((np.empty(count, dtype=rows.dtype), np.empty((len(moved), count))))
            for one in parts[-1]:
                comm.Recv(one, source=rank)
        return parts, sums, np.concatenate(broken)

    def parallel(self) -> dict[str, Any]:
        """Rows and seconds of every rank, and how much longer than the mean the busiest computes (collective)."""
        seconds = self.seconds | {"stepping": self.seconds["stepping"] - self.seconds["exchange"] - self.seconds["agreement"]}
        found = self.comm.gather({"particles": int(self.own.sum()), "halo": self.halo, "seconds": seconds})
        if found is None:
            return {}
        busy = [one["seconds"]["stepping"] for one in found]
        return {"ranks": found, "imbalance": max(busy) / max(1e-300, sum(busy) / len(busy)) - 1.0}


class Parts:
    """The parts of a lattice on all ranks, as rank 0 sees them.

    Args:
        crew: the ranks.
        kind: `Part`, or what is made of it.
        whole: lattice whose state the parts start from; rows that had owners on as many ranks before keep them.
        more: further arguments of `kind`.
    """

    def __init__(self, crew: Crew, kind: type[Part], whole: Any, *more: Any) -> None:
        self._crew, self._number, self._whole = crew, crew.new(), whole
        self._told: dict[int, Any] = {}
        size = crew.comm.size
        if whole._owner is None or whole._owner[1] != size:
            along = whole.reference[:, cut_axis(whole.places, whole.free, size)]
            whole._owner = owners(whole._state, whole.free, along, size), size
        crew.place(self._number, kind, whole._state, whole._terms, whole._owner[0], whole.free, whole.carried, *more)

    def __del__(self) -> None:
        self._crew.forget(self._number)

    def order(self, name: str, *arguments: Any) -> Any:
        """Let all ranks do something; what rank 0 found. Rows of a drive are told once."""
        return self._crew.order(self._number, name, *(self._brief(place, one) for place, one in enumerate(arguments)))

    def _brief(self, place: int, one: Any) -> Any:
        """An argument, or a drive without what the ranks know from an earlier order."""
        if not isinstance(one, Drive):
            return one
        known, self._told[place] = self._told.get(place) is one.loaded, one.loaded
        return one._replace(**dict.fromkeys(LISTED)) if known else one

    def collect(self, strains: bool = False) -> None:
        """Bring the lattice on rank 0 up to date; its strains, too, where they are asked for."""
        parts, sums, broken = self.order("collect", strains)
        state = self._whole._state
        for rows, moved in parts:
            for k, name in enumerate(MOTION if strains else MOTION[:-1]):
                getattr(state, name)[:, _consecutive(rows)] = moved[3 * k : 3 * k + (6 if name == "strain" else 3)]
        state.sums[:] += sums[:SUMS]
        if len(broken):
            cut_all(state, self._whole._terms, broken, touched(state, broken)[0])
