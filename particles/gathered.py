"""What all ranks know together of an assembly that is spread over them: energies, stresses, the whole scene on rank 0."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
from mpi4py import MPI

from particles import energies, listing, network
from particles.assembly import Assembly
from particles.driving import sums_of
from particles.halos import Bordering
from particles.owners import Owners
from particles.parts import ROWS, all_pairs, take_histories, wall_pairs
from particles.system import RADIUS, TRAVEL, WALLS


class Gathered(Bordering):
    """Results of `part`s; every method is collective but those of this rank's own share."""

    whole: Assembly | None
    owners: Owners
    rebuilds: int
    _breaks: list[np.ndarray]
    _stepping: float

    def own_energies(self) -> dict[str, float]:
        """This rank's part of the energies, J, which sum up to those of all particles."""
        part = self.part
        own = part._system
        part._system = own._replace(sums=self._sums())
        terms = energies.table(part)
        part._system = own
        view = self._across()
        if view is not None:
            found = network.contacts(view, with_forces=False)
            for name, energy in network.stored(view, found).items():
                terms[f"elastic_{name}"] = terms.get(f"elastic_{name}", 0.0) + 0.5 * energy
        if self.comm.rank > 0:  # bodies of walls move on all ranks alike
            terms["kinetic_walls"] = terms["imposed"] = 0.0
        return terms

    def _across(self) -> Any:
        """Contacts across the border as those of an assembly, which count half on either side; None without any."""
        if not self.part.count or not int(self._border.start[-1]):
            return None
        view = copy.copy(self.part)
        view._system, view.count = self._border, len(self._border.position)
        view._ids = view._rows = np.arange(view.count)
        view._radii = self._border.position[:, RADIUS].copy()
        return view

    def _summed(self, values: np.ndarray) -> np.ndarray:
        """Sum over all ranks."""
        found = np.ascontiguousarray(values, dtype=float)
        self.comm.Allreduce(MPI.IN_PLACE, found, op=MPI.SUM)
        return found

    def cell_stress(self) -> np.ndarray:
        """Mean stress (axes, axes) in the periodic cell, Pa; see `Assembly.cell_stress`."""
        view = self._across()
        force = network.virial(self.part) + (0.0 if view is None else 0.5 * network.virial(view))
        return self._summed(force) / self.part.cell.volume  # type: ignore[union-attr]

    def force_sums(self) -> np.ndarray:
        """What the unbalanced force ratio is made of; see `Assembly.force_sums`."""
        view = self._across()
        found = sums_of(self.part)
        if view is not None:
            found[3:] += 0.5 * sums_of(view, contacts_only=True)[3:]
        largest = self.comm.allreduce(found[0], op=MPI.MAX)
        return np.append(largest, self._summed(found[1:]))

    def parallel(self, stepping: float | None = None) -> dict[str, Any]:
        """Particles, halos and seconds of each rank; `imbalance`: how much longer than the mean the busiest one computes.

        Args:
            stepping: seconds of this rank in steps, where the loop is the caller's.
        """
        spent = self._stepping if stepping is None else stepping
        own = [self.part.count, self.halo, spent, self._seconds[0], self._seconds[1]]
        particles, halo, stepped, exchange, agreement = np.array(self.comm.allgather(own)).T
        busy = stepped - exchange - agreement
        return {
            "particles": particles.astype(int), "halo": halo.astype(int), "lists": self.rebuilds,
            "handed_over": self.owners.handed, "cuts": self.owners.cuts,
            "seconds": {"stepping": stepped, "exchange": exchange, "agreement": agreement},
            "imbalance": busy.max() / busy.mean() - 1.0 if busy.mean() > 0.0 else 0.0,
        }  # fmt: skip

    @property
    def halo(self) -> int:
        """Particles of other ranks that this one needs."""
        return len(self._halo.into)

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
        parts = comm.gather((self.ids[part._ids], own, pairs, walls, self._sums(), self._breaks[0], part._imposed), root=0)
        if whole is None:
            return None
        for numbers_of, rows, *_ in parts:
            places = whole._rows[numbers_of]
            for name, values in rows.items():
                getattr(whole._system, name)[places] = values
        self.tell_whole()
        whole._imposed = sum(imposed for *_, imposed in parts)
        whole._system.history[:] = 0.0
        whole._system.clock[TRAVEL] = 0.0
        listing.rebuild(whole)
        whole._system.sums[:] = sum(sums for *_, sums, _, _ in parts)
        take_histories(whole, [pairs for _, _, pairs, *_ in parts], [walls for *_, walls, _, _, _ in parts])
        broken = np.concatenate([breaks for *_, breaks, _ in parts])
        whole._file_breaks()
        whole._breaks = [broken[np.lexsort((*np.sort(broken[:, 1:3], axis=1).T, broken[:, 0]))]]
        whole._primed = part._primed
        return whole

    def tell_whole(self) -> None:
        """Bring to the whole scene what every rank knows: time, cell and walls (not collective)."""
        whole, part = self.whole, self.part
        if whole is None:
            return
        whole._system.clock[:] = part._system.clock
        whole.skin = part.skin
        if part.cell is not None and whole.cell is not None:
            for name in ("matrix", "gradient", "rate", "anchor"):
                getattr(whole.cell.arrays, name)[:] = getattr(part.cell.arrays, name)
            whole.cell._whole[:] = part.cell._whole
        if part._system.walls is not None:
            for name in ("body", "wall"):
                getattr(whole._system.walls, name)[:] = getattr(part._system.walls, name)
            for mine, theirs in zip(whole.plates, part.plates):
                mine._rows = list(theirs._rows)
                mine.record = theirs.record
                mine.until_record = theirs.until_record
