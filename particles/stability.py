"""Linearised stiffness of the contact network and the critical time step."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from particles.network import Contacts, contacts, dashpots, stiffnesses

if TYPE_CHECKING:
    from particles.assembly import Assembly


def tangents(normal: np.ndarray) -> list[np.ndarray]:
    """Unit vectors (k, d) that make an orthonormal frame with the normals (k, d): one in the plane, two in space."""
    if normal.shape[1] == 2:
        return [np.column_stack([-normal[:, 1], normal[:, 0]])]
    axis = np.eye(3)[np.abs(normal).argmin(axis=1)]
    first = np.cross(normal, axis)
    first /= np.linalg.norm(first, axis=1)[:, None]
    return [first, np.cross(normal, first)]


def relative_motions(found: Contacts) -> list[tuple[int, np.ndarray]]:
    """Relative displacements of contacts as products with (q_i, q_j): column of `stiffnesses`, matrix (k, 2 freedoms)."""
    n, other = found.normal, np.where(found.plate >= 0, 0.0, 1.0)[:, None]
    arm_i, arm_j = found.first_arm[:, None], found.second_arm[:, None]
    plane = n.shape[1] == 2
    none = np.zeros((len(n), 1 if plane else 3))
    motions = [(0, np.hstack([-n, none, other * n, none]))]
    for t in tangents(n):
        turn = np.ones_like(none) if plane else np.cross(n, t)
        motions.append((1, np.hstack([-t, -arm_i * turn, other * t, -other * arm_j * turn])))
        about = np.ones_like(none) if plane else t
        motions.append((2, np.hstack([0.0 * t, about, 0.0 * t, -other * about])))
    if not plane:
        motions.append((3, np.hstack([none, n, none, -other * n])))
    return motions


def stiffness_matrix(soil: Assembly, contact_range: float = 0.0, walls: bool = False) -> Any:
    """Stiffness of sticking contacts, scipy CSR (f n, f n), f = 3 or 6 freedoms, id order, symmetric: energy 1/2 q K q.

    All pairs with overlap > -contact_range (r_i + r_j), without tension cut, limits and geometric stiffness; with `walls`
    also contacts with plates at rest.

    Returns:
        Rows and columns f id + k for the k-th generalised component; N/m, N, N m.
    """
    from scipy import sparse

    found = contacts(soil, walls, contact_range)
    freedoms = soil.freedoms
    size = freedoms * soil.count
    stiffness = stiffnesses(soil, found)
    blocks = np.zeros((len(found.first), 2 * freedoms, 2 * freedoms))
    for kind, b in relative_motions(found):
        blocks += stiffness[:, kind, None, None] * b[:, :, None] * b[:, None, :]
    second = np.where(found.plate >= 0, found.first, found.second)
    own = np.arange(freedoms)
    dofs = np.concatenate([freedoms * found.first[:, None] + own, freedoms * second[:, None] + own], axis=1)
    rows = np.repeat(dofs, 2 * freedoms, axis=1).ravel()
    columns = np.tile(dofs, (1, 2 * freedoms)).ravel()
    return sparse.coo_matrix((np.ravel(blocks), (rows, columns)), shape=(size, size)).tocsr()


def critical_step(soil: Assembly, sharp: bool = False, contact_range: float = 1e-6) -> float:
    """Largest stable step of the present contacts (pairs and plates), s; infinity without contacts. Use 0.8 of it.

    By default a rigorous bound from splitting each disc's mass over its contacts (each contact then is a small system of
    its own). `sharp` solves for the largest frequency of the sticking network (Lanczos), a step up to about 1.5 times
    larger. Dashpots, which act on the predictor (M9), shorten the step by sqrt(1 + 4 xi^2) - 2 xi, xi the largest damping
    ratio (one oscillator: the root -1 appears at (w h)^2 / 4 + 2 xi w h = 1).

    Args:
        sharp: solve the eigenvalue problem.
        contact_range: counts pairs with overlap > -contact_range (r_i + r_j), so that discs of a lattice that just touch
            are in contact.
    """
    found = contacts(soil, True, contact_range)
    if found.first.size == 0:
        return float("inf")
    masses, inertias = soil.masses, soil.inertias
    discs = found.plate < 0
    degree = np.bincount(found.first, minlength=soil.count) + np.bincount(found.second[discs], minlength=soil.count)
    second = np.where(discs, found.second, 0)
    light_i, light_j = (degree / masses)[found.first], np.where(discs, (degree / masses)[second], 0.0)
    spin_i, spin_j = (degree / inertias)[found.first], np.where(discs, (degree / inertias)[second], 0.0)
    stiffness, damping = stiffnesses(soil, found), dashpots(soil, found)
    opening = light_i + light_j
    slide = opening + found.first_arm**2 * spin_i + found.second_arm**2 * spin_j
    roll = spin_i + spin_j

    def bound(k: np.ndarray) -> float:
        return float(np.max([k[:, 0] * opening, k[:, 1] * slide + k[:, 2] * roll, k[:, 3] * roll]))

    square, rate = bound(stiffness), bound(damping)
    if sharp:
        square = largest_eigenvalue(stiffness_matrix(soil, contact_range, walls=True), masses, inertias)
    frequency = np.sqrt(square)
    ratio = rate / frequency  # 2 xi
    return float(2.0 / frequency * (np.sqrt(1.0 + ratio**2) - ratio))


def largest_eigenvalue(stiffness: Any, masses: np.ndarray, inertias: np.ndarray) -> float:
    """Largest eigenvalue of M^-1 K (1/s2) by Lanczos on the symmetric form M^-1/2 K M^-1/2."""
    from scipy import sparse
    from scipy.sparse.linalg import eigsh

    count = len(masses)
    axes = 2 if stiffness.shape[0] == 3 * count else 3
    weights = np.hstack([np.repeat(masses[:, None], axes, 1), np.repeat(inertias[:, None], 2 * axes - 3, 1)])
    scale = sparse.diags(1.0 / np.sqrt(weights.ravel()))
    scaled = scale @ stiffness @ scale
    if scaled.shape[0] < 32:
        return float(np.linalg.eigvalsh(scaled.toarray())[-1])
    start = np.random.default_rng(1).standard_normal(scaled.shape[0])
    return float(eigsh(scaled, k=1, which="LA", v0=start, tol=1e-8, return_eigenvectors=False)[0])
