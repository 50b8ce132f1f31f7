"""Small scenes for the overlap coupling: a strip of particles on the left, of cells on the right, a zone between them."""

from __future__ import annotations

import numpy as np

from bridge import Overlap, OverlapZone
from bridge.linear import LinearSystem
from continuum import Body, Cauchy, CosseratModuli
from meshes import Box, HalfPlane, domains
from particles import Assembly
from tests.bridge.scenes import ELASTIC, cell_area, lattice, lattice_moduli

RADIUS = 0.125
LENGTH, HEIGHT = 5.0, 2.0  # m
FACES = 1.0, 3.0  # x of the inner and the outer face


def faces(first=FACES[0], second=FACES[1], profile="linear"):
    return OverlapZone(HalfPlane((first, 0.0), (1.0, 0.0)), HalfPlane((second, 0.0), (1.0, 0.0)), profile)


def parts(
    kind="square", *, radius=RADIUS, law=ELASTIC, cell="quadrilateral", size=0.5, anchor=(0.0, 0.0), cosserat=True,
    gravity=(0.0, 0.0), fixed=(),
):  # fmt: skip
    """Body, particles and zone; a Cosserat continuum has the moduli of the lattice."""
    zone = faces()
    stiffness, couple = lattice_moduli(kind, radius, law)
    density = 2600.0 * np.pi * radius**2 / cell_area(kind, radius)
    material = CosseratModuli(stiffness, couple, density) if cosserat else Cauchy(2e8, 0.1, density)
    counts = round((LENGTH - FACES[0]) / size), round(HEIGHT / size)
    body = Body(domains.rectangle((FACES[0], 0.0), (LENGTH, HEIGHT), counts, cell), material, share=zone)
    for side, directions in fixed:
        body.fix(side, directions)
    body.gravity(gravity)
    soil = Assembly(lattice(kind, Box((0.0, 0.0), (FACES[1], HEIGHT)), radius, anchor), radius, 2600.0, law)
    return body, soil, zone


def coupled(kind="square", *, ratio=0.5, substeps=1, constraint="lagrange", rotation=None, penalty=4.0, mass_damping=0.0, vector_damping=None, **scene):  # fmt: skip
    """The scene with a step that is a part of the critical ones."""
    body, soil, zone = parts(kind, **scene)
    ties = {"constraint": constraint, "rotation": rotation, "penalty": penalty, "mass_damping": mass_damping, "vector_damping": vector_damping}
    limit = Overlap(body, soil, zone, step=1e-9, **ties).critical_step(sharp=True)
    if substeps > 1:
        limit = min(substeps * limit, body.critical_step("power"))
    return Overlap(body, soil, zone, step=ratio * limit, substeps=substeps, **ties)


def masses(made):
    """What moves with each particle (n, 3), kg and kg m2."""
    return np.column_stack([made.soil.masses, made.soil.masses, made.soil.inertias])


def momentum(made):
    """Of particles and nodes together, kg m/s."""
    own = masses(made)[:, :2] * made.soil.velocities[:, :2]
    return own.sum(axis=0) + (made.body.mass * made.body.velocity)[:, :2].sum(axis=0)


def one_step(made, ground=1e-6):
    """Matrix of one coarse step of the linear system, for displacements, velocities and accelerations of everything."""
    soil = made.soil
    stiffness = soil.stiffness_matrix(contact_range=1e-6).tolil()
    # what no contact holds would drift
    turning = np.column_stack([np.ones((soil.count, 2)), soil.inertias / soil.masses]).ravel()
    stiffness.setdiag(stiffness.diagonal() + ground * abs(stiffness).max() * turning)
    with LinearSystem(made, stiffness.tocsr(), 10.0 * made.step) as linear:
        columns = []
        for unit in np.eye(len(linear.read())):
            linear.write(unit)
            linear.step()
            columns.append(linear.read())
    return np.array(columns).T


def spectral_radius(made):
    return np.abs(np.linalg.eigvals(one_step(made))).max()
