"""Which rows each loop visits: runs of regular rows, and special ones."""

from __future__ import annotations

import numpy as np
from numba import njit

from particles.lattice.state import (
    BROKEN,
    EXPLICIT,
    FORCE_RUNS,
    FORCE_SPECIAL,
    MOVING_RUNS,
    REGULAR,
    SPECIAL,
    STRAIN_RUNS,
    STRAIN_SPECIAL,
)  # fmt: skip
from particles.system import INNER, STEPS

LONGEST = 512  # rows of a run, so that what one loop reads is still near for the next


@njit(**INNER)
def _runs(kind, wanted, follows, material, runs):
    """Write runs of rows of a kind; where `follows` is given, of one material with neighbours in runs, too. Returns their number."""
    found = 0
    for i in range(len(kind)):
        if kind[i] != wanted:
            continue
        on = i > 0 and kind[i - 1] == wanted
        if on and follows is not None:
            on = follows[i] == 1 and material[i] == material[i - 1]
        if on and runs[found - 1, 1] < LONGEST:
            runs[found - 1, 1] += 1
        else:
            runs[found, 0], runs[found, 1] = i, 1
            found += 1
    return found


@njit(**INNER)
def _special(kind, rows):
    """Write the special rows; returns their number."""
    found = 0
    for i in range(len(kind)):
        if kind[i] == SPECIAL:
            rows[found] = i
            found += 1
    return found


@njit(**STEPS)
def list_rows(state):
    """All lists anew from the kinds of the rows."""
    state.counts[STRAIN_RUNS] = _runs(state.strain_kind, REGULAR, state.follows, state.material, state.strain_runs)
    state.counts[STRAIN_SPECIAL] = _special(state.strain_kind, state.strain_special)
    state.counts[FORCE_RUNS] = _runs(state.force_kind, REGULAR, state.follows, state.material, state.force_runs)
    state.counts[FORCE_SPECIAL] = _special(state.force_kind, state.force_special)
    state.counts[MOVING_RUNS] = _runs(state.moving, 1, None, None, state.moving_runs)


def kinds(rows: np.ndarray, near: np.ndarray, bonds: np.ndarray, material: np.ndarray, flags: int) -> np.ndarray:
    """Kinds (rows,) uint8: REGULAR with all neighbours and all bonds intact and of these flags (with EXPLICIT: one material all
    around); else SPECIAL."""
    whole = np.all((bonds[rows] & (flags | BROKEN)) == flags, axis=1)
    if flags & EXPLICIT:
        whole &= np.all((near[rows] >= 0) & (material[near[rows]] == material[rows, None]), axis=1)
    return np.where(whole, REGULAR, SPECIAL).astype(np.uint8)
