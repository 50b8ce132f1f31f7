"""Springs of a lattice from macroscopic constants (Zhao, Khalili, Fang & Zhao 2012, eqs 10-11)."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass

from particles.laws.checks import checked


@dataclass(frozen=True)
class LatticeMaterial:
    """Elastic, perfectly brittle material of a lattice.

    Args:
        young_modulus: E in Pa.
        poisson_ratio: nu; shear springs are negative above 1/4 (plane stress: 1/3).
        density: of the body, kg/m3 (in the plane per metre of thickness).
        normal_limit: elongation of a bond at which it breaks, m; infinite by default.
        shear_limit: shear deformation at which it breaks, m; `normal_limit` by default.
    """

    young_modulus: float
    poisson_ratio: float
    density: float
    normal_limit: float = math.inf
    shear_limit: float | None = None

    def __post_init__(self) -> None:
        checked(self, ("young_modulus", "density"), positive=("young_modulus", "density"))
        if not -1.0 < self.poisson_ratio < 0.5:
            raise ValueError(f"poisson_ratio={self.poisson_ratio} must lie between -1 and 0.5")
        for name, value in (("normal_limit", self.normal_limit), ("shear_limit", self.shear_limit)):
            if value is not None and not value > 0.0:
                raise ValueError(f"{name}={value} must be positive (m)")

    @property
    def limits(self) -> tuple[float, float]:
        """Elongation and shear deformation at which a bond breaks, m."""
        return self.normal_limit, self.normal_limit if self.shear_limit is None else self.shear_limit

    @property
    def wave_speed(self) -> float:
        """Speed of compression waves in 3D and plane strain, m/s."""
        nu = self.poisson_ratio
        return math.sqrt(self.young_modulus * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu)) / self.density)

    def springs(self, spacing: float, axes: int, plane: str = "strain") -> tuple[float, float]:
        """Normal and shear stiffness in N/m, with alpha = sum of l^2 over the volume: 15/d cubic, 2 sqrt(3) hexagonal.

        Raises:
            ValueError: the lattice cannot carry the Poisson's ratio.
        """
        e, nu = self.young_modulus, self.poisson_ratio
        if axes == 3:
            normal = e * spacing / (5.0 * (1.0 - 2.0 * nu))
            shear = (1.0 - 4.0 * nu) / (1.0 + nu) * normal
            if shear < 0.0:
                warnings.warn(
                    f"poisson_ratio={nu:g} above 0.25 makes shear springs negative ({shear / normal:.3f} of the normal ones); "
                    "the cubic lattice stays stable, since they act on averaged strains", stacklevel=3,
                )  # fmt: skip
            return normal, shear
        alpha = 2.0 * math.sqrt(3.0)
        if plane == "strain":
            most, normal = 0.25, 2.0 * e / (alpha * (1.0 + nu) * (1.0 - 2.0 * nu))
            shear = (1.0 - 4.0 * nu) * normal
        else:
            most, normal = 1.0 / 3.0, 2.0 * e / (alpha * (1.0 - nu))
            shear = (1.0 - 3.0 * nu) / (1.0 + nu) * normal
        if shear < 0.0:
            raise ValueError(
                f"poisson_ratio={nu:g} must be at most {most:.3g} in the hexagonal lattice (plane {plane}), whose shear springs "
                "would be negative; the cubic lattice, one layer of it for plane strain, carries it"
            )
        return normal, shear
