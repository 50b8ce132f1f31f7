"""Failure of bonds: the test, and what a broken bond changes (Zhao et al. 2012, section 2.2.4)."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from particles.lattice.general import bond_energy, elongation_of, set_cluster, shear_of, strain_special
from particles.lattice.lists import list_rows
from particles.lattice.regular import worst_cubic, worst_hexagonal
from particles.lattice.state import (
    BREAKING,
    BROKEN,
    BROKEN_BONDS,
    EXPLICIT,
    FORCE_RUNS,
    FORCE_SPECIAL,
    SPECIAL,
)  # fmt: skip
from particles.system import KERNEL, OUTER


@njit(**KERNEL)
def fails(state, terms, limits, i, k):
    """Whether an intact bond has passed a limit: the smaller one of its ends."""
    if state.bonds[i, k] & (EXPLICIT | BROKEN) != EXPLICIT:
        return False
    j = state.near[i, k]
    a, b = state.material[i], state.material[j]
    stretch, _, _, _ = elongation_of(state, terms, state.rotation, i, j, k)
    if stretch > min(limits[a, 0], limits[b, 0]):
        return True
    sx, sy, sz = shear_of(state, terms, i, j, k)
    return math.sqrt(sx * sx + sy * sy + sz * sz) > min(limits[a, 1], limits[b, 1])


@njit(**OUTER)
def sever(state, terms, i, k):
    """Break one bond: out of both clusters, their strains anew; books the energy that is lost."""
    j = state.near[i, k]
    before = _around(state, terms, i) + _around(state, terms, j)
    before -= _shared(state, terms, i, j)
    _cut(state, terms, i, k)
    _cut(state, terms, j, k ^ 1)
    strain_special(state, terms, state.rotation, i)
    strain_special(state, terms, state.rotation, j)
    after = _around(state, terms, i) + _around(state, terms, j) - _shared(state, terms, i, j)
    state.sums[BREAKING] += before - after
    state.sums[BROKEN_BONDS] += 1.0


@njit(**OUTER)
def _cut(state, terms, i, k):
    """Take a bond out of the cluster of a row."""
    state.bonds[i, k] = state.bonds[i, k] & EXPLICIT | BROKEN
    state.strain_kind[i] = SPECIAL
    state.force_kind[i] = SPECIAL
    set_cluster(state, terms, i)


@njit(**KERNEL)
def _around(state, terms, i):
    """Energy of the bonds of a row."""
    total = 0.0
    for k in range(state.near.shape[1]):
        total += bond_energy(state, terms, i, k)
    return total


@njit(**KERNEL)
def _shared(state, terms, i, j):
    """Energy of the bonds between two rows, several where the lattice repeats after few sites."""
    total = 0.0
    for k in range(state.near.shape[1]):
        if state.near[i, k] == j:
            total += bond_energy(state, terms, i, k)
    return total


@njit(**KERNEL)
def _near_failure(state, terms, limits, plane, first, count):
    """Whether any bond of a run has come to its limit, but for rounding."""
    u, e, kind = state.displacement, state.strain, state.material[first]
    if plane is None:
        worst = worst_cubic(
            first, count, state.near[first], terms.spacing, limits[kind, 0], limits[kind, 1], u[0], u[1], u[2],
            e[0], e[1], e[2], e[3], e[4], e[5],
        )  # fmt: skip
    else:
        worst = worst_hexagonal(
            first, count, state.near[first], terms.spacing, limits[kind, 0], limits[kind, 1], u[0], u[1], e[0], e[1], e[5]
        )
    return worst > 1.0 - 1e-9


@njit(**OUTER)
def failing(state, terms, limits, moving):
    """Bonds (k, 2) that fail now, as row and direction, each asked at the end that it leaves in an even direction.

    Args:
        moving: None, or the rows (n,) uint8 that are asked, others are not.
    """
    found, room = 0, np.empty((16, 2), dtype=np.int64)
    for q in range(state.counts[FORCE_RUNS]):
        first, count = state.force_runs[q, 0], state.force_runs[q, 1]
        if not _near_failure(state, terms, limits, terms.plane, first, count):
            continue
        for i in range(first, first + count):
            found, room = _failing_at(state, terms, limits, moving, i, found, room)
    for q in range(state.counts[FORCE_SPECIAL]):
        found, room = _failing_at(state, terms, limits, moving, state.force_special[q], found, room)
    return room[:found]


@njit(**OUTER)
def _failing_at(state, terms, limits, moving, i, found, room):
    """Add the failing bonds of one row to `room`, which is doubled where it is full."""
    if moving is not None and not moving[i]:
        return found, room
    for k in range(0, state.near.shape[1], 2):
        if fails(state, terms, limits, i, k):
            if found == len(room):
                room = np.concatenate((room, np.empty_like(room)))
            room[found, 0], room[found, 1] = i, k
            found += 1
    return found, room


@njit(**OUTER)
def break_bonds(state, terms, limits):
    """Break all bonds that fail at the strains of now; whether there were any."""
    if limits is None:
        return False
    broken = failing(state, terms, limits, None)
    for b in range(len(broken)):
        sever(state, terms, broken[b, 0], broken[b, 1])
    if len(broken):
        list_rows(state)
    return len(broken) > 0


@njit(**OUTER)
def cut_all(state, terms, broken):
    """Take bonds (k, 2), row and direction, out of the clusters of their ends, where these have forces here."""
    for b in range(len(broken)):
        i, k = broken[b, 0], broken[b, 1]
        j = state.near[i, k]
        if state.force_kind[i]:
            _cut(state, terms, i, k)
        if state.force_kind[j]:
            _cut(state, terms, j, k ^ 1)
    list_rows(state)


@njit(**OUTER)
def break_all(state, terms, broken, ends, around, counted):
    """Break bonds together; returns the energy that is lost by them and by the strains that change with them (J).

    Args:
        broken: (k, 2) row and direction.
        ends: rows that they end at, each once.
        around: those and their neighbours, each once.
        counted: (n,) uint8, rows whose bonds in even directions count here.
    """
    before = _counted(state, terms, around, counted)
    cut_all(state, terms, broken)
    for i in ends:
        if state.strain_kind[i]:
            strain_special(state, terms, state.rotation, i)
    return before - _counted(state, terms, around, counted)


@njit(**KERNEL)
def _counted(state, terms, rows, counted):
    """Energy of the bonds that some rows leave in even directions, of those rows that count."""
    total = 0.0
    for i in rows:
        if counted[i] and state.force_kind[i]:
            for k in range(0, state.near.shape[1], 2):
                total += bond_energy(state, terms, i, k)
    return total
