"""The largest stable step of the particles' side of the overlap coupling."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sparse
import scipy.sparse.linalg as sparse_linalg

from particles.stability import largest_eigenvalue

DENSE = 60  # components up to which all eigenvalues are computed
TOUCHING = 1e-6  # gap, in sums of radii, up to which particles are in contact


def fine_step(fine) -> float:
    """Critical step (s) of the particles, of the nodes of the zone and of what ties them, the other nodes held.

    2 / (largest frequency) of the sticking network and the continuum among those nodes (Lanczos), shortened by
    dashpots as in `particles.stability.critical_step`. Infinity on a rank without particles.
    """
    if not fine.soil.count:
        return np.inf
    stiffness, mass = system(fine)
    value = _largest(stiffness, mass)
    if not value > 0.0:
        return np.inf
    return 2.0 / np.sqrt(value) * _shortening(fine.soil)


def system(fine) -> tuple[sparse.csr_matrix, sparse.csr_matrix]:
    """Stiffness and mass of the components that take the particles' steps, those that do not move left out."""
    soil, tie = fine.soil, fine.tie
    count, nodes = 3 * soil.count, tie.matrix.shape[1]
    own = (3 * tie.ids[:, None] + np.arange(3)).ravel()
    weights = np.column_stack([soil.masses, soil.masses, soil.inertias]).ravel()
    contacts = soil.stiffness_matrix(TOUCHING, walls=True)
    at = sparse.csr_matrix((np.ones(len(own)), (np.arange(len(own)), own)), shape=(len(own), count))
    if fine.eliminated:
        # all components of particles from those that are free and the nodes
        led = np.zeros(count, dtype=bool)
        led[own[fine.tie.tied.ravel()]] = True
        free = np.flatnonzero(~led)
        alone = sparse.csr_matrix((np.ones(len(free)), (free, np.arange(len(free)))), shape=(count, len(free)))
        motion = sparse.hstack([alone, at.T @ tie.matrix])
        stiffness = motion.T @ contacts @ motion
        mass = sparse.block_diag([sparse.diags(weights[free]), fine.mass_matrix])
    else:
        free = np.arange(count)
        gap = sparse.hstack([at, -tie.matrix])
        stiffness = sparse.block_diag([contacts, sparse.csr_matrix((nodes, nodes))])
        stiffness = stiffness + gap.T @ sparse.diags(fine.stiffness.ravel()) @ gap
        mass = sparse.block_diag([sparse.diags(weights), fine.mass_matrix])
    stiffness = stiffness + sparse.block_diag([sparse.csr_matrix((len(free), len(free))), fine.continuum_stiffness])
    kept = np.concatenate([np.arange(len(free)), len(free) + fine.mass.free])
    return sparse.csr_matrix(stiffness)[kept][:, kept], sparse.csr_matrix(mass)[kept][:, kept]


def _largest(stiffness: sparse.csr_matrix, mass: sparse.csr_matrix) -> float:
    """Largest eigenvalue of M^-1 K (1/s2)."""
    if stiffness.shape[0] <= DENSE:
        lower = np.linalg.inv(np.linalg.cholesky(mass.toarray()))
        return float(np.linalg.eigvalsh(lower @ stiffness.toarray() @ lower.T)[-1])
    factor = sparse_linalg.splu(sparse.csc_matrix(mass))
    inverse = sparse_linalg.LinearOperator(mass.shape, matvec=factor.solve, dtype=np.float64)
    start = np.random.default_rng(1).standard_normal(mass.shape[0])
    values = sparse_linalg.eigsh(
        stiffness, k=1, M=mass, Minv=inverse, which="LA", v0=start, tol=1e-8, return_eigenvectors=False
    )
    return float(values[0])


def _shortening(soil) -> float:
    """Factor of the critical step by dashpots, that of the particles by themselves."""
    if soil.system.predicted is None:
        return 1.0
    square = largest_eigenvalue(soil.stiffness_matrix(TOUCHING, walls=True), soil.masses, soil.inertias)
    return float(soil.critical_step(sharp=True, contact_range=TOUCHING) * np.sqrt(square) / 2.0)
