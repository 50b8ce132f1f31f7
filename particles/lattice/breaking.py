"""Failure of bonds: the test, and what a broken bond changes (Zhao et al. 2012, section 2.2.4)."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from particles.lattice.general import ALL, elongation_of, set_clusters, shear_of, strain_special
from particles.lattice.lanes import WIDTH
from particles.lattice.lists import list_kinds
from particles.lattice.masked import NEARLY, reached_masked
from particles.lattice.regular import worst_hexagonal
from particles.lattice.some import energy_of, forces_of, power_of
from particles.lattice.state import (
    AWAKE,
    BROKEN,
    EXPLICIT,
    FORCE_BLOCKS,
    FORCE_RUNS,
    FORCE_SPECIAL,
    REGULAR,
    SPECIAL,
    UNLIMITED,
)  # fmt: skip
from particles.system import KERNEL, OUTER

MOST = 9  # bonds of a row in even directions


@njit(**KERNEL)
def fails(state, terms, limits, i, k):
    """Whether an intact bond has passed a limit: the smaller one of its ends."""
    if state.bonds[i, k] & (EXPLICIT | BROKEN) != EXPLICIT:
        return False
    j = state.near[i, k]
    a, b = state.material[i], state.material[j]
    normal, shear = min(limits[a, 0], limits[b, 0]), min(limits[a, 1], limits[b, 1])
    if normal >= UNLIMITED and shear >= UNLIMITED:
        return False
    stretch, _, _, _ = elongation_of(state, terms, state.rotation, i, j, k)
    if stretch > normal:
        return True
    sx, sy, sz = shear_of(state, terms, i, j, k)
    return math.sqrt(sx * sx + sy * sy + sz * sz) > shear


@njit(**KERNEL)
def _cut(state, i, k):
    """Take a bond out of what a row has, if it has a strain here; some have no force (see `particles.lattice.part`).

    Returns:
        Whether it was a regular row so far.
    """
    regular = state.strain_kind[i] == REGULAR or state.force_kind[i] == REGULAR
    if state.strain_kind[i]:
        state.bonds[i, k] = state.bonds[i, k] & EXPLICIT | BROKEN
        state.strain_kind[i] = SPECIAL
        if state.force_kind[i]:
            state.force_kind[i] = SPECIAL
    return regular


@njit(**KERNEL)
def _near_failure(state, terms, smallest, first, count):
    """Whether any bond of a run has come to its limit, but for rounding."""
    u, e, group = state.displacement, state.strain, state.group[first]
    worst = worst_hexagonal(
        first, count, state.near[first], terms.spacing, smallest[group, 0], smallest[group, 1], u[0], u[1], e[0], e[1], e[5]
    )
    return worst > NEARLY


@njit(**KERNEL)
def _failing_ways(state, terms, limits, moving, i, asked):
    """A bit for each even direction, of those with a bit in `asked`, in which a bond of a row fails; none of rows that are not asked."""
    ways = 0
    if moving is None or moving[i]:
        for k in range(0, state.near.shape[1], 2):
            if asked >> k & 1 and fails(state, terms, limits, i, k):
                ways |= 1 << k
    return ways


@njit(**OUTER)
def _noted(room, found, i, ways):
    """Add the bonds of a row in some directions to the first `found` of `room`, which is doubled where it is full."""
    if found + MOST > len(room):
        room = np.concatenate((room, np.empty((len(room) + MOST, 2), dtype=np.int64)))
    for k in range(0, 2 * MOST, 2):
        if ways >> k & 1:
            room[found, 0], room[found, 1] = i, k
            found += 1
    return room, found


@njit(**OUTER)
def _failing_in_blocks(state, terms, plane, limits, moving, room, found):
    """Add what fails in blocks, which the hexagonal lattice has none of."""
    if plane is not None:
        return room, found
    candidates = np.empty(WIDTH, dtype=np.int64)
    for q in range(state.counts[FORCE_BLOCKS]):
        if state.reached[q]:
            first, number = state.force_blocks[q, 0], state.force_blocks[q, 1]
            asked = state.force_blocks[q - 1, 0] + WIDTH if q > 0 else 0  # blocks may have rows in common
            reached_masked(
                first, state.onward[number], state.mask, terms.spacing, terms.smallest, state.group[first], state.displacement,
                state.strain, candidates,
            )  # fmt: skip
            for i in range(max(first, asked), first + WIDTH):
                ways = 0
                if candidates[i - first] and state.force_kind[i] == SPECIAL:
                    ways = _failing_ways(state, terms, limits, moving, i, candidates[i - first])
                if ways:
                    room, found = _noted(room, found, i, ways)
    return room, found


@njit(**OUTER)
def failing(state, terms, limits, moving):
    """Bonds (k, 2) that fail now, as row and direction, each asked at the end that it leaves in an even direction.

    Forces must be those of now, as what bonds of blocks have reached is found with them.

    Args:
        moving: None, or the rows (n,) uint8 that are asked, others are not.
    """
    found, room = 0, np.empty((MOST, 2), dtype=np.int64)
    for q in range(state.counts[FORCE_RUNS]):
        first, count = state.force_runs[q, 0], state.force_runs[q, 1]
        if _never_fails(state, terms.smallest, first) or not _near_failure(state, terms, terms.smallest, first, count):
            continue
        for i in range(first, first + count):
            ways = _failing_ways(state, terms, limits, moving, i, ALL)
            if ways:
                room, found = _noted(room, found, i, ways)
    room, found = _failing_in_blocks(state, terms, terms.plane, limits, moving, room, found)
    for q in range(state.counts[FORCE_SPECIAL]):
        i, ways = state.force_special[q], 0
        if not _never_fails(state, terms.smallest, i):
            ways = _failing_ways(state, terms, limits, moving, i, ALL)
        if ways:
            room, found = _noted(room, found, i, ways)
    for i in state.strays:
        ways = 0
        if state.force_kind[i] and not _never_fails(state, terms.smallest, i):
            ways = _failing_ways(state, terms, limits, moving, i, state.stray[i])
        if ways:
            room, found = _noted(room, found, i, ways)
    return room[:found]


@njit(**KERNEL)
def _never_fails(state, smallest, i):
    """Whether the bonds of a row, and of others of its group, have no limits."""
    return smallest[state.group[i], 0] >= UNLIMITED and smallest[state.group[i], 1] >= UNLIMITED


@njit(**OUTER)
def touched(state, broken):
    """Rows that some bonds (k, 2), row and direction, end at, and those with their neighbours; each once and in order."""
    seen = np.zeros(len(state.mask), dtype=np.uint8)
    for b in range(len(broken)):
        i, k = broken[b, 0], broken[b, 1]
        _see_around(state, seen, i)
        _see_around(state, seen, state.near[i, k])
    for b in range(len(broken)):
        i, k = broken[b, 0], broken[b, 1]
        seen[i] = seen[state.near[i, k]] = 2
    around = np.empty(2 * len(broken) * (1 + state.near.shape[1]), dtype=np.int64)
    ends = np.empty(2 * len(broken), dtype=np.int64)
    number = last = 0
    for q in range(state.counts[AWAKE]):  # others have neither strains nor forces
        for i in range(state.awake[q, 0], state.awake[q, 1]):
            if seen[i]:
                around[number] = i
                number += 1
                if seen[i] == 2:
                    ends[last] = i
                    last += 1
    return ends[:last], around[:number]


@njit(**KERNEL)
def _see_around(state, seen, i):
    """Mark the neighbours of a row."""
    for k in range(state.near.shape[1]):
        if state.near[i, k] >= 0:
            seen[state.near[i, k]] = 1


@njit(**OUTER)
def cut_all(state, terms, broken, ends):
    """Take bonds (k, 2), row and direction, out of the clusters of their ends (see `touched`), where these have strains here."""
    changed = False
    for b in range(len(broken)):
        i, k = broken[b, 0], broken[b, 1]
        one, other = _cut(state, i, k), _cut(state, state.near[i, k], k ^ 1)
        changed = changed or one or other
    set_clusters(state, terms, ends)
    if changed:
        list_kinds(state)


@njit(**OUTER)
def break_all(state, terms, broken, ends, around, counted):
    """Break bonds together; returns the energy that is lost by them and by the strains that change with them (J).

    Args:
        broken: (k, 2) row and direction.
        ends, around: see `touched`.
        counted: None, or (n,) uint8: rows whose bonds in even directions count here.
    """
    before = energy_of(state, terms, around, counted)
    cut_all(state, terms, broken, ends)
    for i in ends:
        if state.strain_kind[i]:
            strain_special(state, terms, state.rotation, i)
    return before - energy_of(state, terms, around, counted)


@njit(**KERNEL)
def forces_anew(state, terms, rows):
    """Forces of rows (in order), and of others in their blocks, by their own bonds; returns the sum of v.(F before - F) of the rows (W)."""
    power = power_of(state, rows)
    forces_of(state, terms, terms.smallest, rows)
    return power - power_of(state, rows)


@njit(**OUTER)
def break_together(state, terms, broken, counted, by):
    """Break bonds and find the forces without them; the energy that is lost, with what the forces change for a time `by` (s), J."""
    ends, around = touched(state, broken)
    lost = break_all(state, terms, broken, ends, around, counted)
    return lost + by * forces_anew(state, terms, around)
