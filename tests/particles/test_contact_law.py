"""The contact law and its kinematics: objectivity, action and reaction, closed forms of impacts, limits."""

import numpy as np
import pytest

from particles import Assembly, LiChu, Plate
from particles.network import evaluate
from tests.particles.scenes import ALL, PAPER


def _pair(law=ALL, radii=(0.05, 0.03), overlap=1e-4, angle=0.3, swap=False):
    distance = sum(radii) - overlap
    positions = np.array([[0.0, 0.0], distance * np.array([np.cos(angle), np.sin(angle)])]) + [0.2, -0.1]
    order = [1, 0] if swap else [0, 1]
    return Assembly(positions[order], np.array(radii)[order], law=law)


def _jump(soil, places, turn):
    """Move discs to new places in one step of unit size and evaluate; forces in id order."""
    rows = soil.rows
    system, terms = soil.prepare(1.0)
    increment = np.column_stack([places - soil.positions, turn * np.ones(soil.count)])
    system.velocity[rows, :3] = increment
    system.position[rows, :2] = places
    system.acceleration[:] = 0.0
    evaluate(system, terms, 1.0, None, None)
    return soil.forces


@pytest.mark.parametrize("turn", [1e-6, 0.02, 0.04, 1.0, 3.0])
def test_rigid_rotation_by_any_angle_in_one_step_causes_no_tangential_force(turn):
    law = LiChu(2.5e8, 5e7, 1e6, 7e2, sliding_friction=1e9, rolling_friction=1e9, moment_friction=1e9)
    soil = _pair(law)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    places = soil.positions @ rotation.T
    normal = (places[1] - places[0]) / np.linalg.norm(places[1] - places[0])
    forces = _jump(soil, places, turn)
    spring = 2.5e8 * 1e-4
    # rounding: positions of order 0.2 at 1e-16 times the stiffness 2.5e8; the series of the angle is good to 1e-13
    np.testing.assert_allclose(forces[0, :2], -spring * normal, atol=spring * 1e-10)
    np.testing.assert_allclose(forces[:, 2], 0.0, atol=5e7 * 0.08 * 1e-12)


def test_exchange_of_labels_exchanges_the_forces():
    results = []
    for swap in (False, True):
        soil = _pair(ALL, overlap=1e-4, swap=swap)
        order = [1, 0] if swap else [0, 1]
        soil.velocities = np.array([[0.3, -0.2, 5.0], [-0.4, 0.6, -9.0]])[order]
        soil.advance(40, 1e-6)
        results.append((soil.forces[order], soil.displacements[order]))
    np.testing.assert_allclose(results[0][0], results[1][0], rtol=1e-11)
    np.testing.assert_allclose(results[0][1], results[1][1], rtol=1e-11)


def test_rolling_drives_couples_of_the_stated_size():
    """A relative rotation below the limits gives M = (k_w + R'^2 k_r) phi on j, the opposite on i, and no force."""
    law = LiChu(2.5e8, 0.0, 1e6, 7e2, rolling_friction=1e9, moment_friction=1e9)
    soil = _pair(law, overlap=0.001)
    system, terms = soil.prepare(1.0)
    rows, phi = soil.rows, 1e-3
    arms = np.array([0.05, 0.03]) - 0.0005
    radius = arms.prod() / arms.sum()
    before = soil.forces[:, :2]
    system.velocity[rows, 2] = [phi, 0.0]
    evaluate(system, terms, 1.0, None, None)
    expected = (7e2 + radius**2 * 1e6) * phi
    np.testing.assert_allclose(soil.forces[:, 2], [-expected, expected], rtol=1e-12)
    np.testing.assert_allclose(soil.forces[:, :2], before, rtol=1e-12)


def test_literal_rolling_force_breaks_the_energy_balance_and_the_torque_pair_does_not():
    """Methods E-LW-3: a force driven by relative rotation creates or destroys energy whatever the step."""
    from dataclasses import replace

    strong = replace(PAPER, rolling_stiffness=5e7, rolling_friction=0.5)
    errors = {}
    for kind in ("torque", "contact"):
        soil = _pair(replace(strong, rolling_force=kind), overlap=-1e-5)
        soil.velocities = [[1.0, 0.5, 40.0], [0.0, 0.0, 10.0]]
        start = soil.energies()["kinetic"]
        soil.advance(2000, 5e-7)
        errors[kind] = abs(soil.energy_balance()) / start
    assert errors["torque"] < 1e-5
    assert errors["contact"] > 1e-3


def test_restitution_of_a_head_on_impact():
    """Linear spring and dashpot that lets go when the force would turn to tension (closed form by the oscillator)."""
    stiffness, radius = 1e7, 0.05
    soil_mass = 2600 * np.pi * radius**2
    reduced = soil_mass / 2
    ratio = 0.2
    damping = 2 * ratio * np.sqrt(stiffness * reduced)
    soil = Assembly([[0, 0], [0.1, 0]], radius, law=LiChu(stiffness, normal_damping=damping))
    soil.velocities = [[0.5, 0, 0], [-0.5, 0, 0]]
    frequency = np.sqrt(stiffness / reduced)
    soil.advance(4000, 2 * np.pi / frequency / 4000)
    # force zero at tan(w_d t) = 2 xi w_d / (w (2 xi^2 - 1)); speed there relative to the approach speed
    damped = np.sqrt(1 - ratio**2)
    time = (np.pi - np.arctan2(2 * ratio * damped, 1 - 2 * ratio**2)) / damped
    expected = np.exp(-ratio * time)
    # the dashpot sets in with a jump, somewhere within a step: error of first order, 2 pi / 4000
    assert soil.velocities[1, 0] == pytest.approx(0.5 * expected, rel=1.5e-3)


def test_oblique_impact_that_slides_throughout():
    """Impulse J = 2 m v_n, friction takes mu J from the tangential momentum and gives mu J r of spin."""
    radius, friction = 0.05, 0.1
    soil = Assembly([[0, radius]], radius, law=LiChu(1e8, 5e7, sliding_friction=friction))
    soil.add_wall(Plate.rectangle((-1, -1), (1, 0)))
    soil.velocities = [[20.0, -1.0, 0.0]]
    mass, inertia = soil.masses[0], soil.inertias[0]
    soil.advance(4000, 1.1 * np.pi * np.sqrt(mass / 1e8) / 4000)
    velocity = soil.velocities[0]
    # the contact opens within a step: error of first order, 1 / 4000
    assert velocity[1] == pytest.approx(1.0, rel=1e-3)
    assert velocity[0] == pytest.approx(20.0 - 2 * friction, rel=1e-4)
    # the arm is shorter than the radius by the overlap, up to 0.9 %; the disc rolls forward: clockwise
    assert velocity[2] == pytest.approx(-2 * friction * mass * radius / inertia, rel=0.01)


def test_oblique_impact_that_sticks():
    """Without limit and with k_s such that half the tangential period (effective mass m/3) fits: slip velocity turns round."""
    radius, normal = 0.05, 1e8
    soil = Assembly([[0, radius]], radius, law=LiChu(normal, normal / 3, sliding_friction=1e9))
    soil.add_wall(Plate.rectangle((-1, -1), (1, 0)))
    soil.velocities = [[0.5, -1e-2, 0.0]]
    mass = soil.masses[0]
    soil.advance(8000, 1.01 * np.pi * np.sqrt(mass / normal) / 8000)
    vx, _, spin = soil.velocities[0]
    # slip v_x + r spin goes from 0.5 to -0.5 and v_x changes by a third of that change
    assert vx + radius * spin == pytest.approx(-0.5, rel=2e-3)
    assert vx == pytest.approx(0.5 - 1.0 / 3.0, rel=2e-3)


def test_tangential_force_never_exceeds_the_limits():
    soil = _pair(ALL, overlap=2e-4)
    soil.velocities = [[0.0, 3.0, 50.0], [0.0, -3.0, -80.0]]
    for _ in range(50):
        soil.advance(4, 1e-6)
        found = soil.contacts()
        if found.first.size:
            normal = ALL.normal_stiffness * found.overlap
            bounds = normal * [ALL.sliding_friction] + 1e-9
            # limits use the total normal force, the elastic one plus the dashpot's
            approach = abs(ALL.normal_damping * 10.0)
            assert (abs(found.history["sliding"][:, 0]) <= bounds + ALL.sliding_friction * approach).all()


@pytest.mark.parametrize(
    "change, message",
    [
        ({"normal_stiffness": -1}, "normal_stiffness=-1"),
        ({"normal_stiffness": 0.0}, "must be positive"),
        ({"sliding_friction": float("nan")}, "sliding_friction=nan"),
        ({"rolling_length": "long"}, "rolling_length='long'"),
        ({"rolling_force": "pair"}, "rolling_force='pair'"),
    ],
)
def test_bad_constants_are_named(change, message):
    with pytest.raises(ValueError, match=message):
        LiChu(**{"normal_stiffness": 1.0, **change})
