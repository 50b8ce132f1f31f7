"""The coarse step of the variant `subcycling`, compiled: a rank that holds everything needs no Python inside it.

Nodes off the interface take the coarse step at once, under the force at its start. Interface nodes take the particles'
steps, under the particles' forces and that of the continuum, in which their neighbours move evenly over the coarse step.
At the end a kick brings the continuum's impulse on every node to that of the trapezoidal rule over the coarse step: the
sum over the nodes is then that of the loads, so that linear momentum is kept.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from bridge.blocks import row_times
from bridge.substeps import carry_ghosts, ghosts_feel, linear_forces, still_ghosts, take_link
from particles.block_motion import ONWARD, TO_END
from particles.motion import done_with, drift, evaluate_with, kick_on
from particles.ranks import highest, sum_together
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
def _start_coarse(mesh, nodes, stiffness, at, damping, step):
    """Move the nodes off the interface; what the interface nodes are to feel in the coarse step."""
    if mesh is not None:
        move_others(mesh, damping, step)
        for i in range(at.size):
            change = row_times(stiffness, at[i], mesh.increment)
            for component in range(3):
                nodes.velocity[i, component] = mesh.velocity[at[i], component]
                nodes.start[i, component] = mesh.force[at[i], component]
                nodes.slope[i, component] = -change[component] / step


@njit(**INNER)
def _end_coarse(mesh, nodes, stiffness, at, damping, step):
    """Take over what the interface nodes did; kick all nodes."""
    if mesh is not None:
        for i in range(at.size):
            for component in range(3):
                mesh.impulse[at[i], component] = nodes.impulse[i, component]
                mesh.link[at[i], component] = nodes.link[i, component]
                mesh.velocity[at[i], component] = nodes.velocity[i, component]
                mesh.displacement[at[i], component] += nodes.moved[i, component]
                mesh.work[0] += mesh.external[at[i], component] * nodes.moved[i, component]
        for row in range(mesh.force.shape[0]):
            _finish_row(mesh, row, row_times(stiffness, row, mesh.displacement), damping, step)


@njit(**STEPS)
def run_coarse(
    system, terms, linear, ghosts, nodes, inner, mesh, stiffness, at, damping, left, border, halo, h, steps, first
):
    """Coarse steps until none are `left` (1,), each of `steps` fine ones of the particles and the interface nodes.

    The ghosts are where the nodes put them. Returns on the way for a new list, with the number of fine steps done.

    Args:
        inner, stiffness: Of the continuum, among interface nodes and among all nodes.
        mesh: All nodes of a rank that holds everything, or None (then `stiffness` and `at` as well): the caller sets and
            reads `nodes`.
        at: (w,) interface nodes among all nodes.
        damping: c_m, 1/s.
        border, halo: Contacts with particles of other ranks and the way to them, None on one rank; the nodes are on all ranks.
        h: Fine step, s.
        first: -1, or the fine steps done before the list was built anew.
    """
    while left[0] > 0:
        if first < 0:
            _start_coarse(mesh, nodes, stiffness, at, damping, h * steps)
            if highest(halo, 1 if ghosts_feel(system, ghosts) else 0) == 1:
                take_link(system, ghosts, nodes.link)
                sum_together(halo, nodes.link)
            else:
                still_ghosts(system, ghosts)
            _start_nodes(nodes, damping, h)
            drift(system, terms, h)
            carry_ghosts(system, ghosts, nodes, h)
        for j in range(max(first, 0), steps):
            if linear is None:
                if done_with(system, halo):
                    return j
                evaluate_with(system, terms, h, border, halo)
            else:
                linear_forces(system.position, system.force, linear)
            take_link(system, ghosts, nodes.link)
            sum_together(halo, nodes.link)
            last = j == steps - 1
            _pull_nodes(nodes, inner, (j + 1) * h, 0.5 * h if last else h)
            _kick_nodes(nodes, damping, h, last)
            kick_on(system, terms, h, TO_END if last else ONWARD)
            carry_ghosts(system, ghosts, nodes, 0.0 if last else h)
        _end_coarse(mesh, nodes, stiffness, at, damping, h * steps)
        left[0] -= 1
        first = -1
    return steps
