"""Bonded lattices that carry the waves of a strip with restrained sides: square and hexagonal."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from meshes import Box, packings
from particles import Assembly, Bonded
from studies.interface import Parameters

REACH = 0.01  # of bonds, as a share of the distance


def lattice(p: Parameters, end: float, wavelength: float, kept: Any = slice(None)) -> Assembly:
    """Lattice from x = 0 to `end` (m), or its sites that are `kept`, with the pulse at rest; its mass fills the strip."""
    soil = (_square if p.lattice == "square" else _hexagonal)(p, end, kept)
    soil.bond(REACH)
    pulsed(p, soil, wavelength)
    return soil


def pulsed(p: Parameters, soil: Assembly, wavelength: float) -> None:
    """Give particles at rest the displacement of the pulse."""
    moved = np.zeros((soil.count, 3))
    moved[:, 0] = p.pulse(soil.reference[:, 0], wavelength)
    soil.displacements = moved


def restrain(p: Parameters, soil: Assembly, end: float) -> None:
    """Hold the outermost rows across the strip, as far as x < `end` (m)."""
    reach = 1.5 * p.radius if p.lattice == "square" else 0.5 * p.radius
    side = np.abs(soil.reference[:, 1] - 0.5 * p.strip_width) > 0.5 * p.strip_width - reach
    soil.hold(
        np.flatnonzero(side & (soil.reference[:, 0] < end - 0.1 * p.radius)), "y" if p.lattice == "square" else "yr"
    )


def _square(p: Parameters, end: float, kept: Any) -> Assembly:
    """Rows without shear stiffness, k_n = rho c^2: the wave is that of a chain, whatever the contraction."""
    law = Bonded(p.modulus, 0.0, math.inf, math.inf)
    sites = packings.square(Box((0.0, 0.0), (end, p.strip_width)), p.radius)[kept]
    return Assembly(sites, p.radius, p.density * 4.0 / math.pi, law)


def _hexagonal(p: Parameters, end: float, kept: Any) -> Assembly:
    """Rows along x; isotropic, with lambda + G = (sqrt 3 / 2) k_n and k_t = (1 - 4 nu) k_n (plane strain).

    The sides are rows, mirrors of the infinite lattice: their particles have half the mass and half the bonds along the row,
    and neither turn nor move across.
    """
    nu = p.poisson_ratio
    normal = p.young_modulus / (2.0 * (1.0 + nu) * (1.0 - 2.0 * nu)) * 2.0 / math.sqrt(3.0)
    shear = max((1.0 - 4.0 * nu) * normal, 1e-12 * normal)
    whole, half = (Bonded(part * normal, part * shear, math.inf, math.inf) for part in (1.0, 0.5))
    pad = 1e-6 * p.radius
    box = Box((-pad, -pad), (end + pad, p.strip_width + pad))
    sites = packings.hexagonal(box, p.radius, anchor=(0.0, 0.0))[kept]
    side = np.abs(sites[:, 1] - 0.5 * p.strip_width) > 0.5 * p.strip_width - 0.5 * p.radius
    density = np.where(side, 0.5, 1.0) * p.density * 2.0 * math.sqrt(3.0) / math.pi
    laws = {(0, 0): whole, (0, 1): whole, (1, 1): half}
    return Assembly(sites, p.radius, density, laws, materials=side.astype(int))
