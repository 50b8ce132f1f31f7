"""P and Q on several ranks: N^T Mp N put together by PETSc from the particles of each rank, factored once, solved by all."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray
from petsc4py import PETSc

from bridge.interpolation import NodeExchange
from bridge.projection import CONDITION_LIMIT, SymmetricSolver

Array = NDArray[np.float64]

ROUNDS = 10  # of the inverse iteration for the smallest eigenvalue; a matrix beyond the limit shows in the first few


class SpreadSolver:
    """Solve A x = b for a symmetric positive (semi)definite sparse A that is the sum of the ranks' parts (collective).

    Factored once by MUMPS over all ranks. Where the Jacobi-scaled condition number passes `CONDITION_LIMIT`, rank 0 takes over
    with the truncated pseudo-inverse of `SymmetricSolver`: A is of the size of the mesh under the particles.

    Args:
        comm: the ranks.
        exchange: the nodes of this rank's part and their owners.
        matrix: this rank's part (nodes, nodes) of A.
        owned: number of nodes that this rank owns.

    Nodes with nothing on the diagonal of A are left out: x is zero there.
    """

    def __init__(self, comm: Any, exchange: NodeExchange, matrix: sparse.spmatrix, owned: int):
        self._comm = comm
        diagonal = np.zeros((owned, 1))
        exchange.scatter(matrix.diagonal()[:, None], diagonal)
        self._scale = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
        near = sparse.diags(1.0 / exchange.gather(self._scale)[:, 0])
        scaled = sparse.coo_matrix(near @ matrix @ near)
        self._factor(exchange.nodes, scaled, diagonal[:, 0] > 0.0)
        self.condition = self._estimate()
        self._pseudo: SymmetricSolver | None = None
        self._on_root = not self.condition <= CONDITION_LIMIT
        if self._on_root:
            self._collect(exchange.nodes, scaled, diagonal[:, 0] > 0.0)

    def _factor(self, nodes: NDArray[np.int64], scaled: sparse.coo_matrix, there: NDArray[np.bool_]) -> None:
        """Assemble the scaled matrix, with ones where a node is not there, and hand it to MUMPS."""
        matrix = PETSc.Mat().createAIJ(((len(there), PETSc.DETERMINE),) * 2, comm=self._comm)
        matrix.setUp()
        matrix.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
        self._first = matrix.getOwnershipRange()[0]
        add = PETSc.InsertMode.ADD_VALUES
        for row in np.flatnonzero(~there) + self._first:
            matrix.setValue(row, row, 1.0, addv=add)
        rows, places = scaled.tocsr(), nodes.astype(PETSc.IntType)
        for k, row in enumerate(places):
            part = slice(rows.indptr[k], rows.indptr[k + 1])
            matrix.setValues([row], places[rows.indices[part]], rows.data[part], addv=add)
        matrix.assemble()
        matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        self._norm = matrix.norm(PETSc.NormType.NORM_INFINITY)
        self._right, self._found = matrix.createVecs()
        self._solver = PETSc.KSP().create(self._comm)
        self._solver.setOperators(matrix)
        self._solver.setType(PETSc.KSP.Type.PREONLY)
        self._solver.getPC().setType(PETSc.PC.Type.CHOLESKY)
        self._solver.getPC().setFactorSolverType(PETSc.Mat.SolverType.MUMPS)

    def _estimate(self) -> float:
        """Condition number of the scaled matrix: its norm by that of its inverse, from below, by inverse iteration."""
        number = self._first + np.arange(len(self._scale))
        self._right.array[:] = 1.0 + 0.5 * np.sin(number + 1.0)  # the same whatever the ranks
        largest = 0.0
        for _ in range(ROUNDS):
            length = self._right.norm()
            if not (np.isfinite(length) and length > 0.0):  # singular; or no nodes at all
                return np.inf if largest > 0.0 or length > 0.0 or np.isnan(length) else 1.0
            self._right.scale(1.0 / length)
            self._solver.solve(self._right, self._found)
            largest = max(largest, self._found.norm())
            self._found.copy(self._right)
        return self._norm * largest

    def _collect(self, nodes: NDArray[np.int64], scaled: sparse.coo_matrix, there: NDArray[np.bool_]) -> None:
        parts = self._comm.gather((nodes[scaled.row], nodes[scaled.col], scaled.data), root=0)
        kept = self._comm.gather(there, root=0)
        if parts is None:
            return
        row, column, value = (np.concatenate(some) for some in zip(*parts))
        self._there = np.flatnonzero(np.concatenate(kept))
        size = sum(map(len, kept))
        whole = sparse.csr_matrix((value, (row, column)), shape=(size, size))
        self._pseudo = SymmetricSolver(whole[self._there][:, self._there]) if len(self._there) else None

    def solve(self, right: Array) -> Array:
        """Solution (owned nodes, k) for right-hand sides (owned nodes, k)."""
        right = right / self._scale
        if self._on_root:
            return self._solved_on_root(right) / self._scale
        result = np.empty_like(right)
        for column in range(right.shape[1]):
            self._right.array[:] = right[:, column]
            self._solver.solve(self._right, self._found)
            result[:, column] = self._found.array
        return result / self._scale

    def _solved_on_root(self, right: Array) -> Array:
        parts = self._comm.gather(right, root=0)
        answers = None
        if parts is not None:
            whole = np.concatenate(parts)
            found = np.zeros_like(whole)
            if self._pseudo is not None:
                found[self._there] = self._pseudo.solve(whole[self._there])
            answers = np.split(found, np.cumsum([len(part) for part in parts])[:-1])
        return self._comm.scatter(answers, root=0)


class SpreadProjection:
    """`bridge.projection.Projection` for particles that are spread over the ranks; everything is collective.

    Args:
        comm: the ranks.
        owned_range: global indices of the nodes that this rank owns.
        matrix: N of this rank's particles (particles, nodes).
        nodes: global indices of the columns.
        masses, inertias: of the particles (n,), kg and kg m per metre; zero for those that do not count.
        free: mask (owned nodes,) of the nodes that are sought, all by default; others are held.
    """

    def __init__(
        self,
        comm: Any,
        owned_range: tuple[int, int],
        matrix: sparse.csr_matrix,
        nodes: NDArray[np.int64],
        masses: Array,
        inertias: Array,
        free: NDArray[np.bool_] | None = None,
    ):
        used = np.unique(matrix.indices)
        self.matrix = sparse.csr_matrix(matrix[:, used])
        self.exchange = NodeExchange(comm, owned_range, np.asarray(nodes)[used])
        self.weights = np.column_stack([masses, masses, inertias])
        self._transposed = sparse.csr_matrix(self.matrix.T)
        owned = owned_range[1] - owned_range[0]
        self._free = np.ones(owned, dtype=bool) if free is None else np.asarray(free, dtype=bool)
        near = sparse.diags(self.exchange.gather(self._free.astype(float)[:, None])[:, 0])
        inner = self.matrix @ near
        self.solvers = [
            SpreadSolver(comm, self.exchange, sparse.csr_matrix(inner.T @ sparse.diags(w) @ inner), owned)
            for w in (masses, inertias)
        ]

    def extend(self, owned: Array) -> Array:
        """N nodal: (owned nodes, 3) to (particles, 3)."""
        return self.matrix @ self.exchange.gather(owned)

    def restrict(self, values: Array) -> Array:
        """N^T values: (particles, 3) to (owned nodes, 3)."""
        result = np.zeros((len(self._free), 3))
        self.exchange.scatter(self._transposed @ values, result)
        return result

    def coarse(self, values: Array, held: Array | None = None) -> Array:
        """Coefficients (owned nodes, 3) of the coarse part of particle values (particles, 3).

        Args:
            held: values (owned nodes, 3) of the nodes that are not free, which are taken off first and returned; 0 by default.
        """
        free = self._free[:, None]
        nodal = np.zeros((len(free), 3)) if held is None else np.where(free, 0.0, held)
        right = np.where(free, self.restrict(self.weights * (values - self.extend(nodal))), 0.0)
        nodal[:, :2] += self.solvers[0].solve(right[:, :2])
        nodal[:, 2:] += self.solvers[1].solve(right[:, 2:])
        return nodal

    def project(self, values: Array) -> Array:
        """P values: the coarse part, (particles, 3)."""
        return self.extend(self.coarse(values))

    def remainder(self, values: Array) -> Array:
        """Q values: the fine part, (particles, 3)."""
        return values - self.project(values)
