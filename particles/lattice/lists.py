"""Which rows each loop visits: runs of regular rows, blocks that hold special ones, and special rows elsewhere."""

from __future__ import annotations

import numpy as np
from numba import njit

from particles.lattice.blocks import list_blocks
from particles.lattice.state import (
    AWAKE,
    BROKEN,
    EXPLICIT,
    FORCE_BLOCKS,
    FORCE_RUNS,
    FORCE_SPECIAL,
    MOVING_RUNS,
    NONE,
    REGULAR,
    SPECIAL,
    STRAIN_BLOCKS,
    STRAIN_RUNS,
    STRAIN_SPECIAL,
)  # fmt: skip
from particles.system import INNER, STEPS

LONGEST = 512  # rows of a run, so that what one loop reads is still near for the next
GAP = 64  # rows asleep that are looked at with those around them


@njit(**INNER)
def _runs(kind, wanted, follows, group, first, last, runs, found):
    """Add runs of rows of a kind from `first` to `last`; where `follows` is given, of one group with neighbours in runs, too.

    Returns:
        How many there are, `found` of them before.
    """
    for i in range(first, last):
        if kind[i] != wanted:
            continue
        on = i > first and kind[i - 1] == wanted
        if on and follows is not None:
            on = follows[i] == 1 and group[i] == group[i - 1]
        if on and runs[found - 1, 1] < LONGEST:
            runs[found - 1, 1] += 1
        else:
            runs[found, 0], runs[found, 1] = i, 1
            found += 1
    return found


@njit(**INNER)
def _awake(strain_kind, force_kind, ranges):
    """Write ranges of rows that hold all with strains or forces; returns their number."""
    found = 0
    for i in range(len(strain_kind)):
        if strain_kind[i] == NONE and force_kind[i] == NONE:
            continue
        if found > 0 and i - ranges[found - 1, 1] < GAP:
            ranges[found - 1, 1] = i + 1
        else:
            ranges[found, 0], ranges[found, 1] = i, i + 1
            found += 1
    return found


@njit(**STEPS)
def list_rows(state):
    """All lists anew from the kinds of the rows."""
    state.counts[AWAKE] = _awake(state.strain_kind, state.force_kind, state.awake)
    state.counts[MOVING_RUNS] = _runs(state.moving, 1, None, None, 0, len(state.moving), state.moving_runs, 0)
    list_kinds(state)


@njit(**STEPS)
def list_kinds(state):
    """Lists anew after regular rows have become special ones."""
    of, stretch, follows, group = state.stretch_of, state.stretch, state.follows, state.group
    strain_runs = strain_blocks = strain_special = force_runs = force_blocks = force_special = 0
    for q in range(state.counts[AWAKE]):
        first, last = state.awake[q, 0], state.awake[q, 1]
        strain_runs = _runs(state.strain_kind, REGULAR, follows, group, first, last, state.strain_runs, strain_runs)
        force_runs = _runs(state.force_kind, REGULAR, follows, group, first, last, state.force_runs, force_runs)
        strain_blocks, strain_special = list_blocks(
            state.strain_kind, of, stretch, first, last, state.strain_blocks, state.strain_special, strain_blocks, strain_special
        )
        force_blocks, force_special = list_blocks(
            state.force_kind, of, stretch, first, last, state.force_blocks, state.force_special, force_blocks, force_special
        )
    counts = state.counts
    counts[STRAIN_RUNS], counts[STRAIN_BLOCKS], counts[STRAIN_SPECIAL] = strain_runs, strain_blocks, strain_special
    counts[FORCE_RUNS], counts[FORCE_BLOCKS], counts[FORCE_SPECIAL] = force_runs, force_blocks, force_special


def kinds(rows: np.ndarray, near: np.ndarray, bonds: np.ndarray, alike: np.ndarray, flags: int) -> np.ndarray:
    """Kinds (rows,) uint8: REGULAR with all neighbours and all bonds intact and of these flags (with EXPLICIT: one stiffness all
    around); else SPECIAL."""
    whole = np.all((bonds[rows] & (flags | BROKEN)) == flags, axis=1)
    if flags & EXPLICIT:
        whole &= np.all((near[rows] >= 0) & (alike[near[rows]] == alike[rows, None]), axis=1)
    return np.where(whole, REGULAR, SPECIAL).astype(np.uint8)
