"""Plates: faces and corners, reaction, rolling on a plate, prescribed motion, bad input."""

import numpy as np
import pytest

from particles import Assembly, LiChu, Plate
from tests.particles.scenes import ALL, PAPER

FLOOR = ((-5.0, -1.0), (5.0, 0.0))


def test_closest_point_on_faces_corners_and_inside():
    cases = {
        (0.5, 1.3): (0, -1, 0.3),  # above a face
        (-0.2, 0.4): (1, 0, 0.2),
        (1.3, 1.4): (-0.6, -0.8, 0.5),  # off a corner
        (0.9, 0.5): (-1, 0, -0.1),  # inside: pushed out by the nearest face
    }
    for point, expected in cases.items():
        soil = Assembly([point], 0.6, law=PAPER)
        soil.add_wall(Plate.rectangle((0, 0), (1, 1)))
        found = soil.contacts(walls=True)
        assert len(found.first) == 1
        assert (*found.normal[0], found.first_arm[0]) == pytest.approx(expected)


def test_disc_at_rest_on_a_floor_and_reaction_on_the_plate():
    soil = Assembly([[0.3, 0.05]], 0.05, law=PAPER)
    floor = Plate.rectangle(*FLOOR)
    soil.add_wall(floor)
    soil.advance(20000, 2e-5, mass_damping=300.0, gravity=(0, -9.81))
    weight = soil.masses[0] * 9.81
    assert -soil.displacements[0, 1] == pytest.approx(weight / PAPER.normal_stiffness, rel=1e-6)
    # moment about the reference point (0, -0.5): force (0, -weight) at x = 0.3
    np.testing.assert_allclose(floor.force, [0, -weight, -0.3 * weight], rtol=1e-6, atol=1e-9 * weight)


@pytest.mark.parametrize("slope, sticks", [(0.2, True), (0.8, False)])
def test_disc_on_a_slope_rolls_or_slides(slope, sticks):
    """Rolling: a = 2/3 g sin(slope) as long as tan(slope) < 3 mu; else g (sin - mu cos) and spin 2 mu g cos / r."""
    friction = 0.5 if sticks else 0.2
    law = LiChu(1e8, 5e7, normal_damping=1e3, sliding_damping=1e3, sliding_friction=friction)
    soil = Assembly([[0.0, 0.05]], 0.05, law=law)
    soil.add_wall(Plate.rectangle(*FLOOR))
    g = 9.81 * np.array([np.sin(slope), -np.cos(slope)])
    settle, steps, step = 4000, 4000, 2e-5
    soil.advance(settle, step, gravity=g)
    before = soil.velocities[0]
    soil.advance(steps, step, gravity=g)
    rate = (soil.velocities[0] - before) / (steps * step)
    if sticks:
        expected = 2 / 3 * g[0], -2 / 3 * g[0] / 0.05
    else:
        expected = g[0] + friction * g[1], 2 * friction * g[1] / 0.05
    assert (rate[0], rate[2]) == pytest.approx(expected, rel=5e-3)


def test_rolling_moment_slows_a_rolling_disc():
    """Friction couple mu_w N on a disc that rolls without sliding: deceleration mu_w g / (3/2 r)."""
    law = LiChu(1e8, 5e7, 0.0, 7e3, normal_damping=1e3, sliding_damping=1e3, sliding_friction=0.5, moment_friction=1e-3)
    soil = Assembly([[0.0, 0.05 - 1e-9]], 0.05, law=law)
    soil.add_wall(Plate.rectangle(*FLOOR))
    soil.velocities = [[1.0, 0.0, -20.0]]
    soil.advance(2000, 2e-5, gravity=(0, -9.81))
    before = soil.velocities[0]
    soil.advance(4000, 2e-5, gravity=(0, -9.81))
    rate = (soil.velocities[0, 0] - before[0]) / 0.08
    assert rate == pytest.approx(-1e-3 * 9.81 / (1.5 * 0.05), rel=2e-2)


def test_action_and_reaction_with_a_plate_including_moment():
    """Plate and disc together conserve linear and angular momentum, at faces and at corners, with all channels."""
    for place in ([0.2, 0.0495], [-0.03, 0.0385]):
        soil = Assembly([place], 0.05, law=ALL)
        plate = Plate([(0, -1), (1, -1), (1, 0), (0, 0)], velocity=(0.5, 0.1))
        soil.add_wall(plate)
        soil.velocities = [[1.0, -0.5, 30.0]]
        soil.advance(20, 1e-6)
        force, reaction = soil.forces[0], plate.force
        assert np.abs(force).min() > 0
        np.testing.assert_allclose(force[:2], -reaction[:2], rtol=1e-12)
        arm = soil.positions[0]
        about = plate.reference_point + plate.displacement
        total = force[2] + arm[0] * force[1] - arm[1] * force[0]
        total += reaction[2] + about[0] * reaction[1] - about[1] * reaction[0]
        assert total == pytest.approx(0.0, abs=1e-10 * np.abs(force[:2]).max())


def test_corner_contact_is_radial_and_turning_about_the_corner_is_free():
    law = LiChu(1e8, 5e7, sliding_friction=1e9)
    radius, overlap = 0.05, 1e-4
    direction = np.array([-0.6, 0.8])
    soil = Assembly([direction * (radius - overlap)], radius, law=law)
    soil.add_wall(Plate.rectangle((0, -1), (1, 0)))
    soil.advance(1, 1e-12)
    np.testing.assert_allclose(soil.forces[0, :2], 1e8 * overlap * direction, rtol=1e-6)
    # carry the disc around the corner like a rigid body: no sliding force
    rate, h = 2.0, 1e-4
    soil.hold([0], "xyr")
    for _ in range(100):
        x, y = soil.positions[0]
        turned = np.array([x, y]) @ np.array([[np.cos(rate * h), np.sin(rate * h)], [-np.sin(rate * h), np.cos(rate * h)]])
        soil.velocities = [[*((turned - (x, y)) / h), rate]]
        soil.advance(1, h)
    assert abs(soil.contacts(walls=True).history["sliding"][0, 0]) < 5e7 * overlap * 1e-6


def test_driven_plate_follows_its_function_and_books_its_work():
    soil = Assembly([[0.0, 0.05]], 0.05, law=ALL)
    lid = Plate.rectangle((-1, 0.1), (1, 0.2), velocity=lambda t: (0.0, -0.01 * np.sin(100 * t)))
    soil.add_wall(Plate.rectangle(*FLOOR), lid)
    soil.advance(700, 2e-5)
    soil.advance(1000, 2e-5)
    time = 1700 * 2e-5
    # the midpoint rule errs by (100 h)^2 / 24
    assert lid.displacement[1] == pytest.approx(-1e-4 * (1 - np.cos(100 * time)), rel=1e-6)
    assert lid.work == pytest.approx(soil.energies()["wall_work"])
    assert abs(soil.energy_balance()) < 1e-3 * lid.work


def test_smooth_plate_leaves_the_spin_alone():
    soil = Assembly([[0.0, 0.0495]], 0.05, law=ALL)
    soil.add_wall(Plate.rectangle(*FLOOR, frictionless=True))
    soil.velocities = [[1.0, 0.0, 5.0]]
    soil.advance(100, 1e-6)
    assert tuple(soil.velocities[0, [0, 2]]) == (1.0, 5.0)


@pytest.mark.parametrize(
    "corners, velocity, message",
    [
        ([(0, 0), (0, 1), (1, 0)], (0, 0), "counter-clockwise"),
        ([(0, 0), (1, 0)], (0, 0), r"shape \(2, 2\)"),
        ([(0, 0), (1, 0), (float("nan"), 1)], (0, 0), "finite"),
        ([(0, 0), (1, 0), (0, 1)], (0, float("inf")), "velocity="),
    ],
)
def test_bad_plates_are_named(corners, velocity, message):
    with pytest.raises(ValueError, match=message):
        Plate(corners, velocity)
