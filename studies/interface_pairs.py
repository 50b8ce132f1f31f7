"""Strips of one kind of model, or of lattice springs with elements, whose resolution changes at a line: what that alone reflects."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from mpi4py import MPI

from bridge.manifold import Manifold
from continuum import Body, Cauchy
from meshes import Box, domains, packings
from particles import Assembly, Bonded
from particles.lattice import Lattice, LatticeMaterial
from studies.interface import Parameters, Setting
from studies.interface_lattice import lattice, pulsed, restrain

TO_COARSE = 0.25  # reach of bonds from a coarse disc to those of a column up to five times finer, and to no others


class Cells:
    """Cells of a particle's diameter, behind them cells of the element size; or the former alone."""

    def __init__(self, p: Parameters, setting: Setting, alone: bool = False) -> None:
        fine, coarse = 2.0 * p.radius, 2.0 * p.radius if alone else setting.element
        counts = round(p.inner / fine), max(1, round((p.length - p.inner) / coarse))
        rows = max(1, round(p.width / setting.element))
        domain = domains.rectangle((0.0, 0.0), (p.length, p.width), (sum(counts), rows), p.cell, comm=MPI.COMM_SELF)
        x = domain.mesh.geometry.x
        places = np.concatenate(
            [np.linspace(0.0, p.inner, counts[0] + 1), np.linspace(p.inner, p.length, counts[1] + 1)[1:]]
        )
        x[:, 0] = np.interp(x[:, 0], np.linspace(0.0, p.length, sum(counts) + 1), places)
        self.body = Body(domain, Cauchy(p.young_modulus, p.poisson_ratio, p.density))
        for side, held in (("bottom", "y"), ("top", "y"), ("right", "xy")):
            self.body.fix(side, held)
        self.places = self.body.coordinates[:, 0]
        self.body.displacement[:, 0] = p.pulse(self.places, setting.wavelength)
        self.critical = self.body.critical_step("power")

    def advance(self, steps: int, step: float) -> None:
        """Take steps of `step` s."""
        self.body.advance(steps, step)

    def moved(self) -> np.ndarray:
        """Displacements along the strip, m."""
        return self.body.displacement[:, 0]


class _OfDiscs:
    """A strip that is an assembly, from its start on."""

    def __init__(self, soil: Assembly) -> None:
        self.soil, self.places = soil, soil.reference[:, 0]
        self.critical = soil.critical_step(sharp=True)

    def advance(self, steps: int, step: float) -> None:
        """Take steps of `step` s."""
        self.soil.advance(steps, step)

    def moved(self) -> np.ndarray:
        """Displacements along the strip, m."""
        return self.soil.displacements[:, 0]


class Discs(_OfDiscs):
    """A square lattice, behind it one whose discs have the element size as diameter; or the former alone."""

    def __init__(self, p: Parameters, setting: Setting, alone: bool = False) -> None:
        width = max(1, round(p.width / setting.element)) * setting.element
        edge = 2.0 * p.radius * round(p.inner / (2.0 * p.radius))
        coarse = p.radius if alone else 0.5 * setting.element
        left = packings.square(Box((0.0, 0.0), (edge, width)), p.radius)
        right = packings.square(Box((edge, 0.0), (p.length, width)), coarse)
        kind = np.repeat([0, 1], [len(left), len(right)])
        # one coarse disc touches n fine ones: together as stiff as the body of its height between the two columns
        offsets = p.radius * (2.0 * np.arange(round(coarse / p.radius)) + 1.0) - coarse
        along = p.radius + coarse
        joint = 2.0 * coarse * p.modulus / along / float(np.sum(along**2 / (along**2 + offsets**2)))
        laws = {
            pair: Bonded(k, 0.0, math.inf, math.inf)
            for pair, k in {(0, 0): p.modulus, (1, 1): p.modulus, (0, 1): joint}.items()
        }
        radii = np.where(kind == 0, p.radius, coarse)
        soil = Assembly(np.concatenate([left, right]), radii, p.density * 4.0 / math.pi, laws, materials=kind)
        soil.bond(TO_COARSE)
        soil.hold(np.arange(soil.count), "y")
        pulsed(p, soil, setting.wavelength)
        super().__init__(soil)


class Springs:
    """A row of the cubic lattice that repeats across, behind it a layer of manifold elements and continuum; or the row alone.

    Zhao et al. (2012), section 3.
    """

    def __init__(self, p: Parameters, setting: Setting, alone: bool = False) -> None:
        d = 2.0 * p.radius
        sites = packings.simple_cubic(Box((0.0, 0.0, 0.0), (p.length, d, d)), p.radius)
        row = Lattice(sites, d, LatticeMaterial(p.young_modulus, p.poisson_ratio, p.density), periodic="yz")
        row.displacement[:, 0] = p.pulse(row.reference[:, 0], setting.wavelength)
        self.model: Any = row
        if not alone:
            self.model = Manifold(row, (round(setting.element / d), 1, 1), free=lambda x: x[:, 0] < p.inner)
        self.row, self.places, self.critical = row, row.reference[:, 0], self.model.critical_step

    def advance(self, steps: int, step: float) -> None:
        """Take steps of `step` s."""
        self.model.step = step
        self.model.advance(steps)

    def moved(self) -> np.ndarray:
        """Displacements along the strip, m."""
        if self.model is self.row:
            return self.row.displacement[:, 0]
        return self.model.particle_motion()[0][:, 0]


class Discrete(_OfDiscs):
    """The lattice of discs without cells, which the coupled strips are compared with."""

    def __init__(self, p: Parameters, setting: Setting) -> None:
        soil = lattice(p, p.length, setting.wavelength)
        restrain(p, soil, p.length + p.radius)
        super().__init__(soil)


PAIRS: dict[str, Any] = {"cells": Cells, "discs": Discs, "springs": Springs}
