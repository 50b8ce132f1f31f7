"""Contacts and masses that count by a share: the same on both sides, energies and losses with it."""

import numpy as np
import pytest

from particles import Assembly, Bonded, HertzMindlin, LiChu
from tests.particles.scenes import ALL, cloud


def pair(law, shares, radii=(0.05, 0.03), axes=2):
    """Two overlapping particles; what each carries."""
    places = np.zeros((2, axes))
    places[1, 0] = sum(radii) - 1e-4
    soil = Assembly(places, radii, law=law)
    if shares is not None:
        soil.weigh(shares, [0.5, 0.25])
    soil.velocities = np.random.default_rng(1).standard_normal(soil.velocities.shape) * 0.1
    return soil


@pytest.mark.parametrize("axes", [2, 3])
@pytest.mark.parametrize("law", [ALL, Bonded(1e7, 5e6, 1e5, 1e5), LiChu(1e7, 5e6, sliding_friction=0.3, normal_damping=50.0)])
def test_forces_are_those_of_the_whole_times_the_share_at_the_contact_point(law, axes):
    """Linear between the centres: (0.8 r_2 + 0.2 r_1) / (r_1 + r_2) = 0.425; forces of the first step."""
    whole, part = pair(law, None, axes=axes), pair(law, [0.8, 0.2], axes=axes)
    for soil in (whole, part):
        soil.prepare(1e-6)
    np.testing.assert_allclose(part.forces, 0.425 * whole.forces, rtol=1e-13, atol=1e-13 * np.abs(whole.forces).max())
    np.testing.assert_allclose(part.masses, whole.masses * [0.5, 0.25])
    elastic = [sum(value for name, value in soil.energies().items() if "elastic" in name) for soil in (whole, part)]
    assert elastic[1] == pytest.approx(0.425 * elastic[0], rel=1e-12)
    dense = [soil.stiffness_matrix().toarray() for soil in (whole, part)]
    np.testing.assert_allclose(dense[1], 0.425 * dense[0], rtol=1e-12)


def test_a_particle_that_counts_whole_makes_its_contacts_count_in_full():
    whole, part = pair(ALL, None), Assembly([[0.0, 0.0], [0.0799, 0.0]], [0.05, 0.03], law=ALL)
    part.weigh([1.0, 0.2], [1.0, 0.25], whole=[True, False])
    for soil in (whole, part):
        soil.velocities = np.zeros((2, 3))
        soil.prepare(1e-6)
    np.testing.assert_allclose(part.forces, whole.forces, rtol=1e-13)


def test_the_dashpot_of_hertz_is_that_of_the_whole_masses():
    """The reduced mass in a law is a property of the contact: of the share only the whole force knows."""
    law = HertzMindlin(5e9, 0.25, restitution=0.6)
    whole, part = pair(law, None, axes=3), pair(law, [0.5, 0.5], axes=3)
    for soil in (whole, part):
        soil.prepare(1e-7)
    np.testing.assert_allclose(part.forces, 0.5 * whole.forces, rtol=1e-12, atol=1e-9 * np.abs(whole.forces).max())


def test_momentum_is_kept_and_energy_accounted_for():
    """Sticking, slipping, opening contacts with dashpots and a share that varies: action is reaction."""
    soil = cloud()
    share = np.random.default_rng(5).uniform(0.05, 1.0, soil.count)
    soil.weigh(share, np.maximum(share, 0.1))
    soil.velocities = soil.velocities
    before, scale = soil.masses @ soil.velocities[:, :2], np.abs(soil.masses[:, None] * soil.velocities[:, :2]).sum()
    errors = []
    start = soil.energies()["kinetic"]
    soil.advance(400, 1e-6)
    assert soil.energies()["friction_sliding"] > 1e-3 * start and soil.energies()["viscous"] > 1e-3 * start
    errors.append(soil.energy_balance())
    np.testing.assert_allclose(soil.masses @ soil.velocities[:, :2], before, rtol=0.0, atol=1e-12 * scale)
    assert abs(errors[0]) < 1e-4 * start


def test_external_forces_count_by_the_share_of_the_particle():
    soil = Assembly([[0.0, 0.0], [1.0, 0.0]], 0.1, law=ALL)
    soil.weigh([1.0, 0.25], [1.0, 0.5])
    soil.external_forces = [[1.0, 2.0, 3.0]] * 2
    soil.prepare(1e-6)
    np.testing.assert_allclose(soil.forces, [[1.0, 2.0, 3.0], [0.25, 0.5, 0.75]])
    soil.weigh([0.5, 0.5], [1.0, 1.0])  # anew, of the whole
    soil.prepare(1e-6)
    np.testing.assert_allclose(soil.forces, [[0.5, 1.0, 1.5]] * 2)


def test_shares_follow_the_particles_when_rows_are_sorted():
    rng = np.random.default_rng(3)
    soil = Assembly(rng.uniform(0.0, 1.0, (200, 2)), 0.02, law=LiChu(1e5))
    share = rng.uniform(0.2, 1.0, 200)
    soil.weigh(share, share)
    masses = soil.masses
    soil.velocities = rng.standard_normal((200, 3)) * 3.0
    generation = soil.generation
    soil.advance(3000, 1e-4)
    assert soil.generation > generation
    np.testing.assert_allclose(soil.masses, masses, rtol=1e-14)
    np.testing.assert_allclose(soil.system.share[soil.rows, 0], share)


@pytest.mark.parametrize("contacts, masses", [([1.2, 0.5], [1.0, 1.0]), ([0.5, 0.5], [0.0, 1.0]), ([-0.1, 0.5], [1.0, 1.0])])
def test_shares_out_of_range_are_refused(contacts, masses):
    with pytest.raises(ValueError, match="shares from"):
        Assembly([[0.0, 0.0], [1.0, 0.0]], 0.1, law=ALL).weigh(contacts, masses)


def test_bonds_stay_when_displacements_are_assigned():
    """A bond knows its length: a displaced start strains it."""
    soil = Assembly([[0.0, 0.0], [0.1, 0.0]], 0.05, law=Bonded(1e7, 0.0, np.inf, np.inf))
    soil.bond(0.01)
    soil.displacements = [[0.0, 0.0, 0.0], [1e-3, 0.0, 0.0]]
    soil.prepare(1e-6)
    np.testing.assert_allclose(soil.forces[0], [1e4, 0.0, 0.0], rtol=1e-9, atol=1e-6)
    assert len(soil.bonds) == 1
