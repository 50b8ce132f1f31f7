"""The fine steps inside one coarse step, with the ghosts moved by the mesh: jitted loops over the particle kernels.

Each loop starts and ends with velocities at full steps (`particles.motion`). A loop begins with `first` = -1; where it finds
the neighbour list used up it returns the number of substeps done, and is called again with that number once the list is new.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from particles.motion import done_with, drift, evaluate_pairs, kick, kick_drift, moved
from particles.ranks import sum_together
from particles.system import INNER, MERGED, OUTER, STEPS
from particles.walls.contact import end_wall_forces


class Ghosts(NamedTuple):
    """Ghost particles and their shape functions at the interface nodes (CSR), all in the order of `rows`."""

    rows: np.ndarray  # (g,) rows of the ghosts in the particle arrays
    mass: np.ndarray  # (g, 3): m, m, J, kg and kg m2 per metre
    load: np.ndarray  # (g, 3): the part of gravity on a ghost that the continuum carries already, N
    start: np.ndarray  # (g + 1,)
    node: np.ndarray  # interface node of each weight
    weight: np.ndarray
    reference: np.ndarray  # (g, 3) reference positions and angle zero


class Tie(NamedTuple):
    """The interface problem of the multipliers, H = N_g W N_g^T + E with E diagonal, as its inverse by Woodbury."""

    stiffness: np.ndarray  # (g, 3) E^-1
    inverse: np.ndarray  # (3, interface nodes, interface nodes): (W^-1 + N_g^T E^-1 N_g)^-1
    damping: float  # c_m, 1/s
    damper: float  # 1 + c_m h / 2
    retie: float  # part of the ghosts' drift from the mesh that is taken back each coarse step


class Linear(NamedTuple):
    """Contact forces -K (q - q0) in place of the contact law: CSR of K in row order, and the reference positions."""

    start: np.ndarray  # (3 n + 1,)
    column: np.ndarray
    value: np.ndarray
    reference: np.ndarray  # (n, 3)


@njit(**INNER)
def linear_forces(position, force, linear):
    for row in range(position.shape[0]):
        for component in range(3):
            total = 0.0
            line = 3 * row + component
            for k in range(linear.start[line], linear.start[line + 1]):
                other, which = linear.column[k] // 3, linear.column[k] % 3
                total -= linear.value[k] * (position[other, which] - linear.reference[other, which])
            force[row, component] = total


@njit(**MERGED)
def forces(system, terms, linear, h, border, halo):
    """Forces at the places of now, contacts with particles of other ranks included (`border`, `halo`; None on one rank).

    `end_forces` must follow.
    """
    if linear is None:
        evaluate_pairs(system, terms, h, border, halo)
    else:
        linear_forces(system.position, system.force, linear)


@njit(**MERGED)
def end_forces(system, terms, linear, h, halo, values):
    """Reactions on walls, and `values` (k, 3) or None: their sums over the ranks, in one message (collective)."""
    if linear is None:
        end_wall_forces(system, terms, h, halo, values)
    elif values is not None:
        sum_together(halo, values)


@njit(**MERGED)
def list_used_up(system, linear, halo):
    """Whether any rank needs a new list before `forces`."""
    if linear is None:
        return done_with(system, halo)
    return False


@njit(**INNER)
def _save(system, ghosts, saved):
    for k in range(ghosts.rows.size):
        for component in range(3):
            saved[k, component] = system.position[ghosts.rows[k], component]
            saved[k, 3 + component] = system.velocity[ghosts.rows[k], component]


@njit(**MERGED)
def still_ghosts(system, ghosts):
    """Take the ghosts' velocities and forces out of a loop over all rows (they were saved)."""
    for k in range(ghosts.rows.size):
        row = ghosts.rows[k]
        for component in range(3):
            system.velocity[row, component] = 0.0
            system.acceleration[row, component] = 0.0
            system.force[row, component] = 0.0


@njit(**INNER)
def _drift_massless(system, terms, ghosts, saved, acceleration, h):
    """`drift` of all rows; the ghosts move by their own velocity and `acceleration` and book no energy."""
    _save(system, ghosts, saved)
    still_ghosts(system, ghosts)
    drift(system, terms, h)
    fastest = 0.0
    for k in range(ghosts.rows.size):
        row = ghosts.rows[k]
        for component in range(3):
            velocity = saved[k, 3 + component] + 0.5 * h * acceleration[k, component]
            system.velocity[row, component] = velocity
            system.position[row, component] += h * velocity
            system.acceleration[row, component] = acceleration[k, component]
        fastest = max(fastest, system.velocity[row, 0] ** 2 + system.velocity[row, 1] ** 2)
    moved(system, h * np.sqrt(fastest))


@njit(**INNER)
def _advance_others(system, terms, ghosts, h, last, previous):
    """Kick (and drift) all rows but the ghosts, which stand still and feel nothing meanwhile."""
    still_ghosts(system, ghosts)
    if last:
        for i in range(previous.shape[0]):
            for component in range(3):
                previous[i, component] = system.acceleration[i, component]
        kick(system, terms, h)
    else:
        kick_drift(system, terms, h)


@njit(**INNER)
def _place_ghosts(system, ghosts, saved, reaction, acceleration, h, last):
    """Advance the ghost rows from their saved half-step state with the given accelerations (g, 3); restore their forces."""
    fastest = 0.0
    for k in range(ghosts.rows.size):
        row = ghosts.rows[k]
        for component in range(3):
            a = acceleration[k, component]
            system.acceleration[row, component] = a
            system.force[row, component] = reaction[k, component]
            velocity = saved[k, 3 + component] + (0.5 * h * a if last else h * a)
            system.velocity[row, component] = velocity
            system.position[row, component] = saved[k, component] + (0.0 if last else h * velocity)
        fastest = max(fastest, system.velocity[row, 0] ** 2 + system.velocity[row, 1] ** 2)
    if not last:
        moved(system, h * np.sqrt(fastest))


@njit(**INNER)
def _react(system, ghosts, saved, reaction, h, work):
    """Reactions on massless ghosts; the work of what drives them is booked over the step just moved (trapezoidal)."""
    for k in range(ghosts.rows.size):
        row = ghosts.rows[k]
        for component in range(3):
            new = system.force[row, component] - ghosts.load[k, component]
            work[0] -= 0.5 * (reaction[k, component] + new) * h * saved[k, 3 + component]
            reaction[k, component] = new


@njit(**INNER)
def _nodal_sum(ghosts, values, nodal):
    """nodal = N_g^T values."""
    nodal[:] = 0.0
    for k in range(ghosts.rows.size):
        for s in range(ghosts.start[k], ghosts.start[k + 1]):
            for component in range(3):
                nodal[ghosts.node[s], component] += ghosts.weight[s] * values[k, component]


@njit(**INNER)
def _at_ghosts(ghosts, nodal, values):
    """values = N_g nodal."""
    for k in range(ghosts.rows.size):
        for component in range(3):
            total = 0.0
            for s in range(ghosts.start[k], ghosts.start[k + 1]):
                total += ghosts.weight[s] * nodal[ghosts.node[s], component]
            values[k, component] = total


@njit(**MERGED)
def take_link(system, ghosts, link):
    """link = N_g^T of the contact forces on the ghosts, (w, 3); then they stand still and feel nothing."""
    link[:] = 0.0
    for k in range(ghosts.rows.size):
        row = ghosts.rows[k]
        x = system.force[row, 0] - ghosts.load[k, 0]
        y = system.force[row, 1] - ghosts.load[k, 1]
        moment = system.force[row, 2] - ghosts.load[k, 2]
        for s in range(ghosts.start[k], ghosts.start[k + 1]):
            node, weight = ghosts.node[s], ghosts.weight[s]
            link[node, 0] += weight * x
            link[node, 1] += weight * y
            link[node, 2] += weight * moment
        for component in range(3):
            system.velocity[row, component] = 0.0
            system.acceleration[row, component] = 0.0
            system.force[row, component] = 0.0


@njit(**MERGED)
def ghosts_feel(system, ghosts):
    """Whether ghosts have forces: `take_link` leaves none, so that these were evaluated elsewhere (after a change)."""
    for k in range(ghosts.rows.size):
        for component in range(3):
            if system.force[ghosts.rows[k], component] != 0.0:
                return True
    return False


@njit(**MERGED)
def carry_ghosts(system, ghosts, nodes, h):
    """Give the ghosts the nodes' velocity and acceleration, and the displacement of a step of `h` with that velocity."""
    fastest = 0.0
    for k in range(ghosts.rows.size):
        row = ghosts.rows[k]
        vx, vy, spin = 0.0, 0.0, 0.0
        ax, ay, az = 0.0, 0.0, 0.0
        for s in range(ghosts.start[k], ghosts.start[k + 1]):
            node, weight = ghosts.node[s], ghosts.weight[s]
            vx += weight * nodes.velocity[node, 0]
            vy += weight * nodes.velocity[node, 1]
            spin += weight * nodes.velocity[node, 2]
            ax += weight * nodes.acceleration[node, 0]
            ay += weight * nodes.acceleration[node, 1]
            az += weight * nodes.acceleration[node, 2]
        system.velocity[row, 0], system.velocity[row, 1], system.velocity[row, 2] = vx, vy, spin
        system.acceleration[row, 0], system.acceleration[row, 1], system.acceleration[row, 2] = ax, ay, az
        system.position[row, 0] += h * vx
        system.position[row, 1] += h * vy
        system.position[row, 2] += h * spin
        fastest = max(fastest, vx * vx + vy * vy)
    moved(system, h * np.sqrt(fastest))


@njit(**STEPS)
def run_prescribed(
    system, terms, linear, ghosts, acceleration, border, halo, h, steps, first, pause, saved, reaction, previous, work
):
    """Ghosts move with constant acceleration (Li & Wan 2010, eqs 25-26); `acceleration` is (g, 3).

    `border`, `halo`: contacts with particles of other ranks and the way to them, None on one rank (here and below).

    `reaction` (g, 3) are the forces on the ghosts, N and N m; `previous` receives the accelerations before the last step.
    The loop also returns before the evaluation of substep `pause`.
    """
    if first < 0:
        _drift_massless(system, terms, ghosts, saved, acceleration, h)
    for j in range(max(first, 0), steps):
        if j == pause or list_used_up(system, linear, halo):
            return j
        forces(system, terms, linear, h, border, halo)
        end_forces(system, terms, linear, h, halo, None)
        _save(system, ghosts, saved)
        _react(system, ghosts, saved, reaction, h, work)
        last = j == steps - 1
        _advance_others(system, terms, ghosts, h, last, previous)
        _place_ghosts(system, ghosts, saved, reaction, acceleration, h, last)
    return steps


@njit(**OUTER)
def run_slaved(
    system, terms, linear, ghosts, nodal, inverse_mass, border, halo, h, steps, first, saved, reaction, acceleration, previous, work
):
    """Ghosts follow the interface nodes, which the ghosts' reactions move in every substep.

    `nodal` (3, interface nodes, 3): displacement since the coarse time, velocity, acceleration; `inverse_mass` of the nodes.
    """
    sums = np.empty_like(nodal[0])
    if first < 0:
        _at_ghosts(ghosts, nodal[1], acceleration)
        for k in range(ghosts.rows.size):
            for component in range(3):
                system.velocity[ghosts.rows[k], component] = acceleration[k, component]
        _at_ghosts(ghosts, nodal[2], acceleration)
        _drift_massless(system, terms, ghosts, saved, acceleration, h)
        for i in range(nodal.shape[1]):
            for component in range(3):
                nodal[1, i, component] += 0.5 * h * nodal[2, i, component]
                nodal[0, i, component] += h * nodal[1, i, component]
    for j in range(max(first, 0), steps):
        if list_used_up(system, linear, halo):
            return j
        forces(system, terms, linear, h, border, halo)
        _save(system, ghosts, saved)
        _react(system, ghosts, saved, reaction, h, work)
        _nodal_sum(ghosts, reaction, sums)
        end_forces(system, terms, linear, h, halo, sums)
        last = j == steps - 1
        for i in range(nodal.shape[1]):
            for component in range(3):
                a = sums[i, component] * inverse_mass[i, component]
                nodal[2, i, component] = a
                nodal[1, i, component] += 0.5 * h * a if last else h * a
                if not last:
                    nodal[0, i, component] += h * nodal[1, i, component]
        _at_ghosts(ghosts, nodal[2], acceleration)
        _advance_others(system, terms, ghosts, h, last, previous)
        _place_ghosts(system, ghosts, saved, reaction, acceleration, h, last)
    return steps


@njit(**OUTER)
def run_tied(
    system, terms, linear, ghosts, tie, start, end, mesh, border, halo, h, steps, first, shift, multiplier, nodal, work
):
    """Ghosts are particles; multipliers tie their velocities to N_g times the velocity that goes from `start` to `end`.

    `start`, `end` (interface nodes, 3) are the free coarse velocities at both ends of the coarse step. A part of what the
    ghosts' displacement lacks to that of the `mesh` (interface nodes, 3) at the start is added in the first substep; it is
    left in `shift` (g, 3). `multiplier` (g, 3) holds the tie forces, N and N m, taken off the ghosts; `nodal` leaves as
    N_g^T multiplier.
    """
    position, velocity, force = system.position, system.velocity, system.force
    residual = np.empty_like(multiplier)
    right = np.empty_like(nodal)
    if first < 0:
        _at_ghosts(ghosts, mesh, shift)
        for k in range(ghosts.rows.size):
            row = ghosts.rows[k]
            for component in range(3):
                shift[k, component] -= position[row, component] - ghosts.reference[k, component]
        shift *= tie.retie
        drift(system, terms, h)
        _shift_ghosts(system, ghosts, shift, h)
    for j in range(max(first, 0), steps):
        if list_used_up(system, linear, halo):
            return j
        forces(system, terms, linear, h, border, halo)
        part = (j + 1.0) / steps
        nodal[:] = (1.0 - part) * start + part * end
        _at_ghosts(ghosts, nodal, residual)
        for k in range(ghosts.rows.size):
            row = ghosts.rows[k]
            for component in range(3):
                work[0] -= 0.5 * multiplier[k, component] * h * velocity[row, component]
                half = velocity[row, component] - (shift[k, component] / h if j == 0 else 0.0)
                pull = force[row, component] / ghosts.mass[k, component] - tie.damping * half
                free = half + 0.5 * h * pull / tie.damper
                residual[k, component] = (free - residual[k, component]) * tie.stiffness[k, component]
        _nodal_sum(ghosts, residual, right)
        end_forces(system, terms, linear, h, halo, right)
        for component in range(3):
            nodal[:, component] = tie.inverse[component] @ np.ascontiguousarray(right[:, component])
        _at_ghosts(ghosts, nodal, multiplier)
        for k in range(ghosts.rows.size):
            row = ghosts.rows[k]
            for component in range(3):
                tied = residual[k, component] - tie.stiffness[k, component] * multiplier[k, component]
                multiplier[k, component] = tied
                work[0] -= 0.5 * tied * h * velocity[row, component]
                force[row, component] -= tied
                if j == 0:
                    velocity[row, component] -= shift[k, component] / h
        if j == steps - 1:
            kick(system, terms, h)
        else:
            kick_drift(system, terms, h)
    _nodal_sum(ghosts, multiplier, nodal)
    sum_together(halo, nodal)
    return steps


@njit(**INNER)
def _shift_ghosts(system, ghosts, shift, h):
    """Displace the ghosts by `shift` (g, 3) within the step that they have just drifted."""
    largest = 0.0
    for k in range(ghosts.rows.size):
        row = ghosts.rows[k]
        for component in range(3):
            system.position[row, component] += shift[k, component]
            system.velocity[row, component] += shift[k, component] / h
        largest = max(largest, abs(shift[k, 0]) + abs(shift[k, 1]))
    moved(system, largest)
