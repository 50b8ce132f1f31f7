"""Strains and stresses at the middle of the cells, for output and measures."""

from __future__ import annotations

from typing import Any

import numpy as np
from dolfinx import fem

from . import _compat, cells


def strains(body: Any) -> tuple[np.ndarray, np.ndarray]:
    """Strain (cells, 2, 2), eps_ij = u_j,i - e_ij phi, and curvature phi_,i (cells, 2) at cell middles (collective)."""
    body.update_ghosts()
    nodes = body.cell_nodes.shape[1]
    middle = np.full((len(body.cell_nodes), 2), 1.0 / 3.0 if nodes == 3 else 0.5)
    values = body._displacement.x.array.reshape(-1, body.components)[body.cell_nodes]
    gradient = cells.gradients(body.cell_corners, middle)
    strain = np.einsum("cni,cnj->cij", gradient, values[:, :, :2])
    if body.components == 2:
        return strain, np.zeros((len(strain), 2))
    rotation = np.einsum("cn,cn->c", cells.shape_functions(middle, nodes), values[:, :, 2])
    strain[:, 0, 1] -= rotation
    strain[:, 1, 0] += rotation
    return strain, np.einsum("cni,cn->ci", gradient, values[:, :, 2])


def stresses(body: Any) -> tuple[np.ndarray, np.ndarray]:
    """Stress (cells, 2, 2) in Pa and couple stress (cells, 2) in N/m at cell middles (collective)."""
    strain, curvature = strains(body)
    stress = np.einsum("ijkl,ckl->cij", body.material.stiffness, strain)
    return stress, curvature @ np.asarray(body.material.couple).T


def stress_fields(body: Any) -> dict[str, fem.Function]:
    """Functions, one value a cell (collective): stress components, couple stresses, volumetric and effective stress.

    Volumetric: mean of the three normal stresses, with sigma_zz = nu (sigma_xx + sigma_yy). Effective:
    sqrt(3/2 s:s) of the symmetric deviator. Pa (couple stresses N/m), tension positive. Wholly covered cells give NaN.
    """
    stress, couple = stresses(body)
    normal = stress[:, 0, 0] + stress[:, 1, 1]
    out_of_plane = body.material.poisson_ratio * normal
    named = {
        "stress_xx": stress[:, 0, 0],
        "stress_xy": stress[:, 0, 1],
        "stress_yx": stress[:, 1, 0],
        "stress_yy": stress[:, 1, 1],
        "volumetric_stress": (normal + out_of_plane) / 3.0,
        "effective_stress": np.sqrt(1.5 * _deviator_square(stress, out_of_plane)),
    }
    if body.components == 3:
        named |= {"couple_stress_x": couple[:, 0], "couple_stress_y": couple[:, 1]}
    return _functions(body, named)


def strain_fields(body: Any) -> dict[str, fem.Function]:
    """Functions, one value a cell (collective): strain components, curvatures, volumetric and effective strain.

    Volumetric: eps_xx + eps_yy. Effective: sqrt(2/3 e:e) of the symmetric deviator. Wholly covered cells give NaN.
    """
    strain, curvature = strains(body)
    named = {
        "strain_xx": strain[:, 0, 0],
        "strain_xy": strain[:, 0, 1],
        "strain_yx": strain[:, 1, 0],
        "strain_yy": strain[:, 1, 1],
        "volumetric_strain": strain[:, 0, 0] + strain[:, 1, 1],
        "effective_strain": np.sqrt(2.0 / 3.0 * _deviator_square(strain, np.zeros(len(strain)))),
    }
    if body.components == 3:
        named |= {"curvature_x": curvature[:, 0], "curvature_y": curvature[:, 1]}
    return _functions(body, named)


def _deviator_square(tensor: np.ndarray, out_of_plane: np.ndarray) -> np.ndarray:
    """e:e (cells,) of the symmetric 3D deviator of plane tensors (cells, 2, 2) with a zz component (cells,)."""
    mean = (tensor[:, 0, 0] + tensor[:, 1, 1] + out_of_plane) / 3.0
    shear = 0.5 * (tensor[:, 0, 1] + tensor[:, 1, 0])
    normal = (tensor[:, 0, 0] - mean) ** 2 + (tensor[:, 1, 1] - mean) ** 2 + (out_of_plane - mean) ** 2
    return normal + 2.0 * shear**2


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
