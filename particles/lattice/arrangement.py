"""Which rows of a lattice move, which only lend their displacements, and how the force of each is found."""

from __future__ import annotations

import numpy as np

from particles.dispatch import Direct
from particles.lattice import general, lists
from particles.lattice.state import BROKEN, EXPLICIT, JOINED, NONE, SPECIAL, State, Terms

_list_rows, _set_clusters = Direct(lists.list_rows), Direct(general.set_clusters)


def arrange(state: State, terms: Terms, free: np.ndarray, carried: np.ndarray, rows: np.ndarray) -> None:
    """Flags of bonds, kinds and lists of rows anew.

    A bond has a force of its own where one end at least is free and the other free or carried; carried rows that have one keep all
    of their neighbours in their clusters.

    Args:
        free: (n,) bool, rows that move by their forces.
        carried: (n,) bool, rows whose displacements are given, none of them free.
        rows: those whose bonds may differ from before.
    """
    near = state.near[rows]
    there, own_free, own_carried = near >= 0, free[rows, None], carried[rows, None]
    other_free, other_known = there & free[near], there & (free[near] | carried[near])
    explicit = (own_free & other_known) | (own_carried & other_free)
    acting = explicit.any(axis=1) | free[rows]
    broken = state.bonds[rows] & BROKEN
    flags = np.where(there & (broken == 0), JOINED, 0) | np.where(explicit, EXPLICIT, 0) | broken
    state.bonds[rows] = np.where(acting[:, None], flags, 0)
    plain = terms.plane is not None and state.moment is None and state.rotation is None
    for kind, flag in ((state.strain_kind, JOINED), (state.force_kind, JOINED | EXPLICIT)):
        kind[rows] = np.where(acting, lists.kinds(rows, state.near, state.bonds, state.alike, flag) if plain else SPECIAL, NONE)
    state.moving[rows] = free[rows]
    _set_clusters(state, terms, rows)
    _list_rows(state)


def needed(state: State, free: np.ndarray) -> np.ndarray:
    """Rows (n,) bool whose displacements forces depend on, without being free: carried rows with bonds, and their neighbours."""
    found = (state.force_kind > 0) & ~free
    near = state.near[found]
    found[near[near >= 0]] = True
    return found & ~free


def needed_among(state: State, free: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """The same (rows,) of some rows alone."""
    near = state.near[rows]
    lending = (near >= 0) & (state.force_kind[near] > 0) & ~free[near]
    return ~free[rows] & ((state.force_kind[rows] > 0) | lending.any(axis=1))


def without_forces(state: State, rows: np.ndarray) -> None:
    """Leave the forces of rows (n,) bool out of all lists; their strains stay."""
    state.force_kind[rows] = NONE
    _list_rows(state)
