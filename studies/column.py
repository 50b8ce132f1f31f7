"""Collapse of columns of discs on a rough floor under gravity: runout against aspect ratio.

A column of width L0 and height H = a L0 stands between a smooth wall at x = 0 and a gate at x = L0; the gate vanishes, the
column falls and spreads to L. For quasi-two-dimensional columns of sand Lube et al. (2005) found (L - L0) / L0 = 1.2 a for
a < 1.8 and 1.9 a^(2/3) for a > 2.8, Lajeunesse et al. (2005) the same powers; for discs computed by contact dynamics,
without rolling resistance, Staron & Hinch (2005) found 2.5 a for a < 2 and 3.25 a^0.7 beyond. SI units, per metre of
thickness. Lengths do not matter: the unit is the column.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from studies.options import NOT_NEGATIVE, POSITIVE, SHARE, brief, check, parameter

TITLE = "Collapse of columns of discs: runout against aspect ratio"
GRAVITY = 9.81  # m/s2


@dataclass(frozen=True)
class Parameters:
    """Parameters of the study."""

    aspects: str = parameter("0.5,1,2,4,8", "Aspect ratios a = H / L0 of the columns, one run each.")
    particles: int = parameter(1200, "Discs in a column, about.", "", POSITIVE, limits=(50, 1_000_000))
    radius: float = parameter(0.01, "Largest radius.", "m", POSITIVE, limits=(1e-9, 1e3))
    size_ratio: float = parameter(1.5, "Largest over smallest radius.", "-", POSITIVE, limits=(1, 10))
    friction: float = parameter(0.5, "Friction coefficient of sliding, floor included.", "-", NOT_NEGATIVE, limits=(0, 10))
    rolling_friction: float = parameter(
        0.1, "Friction coefficient of rolling, on the rolling radius l_i l_j / (l_i + l_j).", "-", NOT_NEGATIVE, limits=(0, 10)
    )
    damping: float = parameter(
        0.3, "Dampers of the contacts, as a share of critical damping.", "-", NOT_NEGATIVE, limits=(0, 1)
    )
    stiffness_level: float = parameter(
        1000.0, "Normal stiffness over the weight of the column, k_N / (density g H).", "-", POSITIVE, limits=(10, 1e6)
    )
    density: float = parameter(2600.0, "Density of the discs.", "kg/m3", POSITIVE, limits=(1e-3, 1e6))
    seed: int = parameter(1, "Seed of the random packings.", "", NOT_NEGATIVE, limits=(0, 2**32 - 1))
    step_ratio: float = parameter(0.7, "Time step as a share of the critical step of the column.", "-", SHARE)

    def __post_init__(self) -> None:
        check(self)
        if not self.ratios or not all(math.isfinite(a) and 0.05 <= a <= 50.0 for a in self.ratios):
            raise ValueError(f"aspects={brief(self.aspects)} must be aspect ratios between 0.05 and 50, such as 0.5,1,2")
        if list(self.ratios) != sorted(set(self.ratios)):
            raise ValueError(f"aspects={brief(self.aspects)} must be in ascending order, each once")

    @property
    def ratios(self) -> tuple[float, ...]:
        """The aspect ratios."""
        try:
            return tuple(float(part) for part in self.aspects.split(","))
        except ValueError:
            raise ValueError(f"aspects={brief(self.aspects)} must be numbers with commas between, such as 0.5,1,2") from None


def lube(aspect: np.ndarray) -> np.ndarray:
    """Runout (L - L0) / L0 of quasi-two-dimensional columns of sand (Lube et al. 2005); NaN between the two branches."""
    return np.where(aspect < 1.8, 1.2 * aspect, np.where(aspect > 2.8, 1.9 * aspect ** (2.0 / 3.0), np.nan))


def staron_hinch(aspect: np.ndarray) -> np.ndarray:
    """Runout (L - L0) / L0 of columns of discs without rolling resistance (Staron & Hinch 2005)."""
    return np.where(aspect < 2.0, 2.5 * aspect, 3.25 * aspect**0.7)
