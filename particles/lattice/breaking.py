"""Failure of bonds: the test, and what a broken bond changes (Zhao et al. 2012, section 2.2.4)."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from particles.lattice.general import bond_energy, elongation_of, force_special, set_clusters, shear_of, strain_special
from particles.lattice.lanes import WIDTH
from particles.lattice.lists import list_kinds
from particles.lattice.masked import energy_masked, force_masked
from particles.lattice.regular import worst_cubic, worst_hexagonal
from particles.lattice.state import (
    AWAKE,
    BROKEN,
    EXPLICIT,
    FORCE_BLOCKS,
    FORCE_RUNS,
    FORCE_SPECIAL,
    REGULAR,
    SPECIAL,
)  # fmt: skip
from particles.system import KERNEL, OUTER

NEARLY = 1.0 - 1e-9  # of a limit: what may be at it but for rounding


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
def _near_failure(state, terms, smallest, plane, first, count):
    """Whether any bond of a run has come to its limit, but for rounding."""
    u, e, group = state.displacement, state.strain, state.group[first]
    if plane is None:
        worst = worst_cubic(
            first, count, state.near[first], terms.spacing, smallest[group, 0], smallest[group, 1], u[0], u[1], u[2],
            e[0], e[1], e[2], e[3], e[4], e[5],
        )  # fmt: skip
    else:
        worst = worst_hexagonal(
            first, count, state.near[first], terms.spacing, smallest[group, 0], smallest[group, 1], u[0], u[1], e[0], e[1], e[5]
        )
    return worst > NEARLY


@njit(**KERNEL)
def _any_fails(state, terms, limits, i):
    """Whether any of the bonds fails that a row leaves in even directions."""
    for k in range(0, state.near.shape[1], 2):
        if fails(state, terms, limits, i, k):
            return True
    return False


@njit(**OUTER)
def failing(state, terms, limits, moving):
    """Bonds (k, 2) that fail now, as row and direction, each asked at the end that it leaves in an even direction.

    Forces must be those of now, as what bonds of blocks have reached is found with them.

    Args:
        moving: None, or the rows (n,) uint8 that are asked, others are not.
    """
    found, room = 0, np.empty((16, 2), dtype=np.int64)
    for q in range(state.counts[FORCE_RUNS]):
        first, count = state.force_runs[q, 0], state.force_runs[q, 1]
        if not _near_failure(state, terms, terms.smallest, terms.plane, first, count):
            continue
        for i in range(first, first + count):
            found, room = _failing_at(state, terms, limits, moving, i, found, room)
    asked = 0  # blocks may have rows in common
    for q in range(state.counts[FORCE_BLOCKS]):
        first = state.force_blocks[q, 0]
        if state.reached[q] > NEARLY:
            for i in range(max(first, asked), first + WIDTH):
                if state.force_kind[i] == SPECIAL and _any_fails(state, terms, limits, i):
                    found, room = _failing_at(state, terms, limits, moving, i, found, room)
        asked = first + WIDTH
    for q in range(state.counts[FORCE_SPECIAL]):
        if _any_fails(state, terms, limits, state.force_special[q]):
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
def touched(state, broken):
    """Rows that some bonds (k, 2), row and direction, end at, and those with their neighbours; each once and in order."""
    seen = np.zeros(len(state.mask), dtype=np.uint8)
    for b in range(len(broken)):
        i, k = broken[b, 0], broken[b, 1]
        _see(state, seen, i)
        _see(state, seen, state.near[i, k])
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
def _see(state, seen, i):
    """Mark a row by 2, and its neighbours by 1."""
    seen[i] = 2
    for k in range(state.near.shape[1]):
        if state.near[i, k] >= 0:
            seen[state.near[i, k]] = max(seen[state.near[i, k]], 1)


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
    before = _energy(state, terms, around, counted)
    cut_all(state, terms, broken, ends)
    for i in ends:
        if state.strain_kind[i]:
            strain_special(state, terms, state.rotation, i)
    return before - _energy(state, terms, around, counted)


@njit(**OUTER)
def break_together(state, terms, broken, counted, by):
    """Break bonds and find the forces without them; the energy that is lost, with what the forces change for a time `by` (s), J."""
    ends, around = touched(state, broken)
    lost = break_all(state, terms, broken, ends, around, counted)
    return lost + by * forces_anew(state, terms, terms.smallest, around)


@njit(**OUTER)
def _energy(state, terms, rows, counted):
    """Energy (J) of the bonds that rows (in order) leave in even directions, of those rows that count; of others in their blocks, too."""
    total, done, mask = 0.0, 0, _counted(state.mask, counted)
    for i in rows:
        if i < done:
            continue
        number = state.stretch_of[i]
        if number >= 0 and i + WIDTH <= state.stretch[number, 1]:
            done = i + WIDTH
            total += energy_masked(
                i, state.onward[number], mask, terms.spacing, terms.normal, terms.shear, state.material[i], state.displacement,
                state.strain,
            )  # fmt: skip
        elif mask[i]:
            for k in range(0, state.near.shape[1], 2):
                total += bond_energy(state, terms, i, k)
    return total


@njit(**OUTER)
def _counted(mask, counted):
    """Bits of the rows that count, none of the others."""
    if counted is None:
        return mask
    return mask * counted


@njit(**KERNEL)
def forces_anew(state, terms, smallest, rows):
    """Forces of rows (in order), and of others in their blocks, by their own bonds; returns the sum of v.(F before - F) of the rows (W)."""
    power, done = _power(state, rows), 0
    for i in rows:
        if i < done or not state.force_kind[i]:
            continue
        number = state.stretch_of[i]
        if number >= 0 and i + WIDTH <= state.stretch[number, 1]:
            done = i + WIDTH
            force_masked(
                i, state.onward[number], state.mask, terms.spacing, terms.normal, terms.shear, smallest, state.material[i],
                state.group[i], state.displacement, state.strain, state.force,
            )  # fmt: skip
        else:
            state.force[0, i] = state.force[1, i] = state.force[2, i] = 0.0
            force_special(state, terms, state.moment, state.rotation, i)
    return power - _power(state, rows)


@njit(**KERNEL)
def _power(state, rows):
    """Sum of v.F of rows (W)."""
    total = 0.0
    for i in rows:
        for a in range(3):
            total += state.velocity[a, i] * state.force[a, i]
    return total
