"""Linear elastic materials: Cauchy in plane strain and in space, Cosserat (micropolar) in plane strain.

All give the same four things: whether the material `turns` (has a micro-rotation), `stiffness` (2, 2, 2, 2) in Pa, `couple`
(2, 2) in N and `density` in kg/m3; Cauchy has its stiffness in space, too. First stress index = direction of the normal, second = direction of the force; tension positive.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np


def _positive(name: str, value: float, unit: str, zero: bool = False) -> None:
    number = isinstance(value, (int, float, np.number))
    if not (number and np.isfinite(value) and (value > 0 or (zero and value == 0))):
        raise ValueError(f"{name}={value} must be {'zero or ' if zero else ''}positive ({unit})")


def _check_elastic(young_modulus: float, poisson_ratio: float, density: float) -> None:
    _positive("young_modulus", young_modulus, "Pa")
    _positive("density", density, "kg/m3")
    if not -1.0 < poisson_ratio < 0.5:
        raise ValueError(f"poisson_ratio={poisson_ratio} must lie in (-1, 0.5)")


def _isotropic(lame: float, shear: float, cosserat_shear: float, axes: int = 2) -> np.ndarray:
    """D_ijkl = lambda d_ij d_kl + (G + Gc) d_ik d_jl + (G - Gc) d_il d_jk."""
    one = np.eye(axes)
    return (
        lame * np.einsum("ij,kl->ijkl", one, one)
        + (shear + cosserat_shear) * np.einsum("ik,jl->ijkl", one, one)
        + (shear - cosserat_shear) * np.einsum("il,jk->ijkl", one, one)
    )


class _Isotropic:
    """Moduli that both isotropic materials share."""

    young_modulus: float
    poisson_ratio: float

    @property
    def shear_modulus(self) -> float:
        """G = E / 2(1 + nu) in Pa."""
        return 0.5 * self.young_modulus / (1.0 + self.poisson_ratio)

    @property
    def lame_modulus(self) -> float:
        """lambda = 2 G nu / (1 - 2 nu) in Pa."""
        return 2.0 * self.shear_modulus * self.poisson_ratio / (1.0 - 2.0 * self.poisson_ratio)


@dataclass(frozen=True)
class Cauchy(_Isotropic):
    """Classical isotropic elasticity, in plane strain on a plane mesh, in space on one of volume elements.

    Args:
        young_modulus: E in Pa.
        poisson_ratio: nu.
        density: bulk density in kg/m3.
    """

    young_modulus: float
    poisson_ratio: float
    density: float
    turns = False

    def __post_init__(self):
        _check_elastic(self.young_modulus, self.poisson_ratio, self.density)

    @property
    def stiffness(self) -> np.ndarray:
        """D (2, 2, 2, 2) in Pa with sigma_ij = D_ijkl u_l,k; blind to rotation."""
        return self.stiffness_in(2)

    def stiffness_in(self, axes: int) -> np.ndarray:
        """D in Pa in two or three dimensions, (axes,) * 4."""
        return _isotropic(self.lame_modulus, self.shear_modulus, 0.0, axes)

    @property
    def couple(self) -> np.ndarray:
        """Zero (2, 2): no couple stress."""
        return np.zeros((2, 2))


@dataclass(frozen=True)
class Cosserat(_Isotropic):
    """Isotropic Cosserat (micropolar) elasticity in plane strain (de Borst 1991; Li & Wan 2010, eqs 19-20).

    sigma = D eps with eps_ij = u_j,i - e_ij phi, and m_i = B phi_,i.

    Args:
        young_modulus: E in Pa.
        poisson_ratio: nu.
        cosserat_shear: Gc in Pa, the stiffness against rotation relative to the material; at most G is advisable.
        characteristic_length: l_c in m.
        density: bulk density in kg/m3.
        couple_factor: beta in B = beta G l_c^2: 1 as printed by Li & Wan (2010), 2 in de Borst (1991).
        couple_modulus: B in N directly, instead of the length and the factor.
    """

    young_modulus: float
    poisson_ratio: float
    cosserat_shear: float
    characteristic_length: float
    density: float
    couple_factor: float = 1.0
    couple_modulus: float | None = None
    turns = True

    def __post_init__(self):
        _check_elastic(self.young_modulus, self.poisson_ratio, self.density)
        _positive("cosserat_shear", self.cosserat_shear, "Pa")
        _positive("characteristic_length", self.characteristic_length, "m", zero=True)
        _positive("couple_factor", self.couple_factor, "-", zero=True)
        if self.couple_modulus is None:
            value = self.couple_factor * self.shear_modulus * self.characteristic_length**2
            object.__setattr__(self, "couple_modulus", value)
        _positive("couple_modulus", float(self.couple_modulus or 0.0), "N", zero=True)

    @property
    def stiffness(self) -> np.ndarray:
        """D (2, 2, 2, 2) in Pa."""
        return _isotropic(self.lame_modulus, self.shear_modulus, self.cosserat_shear)

    @property
    def couple(self) -> np.ndarray:
        """B (2, 2) in N."""
        return float(self.couple_modulus or 0.0) * np.eye(2)

    @staticmethod
    def from_moduli(stiffness: Any, couple: Any, density: float) -> CosseratModuli:
        """Anisotropic Cosserat material from moduli measured on a packing; see `CosseratModuli`."""
        return CosseratModuli(np.array(stiffness, dtype=float), np.array(couple, dtype=float), float(density))


@dataclass(frozen=True, eq=False)
class CosseratModuli:
    """Cosserat material of any symmetry: sigma_ij = D_ijkl eps_kl, eps_kl = u_l,k - e_kl phi, m_i = B_ij phi_,j.

    Args:
        stiffness: D (2, 2, 2, 2) in Pa, with D_ijkl = D_klij and no negative energy.
        couple: B (2, 2) in N, symmetric, no negative energy.
        density: bulk density in kg/m3.
    """

    stiffness: np.ndarray
    couple: np.ndarray
    density: float
    turns = True

    def __post_init__(self):
        _positive("density", self.density, "kg/m3")
        for name, value, shape, size in (
            ("stiffness", self.stiffness, (2, 2, 2, 2), 4),
            ("couple", self.couple, (2, 2), 2),
        ):
            if value.shape != shape or not np.all(np.isfinite(value)):
                raise ValueError(f"{name} of shape {value.shape} must be finite with the shape {shape}")
            matrix, scale = value.reshape(size, size), np.abs(value).max()
            if np.abs(matrix - matrix.T).max() > 1e-9 * scale:
                raise ValueError(f"{name} must be symmetric ({'D_ijkl = D_klij' if size == 4 else 'B_ij = B_ji'})")
            if np.linalg.eigvalsh(matrix).min() < -1e-9 * scale:
                raise ValueError(f"{name} must not have a negative eigenvalue (negative strain energy)")
        if not np.abs(self.stiffness).max() > 0:
            raise ValueError("stiffness must not vanish")

    @property
    def poisson_ratio(self) -> float:
        """Plane-strain ratio sigma_zz / (sigma_xx + sigma_yy) of the isotropic material with the same mean moduli."""
        d = self.stiffness
        cross = d[0, 0, 1, 1] + d[1, 1, 0, 0]
        return float(cross / (cross + d[0, 0, 0, 0] + d[1, 1, 1, 1]))


Material = Cauchy | Cosserat | CosseratModuli
