"""The higher-order mass of elements: the mean of the lumped and the consistent one (Goudreau & Taylor 1973), without a solution.

To first order in the difference of the two its inverse is A = M_L^-1 + 1/2 M_L^-1 (M_L - M_C) M_L^-1, which is what is taken as the
inverse mass here: symmetric, with the momentum of the lumped mass, since M_L - M_C has no row sums. A wave along an axis of the mesh
has the dispersion error (kh)^4 / 180 in place of the (kh)^2 / 24 of the lumped mass; across the axes a second-order part is left.
Components that are held keep the lumped mass and are not coupled to others.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from continuum import bricks
from particles.system import KERNEL, STEPS

HEAVIEST = 26.0 / 27.0  # largest eigenvalue of M_L^-1 (M_L - M_C): all nodes of a regular mesh in turn against each other
TURNS = 12  # of the iteration for the momenta; each leaves a fifth of the error, 1e-17 of it in the energy after all


class Inertia(NamedTuple):
    """What elements have beside the lumped mass."""

    mass: Any  # (elements,) kg
    coupling: Any  # (8, 8): 1/2 (M_L - M_C) of an element of mass one
    before: Any  # (3, nodes) forces of the last evaluation without its share, N
    rate: Any  # (3, nodes)


def inertia_of(shares: np.ndarray, nodes: int) -> Inertia:
    """Inertia of elements by the masses (elements, 8) that they give to their nodes; those with little at a corner have less."""
    consistent = bricks.mass()
    return Inertia(8.0 * shares.min(axis=1), 0.5 * (np.eye(8) / 8.0 - consistent), np.zeros((3, nodes)), np.zeros((3, nodes)))


def step_factor() -> float:
    """Share of the critical step with the lumped mass that is stable with this one: 1 / sqrt(1 + 1/2 26/27)."""
    return float((1.0 + 0.5 * HEAVIEST) ** -0.5)


@njit(**KERNEL)
def couple(elements, inertia, by, result):
    """Add 1/2 (M_L - M_C) a (N) to `result` for accelerations a (3, nodes) in `by`."""
    coupling = inertia.coupling
    for q in range(len(elements.active)):
        e = elements.active[q]
        mass = inertia.mass[e]
        for a in range(3):
            for c in range(8):
                total = 0.0
                for b in range(8):
                    total += coupling[c, b] * by[a, elements.node[e, b]]
                result[a, elements.node[e, c]] += mass * total


@njit(**KERNEL)
def spread(nodes, elements, inertia, drive):
    """Turn forces f on nodes into f + 1/2 (M_L - M_C) M_L^-1 f, of which the lumped mass makes the accelerations A f."""
    f, before, rate = nodes.force, inertia.before, inertia.rate
    for a in range(3):
        for i in range(f.shape[1]):
            before[a, i] = f[a, i]
            rate[a, i] = nodes.lightness[i] * f[a, i]
    for q in range(len(drive.held)):
        rate[drive.held_axis[q], drive.held[q]] = 0.0
    couple(elements, inertia, rate, f)
    for q in range(len(drive.held)):
        f[drive.held_axis[q], drive.held[q]] = before[drive.held_axis[q], drive.held[q]]


@njit(**KERNEL)
def _coupled(nodes, elements, inertia, drive, velocity, result):
    """M_L^-1 1/2 (M_L - M_C) v, without held components."""
    result[:] = 0.0
    for q in range(len(drive.held)):
        velocity[drive.held_axis[q], drive.held[q]] = 0.0
    couple(elements, inertia, velocity, result)
    for a in range(3):
        for i in range(result.shape[1]):
            result[a, i] *= nodes.lightness[i]
    for q in range(len(drive.held)):
        result[drive.held_axis[q], drive.held[q]] = 0.0


@njit(**STEPS)
def heavier(nodes, elements, inertia, drive, velocity, guess, room):
    """Kinetic energy (J) of nodal velocities v (3, nodes) with the mass A^-1, less that with the lumped mass.

    It is the largest value of x.M_L v - 1/2 x.M_L (1 + D) x - 1/2 v.M_L v, D = 1/2 M_L^-1 (M_L - M_C), whose error is the square of
    that of x. `guess` holds v in the beginning and x in the end, `room` is (3, nodes).
    """
    relax = 1.0 / (1.0 + 0.25 * HEAVIEST)
    for _ in range(TURNS):
        _coupled(nodes, elements, inertia, drive, guess, room)
        for a in range(3):
            for i in range(velocity.shape[1]):
                guess[a, i] += relax * (velocity[a, i] - guess[a, i] - room[a, i])
    _coupled(nodes, elements, inertia, drive, guess, room)
    more = 0.0
    for a in range(3):
        for i in range(velocity.shape[1]):
            if nodes.lightness[i] > 0.0:
                v, x = velocity[a, i], guess[a, i]
                more += (x * (v - 0.5 * (x + room[a, i])) - 0.5 * v * v) / nodes.lightness[i]
    for q in range(len(drive.held)):  # their part is that of the lumped mass
        v = velocity[drive.held_axis[q], drive.held[q]]
        more += 0.5 * v * v / nodes.lightness[drive.held[q]]
    return more
