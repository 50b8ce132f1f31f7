"""Spheres on cubic lattices that overlap tetrahedra or hexahedra, for the tests of the overlap coupling in space.

Bonds that are as stiff in shear as along the normal make every cubic lattice isotropic, with Poisson's ratio zero: the sum of
n_i n_k over the bonds of a sphere is a multiple of the unit matrix, and sigma that multiple of the strain: also of the strain of
a Cosserat continuum, whose Gc is then G.
"""

from __future__ import annotations

import numpy as np

from bridge import Overlap, OverlapZone
from continuum import Body, Cauchy, Cosserat, CosseratModuli
from meshes import Box, HalfSpace, domains, packings
from particles import Assembly, Bonded
from particles.measures import moduli

STIFFNESS, DENSITY = 1e8, 2600.0  # N/m, kg/m3 of a sphere
BONDED = Bonded(STIFFNESS, STIFFNESS, np.inf, np.inf)
LATTICES = {  # sites, volume of the lattice for each sphere over (2 r)^3, Young's modulus times r over the stiffness
    "simple": (packings.simple_cubic, 1.0, 0.5),
    "fcc": (packings.face_centred_cubic, np.sqrt(0.5), np.sqrt(2.0)),
}
TIES = [(constraint, rotation) for constraint in ("lagrange", "penalty") for rotation in ("free", "curl", "micro")]


def parts(
    lattice="simple", cell="hexahedron", *, law=BONDED, radius=0.125, faces=(1.0, 2.0), length=3.0, width=1.0, size=0.5,
    anchor=(0.0, 0.0, 0.0), gravity=(0.0, 0.0, 0.0), cosserat=False,
):  # fmt: skip
    """Spheres of a bar on the left, cells on the right; the continuum is that of the lattice (but for couples, in Cosserat's).

    With cosserat="measured" its moduli, couples and all, are those of a sample of the lattice.
    """
    make, volume, modulus = LATTICES[lattice]
    zone = OverlapZone(*(HalfSpace((x, 0.0, 0.0), (1.0, 0.0, 0.0)) for x in faces))
    density = DENSITY * np.pi / 6.0 / volume
    counts = round((length - faces[0]) / size), round(width / size), round(width / size)
    domain = domains.box((faces[0], 0.0, 0.0), (length, width, width), counts, cell)
    young_modulus = modulus * STIFFNESS / radius
    material = Cosserat(young_modulus, 0.0, 0.5 * young_modulus, radius, density) if cosserat else Cauchy(young_modulus, 0.0, density)
    if cosserat == "measured":
        sites = make(Box((0.0, 0.0, 0.0), (12.0 * radius,) * 3), radius)
        inner = np.flatnonzero(np.all(np.abs(sites - 6.0 * radius) < 4.0 * radius, axis=1))
        sample = len(inner) * volume * (2.0 * radius) ** 3
        material = CosseratModuli(*moduli(Assembly(sites, radius, DENSITY, law), sample, inner), density)
    body = Body(domain, material, "physical", radius, share=zone)
    body.gravity(gravity)
    soil = Assembly(make(Box((0.0, 0.0, 0.0), (faces[1], width, width)), radius, anchor=anchor), radius, DENSITY, law)
    if isinstance(law, Bonded):
        soil.bond(0.01)
    return body, soil, zone


def coupled(ratio=0.5, substeps=1, constraint="lagrange", rotation="free", mass_damping=0.0, **scene):
    """The scene with a step that is a part of the critical ones; a Cosserat body where rotations are tied to its own."""
    body, soil, zone = parts(**{"cosserat": rotation == "micro"} | scene)
    ties = {"constraint": constraint, "rotation": rotation, "mass_damping": mass_damping}
    limit = Overlap(body, soil, zone, step=1e-9, **ties).critical_step(sharp=True)
    if substeps > 1:
        limit = min(substeps * limit, body.critical_step("power"))
    return Overlap(body, soil, zone, step=ratio * limit, substeps=substeps, **ties)


def masses(soil):
    return np.hstack([np.repeat(soil.masses[:, None], 3, axis=1), np.repeat(soil.inertias[:, None], 3, axis=1)])


def momentum(made):
    """Of spheres and nodes together, kg m/s."""
    own = made.soil.masses[:, None] * made.soil.velocities[:, :3]
    return own.sum(axis=0) + (made.body.mass * made.body.velocity)[:, :3].sum(axis=0)


def shaken(speed=1e-3, **scene):
    """Nodes beyond the zone in motion; small, so that everything is linear."""
    made = coupled(**scene)
    x, y, z = made.body.coordinates.T
    made.body.velocity[:, 1] = speed * np.sin(2.0 * x + y - z) * (x > 2.1)
    return made
