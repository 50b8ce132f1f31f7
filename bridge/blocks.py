"""Sparse matrices of three components a node, for compiled loops."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sparse
from numba import njit

from particles.system import INNER


class Blocks(NamedTuple):
    """A sparse matrix of 3 x 3 blocks (CSR)."""

    start: np.ndarray  # (rows + 1,), unsigned: no look for negative indices
    column: np.ndarray  # (blocks,), unsigned
    value: np.ndarray  # (blocks, 3, 3)


def blocks(matrix: sparse.spmatrix) -> Blocks:
    """The matrix (3 n, 3 n) without its zero blocks."""
    matrix = sparse.csr_matrix(matrix, copy=True)
    matrix.eliminate_zeros()
    found = sparse.bsr_matrix(matrix, blocksize=(3, 3))
    return Blocks(found.indptr.astype(np.uint64), found.indices.astype(np.uint64), np.ascontiguousarray(found.data))


@njit(**INNER, fastmath={"contract"})
def row_times(matrix, row, values):
    """The three components of a block row of matrix times values (n, 3)."""
    x = 0.0
    y = 0.0
    z = 0.0
    for k in range(matrix.start[row], matrix.start[row + 1]):
        column = matrix.column[k]
        a, b, c = values[column, 0], values[column, 1], values[column, 2]
        x += matrix.value[k, 0, 0] * a + matrix.value[k, 0, 1] * b + matrix.value[k, 0, 2] * c
        y += matrix.value[k, 1, 0] * a + matrix.value[k, 1, 1] * b + matrix.value[k, 1, 2] * c
        z += matrix.value[k, 2, 0] * a + matrix.value[k, 2, 1] * b + matrix.value[k, 2, 2] * c
    return x, y, z
