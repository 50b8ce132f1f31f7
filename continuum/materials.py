"""Linear elastic materials in plane strain and in space: Cauchy and Cosserat (micropolar).

All give the same four things: whether the material `turns` (has a micro-rotation phi), `stiffness_in(axes)` in Pa with
sigma_ij = D_ijkl eps_kl and eps_kl = u_l,k - e_klm phi_m, `couple_in(axes)` in N with m_ij = B_ijkl phi_l,k, and `density` in
kg/m3. First index = direction of the normal, second = direction of the force or the couple; tension positive. In the plane
phi has one component, about z, and B the shape (2, 1, 2, 1).
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


def _isotropic(trace: float, straight: float, crossed: float, axes: int) -> np.ndarray:
    """a d_ij d_kl + b d_ik d_jl + c d_il d_jk."""
    one = np.eye(axes)
    return (
        trace * np.einsum("ij,kl->ijkl", one, one)
        + straight * np.einsum("ik,jl->ijkl", one, one)
        + crossed * np.einsum("il,jk->ijkl", one, one)
    )


class _Isotropic:
    """Moduli that both isotropic materials share."""

    young_modulus: float
    poisson_ratio: float
    cosserat_shear: float

    @classmethod
    def from_lame(cls, lame_modulus: float, shear_modulus: float, **others: Any):
        """The material with lambda and G in Pa instead of E and nu; `others` are its other arguments, by name.

        E = G (3 lambda + 2 G) / (lambda + G), nu = lambda / 2(lambda + G).
        """
        _positive("shear_modulus", shear_modulus, "Pa")
        if not (np.isfinite(lame_modulus) and 3.0 * lame_modulus + 2.0 * shear_modulus > 0.0):
            raise ValueError(f"lame_modulus={lame_modulus} must be greater than -2/3 shear_modulus (Pa)")
        total = lame_modulus + shear_modulus
        elastic = {
            "young_modulus": shear_modulus * (3.0 * lame_modulus + 2.0 * shear_modulus) / total,
            "poisson_ratio": 0.5 * lame_modulus / total,
        }
        return cls(**elastic, **others)

    @property
    def shear_modulus(self) -> float:
        """G = E / 2(1 + nu) in Pa."""
        return 0.5 * self.young_modulus / (1.0 + self.poisson_ratio)

    @property
    def lame_modulus(self) -> float:
        """lambda = 2 G nu / (1 - 2 nu) in Pa."""
        return 2.0 * self.shear_modulus * self.poisson_ratio / (1.0 - 2.0 * self.poisson_ratio)

    @property
    def stiffness(self) -> np.ndarray:
        """D (2, 2, 2, 2) in Pa in plane strain."""
        return self.stiffness_in(2)

    def stiffness_in(self, axes: int) -> np.ndarray:
        """D_ijkl = lambda d_ij d_kl + (G + Gc) d_ik d_jl + (G - Gc) d_il d_jk in Pa, (axes,) * 4."""
        shear, cosserat = self.shear_modulus, self.cosserat_shear
        return _isotropic(self.lame_modulus, shear + cosserat, shear - cosserat, axes)


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
    cosserat_shear = 0.0
    turns = False

    def __post_init__(self):
        _check_elastic(self.young_modulus, self.poisson_ratio, self.density)

    def couple_in(self, axes: int) -> np.ndarray:
        """No couple stress."""
        turns = 2 * axes - 3
        return np.zeros((axes, turns, axes, turns))


@dataclass(frozen=True)
class Cosserat(_Isotropic):
    """Isotropic Cosserat (micropolar) elasticity (Eringen 1966; in the plane de Borst 1991; Li & Wan 2010, eqs 19-20).

    sigma_ij = lambda eps_kk d_ij + (G + Gc) eps_ij + (G - Gc) eps_ji with eps_ij = u_j,i - e_ijk phi_k, and
    m_ij = alpha phi_k,k d_ij + beta phi_i,j + gamma phi_j,i, of which plane strain has m_iz = gamma phi_,i.

    Args:
        young_modulus: E in Pa.
        poisson_ratio: nu.
        cosserat_shear: Gc in Pa, the stiffness against rotation relative to the material; at most G is advisable.
        characteristic_length: l_c in m.
        density: bulk density in kg/m3.
        couple_factor: gamma / (G l_c^2): 1 as printed by Li & Wan (2010), 2 in de Borst (1991).
        couple_modulus: gamma in N directly, instead of the length and the factor.
        couple_alpha: alpha in N; in space only. 3 alpha + beta + gamma must not be negative.
        couple_beta: beta in N, from -gamma to gamma; in space only.
    """

    young_modulus: float
    poisson_ratio: float
    cosserat_shear: float
    characteristic_length: float
    density: float
    couple_factor: float = 1.0
    couple_modulus: float | None = None
    couple_alpha: float = 0.0
    couple_beta: float = 0.0
    turns = True

    def __post_init__(self):
        _check_elastic(self.young_modulus, self.poisson_ratio, self.density)
        _positive("cosserat_shear", self.cosserat_shear, "Pa")
        _positive("characteristic_length", self.characteristic_length, "m", zero=True)
        _positive("couple_factor", self.couple_factor, "-", zero=True)
        if self.couple_modulus is None:
            value = self.couple_factor * self.shear_modulus * self.characteristic_length**2
            object.__setattr__(self, "couple_modulus", value)
        gamma = float(self.couple_modulus or 0.0)
        _positive("couple_modulus", gamma, "N", zero=True)
        slack = 1e-12 * gamma  # rounding
        if not abs(self.couple_beta) <= gamma + slack:
            raise ValueError(f"couple_beta={self.couple_beta} must lie between -couple_modulus and couple_modulus, {gamma:g} N")
        least = -(self.couple_beta + gamma) / 3.0
        if not (np.isfinite(self.couple_alpha) and self.couple_alpha >= least - slack):
            raise ValueError(
                f"couple_alpha={self.couple_alpha} must be at least -(couple_modulus + couple_beta) / 3, {least:g} N"
            )

    @property
    def couple(self) -> np.ndarray:
        """B (2, 2) in N in plane strain, m_iz = B_ij phi_,j."""
        return float(self.couple_modulus or 0.0) * np.eye(2)

    def couple_in(self, axes: int) -> np.ndarray:
        """B_ijkl = alpha d_ij d_kl + gamma d_ik d_jl + beta d_il d_jk in N; in the plane gamma d_ik, (2, 1, 2, 1)."""
        if axes == 2:
            return self.couple.reshape(2, 1, 2, 1)
        return _isotropic(self.couple_alpha, float(self.couple_modulus or 0.0), self.couple_beta, 3)

    @staticmethod
    def from_moduli(stiffness: Any, couple: Any, density: float) -> CosseratModuli:
        """Anisotropic Cosserat material from moduli measured on a packing; see `CosseratModuli`."""
        return CosseratModuli(np.array(stiffness, dtype=float), np.array(couple, dtype=float), float(density))


@dataclass(frozen=True, eq=False)
class CosseratModuli:
    """Cosserat material of any symmetry, such as `particles.measures.moduli` gives; for plane meshes or for bodies in space.

    sigma_ij = D_ijkl eps_kl with eps_kl = u_l,k - e_klm phi_m; m_ij = B_ijkl phi_l,k, in the plane m_iz = B_ij phi_,j.

    Args:
        stiffness: D (2, 2, 2, 2), in space (3, 3, 3, 3), in Pa, with D_ijkl = D_klij and no negative energy.
        couple: B (2, 2), in space (3, 3, 3, 3), in N, symmetric, no negative energy.
        density: bulk density in kg/m3.
    """

    stiffness: np.ndarray
    couple: np.ndarray
    density: float
    turns = True

    def __post_init__(self):
        _positive("density", self.density, "kg/m3")
        axes = 3 if self.stiffness.shape == (3,) * 4 else 2
        for name, value, shape, size in (
            ("stiffness", self.stiffness, (axes,) * 4, axes**2),
            ("couple", self.couple, (2, 2) if axes == 2 else (3,) * 4, (2 * axes - 3) * axes),
        ):
            if value.shape != shape or not np.all(np.isfinite(value)):
                raise ValueError(f"{name} of shape {value.shape} must be finite with the shape {shape}")
            matrix, scale = value.reshape(size, size), np.abs(value).max()
            if np.abs(matrix - matrix.T).max() > 1e-9 * scale:
                raise ValueError(f"{name} must be symmetric ({'D_ijkl = D_klij' if name == 'stiffness' else 'B_ijkl = B_klij'})")
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

    def stiffness_in(self, axes: int) -> np.ndarray:
        """D in Pa; that of the other number of axes is not known."""
        if self.stiffness.shape != (axes,) * 4:
            raise ValueError(f"stiffness of shape {self.stiffness.shape} must have the shape {(axes,) * 4} on this mesh")
        return self.stiffness

    def couple_in(self, axes: int) -> np.ndarray:
        """B in N, (2, 1, 2, 1) or (3, 3, 3, 3)."""
        turns = 2 * axes - 3
        return self.couple.reshape(axes, turns, axes, turns)


Material = Cauchy | Cosserat | CosseratModuli
