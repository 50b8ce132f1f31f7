"""The strip of the study `interface`, and one passage of the pulse through its overlap zone."""

from __future__ import annotations

import math
import time
from typing import NamedTuple

import numpy as np

from bridge import Overlap, OverlapZone
from continuum import Body, Cauchy, Cosserat
from meshes import Box, HalfPlane, domains, packings
from particles import Assembly, Bonded
from studies.interface import Parameters, Setting


def chain(p: Parameters, end: float, wavelength: float) -> Assembly:
    """Bonded square lattice from x = 0 to `end` (m) with the pulse at rest in it; its mass fills the strip."""
    law = Bonded(p.modulus, 0.0, math.inf, math.inf)
    sites = packings.square(Box((0.0, 0.0), (end, p.width)), p.radius)
    soil = Assembly(sites, p.radius, p.density * 4.0 / np.pi, law)
    soil.bond(0.01)
    moved = np.zeros((soil.count, 3))
    moved[:, 0] = p.pulse(sites[:, 0], wavelength)
    soil.displacements = moved
    return soil


class Strip:
    """Particles and cells with the pulse, what `bridge.run.run` needs of them."""

    def __init__(self, p: Parameters, setting: Setting) -> None:
        self.parameters, self.setting = p, setting
        outer = p.inner + setting.overlap
        zone = OverlapZone(HalfPlane((p.inner, 0.0), (1.0, 0.0)), HalfPlane((outer, 0.0), (1.0, 0.0)), p.profile)
        counts = [max(1, round(size / setting.element)) for size in (p.length - p.inner, p.width)]
        domain = domains.rectangle((p.inner, 0.0), (p.length, p.width), counts, p.cell)
        self.body = Body(domain, self._material(), share=zone)
        self.body.fix("bottom", "y")
        self.body.fix("top", "y")
        self.body.fix("right", "xy")
        self.soil = chain(p, outer, setting.wavelength)
        side = np.abs(self.soil.reference[:, 1] - 0.5 * p.width) > 0.5 * p.width - 1.5 * p.radius
        self.soil.hold(np.flatnonzero(side & (self.soil.reference[:, 0] < p.inner - 0.1 * p.radius)), "y")

        def couple(step: float, substeps: int) -> Overlap:
            return Overlap(
                self.body, self.soil, zone, constraint=setting.constraint, penalty=setting.penalty or 1.0, step=step,
                substeps=substeps,
            )  # fmt: skip

        self.critical = couple(1e-6 * p.radius / p.wave_speed, 1).critical_step(sharp=True)
        limit = self.critical
        if p.substeps > 1:
            self.critical = couple(1e-6 * p.radius / p.wave_speed, p.substeps).critical_step(sharp=True)
            limit = min(p.substeps * self.critical, self.body.critical_step("power"))
        self.step = p.step_ratio * limit
        self.coupled = couple(self.step, p.substeps)
        self.given = self.soil.energies()["elastic_normal"]  # J, of the pulse
        self.before = Section(self.soil.reference[:, 0], p.inner - 0.5 * setting.wavelength)
        self.behind = Section(self.body.coordinates[:, 0], outer + 0.5 * setting.wavelength)

    def _material(self) -> Cauchy | Cosserat:
        p = self.parameters
        if p.continuum == "cauchy":
            return Cauchy(p.young_modulus, p.poisson_ratio, p.density)
        shear = 0.5 * p.young_modulus / (1.0 + p.poisson_ratio)
        return Cosserat(p.young_modulus, p.poisson_ratio, shear, p.radius, p.density)

    @property
    def time(self) -> float:
        """Time since the release, s."""
        return self.coupled.time

    def advance(self, steps: int) -> None:
        """Take steps."""
        self.coupled.advance(steps)

    def energies(self) -> dict[str, float]:
        """Terms since the release, J."""
        return self.coupled.energies()

    def sample(self) -> dict[str, float]:
        """Displacements at two sections and energies now."""
        terms = self.energies()
        return {
            "time_s": self.time, "before_m": self.before.of(self.soil.displacements[:, 0]),
            "behind_m": self.behind.of(self.body.displacement[:, 0]), "kinetic_J": terms["kinetic"],
            "elastic_J": self.given + terms["elastic"], "strain_J": terms["strain"], "penalty_J": terms["penalty"],
            "interface_J": terms["interface"], "balance_J": terms["balance"], "stretch_m": self.coupled.mismatch(),
        }  # fmt: skip

    def profile(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Places and mean displacements along x: of the columns of particles, of the columns of nodes, m."""
        return (
            *columns(self.soil.reference[:, 0], self.soil.displacements[:, 0]),
            *columns(self.body.coordinates[:, 0], self.body.displacement[:, 0]),
        )


class Section:
    """Mean over the column of particles or nodes that is nearest to a place x (m)."""

    def __init__(self, places: np.ndarray, x: float) -> None:
        self.x = float(places[np.abs(places - x).argmin()])
        self._these = np.flatnonzero(np.abs(places - self.x) < 1e-9)

    def of(self, values: np.ndarray) -> float:
        """Mean of values (n,)."""
        return float(values[self._these].mean())


def columns(places: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places and mean values of columns of equal x, ascending."""
    rounded = np.round(places, 9)
    x, which = np.unique(rounded, return_inverse=True)
    return x, np.bincount(which, values) / np.bincount(which)


class Passage(NamedTuple):
    """What one run of the map found."""

    setting: Setting
    reflection: float  # largest displacement that comes back, share of the pulse's height
    transmission: float  # peak behind the zone, share of that of particles alone
    reflected_energy: float  # share of the pulse's
    step: float  # s
    step_of_lattice: float  # critical step, share of that of the lattice alone
    seconds: float


def passage(p: Parameters, setting: Setting) -> Passage:
    """Let the pulse pass the zone, beside the same lattice without cells, and compare the two at both sections.

    What comes back is the difference at the section before the zone, until the free end sends it back again.
    """
    began = time.perf_counter()
    strip = Strip(p, setting)
    alone = chain(p, p.length, setting.wavelength)
    before, behind = (Section(alone.reference[:, 0], section.x) for section in (strip.before, strip.behind))
    outer = p.inner + setting.overlap
    travel = max(2.0 * outer - before.x, behind.x) + 0.75 * setting.wavelength
    found = []
    for _ in range(math.ceil(travel / p.wave_speed / strip.step)):
        strip.advance(1)
        alone.advance(p.substeps, strip.step / p.substeps)
        moved = alone.displacements[:, 0]
        found.append([
            strip.before.of(strip.soil.displacements[:, 0]), before.of(moved),
            strip.behind.of(strip.body.displacement[:, 0]), behind.of(moved),
        ])  # fmt: skip
    here, due_here, there, due_there = np.array(found).T
    back, sent = np.diff(here - due_here), np.diff(due_here)
    lattice = math.sqrt(p.density * (2.0 * p.radius) ** 2 / p.modulus)  # 2 / (largest frequency) of a chain
    return Passage(
        setting, float(np.abs(here - due_here).max() / p.amplitude), float(there.max() / due_there.max()),
        float(back @ back / (sent @ sent)), strip.step, strip.critical / lattice, time.perf_counter() - began,
    )  # fmt: skip
