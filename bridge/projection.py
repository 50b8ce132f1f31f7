"""M = N^T Mp N, P = N M^-1 N^T Mp and Q = I - P of the bridging scale, as operators (never dense)."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse as sparse
import scipy.sparse.linalg as sparse_linalg
from numpy.typing import NDArray

Array = NDArray[np.float64]

CONDITION_LIMIT = 1e10  # of the Jacobi-scaled matrix; beyond it the pseudo-inverse is cut off


class SymmetricSolver:
    """Solve A x = b for a symmetric positive (semi)definite sparse A, factored once.

    Where the Jacobi-scaled condition number passes `CONDITION_LIMIT` (elements that hold too few particles) the truncated
    pseudo-inverse takes over: the solution of least norm, so that P stays the mass-orthogonal projector on the range of N.
    Small systems (up to `DENSE_LIMIT` unknowns) keep the inverse itself: one matrix product a solve.
    """

    DENSE_LIMIT = 150

    def __init__(self, matrix: sparse.spmatrix):
        matrix = sparse.csc_matrix(matrix)
        scale = np.sqrt(matrix.diagonal())
        if np.any(scale == 0.0):
            raise ValueError("a node without particle mass in the matrix: leave such nodes out")
        scaled = sparse.csc_matrix(sparse.diags(1.0 / scale) @ matrix @ sparse.diags(1.0 / scale))
        self._scale = scale[:, None]
        self._factor: Any = None
        self._inverse: Array | None = None
        self.condition = self._estimate(scaled)
        if self.condition > CONDITION_LIMIT:
            self._inverse = scipy.linalg.pinvh(scaled.toarray(), rtol=1.0 / CONDITION_LIMIT)
        elif len(scale) <= self.DENSE_LIMIT:
            self._inverse = np.linalg.inv(scaled.toarray())
        else:
            self._factor = sparse_linalg.splu(scaled, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
        if self._inverse is not None:  # fold the scaling in: a solve is then one product
            self._inverse = np.ascontiguousarray(self._inverse / scale[:, None] / scale[None, :])

    @staticmethod
    def _estimate(scaled: sparse.csc_matrix) -> float:
        count = scaled.shape[0]
        if count <= 400:
            values = np.linalg.eigvalsh(scaled.toarray())
            return float(values[-1] / values[0]) if values[0] > 0.0 else np.inf
        try:
            factor = sparse_linalg.splu(scaled)
        except RuntimeError:  # exactly singular
            return np.inf
        inverse = sparse_linalg.LinearOperator(scaled.shape, matvec=factor.solve, rmatvec=factor.solve, dtype=float)
        return float(sparse_linalg.onenormest(inverse) * sparse_linalg.norm(scaled, 1))

    def solve(self, right: Array) -> Array:
        """Solution (n, k) for right-hand sides (n, k)."""
        if self._inverse is not None:
            return self._inverse @ right
        return self._factor.solve(right / self._scale) / self._scale


class Projection:
    """Mass-weighted least-squares projection of particle motion onto the mesh (Li & Wan 2010, eqs 4-8).

    Args:
        matrix: N, scalar shape functions (particles, nodes), sparse.
        masses: Particle masses (n,), kg per metre.
        inertias: Particle polar inertias (n,), kg m per metre.

    Nodes without any particle in their support are left out: their coefficients are zero.
    """

    def __init__(self, matrix: sparse.csr_matrix, masses: Array, inertias: Array):
        self.matrix = sparse.csr_matrix(matrix)
        self.transposed = sparse.csr_matrix(self.matrix.T)
        self.weights = np.column_stack([masses, masses, inertias])
        self.supported = np.asarray(self.transposed.sum(axis=1)).ravel() > 0.0
        inner = self.matrix[:, self.supported]
        self.gram = [sparse.csr_matrix(inner.T @ sparse.diags(w) @ inner) for w in (masses, inertias)]
        self._solvers = [SymmetricSolver(gram) for gram in self.gram] if self.supported.any() else []

    def restrict(self, values: Array) -> Array:
        """N^T values: (particles, 3) to (nodes, 3)."""
        return self.transposed @ values

    def extend(self, nodal: Array) -> Array:
        """N nodal: (nodes, 3) to (particles, 3)."""
        return self.matrix @ nodal

    def apply_gram(self, nodal: Array) -> Array:
        """M nodal, (nodes, 3)."""
        return self.transposed @ (self.weights * (self.matrix @ nodal))

    def coarse(self, values: Array) -> Array:
        """Coefficients M^-1 N^T Mp values (nodes, 3) of the coarse part of particle values (particles, 3)."""
        result = np.zeros((self.matrix.shape[1], 3))
        if self._solvers:
            moments = (self.transposed @ (self.weights * values))[self.supported]
            result[self.supported, :2] = self._solvers[0].solve(moments[:, :2])
            result[self.supported, 2:] = self._solvers[1].solve(moments[:, 2:])
        return result

    def project(self, values: Array) -> Array:
        """P values: the coarse part, (particles, 3)."""
        return self.matrix @ self.coarse(values)

    def remainder(self, values: Array) -> Array:
        """Q values: the fine part, (particles, 3)."""
        return values - self.project(values)
