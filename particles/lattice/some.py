"""Strains, forces and energies of some rows, in order: in blocks of eight where they lie in stretches, one by one elsewhere."""

from __future__ import annotations

from numba import njit

from particles.lattice.general import ALL, add_force, add_stray_strain, energy_of_row, strain_special
from particles.lattice.lanes import WIDTH
from particles.lattice.masked import energy_masked, force_masked, strain_masked
from particles.system import KERNEL, OUTER


@njit(**KERNEL)
def strains_of(state, terms, rows):
    """Strains of rows, and of others in their blocks; none of rows without neighbours in their clusters."""
    done = 0
    for i in rows:
        if i < done:
            continue
        number = state.stretch_of[i]
        if number >= 0 and i + WIDTH <= state.stretch[number, 1]:
            done = i + WIDTH
            strain_masked(i, state.onward[number], state.mask, state.cluster, terms.whole, terms.spacing, state.displacement, state.strain)
            for j in range(i, done):
                if state.stray[j] and state.strain_kind[j]:
                    add_stray_strain(state, terms, j)
        elif state.strain_kind[i]:
            strain_special(state, terms, state.rotation, i)


@njit(**KERNEL)
def forces_of(state, terms, smallest, rows):
    """Forces of rows, and of others in their blocks, by their own bonds."""
    done = 0
    for i in rows:
        if i < done or not state.force_kind[i]:
            continue
        number = state.stretch_of[i]
        if number >= 0 and i + WIDTH <= state.stretch[number, 1]:
            done = i + WIDTH
            force_masked(
                i, state.onward[number], state.mask, terms.spacing, state.springs[number], smallest, state.group[i], state.displacement,
                state.strain, state.force,
            )  # fmt: skip
            for j in range(i, done):
                if state.stray[j] and state.force_kind[j]:
                    add_force(state, terms, state.moment, state.rotation, j, state.stray[j])
        else:
            state.force[0, i] = state.force[1, i] = state.force[2, i] = 0.0
            add_force(state, terms, state.moment, state.rotation, i, ALL)


@njit(**KERNEL)
def power_of(state, rows):
    """Sum of v.F of rows that have bonds (W)."""
    total = 0.0
    for i in rows:
        if state.force_kind[i]:
            for a in range(3):
                total += state.velocity[a, i] * state.force[a, i]
    return total


@njit(**OUTER)
def energy_of(state, terms, rows, counted):
    """Energy (J) of the bonds that rows leave in even directions, of those rows that count; of others in their blocks, too."""
    total, done, mask = 0.0, 0, _counted(state.mask, counted)
    for i in rows:
        if i < done:
            continue
        number = state.stretch_of[i]
        if number >= 0 and i + WIDTH <= state.stretch[number, 1]:
            done = i + WIDTH
            total += energy_masked(i, state.onward[number], mask, terms.spacing, state.springs[number], state.displacement, state.strain)
            for j in range(i, done):
                if state.stray[j] and (counted is None or counted[j]):
                    total += energy_of_row(state, terms, j, state.stray[j])
        elif counted is None or counted[i]:
            total += energy_of_row(state, terms, i, ALL)
    return total


@njit(**OUTER)
def _counted(mask, counted):
    """Bits of the rows that count, none of the others."""
    if counted is None:
        return mask
    return mask * counted
