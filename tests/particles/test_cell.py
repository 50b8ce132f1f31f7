"""Periodic cells: where the cut lies does not matter, momentum and energy with a deforming cell, stress and power, bad input."""

import numpy as np
import pytest

from particles import Assembly, PeriodicCell
from tests.particles.scenes import ALL, packed, stacked


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
        (lambda: Assembly([[0.0, 0.0]], 0.05, law=ALL).deform(np.zeros((2, 2))), "needs a periodic cell"),
    ],
)
def test_bad_cells_are_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


DAMPINGS = [{"mass_damping": 40.0}, {"local_damping": 0.6}, {"vector_damping": (0.5, 0.4)}]
every_damping = pytest.mark.parametrize("damping", DAMPINGS, ids=lambda damping: next(iter(damping)))


@every_damping
@pytest.mark.parametrize("axes", [2, 3])
def test_affine_flow_is_not_damped(axes, damping):
    """Particles apart from each other that go with a sheared cell go on for ever (L L = 0: the flow is steady)."""
    places = np.stack(np.meshgrid(*[0.25 * np.arange(4)] * axes, indexing="ij"), axis=-1).reshape(-1, axes) - 0.3
    soil = Assembly(places, 0.05, law=ALL, cell=PeriodicCell([1.0] * axes))
    gradient = np.zeros((axes, axes))
    gradient[0, -1] = 3.0
    soil.deform(gradient)
    before = soil.velocities
    soil.advance(300, 1e-4, **damping)
    np.testing.assert_allclose(soil.velocities, before, atol=1e-13)
    terms = soil.energies()
    assert max(terms["mass_damping"], terms["local_damping"]) < 1e-20 * terms["kinetic"]
    assert abs(terms["cell_work"]) < 1e-12 * terms["kinetic"]


def test_mass_damping_takes_the_velocity_beyond_the_flow():
    """Simple shear g, u = v - L x: u_y = b exp(-c t), u_x = (a - g b t) exp(-c t); spins decay by themselves."""
    c, g, a, b, time = 40.0, 3.0, 0.7, -0.4, 0.03
    errors = []
    for steps in (100, 200):
        soil = Assembly([[0.2, 5.3]], 0.01, law=ALL, cell=PeriodicCell((1.0, 1.0)))
        soil.deform([[0.0, g], [0.0, 0.0]])
        soil.velocities = soil.velocities + [[a, b, 2.0]]
        soil.advance(steps, time / steps, mass_damping=c)
        beyond = soil.velocities[0] - [g * soil.positions[0, 1], 0.0, 0.0]
        exact = np.exp(-c * time) * np.array([a - g * b * time, b, 2.0])
        errors.append(np.abs(beyond - exact).max())
        mass, inertia = soil.masses[0], soil.inertias[0]
        # what is taken: integral of c m u u + c J w w
        t = np.linspace(0.0, time, 20001)
        power = np.exp(-2 * c * t) * c * (mass * ((a - g * b * t) ** 2 + b**2) + inertia * 4.0)
        assert soil.energies()["mass_damping"] == pytest.approx(np.trapz(power, t), rel=5e-3)
    assert errors[1] < 1e-4 and errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)


@every_damping
def test_damping_does_not_depend_on_the_origin(damping):
    """The same packing elsewhere in space has another velocity L x, but the same velocities beyond it, losses and stress."""
    found, shift, gradient = [], np.array([3.3, -7.1]), np.array([[-0.5, 3.0], [0, -0.2]])
    for move in (0.0 * shift, shift):
        soil = packed(shift=move)
        soil.deform(gradient)
        soil.advance(400, 1e-5, **damping)
        beyond = soil.velocities[:, :2] - soil.positions @ gradient.T
        beyond -= soil.masses @ beyond / soil.masses.sum()  # what is common: the flow goes on at the velocity of its start
        terms = soil.energies()
        found.append((beyond, soil.cell_stress(), terms["mass_damping"] + terms["local_damping"]))
    (one, stress, loss), (other, other_stress, other_loss) = found
    assert loss > 10.0 and other_loss == pytest.approx(loss, rel=1e-8)
    np.testing.assert_allclose(other, one, atol=1e-8)
    np.testing.assert_allclose(other_stress, stress, atol=1e-8 * np.abs(stress).max())


@every_damping
@pytest.mark.parametrize(
    "make, gradient", [(packed, [[-0.5, 3.0], [0, -0.2]]), (stacked, [[-0.4, 2.0, 1.0], [0, -0.2, 0.5], [0, 0, -0.3]])]
)
def test_energy_audit_closes_with_damping_in_a_deforming_cell(make, gradient, damping):
    """Also with a held particle, on which no damping acts."""
    errors = []
    for steps in (800, 1600):
        soil = make()
        soil.deform(gradient)
        soil.hold([3], "x")
        soil.advance(steps, 0.004 / steps, **damping)
        errors.append(abs(soil.energy_balance()))
    terms = soil.energies()
    loss = terms["mass_damping"] + terms["local_damping"]
    # the dashpots' share of the error: 1.7 J of 4200 J for the spheres, with damping or without
    assert loss > 1.0 and errors[1] < 5e-4 * terms["imposed"]
    assert errors[0] / errors[1] > 2.0, errors  # of second order, but for signs of components that turn round
