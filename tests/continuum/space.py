"""Bodies of tetrahedra and hexahedra that the tests in space share."""

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from continuum import Body, Cauchy, Cosserat
from meshes import domains

ROCK = Cauchy(18e9, 0.25, 2600.0)
GRAINS = Cosserat(18e9, 0.25, 2.4e9, 0.2, 2600.0, couple_alpha=-7e7, couple_beta=9e7)  # gamma = 2.88e8 N
SIZE, CELLS = np.array([2.0, 1.5, 1.0]), (4, 3, 3)  # m


def distorted_box(cell, amount=0.2):
    """Box whose inner nodes are moved by up to `amount` of a cell in each direction."""
    domain = domains.box((0, 0, 0), SIZE, CELLS, cell)
    points = domain.mesh.geometry.x.copy()
    inner = within(points)
    for axis in range(3):
        wave = np.sin(13.0 * points[:, 0] + 7.0 * points[:, 1] - 5.0 * points[:, 2] + 2.0 * axis)
        domain.mesh.geometry.x[inner, axis] += amount * SIZE[axis] / CELLS[axis] * wave[inner]
    return domain


def within(points):
    """Points (n, 3) that do not lie on the surface."""
    return np.all((points > 1e-9) & (points < SIZE - 1e-9), axis=1)


def distorted_body(cell, material=ROCK, **options):
    return Body(distorted_box(cell), material, **options)


def dense_stiffness(body):
    """Stiffness as an array, column by column from internal forces."""
    return np.array([body.internal_force(row.reshape(body.mass.shape)).ravel() for row in np.eye(body.mass.size)])


def solve(body, prescribed):
    """Displacements in equilibrium, with `prescribed` values on the fixed components and the body's loads."""
    stiffness, fixed = body.stiffness_matrix(np.arange(body.count)).tocsc(), body.fixed.ravel()
    moved = np.where(fixed, prescribed.ravel(), 0.0)
    force = body.external_force().ravel() - stiffness @ moved
    moved[~fixed] = spsolve(stiffness[~fixed][:, ~fixed], force[~fixed])
    body.displacement[:] = moved.reshape(body.mass.shape)


every_damping = pytest.mark.parametrize("damping", [{}, {"mass_damping": 3000.0}, {"local_damping": 0.4}])


def check_energy_account(body, damping):
    """A body with everything that does work: what damping takes counts, and the balance closes to rounding."""
    body.advance(200, 0.7 * body.critical_step("power"), **damping)
    energies = body.energies()
    for name in damping:
        assert energies[name] > 0.01 * abs(energies["external_work"])
    assert energies["strain"] > 0 and energies["kinetic"] > 0
    assert abs(energies["balance"]) < 1e-12 * abs(energies["external_work"])
