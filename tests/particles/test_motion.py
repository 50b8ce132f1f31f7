"""Time stepping: conservation, energy audit, order of accuracy, damping, held components, blow-up."""

import numpy as np
import pytest
from numba import njit

from particles import Assembly, LiChu, Plate, Unstable
from particles.columns import WIDTH
from particles.dispatch import Direct
from particles.motion import BLOCK, drift, evaluate, kick, kick_drift
from tests.particles.scenes import ALL, PAPER, cloud, hexagonal_lattice, square_lattice


def _momentum(soil):
    velocities, positions, masses = soil.velocities, soil.positions, soil.masses
    linear = (masses[:, None] * velocities[:, :2]).sum(axis=0)
    arm = masses * (positions[:, 0] * velocities[:, 1] - positions[:, 1] * velocities[:, 0])
    return np.array([*linear, (arm + soil.inertias * velocities[:, 2]).sum()])


def test_linear_and_angular_momentum_are_conserved_to_rounding():
    soil = cloud()
    before = _momentum(soil)
    scale = np.array([1, 1, 0.5]) * (soil.masses * np.hypot(*soil.velocities[:, :2].T)).sum()
    soil.advance(2000, 1e-5)
    # angular momentum at the half step: x and v are at the same time, so only rounding is left
    np.testing.assert_allclose(_momentum(soil), before, atol=1e-12 * scale.max())


@njit
def _by_parts(system, terms, steps, step):
    """All forces first, then all rows, as the building blocks have it."""
    drift(system, terms, step)
    for _ in range(steps - 1):
        evaluate(system, terms, step, None, None)
        kick_drift(system, terms, step)
    evaluate(system, terms, step, None, None)
    kick(system, terms, step)


def _loaded(seed=0):
    """A hexagonal lattice under pressure, shaken: 22,500 discs, each listed pair in contact."""
    soil = Assembly(hexagonal_lattice(150, 150, 0.05), 0.0503, law=ALL, skin=0.02)
    soil.velocities = np.random.default_rng(seed).normal(size=(soil.count, 3)) * [0.4, 0.4, 10.0]
    soil.add_wall(Plate.rectangle((-1, -0.3), (16, -0.0495)))
    soil.hold([5, 600], "xr")
    return soil


def test_rows_that_move_as_soon_as_their_pairs_are_done_move_as_all_at_once():
    """Some blocks of rows end within a batch of pairs. No list is rebuilt: the order of the sums is the same, so the bits are."""
    together, apart = _loaded(), _loaded()
    end = together.system.start[BLOCK::BLOCK]
    assert np.count_nonzero((end - 1) // WIDTH > (end - 3) // WIDTH) > 1  # the last row of a block has three pairs
    loads = {"mass_damping": 50.0, "gravity": (1.0, -9.81)}
    together.advance(5, 1e-5, **loads)
    Direct(_by_parts)(*apart.prepare(1e-5, 5, **loads), 5, 1e-5)
    assert together.rebuilds == apart.rebuilds
    for name in ("displacements", "velocities", "accelerations", "forces"):
        np.testing.assert_array_equal(getattr(together, name), getattr(apart, name), err_msg=name)
    for name, energy in apart.energies().items():
        assert together.energies()[name] == pytest.approx(energy, rel=1e-12, abs=1e-12), name


def _imbalance(steps, law, **loads):
    soil = cloud(law=law)
    soil.add_wall(Plate.rectangle((-1, -0.3), (2, -0.0435)), Plate.rectangle((0.3, 0.595), (0.5, 0.9), velocity=(0.3, -1.0)))
    soil.hold([5, 6], "xr")
    soil.advance(steps, 0.004 / steps, **loads)
    return abs(soil.energy_balance()), soil.energies()


@pytest.mark.parametrize("loads", [{}, {"mass_damping": 50.0, "local_damping": 0.3, "gravity": (1.0, -9.81)}])
def test_energy_audit_closes_and_falls_with_the_square_of_the_step(loads):
    steps = np.array([200, 400, 800, 1600])
    errors = []
    for count in steps:
        error, terms = _imbalance(count, ALL, **loads)
        errors.append(error)
    moved = abs(terms["wall_work"]) + terms["imposed"]
    for name in ("friction_sliding", "friction_rolling", "friction_moment", "viscous", "wall_work"):
        assert abs(terms[name]) > 1e-5 * moved, f"{name} does not happen in this scene"
    if loads:
        assert terms["mass_damping"] > 0 and terms["local_damping"] > 0 and terms["gravity_work"] != 0
    assert errors[-1] < 2e-4 * moved
    # contacts open and close at random within a step, so that single errors scatter
    rate = -np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert rate > 1.7, f"observed rate {rate:.2f} from {errors}"


def test_positions_converge_with_the_square_of_the_step():
    """One lasting contact with dashpots and rolling, no slip: (M9) is of second order, predictor included."""
    law = LiChu(1e7, 5e6, 1e6, 7e2, 2e3, 1e3, 1e3, 1.0, 10.0, 10.0, 10.0)

    def final(steps):
        soil = Assembly([[0, 0], [0.099, 0.0]], 0.05, law=law)
        soil.velocities = [[0.05, 0.02, 0.3], [-0.02, 0.0, -0.1]]
        soil.advance(steps, 1.5e-3 / steps)
        return soil.displacements

    reference = final(6400)
    errors = [np.abs(final(steps) - reference).max() for steps in (100, 200, 400)]
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert rates == pytest.approx(2.0, abs=0.15), f"rates {rates} from {errors}"


def test_free_fall_is_exact():
    """Constant acceleration is integrated exactly by central differences."""
    soil = Assembly([[0, 0], [1, 0]], [0.05, 0.02], law=PAPER)
    soil.velocities = [[1, 2, 3], [0, 0, 0]]
    soil.advance(100, 1e-3, gravity=(0.5, -9.81))
    time = 0.1
    expected = np.array([1, 2]) * time + 0.5 * np.array([0.5, -9.81]) * time**2
    np.testing.assert_allclose(soil.displacements[0], [*expected, 3 * time], rtol=1e-12)
    assert abs(soil.energy_balance()) < 1e-10
    assert soil.time == pytest.approx(time)


def test_mass_damping_decays_as_the_discrete_closed_form():
    """v_{n+1} = v_n (1 - c h/2) / (1 + c h/2) for a free disc, rotations included."""
    soil = Assembly([[0, 0]], 0.05, law=PAPER)
    soil.velocities = [[1, -2, 3]]
    c, h = 40.0, 1e-3
    soil.advance(50, h, mass_damping=c)
    # one step: v+ = v + h/2 (a + a+) with a = -c v
    np.testing.assert_allclose(soil.velocities[0], np.array([1, -2, 3]) * ((1 - c * h / 2) / (1 + c * h / 2)) ** 50, rtol=1e-12)
    # the trapezoidal rule for c v^2 errs by (c h)^2 / 12 of the energy
    assert abs(soil.energy_balance()) < (c * h) ** 2 * soil.energies()["imposed"]


def test_held_components_keep_their_velocity_and_the_holder_does_the_work():
    soil = cloud(30)
    velocities = soil.velocities
    soil.hold([3], "xyr")
    soil.hold([4], "y")
    soil.advance(300, 1e-5, mass_damping=30.0)
    np.testing.assert_array_equal(soil.velocities[3], velocities[3])
    assert soil.velocities[4, 1] == velocities[4, 1] and soil.velocities[4, 0] != velocities[4, 0]
    np.testing.assert_allclose(soil.displacements[3], 300e-5 * velocities[3], rtol=1e-11)  # 300 sums
    assert soil.energies()["held_work"] != 0.0
    assert abs(soil.energy_balance()) < 1e-3 * soil.energies()["imposed"]
    soil.hold([3], "")
    soil.advance(10, 1e-5, gravity=(0, -9.81))
    assert soil.velocities[3, 1] != velocities[3, 1]


def test_external_force_accelerates_and_its_work_is_booked():
    soil = Assembly([[0, 0]], 0.05, law=PAPER)
    soil.external_forces = [[10.0, 0.0, 0.2]]
    soil.advance(100, 1e-3)
    assert soil.velocities[0, 0] == pytest.approx(10.0 / soil.masses[0] * 0.1)
    assert soil.velocities[0, 2] == pytest.approx(0.2 / soil.inertias[0] * 0.1)
    assert abs(soil.energy_balance()) < 1e-12


def test_runs_in_pieces_equal_one_run_bit_for_bit():
    one, pieces = cloud(), cloud()
    one.advance(300, 1e-5)
    for _ in range(30):
        pieces.advance(10, 1e-5)
    # kick and drift are fused within a run: v + h a instead of v + h/2 a + h/2 a, so equal to rounding
    np.testing.assert_allclose(one.displacements, pieces.displacements, rtol=1e-9, atol=1e-13)


def test_blow_up_is_noticed_within_a_hundred_steps_and_named():
    soil = Assembly(square_lattice(10, 10), 0.0502, law=PAPER)
    soil.add_wall(*Plate.box((-0.05, -0.05), (0.95, 0.95), 0.5))
    soil.velocities = 1e-3 * np.random.default_rng(1).normal(size=(100, 3))
    with pytest.raises(Unstable, match=r"particle \d+ runs away in step \d+ at t=.* smaller step"):
        soil.advance(3000, 1.3 * soil.critical_step(sharp=True))
    assert soil.time < 1.0


def test_trial_forces_equal_the_next_evaluation_and_leave_no_trace():
    soil = cloud()
    soil.add_wall(Plate.rectangle((-1, -0.3), (2, -0.04)))
    step, loads = 1e-5, {"gravity": (0.0, -9.81)}
    soil.advance(200, step, **loads)
    before = soil.displacements, soil.velocities, soil.energies()
    rows = soil.rows
    v, a = soil.velocities, soil.accelerations
    increment, velocity = np.empty_like(v), np.empty_like(v)
    increment[rows], velocity[rows] = step * v + 0.5 * step**2 * a, v + step * a
    trial = soil.trial_forces(increment, velocity, **loads)[rows]
    for old, new in zip(before[:2], (soil.displacements, soil.velocities)):
        np.testing.assert_array_equal(old, new)
    assert before[2] == soil.energies()
    soil.advance(1, step, **loads)
    np.testing.assert_allclose(trial, soil.forces, rtol=1e-9, atol=1e-9 * np.abs(trial).max())
