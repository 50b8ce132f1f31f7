"""A bar of Hex8, fixed at one end and loaded at the other: what bars of particles are compared with."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import splu

from bridge.manifold.grid import CORNERS
from continuum import bricks


def bar(p: Any, length: float, across: int, traction: Any, points: Any) -> np.ndarray:
    """Displacements (k, 3) in m of points (k, 3) of a bar along z whose nodes at z = 0 are fixed.

    The traction acts half a spacing inside the other end, where the last particles have their centres.

    Args:
        p: width, spacing (m), young_modulus (Pa) and poisson_ratio of the bar.
        length: m.
        across: elements across; they are twice as short along the bar.
        traction: (3,) in Pa on its end.
        points: m.
    """
    count = np.array([across, across, round(2 * across * length / p.width)])
    size = np.array([p.width, p.width, length]) / count
    cells = np.stack(np.meshgrid(*(np.arange(n) for n in count), indexing="ij"), axis=-1).reshape(-1, 3)
    shape = tuple(count + 1)
    nodes = np.ravel_multi_index(tuple(np.moveaxis(cells[:, None, :] + CORNERS, -1, 0)), shape)
    freedoms = (3 * nodes[:, :, None] + np.arange(3)).reshape(len(nodes), 24)
    matrix = np.tile(bricks.stiffness(size, p.young_modulus, p.poisson_ratio).ravel(), len(nodes))
    rows, columns = np.repeat(freedoms, 24, axis=1).ravel(), np.tile(freedoms, (1, 24)).ravel()
    stiffness = sparse.csr_matrix((matrix, (rows, columns)))

    def weights(x: Any) -> tuple[Any, Any]:
        cell = np.clip((x / size).astype(int), 0, count - 1)
        number = np.ravel_multi_index(tuple(np.moveaxis(cell[:, None, :] + CORNERS, -1, 0)), shape)
        return number, bricks.shape_functions(x / size - cell)

    steps = (np.arange(4 * across) + 0.5) * p.width / (4 * across)
    face = np.stack(np.meshgrid(steps, steps, [length - 0.5 * p.spacing], indexing="ij"), axis=-1).reshape(-1, 3)
    force = np.zeros((int(np.prod(shape)), 3))
    number, share = weights(face)
    for axis in range(3):
        np.add.at(force[:, axis], number, share * traction[axis] * p.width**2 / len(face))
    free = np.arange(force.size).reshape(-1, 3)[np.arange(len(force)) % shape[2] > 0].ravel()  # the last axis is the length
    moved = np.zeros(force.size)
    symmetric = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
    moved[free] = splu(stiffness[free][:, free].tocsc(), **symmetric).solve(force.ravel()[free])
    number, share = weights(points)
    return np.einsum("kn,kna->ka", share, moved.reshape(-1, 3)[number])
