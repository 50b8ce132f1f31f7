"""Element tests on a periodic cell of discs or spheres: biaxial and triaxial compression, simple shear.

A dense random packing is compressed isotropically to a confining stress, without friction (densest) or with it (looser),
and then sheared slowly with friction:

    biaxial     discs; compressed along y at a constant rate, the stress along x held
    triaxial    spheres; compressed along z at a constant rate, the stresses along x and y held
    shear       discs; simple shear along x at a constant rate, the stress along y held, no strain along x

Stiffness and rate are given without units, for results depend on these alone: the stiffness level kappa = k_N / p in the
plane, k_N / (p d) in space (Combe & Roux 2003), and the inertial number I = rate d sqrt(density / p) (GDR MiDi 2004;
da Cruz et al. 2005), below about 1e-3 quasi-static. Dampers sit in the
contacts, where they do not resist the homogeneous motion of the cell. Strains are logarithmic; axial strain and stresses
are positive in compression, volumetric strain in dilation. SI units, in the plane per metre of thickness.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from studies.options import NOT_NEGATIVE, POSITIVE, SHARE, check, parameter


@dataclass(frozen=True)
class Parameters:
    """What the element tests have in common."""

    particles: int = parameter(2000, "Number of particles, about.", "", POSITIVE, limits=(50, 1_000_000))
    strain: float = parameter(0.12, "Axial strain at the end (logarithmic).", "-", POSITIVE, limits=(1e-4, 1.0))
    pressure: float = parameter(1e5, "Confining stress.", "Pa", POSITIVE, limits=(1e-3, 1e12))
    inertial_number: float = parameter(
        1e-4, "Inertial number of the rate; below 1e-3 quasi-static.", "-", POSITIVE, limits=(1e-7, 0.1)
    )
    stiffness_level: float = parameter(
        1000.0, "Normal stiffness over pressure, kappa; 1/kappa is about the overlap over the diameter.", "-", POSITIVE,
        limits=(10, 1e7),
    )  # fmt: skip
    stiffness_ratio: float = parameter(
        0.5, "Sliding (and rolling) over normal stiffness.", "-", POSITIVE, limits=(1e-3, 10)
    )
    friction: float = parameter(0.5, "Friction coefficient of sliding.", "-", NOT_NEGATIVE, limits=(0, 10))
    rolling_friction: float = parameter(
        0.0, "Friction coefficient of rolling, on the rolling radius l_i l_j / (l_i + l_j).", "-", NOT_NEGATIVE, limits=(0, 10)
    )
    preparation_friction: float = parameter(
        0.0, "Friction in the isotropic compression: 0 densest; above 0 the packing is first shaken loose.", "-", NOT_NEGATIVE,
        limits=(0, 10),
    )  # fmt: skip
    damping: float = parameter(
        0.2, "Dampers of the contacts (normal and sliding), as a share of critical damping.", "-", NOT_NEGATIVE, limits=(0, 1)
    )
    radius: float = parameter(0.5e-3, "Largest radius.", "m", POSITIVE, limits=(1e-9, 1e3))
    size_ratio: float = parameter(2.0, "Largest over smallest radius.", "-", POSITIVE, limits=(1, 10))
    density: float = parameter(2600.0, "Density of the particles.", "kg/m3", POSITIVE, limits=(1e-3, 1e6))
    seed: int = parameter(1, "Seed of the random packing.", "", NOT_NEGATIVE, limits=(0, 2**32 - 1))
    step_ratio: float = parameter(0.8, "Time step as a share of the critical step of the packing.", "-", SHARE)

    study: ClassVar[str] = ""
    title: ClassVar[str] = ""
    axes: ClassVar[int] = 2

    def __post_init__(self) -> None:
        check(self)

    @property
    def diameter(self) -> float:
        """Mean diameter of a uniform distribution of radii, m."""
        return self.radius * (1.0 + 1.0 / self.size_ratio)

    @property
    def normal_stiffness(self) -> float:
        """k_N of a contact, N/m."""
        return self.stiffness_level * self.pressure * (1.0 if self.axes == 2 else self.diameter)

    @property
    def mass(self) -> float:
        """Mass of a particle of the mean diameter, kg (in the plane per metre)."""
        r = 0.5 * self.diameter
        return self.density * (math.pi * r**2 if self.axes == 2 else 4.0 / 3.0 * math.pi * r**3)

    @property
    def rate(self) -> float:
        """Rate of the test, 1/s."""
        return self.inertial_number * math.sqrt(self.pressure / self.density) / self.diameter


@dataclass(frozen=True)
class Biaxial(Parameters):
    """Biaxial compression of discs."""

    study: ClassVar[str] = "biaxial"
    title: ClassVar[str] = "Biaxial compression of discs in a periodic cell"


@dataclass(frozen=True)
class Triaxial(Parameters):
    """Triaxial compression of spheres."""

    inertial_number: float = parameter(
        5e-4, "Inertial number of the rate; below 1e-3 quasi-static.", "-", POSITIVE, limits=(1e-7, 0.1)
    )
    size_ratio: float = parameter(1.5, "Largest over smallest radius.", "-", POSITIVE, limits=(1, 10))
    study: ClassVar[str] = "triaxial"
    title: ClassVar[str] = "Triaxial compression of spheres in a periodic cell"
    axes: ClassVar[int] = 3


@dataclass(frozen=True)
class Shear(Parameters):
    """Simple shear of discs."""

    inertial_number: float = parameter(
        2e-4, "Inertial number of the rate; below 1e-3 quasi-static.", "-", POSITIVE, limits=(1e-7, 0.1)
    )
    strain: float = parameter(0.3, "Shear strain at the end.", "-", POSITIVE, limits=(1e-4, 10.0))
    study: ClassVar[str] = "shear"
    title: ClassVar[str] = "Simple shear of discs in a periodic cell at constant normal stress"
