"""A pulse through the interface of particles and continuum (Rojek & Onate 2007, section 7): how much of it comes back?

A strip with restrained sides, free at x = 0 and fixed at x = L, is particles on the left (a square lattice, whose wave is that
of a chain, or a hexagonal one), cells on the right. Both share an overlap zone (elimination or springs), or meet at a line
with ghosts behind it (the variants of the bridging scale). A cosine of width l is released at the free end,
u = A (cos(2 pi x / l) + 1): the half that travels to the right has the height A and the full width l. SI units, per metre of
thickness.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from studies.options import NOT_NEGATIVE, POSITIVE, SHARE, brief, check, parameter

TITLE = "A pulse through the interface of particles and continuum: reflection and transmission"
PUBLISHED_TRANSIT = 51.06e-6  # s, L / c with the paper's constants
LARGEST_MAP = 2000  # settings
OVERLAPPING = ("lagrange", "penalty")
BRIDGING = ("subcycling", "multiplier", "respa", "resync", "paper")
COUPLINGS = (*OVERLAPPING, *BRIDGING)
ALIKE = ("cells", "discs", "springs")  # no coupling of discs and cells
FINEST = 5  # discs of a column that one coarse disc may touch


@dataclass(frozen=True)
class Parameters:
    """Parameters of the study."""

    coupling: str = parameter(
        "lagrange", "Coupling of the run that is shown: ties of the overlap, or variants of the bridging scale.", choices=COUPLINGS
    )
    lattice: str = parameter(
        "square", "Lattice of the particles; hexagonal needs a Poisson's ratio of 0.25 at most.", choices=("square", "hexagonal")
    )
    element: float = parameter(0.002, "Element size of that run.", "m", POSITIVE)
    overlap: float = parameter(0.05, "Width of its overlap zone.", "m", POSITIVE)
    wavelength: float = parameter(0.02, "Width l of its pulse.", "m", POSITIVE)
    penalty: float = parameter(4.0, "Factor of its springs (coupling penalty), see docs/overlap.md.", "-", POSITIVE)
    couplings: str = parameter(
        "lagrange,penalty", "Models of the map: couplings as above; what a change of resolution alone reflects, from cells of a "
        "disc's size, or discs of the radius, to those of the element size (cells, discs); lattice springs with elements (springs).", "",
    )  # fmt: skip
    elements: str = parameter("0.002,0.004,0.005", "Element sizes of the map.", "m")
    overlaps: str = parameter("0.01,0.02,0.03,0.05", "Overlap widths of the map.", "m")
    wavelengths: str = parameter("0.02,0.04", "Pulse widths of the map.", "m")
    penalties: str = parameter("1,4,16", "Factors of the springs of the map.", "-")
    wanted: float = parameter(0.01, "Reflection that is to be kept, a share of the pulse's height.", "-", SHARE)
    cell: str = parameter("triangle", "Cells.", choices=("triangle", "quadrilateral"))
    continuum: str = parameter("cauchy", "Material of the cells (bridging always: cosserat).", choices=("cauchy", "cosserat"))
    profile: str = parameter("linear", "Share of the continuum across the zone.", choices=("linear", "smooth"))
    length: float = parameter(0.3, "Length of the strip.", "m", POSITIVE)
    width: float = parameter(0.01, "Width of the strip (hexagonal: the nearest that rows fill).", "m", POSITIVE)
    inner: float = parameter(0.1, "Where the overlap zone and the cells begin.", "m", POSITIVE)
    radius: float = parameter(0.001, "Radius of the particles (square: their diameter divides the width).", "m", POSITIVE)
    young_modulus: float = parameter(2e11, "Young's modulus E.", "Pa", POSITIVE)
    poisson_ratio: float = parameter(0.3, "Poisson's ratio of the cells.", "-", NOT_NEGATIVE, limits=(0, 0.49))
    density: float = parameter(7800.0, "Density.", "kg/m3", POSITIVE)
    amplitude: float = parameter(1e-5, "Height A of the pulse.", "m", POSITIVE)
    step_ratio: float = parameter(0.8, "Time step as a share of the critical one.", "-", SHARE)
    substeps: int = parameter(1, "Particle steps in a step of the cells.", "", POSITIVE, limits=(1, 100))

    def __post_init__(self) -> None:
        check(self)
        rows = self.width / (2.0 * self.radius)
        if self.lattice == "hexagonal":
            if self.poisson_ratio > 0.25:
                raise ValueError(
                    f"poisson_ratio={self.poisson_ratio:g} must be at most 0.25 with lattice=hexagonal, whose bonds have k_t = (1 - 4 nu) k_n"
                )
        elif abs(rows - round(rows)) > 1e-6 or round(rows) < 1:
            raise ValueError(f"radius={self.radius:g} must be such that discs fill width={self.width:g} m: a half, a fourth, ... of it")
        if self.lattice == "hexagonal" and any(s.coupling == "discs" for s in self.settings()):
            raise ValueError("couplings with discs must go with lattice=square, whose rows are what changes")
        if len(self.settings()) > LARGEST_MAP:
            raise ValueError(f"the map has {len(self.settings())} settings; it must have at most {LARGEST_MAP}: shorten its lists")
        for setting in [self.shown, *self.settings()]:
            self._check_setting(setting)

    def _check_setting(self, s: Setting) -> None:
        """Raise a ValueError where the waves of a run would not stay apart."""
        if not s.wavelength >= 6.0 * self.radius:
            raise ValueError(f"wavelength={s.wavelength:g} must be at least three diameters, {6 * self.radius:g} m")
        if s.is_overlapping and not s.overlap >= 2.0 * self.radius:
            raise ValueError(f"overlap={s.overlap:g} must be at least a diameter of the particles, {2 * self.radius:g} m")
        ratio = s.element / (2.0 * self.radius)
        if s.coupling in ("discs", "springs") and (abs(ratio - round(ratio)) > 1e-6 or round(ratio) < 1):
            raise ValueError(
                f"element={s.element:g} must be a whole number of diameters, {2 * self.radius:g} m, with {s.coupling} among the couplings"
            )
        if s.coupling == "discs" and ratio > FINEST + 0.5:
            raise ValueError(f"element={s.element:g} must be at most {FINEST} diameters, {2 * FINEST * self.radius:g} m, with discs among the couplings")
        if not s.element <= self.length - self.inner:
            raise ValueError(f"element={s.element:g} must be at most {self.length - self.inner:g} m, what is left for cells")
        if not self.inner >= s.overlap + s.wavelength:
            raise ValueError(
                f"inner={self.inner:g} must be at least {s.overlap + s.wavelength:g} m, overlap and wavelength together: else what "
                "comes back from the zone meets what the free end sends"
            )
        if not self.length >= self.inner + s.overlap + 1.5 * s.wavelength:
            raise ValueError(
                f"length={self.length:g} must be at least {self.inner + s.overlap + 1.5 * s.wavelength:g} m, for the pulse to leave "
                "the zone before it meets the end"
            )

    @property
    def shown(self) -> Setting:
        """The run that is shown."""
        overlap = self.overlap if self.coupling in OVERLAPPING else 0.0
        return Setting(self.coupling, self.wavelength, self.element, overlap, self.penalty)

    def settings(self) -> list[Setting]:
        """The runs of the map."""
        waves, sizes, widths = (numbers(name, getattr(self, name)) for name in ("wavelengths", "elements", "overlaps"))
        found = []
        for wave, size in itertools.product(waves, sizes):
            for coupling in listed("couplings", self.couplings, (*COUPLINGS, *ALIKE)):
                zones = widths if coupling in OVERLAPPING else [0.0]
                factors = numbers("penalties", self.penalties) if coupling == "penalty" else [0.0]
                found += [Setting(coupling, wave, size, width, factor) for width in zones for factor in factors]
        return found

    @property
    def strip_width(self) -> float:
        """Width of the strip, m: a whole number of rows."""
        row = math.sqrt(3.0) * self.radius
        return max(1, round(self.width / row)) * row if self.lattice == "hexagonal" else self.width

    @property
    def modulus(self) -> float:
        """Modulus of uniaxial strain, Pa."""
        nu = self.poisson_ratio
        return self.young_modulus * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu))

    @property
    def wave_speed(self) -> float:
        """Speed of compression waves, m/s."""
        return math.sqrt(self.modulus / self.density)

    def pulse(self, x: np.ndarray, wavelength: float) -> np.ndarray:
        """Initial displacement (eq 91)."""
        return np.where(x < 0.5 * wavelength, self.amplitude * (np.cos(2.0 * np.pi * x / wavelength) + 1.0), 0.0)


class Setting(NamedTuple):
    """What varies from run to run; lengths in m, `penalty` counts for springs, `overlap` is zero for bridging."""

    coupling: str
    wavelength: float
    element: float
    overlap: float
    penalty: float

    @property
    def is_overlapping(self) -> bool:
        """Whether there is an overlap zone."""
        return self.coupling in OVERLAPPING

    @property
    def is_alike(self) -> bool:
        """Whether no discs are coupled with cells."""
        return self.coupling in ALIKE

    @property
    def tie(self) -> str:
        """In words."""
        if self.is_alike:
            return "lattice springs, manifold" if self.coupling == "springs" else f"{self.coupling} on both sides"
        if not self.is_overlapping:
            return f"bridging, {self.coupling}"
        return "elimination" if self.coupling == "lagrange" else f"springs, factor {self.penalty:g}"


def listed(name: str, text: str, known: tuple[str, ...]) -> list[str]:
    """Words of a list, each once."""
    found = list(dict.fromkeys(part.strip() for part in text.split(",")))
    if wrong := [word for word in found if word not in known]:
        raise ValueError(f"{name}={brief(text)} must be words of {', '.join(known)} with commas between, not {wrong[0]!r}")
    return found


def numbers(name: str, text: str) -> list[float]:
    """Positive numbers of a list, ascending."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        raise ValueError(f"{name}={brief(text)} must be numbers with commas between, such as 0.01,0.02") from None
    if not all(math.isfinite(value) and value > 0.0 for value in values):
        raise ValueError(f"{name}={brief(text)} must be positive numbers")
    return sorted(set(values))
