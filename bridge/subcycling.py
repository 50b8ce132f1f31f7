"""The coarse step of the variant `subcycling`, compiled: no Python inside it, neither on one rank nor where particles and mesh
are spread over several.

Nodes off the interface take the coarse step at once, under the force at its start. Interface nodes take the particles'
steps, under the particles' forces and that of the continuum, in which their neighbours move evenly over the coarse step.
At the end a kick brings the continuum's impulse on every node to that of the trapezoidal rule over the coarse step: the
sum over the nodes is then that of the loads, so that linear momentum is kept.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from bridge.blocks import row_times
from bridge.substeps import carry_ghosts, end_forces, forces, ghosts_feel, list_used_up, still_ghosts, take_link
from particles.block_motion import ONWARD, TO_END
from particles.motion import drift, kick_on
from particles.ranks import exchange_values, highest, sum_together
from particles.system import INNER, STEPS


class Nodes(NamedTuple):
    """Interface nodes within a coarse step, (w, 3) each."""

    mass: np.ndarray  # kg and kg m2 per metre, 0 where prescribed
    inverse_mass: np.ndarray  # 0 where prescribed
    start: np.ndarray  # force of the continuum at the coarse time, N
    slope: np.ndarray  # its change by the motion of the neighbours, N/s
    force: np.ndarray  # its present value, N
    impulse: np.ndarray  # of it since the coarse time, N s
    link: np.ndarray  # force of the particles, N
    moved: np.ndarray  # displacement since the coarse time, m and rad
    velocity: np.ndarray
    acceleration: np.ndarray
    lost: np.ndarray  # (1,): energy taken by mass damping, J


class Mesh(NamedTuple):
    """The nodes of a rank, (n, 3) each."""

    mass: np.ndarray  # kg and kg m2 per metre, 0 where prescribed or covered
    inverse_mass: np.ndarray  # 0 where prescribed or covered
    external: np.ndarray  # loads, N
    force: np.ndarray  # loads minus internal force at the last coarse time, N
    impulse: np.ndarray  # of the continuum in the coarse step, before the kick at its end, N s
    link: np.ndarray  # force of the particles, N
    increment: np.ndarray  # displacement in the coarse step, 0 on the interface, m and rad
    displacement: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    off: np.ndarray  # nodes off the interface
    lost: np.ndarray  # (1,): energy taken by mass damping, J
    work: np.ndarray  # (1,): of the loads, J


class Others(NamedTuple):
    """Where the mesh is spread over ranks: what else a rank knows, and the way to the others."""

    which: np.ndarray  # numbers among all interface nodes of those that this rank owns
    near: np.ndarray  # (n + some, 3): room for values at its nodes and at those of others beside them
    start: np.ndarray  # (3 w, 3): room for what the interface nodes start with
    way: Any  # `particles.ranks.Halo` between rows of `near`


@njit(**INNER)
def _start_nodes(nodes, damping, h):
    """First half kick and drift of the interface nodes, from velocities at the coarse time."""
    lost = 0.0
    for i in range(nodes.start.shape[0]):
        for component in range(3):
            force = nodes.start[i, component]
            inverse = nodes.inverse_mass[i, component]
            before = nodes.velocity[i, component]
            a = 0.0
            if inverse > 0.0:
                a = (force + nodes.link[i, component]) * inverse - damping * before
            half = before + 0.5 * h * a
            lost += nodes.mass[i, component] * before * half
            nodes.impulse[i, component] = 0.5 * h * force
            nodes.acceleration[i, component] = a
            nodes.velocity[i, component] = half
            nodes.moved[i, component] = h * half
    nodes.lost[0] += 0.5 * h * damping * lost


@njit(**INNER)
def _pull_nodes(nodes, stiffness, time, weight):
    """Force of the continuum at a time (s) since the coarse time; `weight` (s) is that of its impulse."""
    for i in range(nodes.force.shape[0]):
        own = row_times(stiffness, i, nodes.moved)
        for component in range(3):
            force = nodes.start[i, component] + nodes.slope[i, component] * time - own[component]
            nodes.force[i, component] = force
            nodes.impulse[i, component] += weight * force


@njit(**INNER, fastmath={"contract"})
def _kick_nodes(nodes, damping, h, last):
    """New accelerations; velocities to the end of the step, or on to the middle of the next, and drift."""
    less = 1.0 / (1.0 + 0.5 * damping * h)
    onward = 0.5 * h if last else h
    further = 0.0 if last else h
    lost = 0.0
    for i in range(nodes.force.shape[0]):
        for component in range(3):
            half = nodes.velocity[i, component]
            a = 0.0
            if nodes.inverse_mass[i, component] > 0.0:
                pull = nodes.force[i, component] + nodes.link[i, component]
                a = less * (pull * nodes.inverse_mass[i, component] - damping * half)
            end = half + 0.5 * h * a
            lost += nodes.mass[i, component] * end * (0.5 * half if last else end)
            nodes.acceleration[i, component] = a
            nodes.velocity[i, component] = half + onward * a
            nodes.moved[i, component] += further * (half + onward * a)
    nodes.lost[0] += h * damping * lost


@njit(**STEPS, fastmath={"contract"})
def move_others(mesh, damping, step):
    """Take the nodes off the interface over a coarse step (s) under the force at its start, with mass damping (1/s)."""
    less = 1.0 / (1.0 + 0.5 * damping * step)
    lost, work = 0.0, 0.0
    for row in mesh.off:
        for component in range(3):
            before = mesh.velocity[row, component]
            impulse = step * mesh.force[row, component]
            mean = before
            if mesh.inverse_mass[row, component] > 0.0:
                mean = less * (before + 0.5 * impulse * mesh.inverse_mass[row, component])
            increment = step * mean
            lost += mesh.mass[row, component] * mean * increment
            work += mesh.external[row, component] * increment
            mesh.impulse[row, component] = impulse
            mesh.increment[row, component] = increment
            mesh.velocity[row, component] = 2.0 * mean - before
            mesh.displacement[row, component] += increment
    mesh.lost[0] += damping * lost
    mesh.work[0] += work


@njit(**INNER, fastmath={"contract"})
def _finish_row(mesh, row, internal, damping, step):
    """Kick a node to the impulse of the trapezoidal rule, `internal` being its internal force at the end, N."""
    for component in range(3):
        inverse = mesh.inverse_mass[row, component]
        force = mesh.external[row, component] - internal[component]
        missing = 0.5 * step * (mesh.force[row, component] + force) - mesh.impulse[row, component]
        mesh.force[row, component] = force
        if inverse > 0.0:
            velocity = mesh.velocity[row, component] + missing * inverse
            mesh.velocity[row, component] = velocity
            mesh.acceleration[row, component] = (force + mesh.link[row, component]) * inverse - damping * velocity


@njit(**STEPS)
def finish(mesh, internal, damping, step):
    """End the coarse step at internal forces (n, 3)."""
    for row in range(internal.shape[0]):
        _finish_row(mesh, row, internal[row], damping, step)


@njit(**INNER)
def _number(others, i):
    """Number among all interface nodes of the i-th that this rank owns."""
    if others is None:
        return i
    return others.which[i]


@njit(**INNER)
def _fill(others, values):
    """Values (n, 3) of this rank's nodes and of those of others beside them into `near` (collective)."""
    for row in range(values.shape[0]):
        for component in range(3):
            others.near[row, component] = values[row, component]
    exchange_values(others.way, others.near)


@njit(**INNER)
def _start_coarse(mesh, nodes, stiffness, at, others, damping, step):
    """Move the nodes off the interface; what the interface nodes are to feel in the coarse step."""
    if mesh is not None:
        move_others(mesh, damping, step)
        if others is None:
            _set_start(mesh, nodes, stiffness, at, others, mesh.increment, step)
        else:
            _fill(others, mesh.increment)
            nodes.velocity[:] = 0.0
            nodes.start[:] = 0.0
            nodes.slope[:] = 0.0
            _set_start(mesh, nodes, stiffness, at, others, others.near, step)
            _share_start(nodes, others)


@njit(**INNER)
def _set_start(mesh, nodes, stiffness, at, others, increment, step):
    """Velocity, force and its slope of the interface nodes that this rank owns."""
    for i in range(at.size):
        change, k = row_times(stiffness, at[i], increment), _number(others, i)
        for component in range(3):
            nodes.velocity[k, component] = mesh.velocity[at[i], component]
            nodes.start[k, component] = mesh.force[at[i], component]
            nodes.slope[k, component] = -change[component] / step


@njit(**INNER)
def _share_start(nodes, others):
    """Let every rank know the start of all interface nodes (collective)."""
    start, width = others.start, nodes.start.shape[0]
    for i in range(width):
        for component in range(3):
            start[i, component] = nodes.velocity[i, component]
            start[width + i, component] = nodes.start[i, component]
            start[2 * width + i, component] = nodes.slope[i, component]
    sum_together(others.way, start)
    for i in range(width):
        for component in range(3):
            nodes.velocity[i, component] = start[i, component]
            nodes.start[i, component] = start[width + i, component]
            nodes.slope[i, component] = start[2 * width + i, component]


@njit(**INNER)
def _end_coarse(mesh, nodes, stiffness, at, others, damping, step):
    """Take over what the interface nodes did; kick all nodes."""
    if mesh is not None:
        for i in range(at.size):
            k = _number(others, i)
            for component in range(3):
                mesh.impulse[at[i], component] = nodes.impulse[k, component]
                mesh.link[at[i], component] = nodes.link[k, component]
                mesh.velocity[at[i], component] = nodes.velocity[k, component]
                mesh.displacement[at[i], component] += nodes.moved[k, component]
                mesh.work[0] += mesh.external[at[i], component] * nodes.moved[k, component]
        if others is None:
            _finish_rows(mesh, stiffness, mesh.displacement, damping, step)
        else:
            _fill(others, mesh.displacement)
            _finish_rows(mesh, stiffness, others.near, damping, step)


@njit(**INNER)
def _finish_rows(mesh, stiffness, displacement, damping, step):
    for row in range(mesh.force.shape[0]):
        _finish_row(mesh, row, row_times(stiffness, row, displacement), damping, step)


@njit(**STEPS)
def run_coarse(
    system, terms, linear, ghosts, nodes, inner, mesh, stiffness, at, others, damping, left, border, halo, h, steps, first
):
    """Coarse steps until none are `left` (1,), each of `steps` fine ones of the particles and the interface nodes.

    The ghosts are where the nodes put them. Returns on the way for a new list, with the number of fine steps done.

    Args:
        inner: Stiffness of the continuum among the interface nodes.
        mesh: The nodes of a rank, or None (then the next three as well): the caller sets and reads `nodes`.
        stiffness: Of the continuum, rows of this rank's nodes.
        at: Interface nodes among the nodes of this rank.
        others: The rest of the mesh, None where this rank has all of it.
        damping: c_m, 1/s.
        border, halo: Contacts with particles of other ranks and the way to them, None on one rank; the nodes are on all ranks.
        h: Fine step, s.
        first: -1, or the fine steps done before the list was built anew.
    """
    while left[0] > 0:
        if first < 0:
            _start_coarse(mesh, nodes, stiffness, at, others, damping, h * steps)
            if highest(halo, 1 if ghosts_feel(system, ghosts) else 0) == 1:
                take_link(system, ghosts, nodes.link)
                sum_together(halo, nodes.link)
            else:
                still_ghosts(system, ghosts)
            _start_nodes(nodes, damping, h)
            drift(system, terms, h)
            carry_ghosts(system, ghosts, nodes, h)
        for j in range(max(first, 0), steps):
            if list_used_up(system, linear, halo):
                return j
            forces(system, terms, linear, h, border, halo)
            take_link(system, ghosts, nodes.link)
            end_forces(system, terms, linear, h, halo, nodes.link)
            last = j == steps - 1
            _pull_nodes(nodes, inner, (j + 1) * h, 0.5 * h if last else h)
            _kick_nodes(nodes, damping, h, last)
            kick_on(system, terms, h, TO_END if last else ONWARD)
            carry_ghosts(system, ghosts, nodes, 0.0 if last else h)
        _end_coarse(mesh, nodes, stiffness, at, others, damping, h * steps)
        left[0] -= 1
        first = -1
    return steps
