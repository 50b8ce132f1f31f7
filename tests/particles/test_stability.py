"""Critical step from both sides, stiffness matrix, moduli."""

import numpy as np
import pytest

from particles import Assembly, Bonded, Free, HertzMindlin, LiChu, Plate, Wall, shapes
from particles.measures import moduli
from particles.network import dashpots, stiffnesses
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
    positions, radii = random_dense(((0, 0), (1, 1)), seed=2, nearest=True)
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


def pressed(mass, stiffness=1e8, **free):
    """A disc of radius 0.05 m under a free plate of that mass that overlaps it by 1e-4 m; 0.3 m off its middle."""
    soil = Assembly([[0.3, 0.0]], 0.05, law=LiChu(stiffness))
    soil.add_wall(Plate.rectangle((-1, 0.0499), (1, 0.2), motion=Free(mass, **free)))
    return soil, soil.masses[0]


@pytest.mark.parametrize("share", [1e-3, 1.0, 1e3])
def test_a_free_wall_bounds_the_step_as_the_second_of_two_masses(share):
    """omega^2 = k (1/m + 1/M), and with a plate that may turn k (1/m + 1/M + a^2/I), a its arm; from both estimates."""
    mass = share * 2600.0 * np.pi * 0.05**2
    for free, extra in (({}, 0.0), ({"inertia": 0.02 * mass}, 0.3**2 / (0.02 * mass))):
        soil, disc = pressed(mass, **free)
        exact = 2.0 / np.sqrt(1e8 * (1.0 / disc + 1.0 / mass + extra))
        assert soil.critical_step() == pytest.approx(exact, rel=1e-9)
        assert soil.critical_step(sharp=True) == pytest.approx(exact, rel=1e-9)
    soil, disc = pressed(mass, free="x")  # what is held has no mass that could move
    assert soil.critical_step() == pytest.approx(2.0 / np.sqrt(1e8 / disc), rel=1e-9)


@pytest.mark.parametrize("axes", [2, 3])
def test_free_walls_of_many_contacts_are_bounded_from_the_safe_side(axes):
    """Sliding, rolling, rotation and all contacts of a light body in space: the split masses give no longer a step."""
    law = LiChu(1e7, 5e6, 1e5, 1e2, sliding_friction=0.5, rolling_friction=0.1, moment_friction=1e-3)
    places = 0.0999 * np.stack(np.meshgrid(*[np.arange(3)] * (axes - 1), [0], indexing="ij"), axis=-1).reshape(-1, axes)
    soil = Assembly(places, 0.05, law=law)
    low, high = (-0.1,) * (axes - 1) + (0.0499,), (0.35,) * (axes - 1) + (0.06,)
    inertia = 1e-4 if axes == 2 else np.array([[2e-4, 1e-5, 0], [1e-5, 3e-4, 0], [0, 0, 1e-4]])
    soil.add_wall(Wall(shapes.box(low, high), motion=Free(0.05, inertia), centre=(0.02,) * axes))
    bound, sharp = soil.critical_step(), soil.critical_step(sharp=True)
    fixed = Assembly(places, 0.05, law=law)
    fixed.add_wall(Wall(shapes.box(low, high)))
    assert bound <= sharp * (1 + 1e-9) < 0.1 * fixed.critical_step()
    assert soil.stiffness_matrix(walls=True).shape == (soil.count * soil.freedoms,) * 2
    np.testing.assert_allclose(
        soil.stiffness_matrix(walls=True).toarray(), fixed.stiffness_matrix(walls=True).toarray(), rtol=1e-12
    )


@pytest.mark.parametrize("factor, grows", [(0.98, False), (1.02, True)])
def test_motion_of_a_light_lid_grows_beyond_the_critical_step(factor, grows):
    """A disc pressed onto a floor by a loaded lid of a hundredth of its mass: linear, two masses, two springs."""
    k, load = 1e8, 1e4
    soil = Assembly([[0.0, 0.0]], 0.05, law=LiChu(k))
    mass = 0.01 * soil.masses[0]
    lid = Plate.rectangle((-1, 0.05 - load / k), (1, 0.1), motion=Free(mass, load={"y": -load}))
    soil.add_wall(Plate.rectangle((-1, -1), (1, -0.05 + load / k)), lid)
    disc = soil.masses[0]
    exact = np.linalg.eigvalsh(np.array([[2 * k / disc, -k / np.sqrt(disc * mass)], [-k / np.sqrt(disc * mass), k / mass]]))[-1]
    assert soil.critical_step(sharp=True) == pytest.approx(2.0 / np.sqrt(exact), rel=1e-9)
    lid.velocity = (0.0, 1e-9)
    soil.advance(400, factor * soil.critical_step(sharp=True))
    assert (abs(lid.velocity[1]) > 1e-8) == grows


def test_unbonded_contacts_have_no_bending_in_the_step():
    """Bonded pair: omega^2 = 2 k_b / J is the largest here; unbonded only 2 k / m is left; a bond that breaks goes the same way."""
    law = Bonded(1e6, 0.0, 100.0, 1e9, bending_stiffness=1e6)
    soil = Assembly([[0, 0], [0.0999, 0]], 0.05, law=law)
    plain = 2.0 / np.sqrt(2e6 / soil.masses[0])
    assert soil.critical_step() == pytest.approx(plain)
    assert soil.critical_step(sharp=True) == pytest.approx(plain)
    soil.bond(0.02)
    beam = 2.0 / np.sqrt(2e6 / soil.inertias[0])
    assert soil.critical_step() == pytest.approx(beam)
    assert soil.critical_step(sharp=True) == pytest.approx(beam)
    soil.velocities = [[0, 0, 1.0], [0, 0, -1.0]]
    soil.advance(10, 0.1 * beam)
    assert np.abs(soil.forces[:, 2]).max() > 1.0
    for pull in (1e-3, -1e-3):  # the bond breaks at 0.1 mm; back in contact
        soil.displacements = soil.displacements + [[0, 0, 0], [pull, 0, 0]]
        soil.advance(10, 0.1 * beam)
    assert len(soil.bonds) == 0
    assert soil.critical_step() == pytest.approx(plain)
    np.testing.assert_array_equal(soil.forces[:, 2], 0.0)  # a contact that rolls without a moment


def test_dashpots_of_hertz_against_a_free_wall_know_its_mass():
    """c = 2 sqrt(5/6) beta sqrt(S m*), with the m* that the loops use: 1 / (1/m + 1/M), and m where the wall is held."""
    law = HertzMindlin(1e7, 0.2, restitution=0.5)
    for motion, share in ((Free(0.5), True), (None, False)):
        soil = Assembly([[0.0, 0.0, 0.0]], 0.05, law=law)
        soil.add_wall(Wall(shapes.box((-1, -1, 0.0499), (1, 1, 0.1)), motion=motion))
        found = soil.contacts(walls=True)
        mass = 1.0 / (1.0 / soil.masses[0] + share / 0.5)
        stiffness = stiffnesses(soil, found)[0, 0]
        assert dashpots(soil, found)[0, 0] == pytest.approx(law.damping_factor * np.sqrt(stiffness * mass))
