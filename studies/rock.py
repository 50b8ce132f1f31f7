"""Bonded rock in the plane: unconfined compression of a rectangle and the Brazilian disc (Rojek & Onate 2007, section 6).

Discs in a random dense packing are bonded where they (nearly) touch, as they lie, without force. Two rigid plates press on
top and bottom, each at the same constant speed. Stresses and strains along the load are positive in compression. SI units,
per metre of thickness.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from studies.options import NOT_NEGATIVE, POSITIVE, SHARE, check, parameter


@dataclass(frozen=True)
class Parameters:
    """What both tests have in common; the defaults are the published micro parameters where there are any."""

    packings: int = parameter(5, "Number of random packings, one run each.", "", POSITIVE, limits=(1, 1000))
    seed: int = parameter(1, "Seed of the first packing; the others follow.", "", NOT_NEGATIVE, limits=(0, 2**32 - 1001))
    normal_stiffness: float = parameter(1.61129e10, "Normal stiffness of bonds and contacts.", "N/m", POSITIVE, limits=(1, 1e15))
    shear_stiffness: float = parameter(0.3222e10, "Shear stiffness of bonds and contacts.", "N/m", POSITIVE, limits=(1e-3, 1e15))
    tensile_strength: float = parameter(0.29e5, "Tensile strength of a bond.", "N", POSITIVE, limits=(1e-9, 1e15))
    shear_strength: float = parameter(0.29e5, "Shear strength of a bond.", "N", POSITIVE, limits=(1e-9, 1e15))
    friction: float = parameter(0.839, "Friction coefficient of contacts without a bond.", "-", NOT_NEGATIVE, limits=(0, 10))
    plate_friction: float = parameter(0.0, "Friction coefficient of discs on the plates.", "-", NOT_NEGATIVE, limits=(0, 10))
    bond_reach: float = parameter(
        0.02, "Discs with a distance up to 1 + this times the sum of their radii are bonded.", "-", NOT_NEGATIVE, limits=(0, 0.5)
    )
    smallest_radius: float = parameter(0.262e-3, "Smallest radius.", "m", POSITIVE, limits=(1e-9, 1e3))
    largest_radius: float = parameter(0.653e-3, "Largest radius.", "m", POSITIVE, limits=(1e-9, 1e3))
    size_exponent: float = parameter(
        3.56, "The number of discs falls with this power of the radius; 0 is uniform.", "-", NOT_NEGATIVE, limits=(0, 20)
    )
    porosity: float = parameter(
        0.13, "Porosity of the packing; where it cannot be reached, the nearest, with a warning.", "-", POSITIVE, limits=(0.05, 0.6)
    )
    density: float = parameter(2500.0, "Density of the discs.", "kg/m3", POSITIVE, limits=(1e-3, 1e6))
    damping: float = parameter(
        0.2, "Damping force (moment) as a share of the force (moment) on a disc, against its velocity (spin).", "-", NOT_NEGATIVE,
        limits=(0, 0.95),
    )  # fmt: skip
    speed: float = parameter(0.05, "Speed of each plate towards the other; published 0.001 m/s.", "m/s", POSITIVE, limits=(1e-9, 1e3))
    strain: float = parameter(0.015, "Approach of the plates over the height at which a run ends at the latest.", "-", POSITIVE, limits=(1e-6, 0.2))
    drop: float = parameter(
        0.3, "A run ends when the load has fallen to this share of its peak and a crack can have gone through.", "-", POSITIVE,
        limits=(1e-3, 0.99),
    )  # fmt: skip
    inner: float = parameter(0.6, "Size of the inner volume of averages, as a share of the specimen.", "-", POSITIVE, limits=(0.02, 1.0))
    step_ratio: float = parameter(0.8, "Time step as a share of the critical step of the bonded, damped specimen.", "-", SHARE)

    study: ClassVar[str] = ""
    title: ClassVar[str] = ""
    published: ClassVar[dict[str, float]] = {}  # simulated by Rojek & Onate

    def __post_init__(self) -> None:
        check(self)
        if self.smallest_radius > self.largest_radius:
            raise ValueError(
                f"smallest_radius={self.smallest_radius:g} must not be above largest_radius={self.largest_radius:g} (m)"
            )
        if min(self.size) < 8.0 * self.largest_radius:
            raise ValueError(
                f"largest_radius={self.largest_radius:g} must be at most an eighth of the specimen ({min(self.size):g} m); "
                "take smaller discs or a larger specimen"
            )
        solid = 0.85 * math.prod(self.size) / (math.pi * self.smallest_radius**2)
        if solid > 5e6:
            raise ValueError(
                f"smallest_radius={self.smallest_radius:g} would make millions of discs in {self.size[0]:g} m x {self.size[1]:g} m; "
                "are all lengths in metres?"
            )

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the specimen, m."""
        raise NotImplementedError

    @property
    def region(self) -> Any:
        """Outline of the specimen about the origin, as `packing_cache.random_dense` takes it."""
        raise NotImplementedError

    @property
    def area(self) -> float:
        """Of the specimen, m2."""
        return math.prod(self.size)

    def stress(self, force: float) -> float:
        """Stress (Pa) by which the test is reported, from the force of the plates (N)."""
        raise NotImplementedError


@dataclass(frozen=True)
class Compression(Parameters):
    """Unconfined compression of a rectangle."""

    width: float = parameter(0.05, "Width of the specimen.", "m", POSITIVE, limits=(1e-6, 1e4))
    height: float = parameter(0.05, "Height of the specimen.", "m", POSITIVE, limits=(1e-6, 1e4))

    study: ClassVar[str] = "ucs"
    title: ClassVar[str] = "Unconfined compression of bonded rock"
    published: ClassVar[dict[str, float]] = {
        "young_modulus": 18000e6, "poisson_ratio": 0.20, "compressive_strength": 116e6
    }  # fmt: skip

    @property
    def size(self) -> tuple[float, float]:
        return self.width, self.height

    @property
    def region(self) -> Any:
        return (-0.5 * self.width, -0.5 * self.height), (0.5 * self.width, 0.5 * self.height)

    def stress(self, force: float) -> float:
        """Force over width."""
        return force / self.width


@dataclass(frozen=True)
class Brazilian(Parameters):
    """Splitting of a disc along the loaded diameter."""

    inner: float = parameter(0.2, "Size of the inner volume of averages, as a share of the specimen.", "-", POSITIVE, limits=(0.02, 0.7))
    diameter: float = parameter(0.05, "Diameter of the specimen.", "m", POSITIVE, limits=(1e-6, 1e4))

    study: ClassVar[str] = "brazilian"
    title: ClassVar[str] = "Brazilian test of bonded rock"
    published: ClassVar[dict[str, float]] = {"tensile_strength": 16.8e6}

    @property
    def size(self) -> tuple[float, float]:
        return self.diameter, self.diameter

    @property
    def region(self) -> Any:
        from meshes.regions import Disc

        return Disc((0.0, 0.0), 0.5 * self.diameter)

    @property
    def area(self) -> float:
        return 0.25 * math.pi * self.diameter**2

    def stress(self, force: float) -> float:
        """Tension across the loaded diameter of an elastic disc, 2 P / (pi D)."""
        return 2.0 * force / (math.pi * self.diameter)
