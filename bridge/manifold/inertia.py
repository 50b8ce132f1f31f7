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
from particles.lattice.lanes import WIDTH, even, load, store
from particles.system import KERNEL, STEPS

HEAVIEST = 26.0 / 27.0  # largest eigenvalue of M_L^-1 (M_L - M_C): all nodes of a regular mesh in turn against each other; in the plane 8/9
TURNS = 7  # of the iteration for the momenta; each leaves a tenth of the error, 1e-14 of it in the energy after all


class Inertia(NamedTuple):
    """What elements have beside the lumped mass."""

    mass: Any  # (elements,) kg
    coupling: Any  # (corners, 8): 1/2 (M_L - M_C) of an element of mass one; a vector a line, its last numbers zero
    before: Any  # (3, nodes) forces of the last evaluation without its share, N
    rate: Any  # (3, nodes)


def inertia_of(shares: np.ndarray, fold: np.ndarray, nodes: int) -> Inertia:
    """Inertia of elements by the masses (elements, corners) that they give to their nodes; those with little at a corner have less.

    `fold` is that of `bridge.manifold.grid`.
    """
    corners = shares.shape[1]
    whole = 0.5 * (np.eye(corners) / corners - bricks.mass(3 if corners == 8 else 2))
    coupling = np.zeros((fold.shape[1], WIDTH))
    coupling[:, : fold.shape[1]] = fold.T @ whole @ fold
    return Inertia(corners * shares.min(axis=1), coupling, np.zeros((3, nodes)), np.zeros((3, nodes)))


def step_factor(axes: int) -> float:
    """Share of the critical step with the lumped mass that is stable with this one: 1 / sqrt(1 + 1/2 26/27), in the plane 8/9."""
    return float((1.5 - 0.5 * 3.0**-axes) ** -0.5)


@njit(**KERNEL)
def couple(elements, inertia, by, result):
    """Add 1/2 (M_L - M_C) a (N) to `result` for accelerations a (3, nodes) in `by`."""
    coupling, given = inertia.coupling, elements.room
    for q in range(len(elements.active)):
        e = elements.active[q]
        mass = inertia.mass[e]
        axes, corners = len(elements.axes), len(elements.corners)
        for c in range(corners):
            for a in range(axes):
                given[WIDTH * a + c] = mass * by[a, elements.node[e, c]]
        x = y = z = even(0.0)
        for c in range(corners):
            line = load(coupling[c], 0)
            x = x + line * given[c]
            y = y + line * given[WIDTH + c]
            if axes == 3:
                z = z + line * given[2 * WIDTH + c]
        store(given, 0, x)
        store(given, WIDTH, y)
        store(given, 2 * WIDTH, z)
        for c in range(corners):
            node = elements.node[e, c]
            for a in range(axes):
                result[a, node] += given[WIDTH * a + c]


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
def heavier(nodes, elements, inertia, drive, h, velocity, guess, way, room):
    """Kinetic energies (J) with the mass A^-1 less those with the lumped mass, of now and in the middle of the coming step.

    That of now is the largest value of x.M_L v - 1/2 x.M_L (1 + D) x - 1/2 v.M_L v with D = 1/2 M_L^-1 (M_L - M_C), sought by
    Chebyshev's iteration (eigenvalues of 1 + D from 1 to 1 + 13/27); its error is the square of that of x. `velocity` and `guess`
    (3, nodes) hold v in the beginning, `way` and `room` are of the same shape.
    """
    half = 0.25 * HEAVIEST
    middle, ratio, by = 1.0 + half, half / (1.0 + half), 0.0
    for turn in range(TURNS):
        _coupled(nodes, elements, inertia, drive, guess, room)
        before, by = by, 1.0 / (2.0 / ratio - by) if turn > 0 else ratio
        for a in range(3):
            for i in range(velocity.shape[1]):
                left = velocity[a, i] - guess[a, i] - room[a, i]
                way[a, i] = left / middle if turn == 0 else by * before * way[a, i] + 2.0 * by / half * left
                guess[a, i] += way[a, i]
    _coupled(nodes, elements, inertia, drive, guess, room)
    for q in range(len(drive.held)):  # they have the lumped mass
        a, i = drive.held_axis[q], drive.held[q]
        room[a, i], guess[a, i], inertia.before[a, i] = 0.0, velocity[a, i], nodes.force[a, i]
    now = coming = 0.0
    for a in range(3):
        for i in range(velocity.shape[1]):
            if nodes.lightness[i] > 0.0:
                v, x, f = velocity[a, i], guess[a, i], nodes.force[a, i]
                now += (x * (v - 0.5 * (x + room[a, i])) - 0.5 * v * v) / nodes.lightness[i]
                coming += 0.5 * h * (v + 0.25 * h * nodes.lightness[i] * f) * (inertia.before[a, i] - f)
    return now, now + coming
