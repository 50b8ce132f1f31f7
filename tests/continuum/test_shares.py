"""A body that carries a share of everything: exact where the share is linear in the cells."""

import numpy as np
import pytest

from continuum import Body
from meshes import Box, domains


def slope(points):
    """From 0 at x = 1 to 1 at x = 4."""
    return np.clip((points[:, 0] - 1.0) / 3.0, 0.0, 1.0)


def test_mass_and_strain_energy_are_weighted(cell, material):
    """Integral of the share over 6 x 3 m: (6 - 1 - 3/2) 3 m2 for the mass, the same for a uniform strain."""
    body = Body(domains.rectangle((0, 0), (6, 3), (6, 3), cell), material, "physical", 0.05, share=slope)
    assert body.mass[:, 0].sum() == pytest.approx(2042 * 10.5, rel=1e-13)
    body.displacement[:, 0] = 1e-3 * body.coordinates[:, 0]
    assert body.strain_energy() == pytest.approx(0.5 * material.stiffness[0, 0, 0, 0] * 1e-6 * 10.5, rel=1e-12)
    assert np.all(body.mass[body.coordinates[:, 0] < 0.5] == 0.0)


def test_internal_forces_of_uniform_stress_are_those_of_the_gradient(material):
    """f_I = -sigma int grad(share) N_I inside: a third of the stress per metre on nodes of the slope."""
    body = Body(domains.rectangle((0, 0), (6, 4), (6, 4)), material, "physical", 0.05, share=slope)
    body.displacement[:, 0] = 1e-3 * body.coordinates[:, 0]
    stress = 1e-3 * material.stiffness[0, 0, 0, 0]
    x, y = body.coordinates.T
    inner = (x > 1.5) & (x < 3.5) & (y > 0.5) & (y < 3.5)
    np.testing.assert_allclose(body.internal_force()[inner, 0], -stress / 3.0, rtol=1e-11)


def test_a_share_of_one_is_the_whole_body(cell, material):
    domain = domains.rectangle((0, 0), (2, 2), (3, 3), cell)
    whole, part = Body(domain, material), Body(domain, material, share=lambda points: np.ones(len(points)))
    np.testing.assert_array_equal(whole.mass, part.mass)
    trial = np.random.default_rng(0).standard_normal(whole.mass.shape)
    np.testing.assert_array_equal(whole.internal_force(trial), part.internal_force(trial))


def test_a_kink_within_cells_costs_little(cell, material):
    """Cells of 1 m with a face of the share through their middle: the fine mesh that follows it, to 1e-3."""

    def moved(points):
        return slope(points + [0.37, 0.0])

    body = Body(domains.rectangle((0, 0), (6, 3), (6, 3), cell), material, "physical", 0.05, share=moved)
    x = body.coordinates[:, 0]
    fine = (np.arange(60000) + 0.5) * 1e-4
    for node in (1.0, 3.0, 4.0):
        due = 2042 * 3.0 * np.sum(moved(np.column_stack([fine, fine])) * np.maximum(0.0, 1.0 - np.abs(fine - node))) * 1e-4
        assert body.mass[np.isclose(x, node), 0].sum() == pytest.approx(due, abs=1e-3 * 2042 * 3.0)


def test_loads_are_weighted(material):
    """Traction on the top: its integral with the share; gravity: with the mass."""
    body = Body(domains.rectangle((0, 0), (6, 3), (6, 3)), material, "physical", 0.05, share=slope)
    body.traction("top", (0.0, -1e3))
    assert body.external_force()[:, 1].sum() == pytest.approx(-3500.0, rel=1e-12)
    body.gravity((0.0, -10.0))
    assert body.external_force()[:, 1].sum() == pytest.approx(-3500.0 - 204200 * 1.05, rel=1e-12)


def test_stiffness_of_some_cells(cell, material):
    """Parts of the cells add up to the whole; nodes of both parts are counted by cell."""
    body = Body(domains.rectangle((0, 0), (4, 2), (4, 2), cell), material, "physical", 0.05, share=slope)
    nodes = np.arange(body.count)
    left = body.marked_nodes(body.coordinates[:, 0] < 2.5) == body.cell_nodes.shape[1]
    assert 0 < left.sum() < len(left)
    parts = body.stiffness_matrix(nodes, left) + body.stiffness_matrix(nodes, ~left)
    whole = body.stiffness_matrix(nodes)
    assert abs(parts - whole).max() < 1e-12 * abs(whole).max()


def test_gradients_of_shape_functions_at_points(cell, material):
    """Of a linear field: its gradient, anywhere."""
    body = Body(domains.rectangle((0, 0), (4, 2), (4, 2), cell), material)
    points = np.random.default_rng(2).uniform(0.1, 1.9, (20, 2))
    nodes, shape, found = body.shape_functions(points, gradients=True)
    assert found.all()
    field = body.coordinates @ [2.0, -3.0]
    np.testing.assert_allclose(np.einsum("kn,kn->k", shape[:, :, 0], field[nodes]), points @ [2.0, -3.0], atol=1e-12)
    np.testing.assert_allclose(np.einsum("knj,kn->kj", shape[:, :, 1:], field[nodes]), [[2.0, -3.0]] * 20, rtol=1e-12)


@pytest.mark.parametrize("wrong", [lambda points: 2.0 * np.ones(len(points)), lambda points: points])
def test_a_share_that_is_none_is_refused(wrong, material):
    domain = domains.rectangle((0, 0), (2, 2), (2, 2))
    with pytest.raises(ValueError, match="one number from 0 to 1"):
        Body(domain, material, share=wrong)
    with pytest.raises(ValueError, match="must not be given both"):
        Body(domain, material, share=slope, excluded=Box((0, 0), (1, 1)))
