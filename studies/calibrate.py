"""Calibration of bonded rock: targets, grid of the relations, and the specimens that are tested."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from studies.calibration import Micro
from studies.options import NOT_NEGATIVE, POSITIVE, brief, check, parameter
from studies.rock import Brazilian, Compression, Parameters

TITLE = "Micro parameters of bonded rock from its moduli and strengths"
MICRO = ("normal_stiffness", "shear_stiffness", "tensile_strength", "shear_strength")
NOT_OPTIONS = (*MICRO, "packings", "strain")  # fields of the specimen that the calibration sets itself
WIDEST_STRAIN = 3.0  # of a run, in strains of an elastic specimen at its strength


@dataclass(frozen=True)
class Targets:
    """What the rock shall have, and how it is sought; the default is the sandstone of Rojek & Onate (2007)."""

    young_modulus: float = parameter(18690e6, "Young's modulus of the rock.", "Pa", POSITIVE, limits=(1, 1e15))
    poisson_ratio: float = parameter(0.18, "Poisson's ratio of the rock.", "-", NOT_NEGATIVE, limits=(0, 0.9))
    compressive_strength: float = parameter(127.8e6, "Unconfined compressive strength.", "Pa", POSITIVE, limits=(1e-3, 1e12))
    tensile_strength: float | None = parameter(
        None, "Tensile strength of the Brazilian test; needs as many runs again and a grid of strength ratios.", "Pa", POSITIVE,
        shown="none", limits=(1e-3, 1e12),
    )  # fmt: skip
    stiffness_ratios: str = parameter("0.1,0.2,0.4,0.8", "k_t / k_n of the relations, two or more.")
    strength_ratios: str = parameter(
        "1", "R_t / R_n of the relations; the first is kept without a tensile strength, with one give several, such as 0.5,1,2,4."
    )
    packings: int = parameter(3, "Random packings of each run.", "", POSITIVE, limits=(1, 1000))
    check_packings: int = parameter(3, "Other packings on which the result is checked.", "", POSITIVE, limits=(1, 1000))
    rounds: int = parameter(4, "Most rounds of runs that correct the result of the relations.", "", POSITIVE, limits=(1, 100))

    def __post_init__(self) -> None:
        check(self)
        if len(self.stiffness_grid) < 2:
            raise ValueError(f"stiffness_ratios={brief(self.stiffness_ratios)} must be two or more, such as 0.1,0.2,0.4,0.8")
        if self.tensile_strength is not None and len(self.strength_grid) < 2:
            raise ValueError(
                f"strength_ratios={brief(self.strength_ratios)} must be two or more for a tensile strength, such as 0.5,1,2,4"
            )
        if self.compressive_strength > 0.1 * self.young_modulus:
            raise ValueError(
                f"compressive_strength={self.compressive_strength:g} must be below a tenth of young_modulus={self.young_modulus:g} "
                "(Pa): bonds are linear for small strains"
            )

    @property
    def stiffness_grid(self) -> tuple[float, ...]:
        """The stiffness ratios."""
        return _grid("stiffness_ratios", self.stiffness_ratios)

    @property
    def strength_grid(self) -> tuple[float, ...]:
        """The strength ratios."""
        grid = _grid("strength_ratios", self.strength_ratios)
        return grid if self.tensile_strength is not None else grid[:1]

    @property
    def responses(self) -> np.ndarray:
        """Targets as responses y (see `studies.calibration`)."""
        strengths = [self.compressive_strength] + ([] if self.tensile_strength is None else [self.tensile_strength])
        return np.array([math.log(self.young_modulus), self.poisson_ratio, *map(math.log, strengths)])

    @property
    def tests(self) -> tuple[type[Parameters], ...]:
        """Tests that each packing undergoes."""
        return (Compression,) if self.tensile_strength is None else (Compression, Brazilian)


def _grid(name: str, text: str) -> tuple[float, ...]:
    try:
        grid = tuple(float(part) for part in text.split(","))
    except ValueError:
        raise ValueError(f"{name}={brief(text)} must be numbers with commas between, such as 0.1,0.2,0.4") from None
    if not all(0.01 <= value <= 100.0 for value in grid) or list(grid) != sorted(set(grid)):
        raise ValueError(f"{name}={brief(text)} must be between 0.01 and 100, in ascending order, each once")
    return grid


def rock_test(kind: type[Parameters], micro: Micro, specimen: Compression, target: Targets) -> Parameters:
    """Parameters of a test with these micro parameters on specimens of this kind; discs are as wide as the rectangle."""
    given: dict[str, Any] = {
        field.name: getattr(specimen, field.name) for field in fields(Parameters) if field.name not in (*MICRO, "inner", "strain")
    }
    given |= {"width": specimen.width, "height": specimen.height} if kind is Compression else {"diameter": specimen.width}
    elastic = target.compressive_strength / target.young_modulus
    return kind(
        **given, strain=min(WIDEST_STRAIN * elastic, 0.2), normal_stiffness=micro.normal_stiffness,
        shear_stiffness=micro.stiffness_ratio * micro.normal_stiffness, tensile_strength=micro.bond_strength,
        shear_strength=micro.strength_ratio * micro.bond_strength,
    )  # fmt: skip
