"""A sparse symmetric mass matrix for compiled loops, factored once: products and solutions for flat nodal components."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sparse
import scipy.sparse.linalg as sparse_linalg
from numba import njit
from numpy.typing import NDArray

from particles.system import INNER, OUTER


class Rows(NamedTuple):
    """A sparse matrix by rows (CSR)."""

    start: np.ndarray
    column: np.ndarray
    value: np.ndarray


class Mass(NamedTuple):
    """The matrix among the free components, and its factors: row i of L U is row `order[i]` of the matrix."""

    free: np.ndarray  # places of the free components among all
    matrix: Rows
    lower: Rows  # below the diagonal of ones
    upper: Rows  # above the diagonal
    pivot: np.ndarray  # diagonal of U
    row_order: np.ndarray
    column_order: np.ndarray
    room: np.ndarray


def factored(matrix: sparse.spmatrix, free: NDArray[np.int64]) -> Mass:
    """Factor the rows and columns `free` of a matrix; the components left out do not move.

    Elimination in place, without pivoting beside the diagonal (the matrix is symmetric and positive).
    """
    inner = sparse.csc_matrix(sparse.csr_matrix(matrix)[free][:, free])
    if not len(free):
        none = rows_of(inner)
        return Mass(free, none, none, none, np.ones(0), free, free, np.ones(0))
    options = {"SymmetricMode": True}
    lu = sparse_linalg.splu(inner, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    lower, upper = sparse.tril(lu.L, -1), sparse.triu(lu.U, 1)
    return Mass(
        free, rows_of(inner), rows_of(lower), rows_of(upper), lu.U.diagonal(), lu.perm_r.astype(np.int64),
        lu.perm_c.astype(np.int64), np.zeros(len(free)),
    )  # fmt: skip


def rows_of(matrix: sparse.spmatrix) -> Rows:
    """The matrix by rows."""
    matrix = sparse.csr_matrix(matrix)
    return Rows(matrix.indptr.astype(np.int64), matrix.indices.astype(np.int64), matrix.data.astype(np.float64))


@njit(**INNER)
def minus_row(rows, i, values, total):
    """`total` less the product of row i with values (flat)."""
    for k in range(rows.start[i], rows.start[i + 1]):
        total -= rows.value[k] * values[rows.column[k]]
    return total


@njit(**OUTER)
def solve(mass, values):
    """values = M^-1 values in place (flat); zero where a component is not free."""
    room = mass.room
    for i in range(room.size):
        room[mass.row_order[i]] = values[mass.free[i]]
    for i in range(values.size):
        values[i] = 0.0
    for i in range(room.size):
        room[i] = minus_row(mass.lower, i, room, room[i])
    for i in range(room.size - 1, -1, -1):
        room[i] = minus_row(mass.upper, i, room, room[i]) / mass.pivot[i]
    for i in range(room.size):
        values[mass.free[i]] = room[mass.column_order[i]]


@njit(**OUTER)
def product(mass, one, other):
    """one . M other (flat)."""
    total = 0.0
    for i in range(mass.free.size):
        for k in range(mass.matrix.start[i], mass.matrix.start[i + 1]):
            total += one[mass.free[i]] * mass.matrix.value[k] * other[mass.free[mass.matrix.column[k]]]
    return total
