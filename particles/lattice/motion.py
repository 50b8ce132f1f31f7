"""Explicit central difference of a lattice as building blocks for jitted loops.

A run of steps of size h is a `kick` of half a step with a drift, then for every step `evaluate` and a `kick` with a drift (more
steps follow) or of half a step (the last one). After a drift displacements are at the new time and velocities in the middle of
the step; in the end both are of the same time. Sums grow by h v.X at each evaluation of a force X, with v the mean of the velocities before and after it: together
with the kinetic energy in the middle of the step, and E - h/2 v.F for an elastic energy, the balance closes to rounding where the
energy is quadratic.
"""

from __future__ import annotations

import math

from numba import njit

from particles.lattice.breaking import break_all, failing, forces_anew, touched
from particles.lattice.general import (
    ALL,
    add_force,
    add_stray_strain,
    energy_of_row,
    moment_of,
    spread_moment,
    strain_special,
)
from particles.lattice.lanes import WIDTH
from particles.lattice.masked import energy_masked, force_masked, strain_masked
from particles.lattice.regular import force_hexagonal, strain_hexagonal
from particles.lattice.state import (
    ABSORBED,
    AWAKE,
    BREAKING,
    BROKEN_BONDS,
    DAMPING,
    EXCESS,
    EXTERNAL,
    FORCE_BLOCKS,
    FORCE_RUNS,
    FORCE_SPECIAL,
    HELD,
    MOVING_RUNS,
    STRAIN_BLOCKS,
    STRAIN_RUNS,
    STRAIN_SPECIAL,
)  # fmt: skip
from particles.system import KERNEL, OUTER, STEADY, STEPS

STEADY_STEPS = {**STEPS, "fastmath": STEADY}


@njit(**KERNEL)
def strains(state, terms, plane):
    """Strains of all rows that need one."""
    u, e = state.displacement, state.strain
    if plane is not None:
        for q in range(state.counts[STRAIN_RUNS]):
            first, count = state.strain_runs[q, 0], state.strain_runs[q, 1]
            strain_hexagonal(first, count, state.near[first], terms.spacing, u[0], u[1], e[0], e[1], e[5])
    else:
        for q in range(state.counts[STRAIN_BLOCKS]):
            first, number = state.strain_blocks[q, 0], state.strain_blocks[q, 1]
            strain_masked(first, state.onward[number], state.mask, state.cluster, terms.whole, terms.spacing, u, e)
        for i in state.strays:
            if state.strain_kind[i]:
                add_stray_strain(state, terms, i)
    for q in range(state.counts[STRAIN_SPECIAL]):
        strain_special(state, terms, state.rotation, state.strain_special[q])


@njit(**KERNEL)
def bond_forces(state, terms, moment, plane, smallest):
    """Forces of all explicit bonds, written into `force`, and how far bonds of blocks have come to their limits."""
    u, e, f = state.displacement, state.strain, state.force
    if moment is not None:
        variational_forces(state, terms, moment)
        return
    if plane is not None:
        for q in range(state.counts[FORCE_RUNS]):
            first, count = state.force_runs[q, 0], state.force_runs[q, 1]
            kind = state.material[first]
            force_hexagonal(
                first, count, state.near[first], terms.spacing, terms.normal[kind], terms.shear[kind], u[0], u[1],
                e[0], e[1], e[5], f[0], f[1],
            )  # fmt: skip
    else:
        for q in range(state.counts[FORCE_BLOCKS]):
            first, number = state.force_blocks[q, 0], state.force_blocks[q, 1]
            state.reached[q] = force_masked(
                first, state.onward[number], state.mask, terms.spacing, state.springs[number], smallest, state.group[first], u, e, f
            )
        for i in state.strays:
            if state.force_kind[i]:
                add_force(state, terms, moment, state.rotation, i, state.stray[i])
    for q in range(state.counts[FORCE_SPECIAL]):
        i = state.force_special[q]
        f[0, i] = f[1, i] = f[2, i] = 0.0
        add_force(state, terms, moment, state.rotation, i, ALL)


@njit(**KERNEL)
def variational_forces(state, terms, moment):
    """Forces that are the gradient of the energy; all rows are special."""
    f = state.force
    for i in range(f.shape[1]):
        f[0, i] = f[1, i] = f[2, i] = 0.0
    for q in range(state.counts[FORCE_SPECIAL]):
        i = state.force_special[q]
        add_force(state, terms, moment, state.rotation, i, ALL)
        moment_of(state, terms, moment, i)
    for q in range(state.counts[FORCE_SPECIAL]):
        spread_moment(state, terms, moment, state.force_special[q])


@njit(**KERNEL)
def act(points, damping, drive, s, h, booked):
    """Loads, dashpots, damping and held components of the evaluation after step s; their work where `booked` is 1, not 0.

    `points` are the particles of a lattice, or anything else with displacement, velocity, force, lightness and moving runs.
    """
    push(points, drive, s, h)
    if damping is not None:
        points.sums[DAMPING] += booked * damp(points, damping, h)
    hold(points, drive, s, h, booked)
    book(points, points.force, drive, s, h, booked)


@njit(**KERNEL)
def push(points, drive, s, h):
    """Add loads and dashpots to the forces; a dashpot acts on the mean velocity of the step that these forces give."""
    v, f = points.velocity, points.force
    for q in range(len(drive.loaded)):
        i, factor = drive.loaded[q], drive.load_factor[s, drive.load_group[q]]
        for a in range(3):
            f[a, i] += factor * drive.load[q, a]
    for q in range(len(drive.absorbing)):
        i = drive.absorbing[q]
        by = 0.5 * h * points.lightness[i]
        for a in range(3):
            c = drive.dashpot[q, a]
            f[a, i] -= c * (v[a, i] + by * f[a, i]) / (1.0 + by * c)


@njit(**KERNEL)
def hold(points, drive, s, h, booked):
    """Forces of held components that give them their velocities."""
    v, f = points.velocity, points.force
    for q in range(len(drive.held)):
        i, a = drive.held[q], drive.held_axis[q]
        wanted = drive.held_velocity[s, drive.held_group[q]]
        needed = (wanted - v[a, i]) / (h * points.lightness[i])
        points.sums[HELD] += booked * 0.5 * h * (v[a, i] + wanted) * (needed - f[a, i])
        f[a, i] = needed


@njit(**KERNEL)
def book(points, before, drive, s, h, booked):
    """Work of loads and dashpots; `before` are the forces by whose velocities the dashpots acted."""
    v, f, sums = points.velocity, points.force, points.sums
    for q in range(len(drive.loaded)):
        i, factor = drive.loaded[q], drive.load_factor[s, drive.load_group[q]]
        by = 0.5 * h * points.lightness[i]
        for a in range(3):
            sums[EXTERNAL] += booked * h * factor * drive.load[q, a] * (v[a, i] + by * f[a, i])
    for q in range(len(drive.absorbing)):
        i = drive.absorbing[q]
        by = 0.5 * h * points.lightness[i]
        for a in range(3):
            sums[ABSORBED] += booked * h * drive.dashpot[q, a] * (v[a, i] + by * before[a, i]) * (v[a, i] + by * f[a, i])


@njit(**KERNEL)
def damp(points, alpha, h):
    """Local damping of each component,  F - alpha |F| sgn(v)  (Zhao et al. 2012, eq 26); returns the energy that it takes (J)."""
    lost = 0.0
    for a in range(3):
        v, f, lightness = points.velocity[a], points.force[a], points.lightness
        for q in range(points.counts[MOVING_RUNS]):
            first = points.moving_runs[q, 0]
            for i in range(first, first + points.moving_runs[q, 1]):
                against = alpha * abs(f[i]) * ((v[i] > 0.0) - (v[i] < 0.0))
                f[i] -= against
                lost += against * (v[i] + 0.5 * h * lightness[i] * f[i])
    return h * lost


@njit(**KERNEL)
def kick(points, by, drift):
    """Velocities on by the forces for a time `by`, then displacements by the velocities for a time `drift`."""
    for a in range(3):
        u, v, f, lightness = points.displacement[a], points.velocity[a], points.force[a], points.lightness
        for q in range(points.counts[MOVING_RUNS]):
            first = points.moving_runs[q, 0]
            for i in range(first, first + points.moving_runs[q, 1]):
                v[i] += by * lightness[i] * f[i]
                u[i] += drift * v[i]


@njit(**OUTER)
def forces(state, terms, h, booked):
    """Forces of the bonds at the displacements of now, once more where bonds fail under them.

    What a bond releases between evaluations is E - h/2 v.F with it, less the same without it.
    """
    strains(state, terms, terms.plane)
    bond_forces(state, terms, state.moment, terms.plane, terms.smallest)
    audit(state, terms, 0.5 * h, booked)
    lost = _break(state, terms, state.moment, terms.limits, 0.5 * booked * h)
    _keep(state, lost)


@njit(**KERNEL)
def audit(state, terms, half, booked):
    """Book what the bonds have done since the last evaluation, (F before + F) u / 2, beyond the loss of their energy; keep that of now."""
    if state.acting.size == 0:
        return
    v, f, acting = state.velocity, state.force, state.acting
    energy, power = elastic_energy(state, terms), 0.0
    for q in range(state.counts[AWAKE]):
        for i in range(state.awake[q, 0], state.awake[q, 1]):
            for a in range(3):
                power += v[a, i] * (acting[a, i] + f[a, i])
    state.sums[EXCESS] += booked * (energy - state.stored[0] + half * power)
    state.stored[0] = energy


@njit(**KERNEL)
def _keep(state, lost):
    """Keep the forces of the bonds for the next `audit`, and their energy less what those have lost that broke (J)."""
    if state.acting.size == 0:
        return
    state.stored[0] -= lost
    for q in range(state.counts[AWAKE]):
        for a in range(3):
            for i in range(state.awake[q, 0], state.awake[q, 1]):
                state.acting[a, i] = state.force[a, i]


@njit(**OUTER)
def _break(state, terms, moment, limits, by):
    """Break what fails, with the forces without it, whose power for a time `by` (s) is booked; the energy that is lost (J)."""
    if limits is None:
        return 0.0
    broken = failing(state, terms, limits, None)
    if len(broken) == 0:
        return 0.0
    ends, around = touched(state, broken)
    lost = break_all(state, terms, broken, ends, around, None)
    state.sums[BREAKING] += lost
    state.sums[BROKEN_BONDS] += len(broken)
    if moment is None:
        state.sums[BREAKING] += by * forces_anew(state, terms, around)
    else:
        before = state.force.copy()
        variational_forces(state, terms, moment)
        state.sums[BREAKING] += by * (state.velocity * (before - state.force)).sum()
    return lost


@njit(**OUTER)
def evaluate(state, terms, drive, s, h, booked):
    """All forces at the displacements of now."""
    forces(state, terms, h, booked)
    act(state, terms.damping, drive, s, h, booked)


@njit(**STEPS)
def kick_points(points, by, drift):
    """`kick`, from Python."""
    kick(points, by, drift)


@njit(**STEPS)
def feel(state, terms):
    """Strains and forces of the bonds at the displacements of now; none break."""
    strains(state, terms, terms.plane)
    bond_forces(state, terms, state.moment, terms.plane, terms.smallest)


@njit(**STEPS)
def act_on(points, terms, drive, s, h):
    """`act`, booked, from Python."""
    act(points, terms.damping, drive, s, h, 1.0)


@njit(**OUTER)
def advance(state, terms, drive, steps, h):
    """Whole steps, from and to a state with displacements, velocities and forces of one time; with none, the forces of now alone."""
    booked = 1.0 if steps else 0.0
    kick(state, booked * 0.5 * h, booked * h)
    for s in range(max(steps, 1)):
        evaluate(state, terms, drive, s, h, booked)
        if s < steps - 1:
            kick(state, h, h)
    kick(state, booked * 0.5 * h, 0.0)


@njit(**KERNEL)
def elastic_energy(state, terms):
    """Elastic energy (J) of all explicit bonds, each once; strains must be those of the displacements."""
    total = 0.0
    for q in range(state.counts[AWAKE]):
        i, last = state.awake[q, 0], state.awake[q, 1]
        while i < last:
            number = state.stretch_of[i]
            if number >= 0 and i + WIDTH <= state.stretch[number, 1]:
                total += energy_masked(i, state.onward[number], state.mask, terms.spacing, state.springs[number], state.displacement, state.strain)
                i += WIDTH
                continue
            total += energy_of_row(state, terms, i, ALL & ~state.stray[i])
            i += 1
    for i in state.strays:
        total += energy_of_row(state, terms, i, state.stray[i])
    return total


@njit(**STEPS)
def elastic(state, terms):
    """Elastic energy (J) at the displacements of now; `force` becomes the force of the bonds alone."""
    strains(state, terms, terms.plane)
    bond_forces(state, terms, state.moment, terms.plane, terms.smallest)
    return elastic_energy(state, terms)


@njit(**STEPS)
def ahead(points, total, h):
    """1/2 m v^2 - h/2 v.F (J) with the velocities that the forces `total` give in the middle of the coming step; F is `force`."""
    energy = 0.0
    for a in range(3):
        for q in range(points.counts[MOVING_RUNS]):
            first = points.moving_runs[q, 0]
            for i in range(first, first + points.moving_runs[q, 1]):
                v = points.velocity[a, i] + 0.5 * h * total[a, i] * points.lightness[i]
                energy += 0.5 * v * v / points.lightness[i] - 0.5 * h * v * points.force[a, i]
    return energy


@njit(**STEADY_STEPS)
def fastest(state):
    """Largest velocity component (m/s) of rows with strains or forces; infinite where any is not finite."""
    most = 0.0
    for q in range(state.counts[AWAKE]):
        for a in range(3):
            for i in range(state.awake[q, 0], state.awake[q, 1]):
                if not abs(state.velocity[a, i]) <= most:
                    most = abs(state.velocity[a, i])
                    if not most <= 1e300:
                        return math.inf
    return most
