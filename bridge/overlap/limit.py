"""The largest stable step of the particles' side of the overlap coupling."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sparse
import scipy.sparse.linalg as sparse_linalg

from bridge.interpolation import NodeExchange
from particles.stability import largest_eigenvalue

DENSE = 60  # components up to which all eigenvalues are computed
TOUCHING = 1e-6  # gap, in sums of radii, up to which particles are in contact


def bound(coupled) -> float:
    """A step (s) that is certainly stable: that of the particles, of the continuum and of the springs, each by itself.

    Eliminated components only restrict the motion of both sides, which raises no frequency. Springs add theirs: the squares of
    the frequencies, that of the springs from the row sums of k^1/2 b M^-1 b^T k^1/2, b the stretch by the motion of all.
    """
    fine, tie = coupled.fine, coupled.tie
    alone = coupled.body.critical_step()
    if fine.soil.count:
        alone = min(alone, fine.soil.critical_step())
    if fine.eliminated or not len(tie.ids):
        return alone
    root = sparse.diags(np.sqrt(fine.stiffness.ravel()))
    inverse = np.zeros(len(fine.lumped))
    inverse[fine.mass.free] = 1.0 / fine.lumped[fine.mass.free]
    by_mesh = root @ tie.matrix
    pairs = abs(by_mesh @ sparse.diags(inverse) @ by_mesh.T) + root @ sparse.diags(1.0 / fine.masses.ravel()) @ root
    return float(2.0 / np.sqrt(4.0 / alone**2 + pairs.sum(axis=1).max()))


def sharp(coupled) -> float:
    """Critical step (s) of the particles, of the nodes that take their steps and of what ties them, other nodes held.

    2 / (largest frequency) of the sticking network and the continuum among those nodes (Lanczos), shortened by
    dashpots as in `particles.stability.critical_step`. With one substep the nodes are all nodes, and the step is
    that of the whole system. Infinity on a rank without particles (collective).
    """
    soil, nodes = coupled.fine.soil, _nodes(coupled)
    if not soil.count:
        return np.inf
    square = _largest(*system(coupled, nodes))
    return float(2.0 / np.sqrt(square) * _shortening(soil)) if square > 0.0 else np.inf


def system(coupled, given=None) -> tuple[sparse.csr_matrix, sparse.csr_matrix]:
    """Stiffness and mass of the components that take the particles' steps, those that do not move left out.

    `given`: what `_nodes` gave, where it is known.
    """
    fine, tie = coupled.fine, coupled.tie
    stiffness, lumped, free, nodes = given or _nodes(coupled)
    matrix = tie.matrix @ nodes
    soil, freedoms = fine.soil, fine.soil.freedoms
    count = freedoms * soil.count
    own = (freedoms * tie.ids[:, None] + np.arange(freedoms)).ravel()
    weights = fine.all_masses.ravel()
    contacts = soil.stiffness_matrix(TOUCHING, walls=True)
    at = sparse.csr_matrix((np.ones(len(own)), (np.arange(len(own)), own)), shape=(len(own), count))
    alone = np.arange(count)
    if fine.eliminated:
        alone = np.setdiff1d(alone, own[tie.tied.ravel()])
        lumped = lumped + matrix.T @ sparse.diags(fine.masses.ravel()) @ matrix
    # all components of the particles from those that move alone and the nodes
    by_itself = sparse.csr_matrix((np.ones(len(alone)), (alone, np.arange(len(alone)))), shape=(count, len(alone)))
    motion = sparse.hstack([by_itself, at.T @ matrix if fine.eliminated else sparse.csr_matrix((count, matrix.shape[1]))])
    whole = motion.T @ contacts @ motion
    whole = whole + sparse.block_diag([sparse.csr_matrix((len(alone),) * 2), stiffness])
    if not fine.eliminated:
        gap = sparse.hstack([at, -matrix])
        whole = whole + gap.T @ sparse.diags(fine.stiffness.ravel()) @ gap
    mass = sparse.block_diag([sparse.diags(weights[alone]), lumped])
    kept = np.concatenate([np.arange(len(alone)), len(alone) + np.flatnonzero(free & (lumped.diagonal() > 0.0))])
    return sparse.csr_matrix(whole)[kept][:, kept], sparse.csr_matrix(mass)[kept][:, kept]


def _nodes(coupled):
    """Stiffness, lumped mass, free components of the nodes that take the particles' steps; zone's components from them."""
    fine, mesh, own = coupled.fine, coupled.mesh, coupled.exchange.nodes
    width, size = mesh.width, mesh.width * len(own)
    if coupled.substeps > 1:
        free = np.zeros(size, dtype=bool)
        free[fine.mass.free] = True
        return fine.continuum_stiffness, sparse.diags(fine.lumped), free, sparse.identity(size, format="csr")
    count = mesh.comm.allreduce(len(mesh.mass))
    every = np.arange(count if fine.soil.count else 0)
    exchange = NodeExchange(mesh.comm, mesh.body.owned_range, every)
    mass, fixed = exchange.gather(mesh.mass), exchange.gather(mesh.fixed.astype(float))
    places = (width * own[:, None] + np.arange(width)).ravel() if fine.soil.count else np.zeros(0, dtype=np.int64)
    size = len(places)
    select = sparse.csr_matrix((np.ones(size), (np.arange(size), places)), shape=(size, mass.size))
    return mesh.stiffness_matrix(every), sparse.diags(mass.ravel()), fixed.ravel() < 0.5, select


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
    if soil.terms().viscous is None:
        return 1.0
    square = largest_eigenvalue(soil.stiffness_matrix(TOUCHING, walls=True), soil.masses, soil.inertias)
    return float(soil.critical_step(sharp=True, contact_range=TOUCHING) * np.sqrt(square) / 2.0)
