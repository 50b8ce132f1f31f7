"""The nodes of the zone within a coarse step, compiled: central differences with the particles' steps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from bridge.overlap.mass import minus_row, product, solve
from particles.system import INNER


class ZoneNodes(NamedTuple):
    """Nodes of the zone within a coarse step, flat components (3 w,) each."""

    start: np.ndarray  # force of the continuum at the coarse time, N
    slope: np.ndarray  # its change by the motion of the neighbours, N/s
    force: np.ndarray  # its present value, N
    swept: np.ndarray  # integral of `moved` since the coarse time, m s
    link: np.ndarray  # force of the particles of all ranks, N
    base: np.ndarray  # displacement at the coarse time, m and rad
    moved: np.ndarray  # displacement since
    velocity: np.ndarray
    acceleration: np.ndarray
    links: np.ndarray  # the numbers of `link`, three in a row
    lost: np.ndarray  # (1,): energy taken by mass damping, J
    work: np.ndarray  # (1,): of the continuum on these nodes since the coarse time, J


@njit(**INNER)
def _accelerate_nodes(nodes, mass, pull, damping, h):
    """Accelerations under a force of the continuum and the particles', `h` s after the velocity is known."""
    acceleration = nodes.acceleration
    for i in range(acceleration.size):
        acceleration[i] = pull[i] + nodes.link[i]
    solve(mass, acceleration)
    less = 1.0 / (1.0 + damping * h)
    for i in range(acceleration.size):
        acceleration[i] = less * (acceleration[i] - damping * nodes.velocity[i])


@njit(**INNER)
def _work(force, velocity):
    """Power of a force."""
    power = 0.0
    for i in range(force.size):
        power += force[i] * velocity[i]
    return power


@njit(**INNER)
def start_nodes(nodes, mass, damping, h):
    """First half kick and drift of the nodes, from velocities at the coarse time."""
    _accelerate_nodes(nodes, mass, nodes.start, damping, 0.0)
    if damping > 0.0:
        drag = product(mass, nodes.velocity, nodes.velocity) + 0.5 * h * product(mass, nodes.velocity, nodes.acceleration)
        nodes.lost[0] += 0.5 * h * damping * drag
    for i in range(nodes.velocity.size):
        nodes.velocity[i] += 0.5 * h * nodes.acceleration[i]
        nodes.moved[i] = h * nodes.velocity[i]
        nodes.swept[i] = 0.0
    nodes.work[0] = 0.5 * h * _work(nodes.start, nodes.velocity)


@njit(**INNER)
def pull_nodes(nodes, stiffness, time, weight):
    """Force of the continuum at a time (s) since the coarse time; `weight` (s) is that of the time integral."""
    for i in range(nodes.force.size):
        nodes.force[i] = minus_row(stiffness, i, nodes.moved, nodes.start[i] + nodes.slope[i] * time)
        nodes.swept[i] += weight * nodes.moved[i]


@njit(**INNER)
def kick_nodes(nodes, mass, damping, h, last):
    """New accelerations; velocities to the end of the step, or on to the middle of the next, and drift."""
    _accelerate_nodes(nodes, mass, nodes.force, damping, 0.5 * h)
    nodes.work[0] += 0.5 * h * _work(nodes.force, nodes.velocity)
    if damping > 0.0:
        # v M w: v at this time, w the mean velocity around it (at the end of the coarse step half of that before)
        before, change = nodes.velocity, nodes.acceleration
        level = product(mass, before, before) + 0.5 * h * product(mass, before, change)
        if last:
            level *= 0.5
        else:
            level += 0.5 * h * product(mass, before, change) + 0.25 * h * h * product(mass, change, change)
        nodes.lost[0] += h * damping * level
    for i in range(nodes.velocity.size):
        nodes.velocity[i] += (0.5 * h if last else h) * nodes.acceleration[i]
        if not last:
            nodes.moved[i] += h * nodes.velocity[i]
    if not last:
        nodes.work[0] += 0.5 * h * _work(nodes.force, nodes.velocity)
