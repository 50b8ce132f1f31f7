"""The fine steps of the overlap coupling, compiled: tied particles follow the mesh, or are drawn to it by springs.

Nodes of the zone take the particles' steps under the forces of the tied particles and of the continuum, in which the other
nodes move evenly over the coarse step (as in `bridge.subcycling`). A loop begins with `first` = -1; where it finds the
neighbour list used up it returns the number of substeps done, and is called again with that number once the list is new.
Between two calls the rows of the particles hold the forces that act on them, springs and ties left out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from bridge.overlap.nodes import kick_nodes, pull_nodes, start_nodes
from bridge.substeps import end_forces, forces, list_used_up
from particles.block_motion import ONWARD, TO_END
from particles.motion import drift, kick_on, moved
from particles.ranks import sum_together
from particles.system import INNER, STEPS


class Tied(NamedTuple):
    """Tied particles; line f k + c of the tie (CSR) gives component c of particle k from the flat nodal components.

    The f components are x, y, angle in the plane, and x, y, z and three rotations in space, where rotations have arrays of their
    own: every part of the loop goes over the translations (in the plane all components) and over the arrays of rotations.
    """

    rows: np.ndarray  # (g,) in the particle arrays
    start: np.ndarray  # (f g + 1,); a component with an empty line is not tied
    column: np.ndarray
    value: np.ndarray
    load: np.ndarray  # (g, f): part of the force on an eliminated component that is a load of the mesh, N and N m
    origin: np.ndarray  # (g, f): place of the particle where nothing has moved, m and rad
    stiffness: np.ndarray  # (g, f): of the springs, N/m and N m/rad
    force: np.ndarray  # (g, f): of the contacts (eliminated) or of the springs (penalty) at the last evaluation


@njit(**INNER)
def _feel_rows(tied, first, link, force, velocity, acceleration):
    """Add G^T of the forces on the tied components from `first` on; these then stand still and feel nothing."""
    if force is not None:
        for k in range(tied.rows.size):
            row = tied.rows[k]
            for c in range(3):
                line = tied.load.shape[1] * k + first + c
                if tied.start[line] == tied.start[line + 1]:
                    continue
                pull = force[row, c] - tied.load[k, first + c]
                tied.force[k, first + c] = pull
                for s in range(tied.start[line], tied.start[line + 1]):
                    link[tied.column[s]] += tied.value[s] * pull
                velocity[row, c] = 0.0
                acceleration[row, c] = 0.0
                force[row, c] = 0.0


@njit(**INNER)
def _feel(system, tied, link):
    """link = G^T of the forces on the tied components, which then stand still and feel nothing."""
    for i in range(link.size):
        link[i] = 0.0
    _feel_rows(tied, 0, link, system.force, system.velocity, system.acceleration)
    _feel_rows(tied, 3, link, system.torque, system.spin, system.angular)


@njit(**INNER)
def _carry_rows(tied, first, nodes, h, position, velocity, acceleration):
    """Give tied components from `first` on the velocity and acceleration of the mesh, and the displacement of a step."""
    if position is not None:
        for k in range(tied.rows.size):
            row = tied.rows[k]
            for c in range(3):
                line = tied.load.shape[1] * k + first + c
                if tied.start[line] == tied.start[line + 1]:
                    continue
                v, a = 0.0, 0.0
                for s in range(tied.start[line], tied.start[line + 1]):
                    v += tied.value[s] * nodes.velocity[tied.column[s]]
                    a += tied.value[s] * nodes.acceleration[tied.column[s]]
                velocity[row, c] = v
                acceleration[row, c] = a
                position[row, c] += h * v


@njit(**INNER)
def _carry(system, tied, nodes, h):
    """Give tied components the velocity and acceleration of the mesh, and the displacement of a step of `h` s."""
    _carry_rows(tied, 0, nodes, h, system.position, system.velocity, system.acceleration)
    _carry_rows(tied, 3, nodes, h, system.rotation, system.spin, system.angular)
    axes, fastest = 1 + tied.load.shape[1] // 3, 0.0
    for row in tied.rows:
        square = 0.0
        for c in range(axes):
            square += system.velocity[row, c] ** 2
        fastest = max(fastest, square)
    moved(system, h * np.sqrt(fastest))


@njit(**INNER)
def _show_rows(tied, first, force):
    """Give rows of tied particles their forces back."""
    if force is not None:
        for k in range(tied.rows.size):
            for c in range(first, first + 3):
                line = tied.load.shape[1] * k + c
                if tied.start[line] < tied.start[line + 1]:
                    force[tied.rows[k], c - first] = tied.force[k, c] + tied.load[k, c]


@njit(**INNER)
def _show_forces(system, tied):
    """Give the rows of tied particles their forces back."""
    _show_rows(tied, 0, system.force)
    _show_rows(tied, 3, system.torque)


@njit(**INNER)
def _stretch_rows(tied, first, nodes, position, force):
    """Forces of the springs of components from `first` on."""
    link, base, since = nodes.link, nodes.base, nodes.moved
    if position is not None:
        for k in range(tied.rows.size):
            row = tied.rows[k]
            for c in range(3):
                line = tied.load.shape[1] * k + first + c
                if tied.start[line] == tied.start[line + 1]:
                    continue
                gap = position[row, c] - tied.origin[k, first + c]
                for s in range(tied.start[line], tied.start[line + 1]):
                    gap -= tied.value[s] * (base[tied.column[s]] + since[tied.column[s]])
                pull = tied.stiffness[k, first + c] * gap
                tied.force[k, first + c] = pull
                force[row, c] -= pull
                for s in range(tied.start[line], tied.start[line + 1]):
                    link[tied.column[s]] += tied.value[s] * pull


@njit(**INNER)
def _stretch(system, tied, nodes):
    """Forces of the springs: on the tied particles, and as their reactions on the nodes."""
    for i in range(nodes.link.size):
        nodes.link[i] = 0.0
    _stretch_rows(tied, 0, nodes, system.position, system.force)
    _stretch_rows(tied, 3, nodes, system.rotation, system.torque)


@njit(**INNER)
def _relax_rows(tied, first, force):
    """Take the forces of the springs off rows again."""
    if force is not None:
        for k in range(tied.rows.size):
            for c in range(first, first + 3):
                line = tied.load.shape[1] * k + c
                if tied.start[line] < tied.start[line + 1]:
                    force[tied.rows[k], c - first] += tied.force[k, c]


@njit(**INNER)
def _relax(system, tied):
    """Take the forces of the springs off the rows again."""
    _relax_rows(tied, 0, system.force)
    _relax_rows(tied, 3, system.torque)


@njit(**INNER)
def _accelerate_rows(tied, first, damping, force, lightness, velocity, acceleration):
    """Accelerations of tied components from `first` on, from the present forces."""
    if force is not None:
        for k in range(tied.rows.size):
            row = tied.rows[k]
            for c in range(3):
                line = tied.load.shape[1] * k + first + c
                if tied.start[line] < tied.start[line + 1]:
                    acceleration[row, c] = force[row, c] * lightness[row, c] - damping * velocity[row, c]


@njit(**INNER)
def _accelerate(system, tied, damping):
    """Accelerations of the tied components from the present forces, at the start of a coarse step."""
    _accelerate_rows(tied, 0, damping, system.force, system.lightness, system.velocity, system.acceleration)
    _accelerate_rows(tied, 3, damping, system.torque, system.nimbleness, system.spin, system.angular)


@njit(**STEPS)
def run_tied(system, terms, linear, tied, nodes, stiffness, mass, damping, border, halo, h, steps, first):
    """Fine steps in which the tied components are eliminated: the mass of the nodes holds that of the particles.

    Args:
        stiffness: Of the continuum among the nodes of the zone (`Rows`).
        mass: `Mass` of the nodes.
        damping: c_m, 1/s.
        border, halo: Contacts with particles of other ranks and the way to them, None on one rank; the nodes are on all ranks.
    """
    if first < 0:
        _feel(system, tied, nodes.link)
        sum_together(halo, nodes.links)
        start_nodes(nodes, mass, damping, h)
        drift(system, terms, h)
        _carry(system, tied, nodes, h)
    for j in range(max(first, 0), steps):
        if list_used_up(system, linear, halo):
            return j
        forces(system, terms, linear, h, border, halo)
        _feel(system, tied, nodes.link)
        end_forces(system, terms, linear, h, halo, nodes.links)
        last = j == steps - 1
        pull_nodes(nodes, stiffness, (j + 1) * h, 0.5 * h if last else h)
        kick_nodes(nodes, mass, damping, h, last)
        kick_on(system, terms, h, TO_END if last else ONWARD)
        _carry(system, tied, nodes, 0.0 if last else h)
        if last:
            _show_forces(system, tied)
    return steps


@njit(**STEPS)
def run_penalised(system, terms, linear, tied, nodes, stiffness, mass, damping, border, halo, h, steps, first):
    """Fine steps with springs between the tied components and the mesh; arguments as in `run_tied`."""
    if first < 0:
        for i in range(nodes.moved.size):
            nodes.moved[i] = 0.0
        _stretch(system, tied, nodes)
        sum_together(halo, nodes.links)
        _accelerate(system, tied, damping)
        _relax(system, tied)
        start_nodes(nodes, mass, damping, h)
        drift(system, terms, h)
    for j in range(max(first, 0), steps):
        if list_used_up(system, linear, halo):
            return j
        forces(system, terms, linear, h, border, halo)
        _stretch(system, tied, nodes)
        end_forces(system, terms, linear, h, halo, nodes.links)
        last = j == steps - 1
        pull_nodes(nodes, stiffness, (j + 1) * h, 0.5 * h if last else h)
        kick_nodes(nodes, mass, damping, h, last)
        kick_on(system, terms, h, TO_END if last else ONWARD)
        if last:
            _relax(system, tied)
    return steps
