"""Linearised stiffness of the contact network and the critical time step."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from particles.network import contacts, rolling_radius

if TYPE_CHECKING:
    from particles.assembly import Assembly


def stiffness_matrix(soil: Assembly, contact_range: float = 0.0, walls: bool = False) -> Any:
    """Stiffness of sticking contacts, scipy CSR (3n, 3n), id order, symmetric: energy 1/2 q K q.

    All pairs with overlap > -contact_range (r_i + r_j), without tension cut, limits and geometric stiffness; with `walls`
    also contacts with plates at rest.

    Returns:
        Rows and columns 3 id + (0, 1, 2) for (x, y, rotation); N/m, N, N m.
    """
    from scipy import sparse

    found = contacts(soil, walls, contact_range)
    size = 3 * soil.count
    n, zero = found.normal, np.zeros(len(found.first))
    t = np.column_stack([-n[:, 1], n[:, 0]])
    other = np.where(found.plate >= 0, 0.0, 1.0)
    unit = np.ones_like(zero)
    # rows: relative displacement in the three directions as a product with (u_i, u_j)
    opening = np.column_stack([-n[:, 0], -n[:, 1], zero, other * n[:, 0], other * n[:, 1], zero])
    slide = np.column_stack(
        [-t[:, 0], -t[:, 1], -found.first_arm, other * t[:, 0], other * t[:, 1], -other * found.second_arm]
    )
    roll = np.column_stack([zero, zero, unit, zero, zero, -other])
    rotational = found.constants[:, 8] + rolling_radius(found) ** 2 * found.constants[:, 5]
    blocks = sum(
        k[:, None, None] * b[:, :, None] * b[:, None, :]
        for k, b in ((found.constants[:, 0], opening), (found.constants[:, 2], slide), (rotational, roll))
    )
    second = np.where(found.plate >= 0, found.first, found.second)
    dofs = np.concatenate([3 * found.first[:, None] + np.arange(3), 3 * second[:, None] + np.arange(3)], axis=1)
    rows = np.repeat(dofs, 6, axis=1).ravel()
    columns = np.tile(dofs, (1, 6)).ravel()
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
    k = found.constants
    radius = rolling_radius(found)
    opening = light_i + light_j
    slide = opening + found.first_arm**2 * spin_i + found.second_arm**2 * spin_j
    roll = spin_i + spin_j
    square = np.maximum(k[:, 0] * opening, k[:, 2] * slide + (k[:, 8] + radius**2 * k[:, 5]) * roll).max()
    rate = np.maximum(k[:, 1] * opening, k[:, 4] * slide + (k[:, 10] + radius**2 * k[:, 7]) * roll).max()
    if sharp:
        square = largest_eigenvalue(stiffness_matrix(soil, contact_range, walls=True), masses, inertias)
    frequency = np.sqrt(square)
    ratio = rate / frequency  # 2 xi
    return float(2.0 / frequency * (np.sqrt(1.0 + ratio**2) - ratio))


def largest_eigenvalue(stiffness: Any, masses: np.ndarray, inertias: np.ndarray) -> float:
    """Largest eigenvalue of M^-1 K (1/s2) by Lanczos on the symmetric form M^-1/2 K M^-1/2."""
    from scipy import sparse
    from scipy.sparse.linalg import eigsh

    scale = sparse.diags(1.0 / np.sqrt(np.column_stack([masses, masses, inertias]).ravel()))
    scaled = scale @ stiffness @ scale
    if scaled.shape[0] < 32:
        return float(np.linalg.eigvalsh(scaled.toarray())[-1])
    start = np.random.default_rng(1).standard_normal(scaled.shape[0])
    return float(eigsh(scaled, k=1, which="LA", v0=start, tol=1e-8, return_eigenvectors=False)[0])
