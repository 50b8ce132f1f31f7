"""Internal and external forces: patch test, rigid motion, matrix against form, equilibrium."""

import numpy as np
import pytest

from continuum import Body
from meshes import Box, domains

STRAIN = np.array([[1.0e-3, 4.0e-4], [-2.0e-4, -7.0e-4]])  # eps_ij = u_j,i at phi = 0, not symmetric


def impose(body, gradient, rotation=0.0):
    """u_j = gradient_ij x_i, phi = rotation."""
    body.displacement[:, :2] = body.coordinates @ gradient
    if body.components == 3:
        body.displacement[:, 2] = rotation


def stress_of(body, gradient, rotation=0.0):
    spin = rotation * np.array([[0.0, 1.0], [-1.0, 0.0]]) if body.components == 3 else 0.0
    return np.einsum("ijkl,kl->ij", body.material.stiffness, gradient - spin)


def inner_nodes(body, width=2.0, height=1.5):
    x, y = body.coordinates.T
    return (x > 1e-9) & (x < width - 1e-9) & (y > 1e-9) & (y < height - 1e-9)


def test_uniform_strain_is_in_equilibrium_on_a_distorted_mesh(distorted):
    """Patch test: no force inside; the couple there is the moment of the unequal shear stresses, int N = m / rho.

    The bound is rounding: a nodal force is a sum of some ten terms of size stress x cell size.
    """
    impose(distorted, STRAIN)
    stress = stress_of(distorted, STRAIN)
    force = distorted.internal_force()
    scale = np.abs(stress).max()
    inner = inner_nodes(distorted)
    assert inner.any()
    assert np.abs(force[inner, :2]).max() < 1e-12 * scale
    if distorted.components == 3:
        couple = (stress[1, 0] - stress[0, 1]) * distorted.mass[:, 0] / distorted.material.density
        assert np.abs(force[:, 2] - couple).max() < 1e-12 * scale
        assert np.abs(couple).max() > 1e-3 * scale


def test_forces_on_the_sides_are_the_tractions(distorted):
    impose(distorted, STRAIN)
    stress, force = stress_of(distorted, STRAIN), distorted.internal_force()
    corner_free = [np.isclose(distorted.coordinates[:, 0], 2.0), np.isclose(distorted.coordinates[:, 1], 1.5)]
    # side x = 2 without its corner nodes carries t_j = sigma_xj over its length less half an edge at both ends
    side = corner_free[0] & (distorted.coordinates[:, 1] > 1e-9) & ~corner_free[1]
    assert force[side, :2].sum(axis=0) == pytest.approx(stress[0] * (1.5 - 0.5), rel=1e-12)
    # all nodes left of any cut together: zero resultant
    assert np.abs(force[:, :2].sum(axis=0)).max() < 1e-12 * np.abs(stress).max()


def test_strain_energy_of_uniform_strain(distorted):
    impose(distorted, STRAIN, rotation=3e-4)
    spin = 3e-4 * np.array([[0.0, 1.0], [-1.0, 0.0]]) if distorted.components == 3 else 0.0
    density = 0.5 * np.vdot(stress_of(distorted, STRAIN, 3e-4), STRAIN - spin)
    assert distorted.strain_energy() == pytest.approx(density * 3.0, rel=1e-12)


def test_rigid_rotation_is_free_of_stress(distorted):
    """u = (-theta y, theta x), phi = theta gives nothing; without the rotation phi a Cosserat body resists."""
    angle = 1e-2
    gradient = angle * np.array([[0.0, 1.0], [-1.0, 0.0]])
    impose(distorted, gradient, angle)
    scale = angle * np.abs(distorted.material.stiffness).max()
    assert np.abs(distorted.internal_force()).max() < 1e-13 * scale
    assert np.nanmax(np.abs(distorted.stress_fields()["effective_stress"].x.array)) < 1e-13 * scale
    if distorted.components == 3:
        impose(distorted, gradient, 0.0)
        assert np.abs(distorted.internal_force()).max() > 1e-3 * scale


def test_matrix_action_equals_assembled_form(distorted):
    rng = np.random.default_rng(1)
    trial = rng.standard_normal(distorted.displacement.shape)
    by_matrix, by_form = distorted.internal_force(trial), distorted.internal_force(trial, method="form")
    assert np.abs(by_matrix - by_form).max() < 1e-13 * np.abs(by_matrix).max()
    distorted.displacement[:] = trial
    assert np.array_equal(distorted.internal_force(), by_matrix)


def test_internal_forces_of_any_motion_have_no_resultant(distorted):
    """Linear and angular momentum: the moment counts the couples, x (reference) cross f + f_phi."""
    force = distorted.internal_force(np.random.default_rng(2).standard_normal(distorted.displacement.shape))
    x, y = distorted.coordinates.T
    moment = x * force[:, 1] - y * force[:, 0] + (force[:, 2] if distorted.components == 3 else 0.0)
    scale = np.abs(force).max() * len(force)
    assert np.abs(force[:, :2].sum(axis=0)).max() < 1e-12 * scale
    assert abs(moment.sum()) < 1e-12 * scale


def test_assigned_state_is_the_state(distorted):
    """Assignment writes through the view that the force is computed from."""
    trial = np.random.default_rng(3).standard_normal(distorted.displacement.shape)
    distorted.displacement = trial
    distorted.displacement *= 2.0
    expected = distorted.internal_force(2.0 * trial)
    assert np.array_equal(distorted.internal_force(), expected) and np.abs(expected).max() > 0


def test_lumped_mass_is_the_mass(distorted):
    assert distorted.mass[:, 0].sum() == pytest.approx(2042.0 * 3.0, rel=1e-13)
    assert distorted.mass.min() > 0


@pytest.mark.parametrize(
    "choice, radius, inertia", [("scaled", None, 2042 / 12), ("physical", 0.05, 2042 * 0.05**2 / 2), (7.0, None, 7.0)]
)
def test_micro_inertia(choice, radius, inertia, cell, make_material):
    """Theta = rho h^2/12, rho r^2/2 or as given (kg/m), over 6 m2 of squares of side h = 1 m, or of their halves."""
    body = Body(domains.rectangle((0, 0), (3, 2), (3, 2), cell), make_material("cosserat"), choice, radius)
    assert body.mass[:, 2].sum() == pytest.approx(6 * inertia, rel=1e-13)


def test_loads_and_reactions_balance(cell, make_domain, make_material):
    """Gravity and a traction at rest: the supports carry both, moments included."""
    body = Body(make_domain(cell), make_material("cosserat"))
    body.traction("top", (3e3, -2e3))
    body.gravity((0.0, -9.81))
    load = body.external_force()
    weight = 2042 * 3.0 * 9.81
    assert load.sum(axis=0) == pytest.approx([3e3 * 2, -2e3 * 2 - weight, 0.0], rel=1e-12)
    x, y = body.coordinates.T
    assert np.sum(x * load[:, 1]) == pytest.approx(1.0 * (-2e3 * 2 - weight), rel=1e-12)  # centred at x = 1
    body.fix(Box((-1, -1), (3, 3)), "xyr")  # everything held: reactions are minus the loads
    reaction = body.reaction(Box((-1, -1), (3, 3)))
    moment = np.sum(x * load[:, 1] - y * load[:, 0])
    assert reaction == pytest.approx([-3e3 * 2, 2e3 * 2 + weight, -moment], rel=1e-12)


@pytest.mark.parametrize(
    "side, length, middle",
    [("left", 1.5, (0, 0.75)), ("right", 1.5, (2, 0.75)), ("bottom", 2.0, (1, 0)), ("top", 2.0, (1, 1.5))],
)
def test_traction_on_each_side(side, length, middle, cell, make_domain, make_material):
    """Resultant t L through the middle of the side, and nothing on nodes elsewhere."""
    body = Body(make_domain(cell), make_material("cauchy"))
    body.traction(side, (3e3, -2e3))
    load = body.external_force()
    assert load.sum(axis=0) == pytest.approx([3e3 * length, -2e3 * length], rel=1e-12)
    assert load[:, 0] @ body.coordinates == pytest.approx(np.multiply(3e3 * length, middle), rel=1e-12, abs=1e-9)


def test_prescribed_components(make_material):
    body = Body(domains.rectangle((0, 0), (4, 2), (4, 2), plate=2.0), make_material("cosserat"))
    body.fix("bottom", "xyr")
    body.fix("left", "xr")
    body.prescribe("plate", "y", lambda t: -2.0 * t)
    assert np.count_nonzero(body.fixed[:, 0]) == 5 + 2
    assert np.count_nonzero(body.fixed[:, 1]) == 5 + 3
    velocity = body.prescribed_velocity(0.5)
    assert velocity.min() == -1.0 and np.count_nonzero(velocity) == 3
    assert np.all(body.coordinates[velocity[:, 1] < 0, 1] == 2.0)


@pytest.mark.parametrize(
    "action, words",
    [
        (lambda b: b.fix("nowhere", "x"), 'facets "nowhere" are unknown in this mesh; known: '),
        (lambda b: b.fix("top", "z"), 'directions="z" must be'),
        (lambda b: b.fix("top", "xx"), 'directions="xx" must be'),
        (lambda b: b.fix(Box((50, 50), (51, 51)), "x"), "holds no nodes"),
        (lambda b: b.prescribe("top", "y", np.nan), "velocity=nan must be finite"),
        (lambda b: b.traction("top", (1.0, np.nan)), "traction=.* must be two finite numbers"),
        (lambda b: b.gravity(9.81), "acceleration=9.81 must be two finite numbers"),
        (lambda b: b.advance(10, -1e-3), "step=-0.001 must be positive"),
        (lambda b: b.advance(1.5, 1e-3), "steps=1.5 must be a whole number"),
        (lambda b: b.advance(1, 1e-3, local_damping=1.0), "local_damping=1.0 must lie in"),
        (lambda b: b.advance(1, 1e-3, mass_damping=np.nan), "mass_damping=nan must be"),
        (lambda b: b.internal_force(method="magic"), 'method="magic" must be'),
        (lambda b: b.critical_step("guess"), 'bound="guess" must be'),
        (lambda b: b.reaction("top"), "where=top has no prescribed motion"),
        (lambda b: b.shape_functions([[np.nan, 0.0]]), "points .* must be finite"),
    ],
)
def test_bad_input_is_named(action, words, make_material):
    body = Body(domains.rectangle((0, 0), (2, 1), (2, 1)), make_material("cosserat"))
    with pytest.raises(ValueError, match=words):
        action(body)


@pytest.mark.parametrize(
    "options, words",
    [
        (dict(micro_inertia="large"), "micro_inertia='large' must be"),
        (dict(micro_inertia=-1.0), "micro_inertia=-1.0 must be"),
        (dict(micro_inertia="physical"), "particle_radius=None must be positive"),
        (dict(excluded="box"), "must be a region"),
    ],
)
def test_bad_bodies_are_named(options, words, make_material):
    with pytest.raises(ValueError, match=words):
        Body(domains.rectangle((0, 0), (2, 1), (2, 1)), make_material("cosserat"), **options)
