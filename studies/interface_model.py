"""The strip of the study `interface`, and one passage of the pulse through its overlap zone."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from mpi4py import MPI

from bridge import BridgingScale, Overlap, OverlapZone, nested_layout
from continuum import Body, Cauchy, Cosserat
from continuum import Unstable as ContinuumUnstable
from meshes import Box, HalfPlane, domains
from particles import Unstable
from studies.interface import Parameters, Setting
from studies.interface_lattice import lattice, restrain
from studies.interface_pairs import PAIRS, Discrete


class Strip:
    """Particles and cells with the pulse, what `bridge.run.run` needs of them."""

    def __init__(self, p: Parameters, setting: Setting) -> None:
        self.parameters, self.setting = p, setting
        self._make = self._overlapping() if setting.is_overlapping else self._bridging()
        across = "yr" if self.body.turns else "y"
        self.body.fix("bottom", across)
        self.body.fix("top", across)
        self.body.fix("right", "xy")
        self.critical = self._critical(1)
        limit = self.critical
        if p.substeps > 1 or not setting.is_overlapping:
            self.critical = self._critical(p.substeps)
            limit = min(p.substeps * self.critical, self._critical_coarse())
        self.step = p.step_ratio * limit
        self.coupled = self._make(self.step, p.substeps)
        if not setting.is_overlapping:
            self.coupled.project_covered()  # the coarse part of the pulse
        self.given = self.soil.energies()["elastic_normal"]  # J, of the pulse
        self.before, self.behind = sections(p, setting, self.soil.reference[:, 0], self.body.coordinates[:, 0])

    def _domain(self, start: float) -> Any:
        """Cells from a place x (m) to the end."""
        p = self.parameters
        counts = [max(1, round(size / self.setting.element)) for size in (p.length - start, p.strip_width)]
        return domains.rectangle((start, 0.0), (p.length, p.strip_width), counts, p.cell, comm=MPI.COMM_SELF)

    def _overlapping(self) -> Callable[[float, int], Any]:
        """Make both sides with an overlap zone; returns what couples them with a step (s) and substeps."""
        p, setting = self.parameters, self.setting
        outer = p.inner + setting.overlap
        zone = OverlapZone(HalfPlane((p.inner, 0.0), (1.0, 0.0)), HalfPlane((outer, 0.0), (1.0, 0.0)), p.profile)
        self.body = Body(self._domain(p.inner), self._material(), share=zone)
        self.soil = lattice(p, outer, setting.wavelength)
        restrain(p, self.soil, outer + p.radius if p.lattice == "hexagonal" else p.inner)
        return lambda step, substeps: Overlap(
            self.body,
            self.soil,
            zone,
            constraint=setting.coupling,
            penalty=setting.penalty or 1.0,
            step=step,
            substeps=substeps,
        )

    def _bridging(self) -> Callable[[float, int], Any]:
        """Make both sides with ghosts behind the interface; returns what couples them with a step (s) and substeps."""
        p, setting = self.parameters, self.setting
        covered = Box((-p.inner, -p.inner), (p.inner, p.strip_width + p.inner))
        self.body = Body(self._domain(0.0), self._material(), excluded=covered)
        every = lattice(p, p.inner + 6.0 * p.radius, setting.wavelength)
        layout = nested_layout(every.reference, p.radius, covered)
        self.soil = lattice(p, p.inner + 6.0 * p.radius, setting.wavelength, layout.kept)
        restrain(p, self.soil, p.inner)
        variant = setting.coupling
        return lambda step, substeps: BridgingScale(
            self.body, self.soil, layout.ghost, layout.share, step=step, substeps=substeps, variant=variant
        )

    def _critical(self, substeps: int) -> float:
        """Largest stable step of the particles, s, with the zone where there is one."""
        if not self.setting.is_overlapping:
            return self.soil.critical_step(sharp=True)
        p = self.parameters
        return self._make(1e-6 * p.radius / p.wave_speed, substeps).critical_step(sharp=True)

    def _critical_coarse(self) -> float:
        """Largest stable step of the continuum, s."""
        if self.setting.is_overlapping:
            return self.body.critical_step("power")
        return self._make(1e-6 * self.parameters.radius / self.parameters.wave_speed, 1).critical_coarse_step()

    def _material(self) -> Cauchy | Cosserat:
        p = self.parameters
        if p.continuum == "cauchy" and self.setting.is_overlapping:
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

    def heights(self) -> tuple[float, float]:
        """Displacements at the sections before and behind the zone, m."""
        return self.before.of(self.soil.displacements[:, 0]), self.behind.of(self.body.displacement[:, 0])

    def energies(self) -> dict[str, float]:
        """Terms since the release, J."""
        return self.coupled.energies()

    def sample(self) -> dict[str, float]:
        """Displacements at two sections and energies now."""
        terms, (before, behind) = self.energies(), self.heights()
        return {
            "time_s": self.time, "before_m": before, "behind_m": behind, "kinetic_J": terms["kinetic"],
            "elastic_J": self.given + terms["elastic"], "strain_J": terms["strain"], "penalty_J": terms.get("penalty", 0.0),
            "interface_J": terms["interface"], "balance_J": terms["balance"], "stretch_m": self.coupled.mismatch(),
        }  # fmt: skip

    def profile(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Places and mean displacements along x: of the columns of particles, of the columns of nodes, m."""
        cells = self.body.coordinates[:, 0] > self.parameters.inner - 1e-9
        return (
            *columns(self.soil.reference[:, 0], self.soil.displacements[:, 0]),
            *columns(self.body.coordinates[cells, 0], self.body.displacement[cells, 0]),
        )

    @property
    def tied(self) -> int:
        """Number of particles that are tied, or led (ghosts)."""
        return len(self.coupled.tie.ids) if self.setting.is_overlapping else len(self.coupled.fine.ids)


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
    """What one run of the map found; NaN where it became unstable."""

    setting: Setting
    reflection: float  # largest displacement that comes back, share of the pulse's height
    transmission: float  # peak behind the zone, share of that of the left model alone
    reflected_energy: float  # share of the pulse's
    step: float  # s
    step_of_lattice: float  # critical step, share of that of the left model alone
    seconds: float


class Alike:
    """A strip that is no coupling of discs and cells (`interface_pairs`), with its two sections."""

    def __init__(self, p: Parameters, setting: Setting, strip: Any, step: float) -> None:
        self.strip, self.step, self.critical = strip, step, strip.critical
        self.before, self.behind = sections(p, setting, strip.places, strip.places)

    def advance(self, steps: int) -> None:
        """Take steps."""
        self.strip.advance(steps, self.step)

    def heights(self) -> tuple[float, float]:
        """Displacements at the sections, m."""
        moved = self.strip.moved()
        return self.before.of(moved), self.behind.of(moved)


def sections(p: Parameters, setting: Setting, left: np.ndarray, right: np.ndarray) -> tuple[Section, Section]:
    """Half a pulse before and behind the zone, at places of the left and of the right model (m)."""
    half = 0.5 * setting.wavelength
    return Section(left, p.inner - half), Section(right, p.inner + setting.overlap + half)


def sides(p: Parameters, setting: Setting) -> tuple[Strip | Alike, Alike, int]:
    """The strip of a setting, the one that it is compared with, and how many steps this takes for one of the strip's."""
    if setting.is_alike:
        kind = PAIRS[setting.coupling]
        changing, alone = kind(p, setting), kind(p, setting, alone=True)
        step = p.step_ratio * min(changing.critical, alone.critical)
        return Alike(p, setting, changing, step), Alike(p, setting, alone, step), 1
    strip = Strip(p, setting)
    return strip, Alike(p, setting, Discrete(p, setting), strip.step / p.substeps), p.substeps


def passage(p: Parameters, setting: Setting) -> Passage:
    """Let the pulse pass the zone, beside the model of the left side alone, and compare the two at both sections.

    What comes back is the difference at the section before the zone, until the free end sends it back again.
    """
    began = time.perf_counter()
    strip, alone, substeps = sides(p, setting)
    alone.before, alone.behind = (Section(alone.strip.places, section.x) for section in (strip.before, strip.behind))
    outer = p.inner + setting.overlap
    travel = max(2.0 * outer - strip.before.x, strip.behind.x) + 0.75 * setting.wavelength
    share, found = strip.critical / alone.critical, []
    for _ in range(math.ceil(travel / p.wave_speed / strip.step)):
        try:
            strip.advance(1)
        except (ContinuumUnstable, Unstable):
            return Passage(setting, math.nan, math.nan, math.nan, strip.step, share, time.perf_counter() - began)
        alone.advance(substeps)
        (here, there), (due_here, due_there) = strip.heights(), alone.heights()
        found.append([here, due_here, there, due_there])
    here, due_here, there, due_there = np.array(found).T
    back, sent = np.diff(here - due_here), np.diff(due_here)
    return Passage(
        setting, float(np.abs(here - due_here).max() / p.amplitude), float(there.max() / due_there.max()),
        float(back @ back / (sent @ sent)), strip.step, share, time.perf_counter() - began,
    )  # fmt: skip
