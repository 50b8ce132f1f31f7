"""Critical step: closed forms of single elements, the assembled value from both sides, the order of the bounds."""

import numpy as np
import pytest

from continuum import Body, Cauchy
from meshes import Box, domains


def wave_speed(material):
    return np.sqrt(material.stiffness[0, 0, 0, 0] / material.density)


@pytest.mark.parametrize("poisson_ratio", [0.0, 0.2, 0.4])
def test_square_cauchy_element(poisson_ratio):
    """Highest mode of a lumped square: omega = 2 c_p / (h sqrt(1 - nu)), hence h/c_p sqrt(1 - nu)."""
    material = Cauchy(1e9, poisson_ratio, 2000.0)
    body = Body(domains.rectangle((0, 0), (1.5, 1.0), (3, 2)), material)
    assert body.critical_step() == pytest.approx(0.5 / wave_speed(material) * np.sqrt(1 - poisson_ratio), rel=1e-10)


@pytest.mark.parametrize("inertia, expected", [("physical", 1.91e-4), ("scaled", 1.44e-3)])
def test_data_of_li_and_wan(inertia, expected, make_material):
    """The micro-rotation sets the step: 1.91e-4 s with rho r^2/2, 1.44e-3 s with rho h^2/12 (numbers to 3 digits)."""
    body = Body(domains.rectangle((0, 0), (18, 9)), make_material("cosserat"), inertia, particle_radius=0.05)
    assert body.critical_step() == pytest.approx(expected, rel=3e-3)
    # a uniform rotation swings at omega^2 = 4 Gc / Theta exactly: its couple is 4 Gc over the nodal volume
    body.displacement[:, 2] = 1.0
    theta = 2042 * 0.05**2 / 2 if inertia == "physical" else 2042 / 12
    ratio = body.internal_force()[:, 2] / body.mass[:, 2]
    assert ratio == pytest.approx(np.full(body.count, 4 * 70e6 / theta), rel=1e-10)
    assert body.critical_step() < 2 / np.sqrt(4 * 70e6 / theta)


def dense_eigenvalue(body):
    """Largest eigenvalue of M^-1 K over the free components, by numpy."""
    size = body.mass.size
    stiffness = np.array([body.internal_force(row.reshape(body.mass.shape)).ravel() for row in np.eye(size)])
    free = ~body.fixed.ravel() & (body.mass.ravel() > 0)
    root = 1 / np.sqrt(body.mass.ravel()[free])
    return np.linalg.eigvalsh(stiffness[np.ix_(free, free)] * np.outer(root, root))[-1]


def test_power_value_is_the_largest_eigenvalue_and_the_element_bound_is_below(distorted):
    distorted.fix("bottom", "xy")
    exact = 2 / np.sqrt(dense_eigenvalue(distorted))
    power = distorted.critical_step("power")
    assert power == pytest.approx(exact, rel=1e-6) and power <= exact * (1 + 1e-12)
    assert distorted.critical_step("element") <= exact


def test_cut_cells_count_and_covered_cells_do_not(cell, make_domain, make_material):
    body = Body(make_domain(cell), make_material("cosserat"), excluded=Box((0.6, 0.7), (1.7, 1.5)))
    exact = 2 / np.sqrt(dense_eigenvalue(body))
    assert body.critical_step("power") == pytest.approx(exact, rel=1e-6)
    assert 0 < body.critical_step("element") <= exact * (1 + 1e-12)


@pytest.mark.parametrize("kind", ["cauchy", "cosserat"])
def test_motion_is_bounded_just_below_and_grows_just_above(kind, cell, make_domain, make_material):
    """2000 steps at 0.99 and 1.01 of the power value: above, the highest mode grows by exp(2 acosh(1.01)) a step.

    That makes 1e245 in 2000 steps, from a start so small that it never ends in a blow-up.
    """
    largest = []
    for factor in (0.99, 1.01):
        body = Body(make_domain(cell), make_material(kind))
        body.fix("bottom", "xy")
        body.displacement[:] = 1e-270 * np.random.default_rng(0).standard_normal(body.displacement.shape)
        step = factor * body.critical_step("power")
        largest_start = np.abs(body.displacement).max()
        body.advance(2000, step)
        largest.append(np.abs(body.displacement).max() / largest_start)
    assert largest[0] < 1e3 and largest[1] > 1e200
