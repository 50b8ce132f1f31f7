"""Explicit motion in space: waves and their dispersion, energy, momentum, the critical step from both sides."""

import numpy as np
import pytest

from continuum import Body, Cauchy, Unstable
from meshes import Box, domains
from tests.continuum.space import ROCK, check_energy_account, dense_stiffness, distorted_body, every_damping, solve

EVERYWHERE = Box((-9, -9, -9), (99, 99, 99))
PRESSURE = np.sqrt((ROCK.lame_modulus + 2.0 * ROCK.shear_modulus) / ROCK.density)
SHEAR = np.sqrt(ROCK.shear_modulus / ROCK.density)


@pytest.fixture(params=["tetrahedron", "hexahedron"])
def cell(request):
    return request.param


def bar(cell, cells, moving="x", length=20.0):
    """Bar along x of which one component moves, alike over its cross-section."""
    body = Body(domains.box((0, 0, 0), (length, 1, 1), (cells, 1, 1), cell), ROCK)
    body.fix(EVERYWHERE, "xyz".replace(moving, ""))
    return body


@pytest.mark.parametrize("moving, speed", [("x", PRESSURE), ("y", SHEAR)])
def test_standing_wave_of_hexahedra_has_the_frequency_of_a_bar(moving, speed):
    """u(x) only: lumped cubes act as two-node bars, sin(w dt/2) = (c dt/h) sin(k h/2); half a period after release."""
    body, k = bar("hexahedron", 20, moving), 2.0 * np.pi / 20.0
    shape = 1e-4 * np.cos(k * body.coordinates[:, 0])
    step = 0.5 / speed
    omega = 2.0 / step * np.arcsin(0.5 * np.sin(k / 2.0))
    axis = "xyz".index(moving)
    body.displacement[:, axis] = shape
    body.advance(25, step)
    assert body.displacement[:, axis] == pytest.approx(shape * np.cos(omega * 25 * step), abs=1e-15)


def test_a_pulse_of_hexahedra_travels_at_the_wave_speed():
    """At h = c dt central differences solve the wave equation exactly, and turn the pulse at a fixed end."""
    body = bar("hexahedron", 60, length=60.0)
    body.fix("right", "x")
    x, step = body.coordinates[:, 0], 1.0 / PRESSURE

    def pulse(s):
        return np.where(np.abs(s - 12) < 8, 1e-3 * np.cos(np.pi * (s - 12) / 16) ** 2, 0.0)

    body.displacement[:, 0] = pulse(x)
    body.velocity[:, 0] = (pulse(x - 1) - pulse(x + 1)) / (2 * step)
    body.advance(80, step)
    assert body.displacement[:, 0] == pytest.approx(-pulse(120 - 80 - x), abs=1e-13)


@pytest.mark.parametrize("moving, speed", [("x", PRESSURE), ("y", SHEAR)])
def test_the_error_of_the_wave_speed_is_of_second_order(cell, moving, speed):
    """Rayleigh's quotient of the longest wave of a bar with 5, 10 and 20 cells against (c k)^2: a quarter each time."""
    errors = []
    for count in (5, 10, 20):
        body, axis = bar(cell, count, moving), "xyz".index(moving)
        k = np.pi / 20.0
        shape = np.zeros_like(body.mass)
        shape[:, axis] = np.cos(k * body.coordinates[:, 0])
        square = np.vdot(shape, body.internal_force(shape)) / np.vdot(shape, body.mass * shape)
        errors.append(1.0 - np.sqrt(square) / (speed * k))
    assert np.all(np.array(errors) > 0.0) and errors[-1] < 2e-3
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx([2.0, 2.0], abs=0.1)


def shaken(cell):
    """A body with everything that does work: supports, a moving side, traction, weight."""
    body = distorted_body(cell)
    body.fix("bottom", "xyz")
    body.prescribe("top", "z", lambda t: -0.1 * np.sin(2e4 * t))
    body.traction("right", (-1e5, 2e4, 1e4))
    body.gravity((0.0, 1.0, -9.81))
    return body


@every_damping
def test_energy_account_closes(damping, cell):
    check_energy_account(shaken(cell), damping)


def test_plain_sum_of_energies_closes_at_second_order(cell):
    errors = []
    for halvings in (0, 1, 2):
        body = shaken(cell)
        body.traction("right", (1e5, -2e4, -1e4))  # no load at the start: a smooth beginning
        body.gravity((0.0, 0.0, 0.0))
        body.advance(32 * 2**halvings, 2e-5 / 2**halvings, mass_damping=2000.0)
        e = body.energies()
        errors.append(abs(e["strain"] + e["kinetic"] + e["mass_damping"] - e["external_work"]))
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx([2.0, 2.0], abs=0.3)


def test_impulse_is_momentum(cell):
    """A free body under a constant traction: M v = F t, M (x cross v) = moment t about the centre."""
    body = distorted_body(cell)
    force = np.array([2e4, -1e4, 5e3])
    body.traction("right", force)
    step = 0.5 * body.critical_step("power")
    body.advance(300, step)
    impulse = force * 1.5 * 300 * step
    momentum = (body.mass * body.velocity).sum(axis=0)
    np.testing.assert_allclose(momentum, impulse, rtol=1e-11)
    spin = np.cross(body.coordinates, body.mass * body.velocity).sum(axis=0)
    np.testing.assert_allclose(spin, np.cross([2.0, 0.75, 0.5], impulse), rtol=0.0, atol=1e-10 * np.abs(impulse).max())


@pytest.mark.parametrize("poisson_ratio", [0.0, 0.2, 0.4])
def test_critical_step_of_a_cube(poisson_ratio):
    """Largest eigenvalue of a single lumped cube by numpy: the bound is its 2 / omega whatever the mesh's size."""
    material = Cauchy(1e9, poisson_ratio, 2000.0)
    single = Body(domains.box((0, 0, 0), (0.5, 0.5, 0.5), (1, 1, 1)), material)
    square = np.linalg.eigvalsh(dense_stiffness(single))[-1] / single.mass[0, 0]
    mesh = Body(domains.box((0, 0, 0), (1.5, 1.0, 1.0), (3, 2, 2)), material)
    assert mesh.critical_step() == pytest.approx(2.0 / np.sqrt(square), rel=1e-9)


def test_power_value_is_the_largest_eigenvalue_and_the_element_bound_is_below(cell):
    body = distorted_body(cell)
    body.fix("bottom", "xyz")
    free = ~body.fixed.ravel()
    root = 1.0 / np.sqrt(body.mass.ravel()[free])
    square = np.linalg.eigvalsh(dense_stiffness(body)[np.ix_(free, free)] * np.outer(root, root))[-1]
    exact, power = 2.0 / np.sqrt(square), body.critical_step("power")
    assert power == pytest.approx(exact, rel=1e-6) and power <= exact * (1 + 1e-12)
    assert 0.3 * exact < body.critical_step() <= exact


def test_motion_is_bounded_just_below_and_grows_just_above(cell):
    """2000 steps at 0.99 and 1.01 of the power value, from a start so small that it never ends in a blow-up."""
    growth = []
    for factor in (0.99, 1.01):
        body = distorted_body(cell)
        body.fix("bottom", "xyz")
        body.displacement[:] = 1e-270 * np.random.default_rng(0).standard_normal(body.mass.shape)
        start = np.abs(body.displacement).max()
        body.advance(2000, factor * body.critical_step("power"))
        growth.append(np.abs(body.displacement).max() / start)
    assert growth[0] < 1e3 and growth[1] > 1e200


def test_blow_up_is_named_with_a_place_in_space():
    body = bar("hexahedron", 10)
    body.displacement[:, 0] = 1e-6 * np.random.default_rng(0).standard_normal(body.count)
    with pytest.raises(Unstable, match=r"the node at \(.*, .*, .*\) m moves faster"):
        body.advance(100, 4.0 / PRESSURE)


def bending_stiffness(cell, cells, poisson_ratio=0.0):
    """Ratio of the tip's deflection of a slender cantilever to that of beam theory."""
    body = Body(domains.box((0, 0, 0), (10, 1, 1), cells, cell), Cauchy(1e9, poisson_ratio, 2000.0))
    body.fix("left", "xyz")
    body.traction("right", (0.0, 0.0, 1e3))
    solve(body, np.zeros_like(body.mass))
    tip = body.displacement[np.isclose(body.coordinates[:, 0], 10.0), 2].mean()
    return tip / (1e3 * 10.0**3 / (3.0 * 1e9 / 12.0))


def test_what_locks():
    """One layer of cubes in bending is half as stiff again as two layers; tetrahedra are stiffer; more cells help.

    Q1 with full integration: the parasitic shear of a cube of length a multiplies the stiffness by 1 + G a^2 / (E h^2) = 1.5 at
    nu = 0, less what shear deformation adds.
    """
    one, two = (bending_stiffness("hexahedron", (10 * n, n, n)) for n in (1, 2))
    assert one == pytest.approx(1.0 / 1.5, abs=0.02) and two == pytest.approx(1.0 / 1.125, abs=0.02)
    assert bending_stiffness("tetrahedron", (10, 1, 1)) < 0.5 * one
