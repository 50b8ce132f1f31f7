"""Critical step from both sides, stiffness matrix, moduli."""

import numpy as np
import pytest

from particles import Assembly, LiChu, Plate
from particles.measures import moduli
from particles.packing import random_dense
from particles.stability import largest_eigenvalue
from tests.particles.scenes import PAPER, hexagonal_lattice, square_lattice

RADIUS = 0.05


@pytest.mark.parametrize("sliding", [1e6, 5e7, 2e8])
@pytest.mark.parametrize("lattice", ["square", "hexagonal"])
def test_largest_frequency_of_lattices(lattice, sliding):
    """Infinite lattices, k_rot = 0: square max(4 (kN + ks), 16 ks) / m, hexagonal max(6 kN + 2 ks, 24 ks) / m.

    A finite piece lies below by about (pi / cells)^2 / 8 of it; the rigorous bound lies above.
    """
    normal, size = 2.5e8, 24
    positions = (square_lattice if lattice == "square" else hexagonal_lattice)(size, size, RADIUS)
    soil = Assembly(positions, RADIUS, law=LiChu(normal, sliding, sliding_friction=0.5))
    factor = max(4 * (normal + sliding), 16 * sliding) if lattice == "square" else max(6 * normal + 2 * sliding, 24 * sliding)
    exact = 2.0 / np.sqrt(factor / soil.masses[0])
    sharp, bound = soil.critical_step(sharp=True), soil.critical_step()
    assert exact * (1 - 1e-9) <= sharp <= exact * (1 + (np.pi / size) ** 2)
    assert 0.6 * exact < bound <= exact * (1 + 1e-9)


@pytest.mark.parametrize("factor, grows", [(0.98, False), (1.02, True)])
def test_linear_motion_is_bounded_below_the_critical_step_and_grows_above(factor, grows):
    """Prestressed, confined lattice with endless friction: linear; white noise is what the step limit is about."""
    law = LiChu(2.5e8, 5e7, 1e6, 7e2, sliding_friction=1e9, rolling_friction=1e9, moment_friction=1e9)
    soil = Assembly(square_lattice(6, 6, RADIUS), RADIUS * 1.01, law=law)
    soil.add_wall(*Plate.box((-0.99 * RADIUS, -0.99 * RADIUS), (10.99 * RADIUS, 10.99 * RADIUS), 0.5))
    step = factor * soil.critical_step(sharp=True)
    soil.velocities = 1e-7 * np.random.default_rng(0).normal(size=(36, 3))
    soil.advance(400, step)
    speed = np.abs(soil.velocities).max()
    # growth per step above the limit: exp(2 sqrt(2 * 0.02)) = 1.5
    assert (speed > 1e-3) == grows


@pytest.mark.parametrize("factor, grows", [(0.98, False), (1.02, True)])
def test_dashpots_shorten_the_step(factor, grows):
    """A disc pressed between two plates, damping ratio 0.5: the predictor scheme is stable to sqrt(1 + 4 xi^2) - 2 xi."""
    stiffness = 1e7
    soil = Assembly([[0, 0]], 0.05, law=LiChu(stiffness))
    damping = 0.5 * 2 * np.sqrt(2 * stiffness * soil.masses[0]) / 2  # two contacts
    soil = Assembly([[0, 0]], 0.05, law=LiChu(stiffness, normal_damping=damping))
    soil.add_wall(Plate.rectangle((-1, -1), (1, -0.049)), Plate.rectangle((-1, 0.049), (1, 1)))
    frequency = np.sqrt(2 * stiffness / soil.masses[0])
    assert soil.critical_step() == pytest.approx(2 / frequency * (np.sqrt(2.0) - 1.0))
    soil.velocities = [[0, 1e-9, 0]]
    soil.advance(400, factor * soil.critical_step())
    assert (abs(soil.velocities[0, 1]) > 1e-9) == grows


def test_stiffness_matrix_is_symmetric_semidefinite_and_leaves_rigid_motion_free():
    positions, radii = random_dense(((0, 0), (1, 1)), seed=2)
    soil = Assembly(positions, radii, law=PAPER)
    matrix = soil.stiffness_matrix()
    assert abs(matrix - matrix.T).max() < 1e-12 * abs(matrix).max()
    x, y = soil.positions.T
    one, zero = np.ones_like(x), np.zeros_like(x)
    for motion in ([one, zero, zero], [zero, one, zero], [-y, x, one]):
        q = np.column_stack(motion).ravel()
        assert np.abs(matrix @ q).max() < 1e-9 * abs(matrix).max()
    rng = np.random.default_rng(0)
    for q in rng.normal(size=(20, matrix.shape[0])):
        assert q @ matrix @ q > 0


def test_stiffness_matrix_is_the_linearised_force():
    """Trial forces of a small increment from a settled packing, all contacts sticking and none opening: F = -K q."""
    soil = Assembly(hexagonal_lattice(5, 5, 0.0495), 0.05, law=PAPER)
    rows = soil.rows
    still = np.zeros((soil.count, 3))
    base = soil.trial_forces(still, still)[rows]
    increment = 1e-8 * np.random.default_rng(0).normal(size=(soil.count, 3))
    row_increment = np.empty_like(increment)
    row_increment[rows] = increment
    change = soil.trial_forces(row_increment, still)[rows] - base
    # rolling and sliding limits hold: 5e7 * 1e-8 << 0.05 * 2.5e8 * 1e-3; prestress adds a geometric stiffness of delta / 2r
    expected = -(soil.stiffness_matrix() @ increment.ravel()).reshape(-1, 3)
    np.testing.assert_allclose(change, expected, atol=0.05 * np.abs(expected).max())


def test_moduli_of_the_hexagonal_lattice_are_exact():
    """Methods 4.6: lambda = (kN - ks) s, G = (kN + ks) s, Gc = 2 ks s with s = N r^2 / 2V = sqrt(3)/4; B = 2 k_rot N r^2 / V."""
    soil = Assembly(hexagonal_lattice(40, 40, RADIUS), RADIUS, law=PAPER)
    interior = np.flatnonzero(np.bincount(np.concatenate(soil.contacts(contact_range=1e-6)[:2])) == 6)
    area = interior.size * 2 * np.sqrt(3) * RADIUS**2
    elastic, couple = moduli(soil, area, interior)
    share = np.sqrt(3) / 4
    lame, shear, cosserat = share * (2.5e8 - 5e7), share * (2.5e8 + 5e7), 2 * share * 5e7
    delta = np.eye(2)
    expected = (
        lame * np.einsum("ij,kl->ijkl", delta, delta)
        + (shear + cosserat) * np.einsum("ik,jl->ijkl", delta, delta)
        + (shear - cosserat) * np.einsum("il,jk->ijkl", delta, delta)
    )
    np.testing.assert_allclose(elastic, expected, atol=1e-9 * shear)
    rotational = 7e2 + (RADIUS / 2) ** 2 * 1e6
    np.testing.assert_allclose(couple, 4 * share * rotational * delta, atol=1e-9 * rotational)


def test_eigenvalue_of_two_discs():
    """Two discs and a normal spring: omega^2 = 2 k / m."""
    soil = Assembly([[0, 0], [0.1, 0]], 0.05, law=LiChu(1e7))
    value = largest_eigenvalue(soil.stiffness_matrix(1e-6), soil.masses, soil.inertias)
    assert value == pytest.approx(2e7 / soil.masses[0])
    assert soil.critical_step() == pytest.approx(2 / np.sqrt(2e7 / soil.masses[0]))
