"""Critical time step 2 / omega_max of the explicit motion, micro-rotation included."""

from __future__ import annotations

from typing import Any

import numpy as np
import ufl
from dolfinx import fem

from . import _compat

LANCZOS_STEPS, LANCZOS_TOLERANCE = 400, 1e-8


def critical_step(body: Any, bound: str = "element", mass: np.ndarray | None = None) -> float:
    """Largest stable step in s (collective).

    Args:
        body: the Body.
        bound: "element": rigorous, omega_max <= max over elements (Belytschko, Yen & Mullen 1979), supports ignored;
            "power": largest eigenvalue of M^-1 K of the assembled body with its supports, by the Lanczos iteration.
        mass: lumped mass (owned nodes, components) in place of the body's own, with "power".

    Elements and nodes that an excluded region covers wholly are left out.
    """
    if bound == "element":
        square = _element_bound(body)
    elif bound == "power":
        square = _largest_eigenvalue(body, body.mass if mass is None else mass)
    else:
        raise ValueError(f'bound="{bound}" must be "element" or "power"')
    return float(2.0 / np.sqrt(square)) if square > 0 else np.inf


def _element_bound(body: Any) -> float:
    """Largest omega^2 of a single unsupported element."""
    stiffness, mass = element_matrices(body)
    largest = 0.0
    if len(mass):
        keys = np.concatenate((stiffness.reshape(len(mass), -1), mass), axis=1)
        scale = np.abs(keys).max(axis=0)
        keys = np.round(keys / np.where(scale > 0, scale, 1.0), 10) + 0.0
        _, first = np.unique(keys, axis=0, return_index=True)
        root = 1.0 / np.sqrt(mass[first])
        scaled = stiffness[first] * root[:, :, None] * root[:, None, :]
        largest = float(np.linalg.eigvalsh(scaled)[:, -1].max())
    return float(body._reduce_max(np.array([largest]))[0])


def element_matrices(body: Any) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness (cells, n, n) and lumped mass (cells, n) of the owned cells that are not wholly covered.

    By dolfinx, from the same forms on a space without shared nodes, whose matrices are block diagonal.
    """
    space = _compat.broken_space(body.mesh, body.components)
    w, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    matrix = _compat.assemble_matrix(_compat.form(body._work(w, v)))
    mass = fem.Function(space)
    _compat.assemble_into(mass, _compat.form(body._mass(v)))
    kept = np.flatnonzero(body.cell_fractions > 0.0)
    nodes = _compat.cell_nodes(space)[kept]
    size = body.components * body.cell_nodes.shape[1]
    dofs = (body.components * nodes[:, :, None] + np.arange(body.components)).reshape(len(kept), size)
    start = matrix.getOwnershipRange()[0]
    blocks = np.zeros((len(kept), size, size))
    for block, rows in zip(blocks, dofs.astype(np.int32)):
        block[:] = matrix.getValues(rows + start, rows + start)
    return blocks, mass.x.array[dofs]


def _largest_eigenvalue(body: Any, mass: np.ndarray) -> float:
    """Largest eigenvalue of M^-1/2 K M^-1/2 over the free components with mass, by Lanczos; from above by its residual."""
    free = (mass > 0) & ~body.fixed
    with np.errstate(divide="ignore"):
        root = np.where(free, 1.0 / np.sqrt(mass), 0.0)
    if body._total(int(np.count_nonzero(free))) == 0:
        return 0.0
    current = np.where(free, np.random.default_rng(1 + body.comm.rank).standard_normal(free.shape), 0.0)
    current /= np.sqrt(body._total(float(np.vdot(current, current))))
    previous, beta = np.zeros_like(current), 0.0
    diagonal: list[float] = []
    off: list[float] = []
    value = 0.0
    for _ in range(LANCZOS_STEPS):
        image = root * body.internal_force(root * current) - beta * previous
        alpha = float(body._total(float(np.vdot(image, current))))
        image -= alpha * current
        beta = float(np.sqrt(body._total(float(np.vdot(image, image)))))
        diagonal.append(alpha)
        ritz, vectors = np.linalg.eigh(np.diag(diagonal) + np.diag(off, 1) + np.diag(off, -1))
        residual = beta * abs(float(vectors[-1, -1]))
        value = float(ritz[-1]) + residual
        if residual <= LANCZOS_TOLERANCE * value or beta <= 1e-14 * value:
            break
        off.append(beta)
        previous, current = current, image / beta
    return value
