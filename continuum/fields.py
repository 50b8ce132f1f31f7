"""Strains and stresses at the middle of the cells, for output and measures."""

from __future__ import annotations

from typing import Any

import numpy as np
from dolfinx import fem

from . import _compat, cells

PERMUTATION = np.linalg.det(np.eye(3)[np.indices((3, 3, 3)).transpose(1, 2, 3, 0)]).round()  # e_ijk


def strains(body: Any) -> tuple[np.ndarray, np.ndarray]:
    """Strain (cells, axes, axes), eps_ij = u_j,i - e_ijk phi_k, and curvature phi_j,i (cells, axes, rotations) at cell middles.

    In the plane phi has its component about z only. Collective.
    """
    body.update_ghosts()
    nodes, axes = body.cell_nodes.shape[1], body.axes
    middle = np.tile(cells.middle(nodes, axes), (len(body.cell_nodes), 1))
    values = body._displacement.x.array.reshape(-1, body.components)[body.cell_nodes]
    gradient = np.einsum("cni,cnj->cij", cells.gradients(body.cell_corners, middle), values)
    strain, curvature = gradient[:, :, :axes], gradient[:, :, axes:]
    if body.turns:
        rotation = np.einsum("cn,cnk->ck", cells.shape_functions(middle, nodes), values[:, :, axes:])
        strain = strain - np.einsum("ijk,ck->cij", PERMUTATION if axes == 3 else PERMUTATION[:2, :2, 2:], rotation)
    return strain, curvature


def stresses(body: Any) -> tuple[np.ndarray, np.ndarray]:
    """Stress (cells, axes, axes) in Pa and couple stress (cells, axes, rotations) in N/m at cell middles (collective)."""
    strain, curvature = strains(body)
    stress = np.einsum("ijkl,ckl->cij", body.moduli, strain)
    return stress, np.einsum("ijkl,ckl->cij", body.couple_moduli, curvature) if body.turns else curvature


def stress_fields(body: Any) -> dict[str, fem.Function]:
    """Functions, one value a cell (collective): stress components, couple stresses, volumetric and effective stress.

    Volumetric: mean of the three normal stresses, in plane strain with sigma_zz = nu (sigma_xx + sigma_yy). Effective:
    sqrt(3/2 s:s) of the symmetric deviator. Pa (couple stresses N/m), tension positive. Wholly covered cells give NaN.
    """
    stress, couple = stresses(body)
    whole = stress
    if body.axes == 2:
        whole = _in_space(stress, body.material.poisson_ratio * (stress[:, 0, 0] + stress[:, 1, 1]))
    named = _components("stress", stress) | _components("couple_stress", couple) | {
        "volumetric_stress": _trace(whole) / 3.0,
        "effective_stress": np.sqrt(1.5 * _deviator_square(whole)),
    }
    return _functions(body, named)


def strain_fields(body: Any) -> dict[str, fem.Function]:
    """Functions, one value a cell (collective): strain components, curvatures, volumetric and effective strain.

    Volumetric: eps_xx + eps_yy (+ eps_zz). Effective: sqrt(2/3 e:e) of the symmetric deviator. Wholly covered cells give NaN.
    """
    strain, curvature = strains(body)
    whole = strain if body.axes == 3 else _in_space(strain, np.zeros(len(strain)))
    named = _components("strain", strain) | _components("curvature", curvature) | {
        "volumetric_strain": _trace(whole),
        "effective_strain": np.sqrt(2.0 / 3.0 * _deviator_square(whole)),
    }
    return _functions(body, named)


def _components(name: str, tensor: np.ndarray) -> dict[str, np.ndarray]:
    """The components of tensors (cells, axes, axes) by name; with one column (cells, axes, 1) a letter less."""
    rows, columns = "xyz"[: tensor.shape[1]], [""] if tensor.shape[2] == 1 else "xyz"[: tensor.shape[2]]
    return {f"{name}_{a}{b}": tensor[:, i, j] for i, a in enumerate(rows) for j, b in enumerate(columns)}


def _in_space(plane: np.ndarray, out_of_plane: np.ndarray) -> np.ndarray:
    """Tensors (cells, 3, 3) of plane ones (cells, 2, 2) and a zz component (cells,)."""
    whole = np.zeros((len(plane), 3, 3))
    whole[:, :2, :2], whole[:, 2, 2] = plane, out_of_plane
    return whole


def _trace(tensor: np.ndarray) -> np.ndarray:
    return tensor[:, 0, 0] + tensor[:, 1, 1] + tensor[:, 2, 2]


def _deviator_square(tensor: np.ndarray) -> np.ndarray:
    """e:e (cells,) of the symmetric deviator of tensors (cells, 3, 3)."""
    mean = _trace(tensor) / 3.0
    normal = (tensor[:, 0, 0] - mean) ** 2 + (tensor[:, 1, 1] - mean) ** 2 + (tensor[:, 2, 2] - mean) ** 2
    shear = [(0.5 * (tensor[:, i, j] + tensor[:, j, i])) ** 2 for i, j in ((0, 1), (0, 2), (1, 2))]
    return normal + 2.0 * (shear[0] + shear[1] + shear[2])


def _functions(body: Any, named: dict[str, np.ndarray]) -> dict[str, fem.Function]:
    space = _compat.cell_space(body.mesh)
    result = {}
    for name, values in named.items():
        function = fem.Function(space)
        function.name = name
        function.x.array[: len(values)] = np.where(body.cell_fractions > 0.0, values, np.nan)
        function.x.scatter_forward()
        result[name] = function
    return result
