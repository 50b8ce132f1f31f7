"""Settling, local damping by vectors, walls at a strain rate, inertial number."""

import numpy as np
import pytest

from particles import Assembly, LiChu, Plate
from particles.driving import NotSettled, inertial_number, is_quasi_static, settle, strain_velocity, unbalanced

LAW = LiChu(1e7, 5e6, sliding_friction=0.5)
RADIUS, COUNT = 0.05, 8


def stack(axes, count=COUNT):
    """Particles one upon another, the lowest held; gravity acts along the last axis."""
    places = np.zeros((count, axes))
    places[:, -1] = 2 * RADIUS * np.arange(count)
    soil = Assembly(places, RADIUS, 2600.0, LAW)
    soil.hold([0])
    return soil


@pytest.mark.parametrize("axes, damping", [(2, "local"), (2, "adaptive"), (3, "adaptive")])
def test_a_stack_settles_under_its_weight(axes, damping):
    """Each contact carries the weight above: overlap = number above m g / k."""
    soil = stack(axes)
    gravity = (0.0,) * (axes - 1) + (-9.81,)
    step = 0.4 * soil.critical_step()
    found = settle(soil, step, 1e-4, damping, gravity=gravity)
    weight = soil.masses[0] * 9.81
    overlap = 2 * RADIUS - np.diff(soil.positions[:, -1])
    # mean resultant of 1e-4 times the mean contact force; up to seven of them add up
    np.testing.assert_allclose(overlap, weight * np.arange(COUNT - 1, 0, -1) / 1e7, atol=7 * 1e-4 * 4 * weight / 1e7)
    assert found.unbalanced.mean <= 1e-4 and found.unbalanced.mean <= found.unbalanced.largest
    # lowest frequency of a column: about pi / 2n sqrt(k / m); a factor of e every 1 / w takes ln(1e4) = 9 of them
    lowest = np.pi / (2 * (COUNT - 0.5)) * np.sqrt(1e7 / soil.masses[0])
    assert found.steps * step < 60.0 / lowest
    if damping == "adaptive":
        assert found.mass_damping == pytest.approx(2 * lowest, rel=0.5)
    assert np.abs(soil.energy_balance()) < 1e-2 * soil.energies()["gravity_work"]


def test_what_does_not_settle_says_how_far_it_came():
    soil = stack(2)
    with pytest.raises(NotSettled, match=r"unbalanced force ratio \S+ \(largest \S+\) after 100 steps .* tolerance=1e-09"):
        settle(soil, 0.4 * soil.critical_step(), 1e-9, most=100, gravity=(0.0, -9.81))
    for change, message in (({"tolerance": 0.0}, "tolerance=0"), ({"damping": "none"}, "damping='none'"), ({"every": 0}, "every=0")):
        with pytest.raises(ValueError, match=message):
            settle(soil, 1e-6, **change)


def test_unbalanced_ratios_of_known_forces():
    """Three in a row, overlaps of 1 and 3: resultants 1, 2, 3 over a mean contact force of 2."""
    positions = [[0.0, 0.0], [0.1 - 1e-5, 0.0], [0.2 - 4e-5, 0.0]]
    # as many terms as in the stack, which share its compiled code: next to no gravity, a held rotation
    loads = {"local_damping": 0.7, "gravity": (0.0, -1e-12)}
    soil = Assembly(positions, RADIUS, 2600.0, LAW)
    soil.hold([0], "r")
    soil.prepare(1e-6, **loads)
    assert unbalanced(soil) == pytest.approx((1.0, 1.5))
    soil.hold([2])
    soil.prepare(1e-6, **loads)
    assert unbalanced(soil) == pytest.approx((0.75, 1.0))
    lone = Assembly([[0.0, 0.0]], RADIUS, 2600.0, LAW)
    lone.hold([0], "r")
    assert unbalanced(lone) == (0.0, 0.0)
    lone.prepare(1e-6, **loads)
    assert unbalanced(lone) == (np.inf, np.inf)


@pytest.mark.parametrize("axes", [2, 3])
def test_vector_damping_acts_against_the_velocity_whatever_the_axes(axes):
    """A free particle pushed along its way gains (1 - alpha) F, one pushed against it loses (1 + alpha) F; rotations alike."""
    direction = np.array([0.6, 0.8, 0.0])[:axes]
    alpha, alpha_r, steps, step = 0.6, 0.3, 50, 1e-4
    soil = Assembly(np.outer([0.0, 1.0], np.ones(axes)), RADIUS, 2600.0, LAW)
    velocity = np.zeros((2, soil.freedoms))
    velocity[:, :axes], velocity[:, -1] = direction, 2.0
    soil.velocities = velocity
    force = np.zeros_like(velocity)
    force[:, :axes], force[:, -1] = np.outer([3.0, -3.0], direction), [0.01, -0.01]
    soil.external_forces = force
    soil.advance(steps, step, vector_damping=(alpha, alpha_r))
    time, ratio = steps * step, np.array([1 - alpha, 1 + alpha])
    turn = np.array([1 - alpha_r, 1 + alpha_r])
    expected = np.outer(1.0 + np.array([3.0, -3.0]) * ratio * time / soil.masses[0], direction)
    np.testing.assert_allclose(soil.velocities[:, :axes], expected, rtol=1e-12)
    np.testing.assert_allclose(soil.velocities[:, -1], 2.0 + np.array([0.01, -0.01]) * turn * time / soil.inertias[0], rtol=1e-11)
    # work of constant damping forces along straight ways: booked without error
    assert soil.energies()["local_damping"] > 0.0
    assert abs(soil.energy_balance()) < 1e-10 * soil.energies()["imposed"]


def test_vector_damping_is_zero_at_rest_and_goes_with_mass_damping():
    """One step from rest: the first half kick without damping, the second with both, mass damping at the end of the step."""
    soil = Assembly([[0.0, 0.0]], RADIUS, 2600.0, LAW)
    soil.external_forces = [[1.0, 0.0, 0.0]]
    alpha, c, h = 0.9, 100.0, 1e-3
    soil.advance(1, h, vector_damping=(alpha, 0.5), mass_damping=c)
    start = 1.0 / soil.masses[0]
    end = ((1 - alpha) / soil.masses[0] - c * 0.5 * h * start) / (1 + 0.5 * c * h)
    assert soil.velocities[0, 0] == pytest.approx(0.5 * h * (start + end))
    for wrong in ((0.5,), (0.5, 1.0), (-0.1, 0.2)):
        with pytest.raises(ValueError, match="vector_damping"):
            soil.advance(1, h, vector_damping=wrong)


@pytest.mark.parametrize("logarithmic", [True, False])
def test_a_wall_at_a_strain_rate_reaches_the_strain(logarithmic):
    """ln(L / L0) = rate t, or (L - L0) / L0 = rate t, by velocities taken in the middle of the steps as walls do."""
    rate, length, time, start = -0.5, 0.8, 0.4, 0.3
    velocity = strain_velocity(rate, length, (0, 2), start, logarithmic)
    steps = (np.arange(400) + 0.5) * time / 400
    moved = sum(velocity(start + one) for one in steps) * time / 400
    strain = np.log1p(moved[1] / length) if logarithmic else moved[1] / length
    assert moved[0] == 0.0 and strain == pytest.approx(rate * time, rel=1e-7)  # midpoint rule: (rate h)^2 / 24
    assert Plate.rectangle((-1, length), (1, 1), velocity=velocity).is_driven
    with pytest.raises(ValueError, match="length=0"):
        strain_velocity(1.0, 0.0, (0, 1))


def test_inertial_number():
    """I = rate d sqrt(rho / p): 0.1 * 0.1 * sqrt(2600 / 1e5) = 1.6e-3."""
    for axes in (2, 3):
        soil = stack(axes)
        assert inertial_number(soil, -0.1, 1e5) == pytest.approx(0.01 * np.sqrt(0.026))
        assert is_quasi_static(soil, 0.01, 1e5) and not is_quasi_static(soil, 0.1, 1e5)
    with pytest.raises(ValueError, match="pressure=0"):
        inertial_number(soil, 0.1, 0.0)
