"""Periodic cells: where the cut lies does not matter, momentum and energy with a deforming cell, stress and power, bad input."""

import numpy as np
import pytest

from particles import Assembly, PeriodicCell, Plate
from tests.particles.scenes import ALL, hexagonal_lattice


def packed(shift=(0.0, 0.0), seed=1):
    """64 unequal discs that fill a cell without walls, shaken."""
    rng = np.random.default_rng(seed)
    places = hexagonal_lattice(8, 8, 0.0499) + rng.uniform(-2e-4, 2e-4, (64, 2))
    size = 16 * 0.0499, 8 * np.sqrt(3) * 0.0499
    soil = Assembly(places + shift, rng.uniform(0.0492, 0.0505, 64), law=ALL, cell=PeriodicCell(size))
    soil.velocities = rng.normal(size=(64, 3)) * [0.2, 0.2, 5.0]
    return soil


def stacked():
    """125 unequal spheres in a cell, shaken."""
    rng = np.random.default_rng(2)
    grid = np.stack(np.meshgrid(*[np.arange(5)] * 3, indexing="ij"), axis=-1).reshape(-1, 3) * 0.0998
    soil = Assembly(grid, rng.uniform(0.0492, 0.0505, 125), law=ALL, cell=PeriodicCell([5 * 0.0998] * 3))
    soil.velocities = rng.normal(size=(125, 6)) * [0.2, 0.2, 0.2, 5.0, 5.0, 5.0]
    return soil


def test_motion_does_not_depend_on_where_the_cell_is_cut():
    here, there = packed(), packed(shift=(0.33, -0.71))
    assert len(here.contacts().first) > 80
    for soil in (here, there):
        soil.advance(400, 1e-5)
    # rounding of positions (1e-16) grows in 400 steps of contacts that open and close
    np.testing.assert_allclose(here.displacements, there.displacements, atol=1e-11)


@pytest.mark.parametrize(
    "make, gradient", [(packed, [[-0.5, 3.0], [0, -0.2]]), (stacked, [[-0.4, 2.0, 1.0], [0, -0.2, 0.5], [0, 0, -0.3]])]
)
def test_momentum_is_kept_and_the_energy_audit_closes_with_a_deforming_cell(make, gradient):
    errors = []
    for steps in (400, 800, 1600):
        soil = make()
        soil.deform(gradient)
        before = soil.masses @ soil.velocities[:, : soil.axes]
        soil.advance(steps, 0.01 / steps)
        drift = soil.masses @ soil.velocities[:, : soil.axes] - before
        assert np.abs(drift).max() < 1e-12 * (soil.masses @ np.abs(soil.velocities[:, : soil.axes])).max()
        errors.append(abs(soil.energy_balance()))
    work = soil.energies()["cell_work"]
    assert work > 100.0 and errors[-1] < 5e-3 * work  # dashpots of the spheres' impacts at a twentieth of the step limit
    assert np.log2(errors[0] / errors[-1]) / 2 == pytest.approx(2.0, abs=0.4), errors


def test_power_of_the_cell_is_stress_times_rate():
    """Quasi-static: dW/dt = V sigma : L, from two ways through the code (sums of the loops; contacts)."""
    soil = packed()
    soil.velocities = 0.0 * soil.velocities
    gradient = np.array([[-0.01, 0.004], [0.0, -0.02]])
    soil.deform(gradient)
    soil.advance(4000, 1e-5, local_damping=0.5)
    before, power = soil.energies()["cell_work"], []
    for _ in range(20):
        power.append(np.sum(soil.cell_stress() * gradient.T) * soil.cell.volume)
        soil.advance(5, 1e-5, local_damping=0.5)
    # dashpots are left out of the contacts' forces: damping ratio 0.02 times the rate of overlaps
    assert (soil.energies()["cell_work"] - before) / (20 * 5e-5) == pytest.approx(np.mean(power), rel=0.01)


def test_shear_goes_on_over_many_cells():
    """The leaning edges are taken back by whole edges: two cell lengths of shear, area kept, energies in balance."""
    soil = packed()
    area = soil.cell.volume
    soil.deform([[0.0, 20.0], [0.0, 0.0]])
    soil.advance(20000, 5e-6)
    assert abs(soil.cell.matrix[0, 1]) <= 0.5 * soil.cell.matrix[0, 0] + 1e-2
    assert soil.cell.volume == pytest.approx(area, rel=1e-12)
    energies = soil.energies()
    assert energies["friction_sliding"] > 0.1 * energies["cell_work"] > 0.0
    assert abs(soil.energy_balance()) < 1e-3 * energies["cell_work"]


def test_one_axis_may_repeat_alone():
    """A row of discs between free sides pushes itself along the axis that repeats only."""
    soil = Assembly([[0.1 * k, 0.0] for k in range(6)], 0.0505, law=ALL, cell=PeriodicCell((0.6, 1.0), (True, False)))
    assert len(soil.contacts().first) == 6
    soil.advance(10, 1e-5)
    np.testing.assert_allclose(soil.forces, 0.0, atol=1e-6)


@pytest.mark.parametrize(
    "call, message",
    [
        (lambda: PeriodicCell((1.0, -1.0)), "size="),
        (lambda: PeriodicCell((1.0, 1.0), (False, False)), "periodic="),
        (lambda: Assembly([[0.0, 0.0]], 0.05, law=ALL, cell=PeriodicCell((0.2, 1.0))), "cell is 0.2 m wide along axis 0"),
        (lambda: Assembly([[0.0, 0.0]], 0.05, law=ALL, cell=PeriodicCell((1.0, 1.0, 1.0))), "cell has 3 axes"),
        (lambda: packed().deform([[0.0, 0.0], [1.0, 0.0]]), "zero below the diagonal"),
        (lambda: packed().add_wall(Plate.rectangle((0, -1), (1, 0))), "walls do not go with a periodic cell"),
        (lambda: Assembly([[0.0, 0.0]], 0.05, law=ALL).deform(np.zeros((2, 2))), "needs a periodic cell"),
    ],
)
def test_bad_cells_are_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()
