"""The projectors of the bridging scale: Li & Wan (2010), eqs 4-8."""

import numpy as np
import pytest
import scipy.sparse as sparse

from bridge.interpolation import Interpolation
from bridge.projection import Projection, SymmetricSolver
from continuum import Body, Cosserat
from meshes import domains


def cloud(cell, points_per_cell=12, seed=3):
    """A body, random particles in its right half, and their N."""
    random = np.random.default_rng(seed)
    body = Body(domains.rectangle((0, 0), (4, 2), (4, 2), cell=cell), Cosserat(1e6, 0.2, 1e5, 0.1, density=1.0))
    points = np.column_stack(
        [random.uniform(2.0, 4.0, 4 * points_per_cell), random.uniform(0.0, 2.0, 4 * points_per_cell)]
    )
    radii = random.uniform(0.02, 0.05, len(points))
    return body, points, Interpolation(body, points), radii**2, 0.5 * radii**4, random


@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
def test_interpolation_reproduces_linear_fields_at_the_particles(cell):
    body, points, interpolation, *_ = cloud(cell)
    linear = body.coordinates @ [[2.0, -1.0, 0.5], [0.3, 4.0, -2.0]] + [1.0, 0.0, -3.0]
    at_particles = interpolation.matrix @ interpolation.exchange.gather(linear)
    expected = points @ [[2.0, -1.0, 0.5], [0.3, 4.0, -2.0]] + [1.0, 0.0, -3.0]
    np.testing.assert_allclose(at_particles, expected, atol=1e-12)


def test_scatter_is_the_transpose_of_gather():
    body, points, interpolation, *_, random = cloud("quadrilateral")
    forces, nodal = random.standard_normal((len(points), 3)), random.standard_normal((body.count, 3))
    spread = np.zeros((body.count, 3))
    interpolation.exchange.scatter(interpolation.matrix.T @ forces, spread)
    assert np.vdot(spread, nodal) == pytest.approx(
        np.vdot(forces, interpolation.matrix @ interpolation.exchange.gather(nodal))
    )
    np.testing.assert_allclose(spread.sum(axis=0), forces.sum(axis=0), rtol=1e-12)  # partition of unity: force is kept


@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
def test_identities_of_the_projectors(cell):
    _, points, interpolation, masses, inertias, random = cloud(cell)
    projection = Projection(interpolation.matrix, masses, inertias)
    q, other = random.standard_normal((2, len(points), 3))
    nodal = random.standard_normal((len(interpolation.nodes), 3))
    weights = projection.weights
    close = dict(rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(projection.project(projection.project(q)), projection.project(q), **close)  # P P = P
    np.testing.assert_allclose(
        projection.project(projection.extend(nodal)), projection.extend(nodal), **close
    )  # P N = N
    np.testing.assert_allclose(projection.remainder(projection.extend(nodal)), 0.0, **close)  # Q N = 0
    np.testing.assert_allclose(projection.restrict(weights * projection.remainder(q)), 0.0, atol=1e-14)  # N^T Mp Q = 0
    left, right = np.vdot(other, weights * projection.project(q)), np.vdot(q, weights * projection.project(other))
    assert left == pytest.approx(right, abs=1e-13)  # Mp P is symmetric
    fine = projection.remainder(q)
    assert np.vdot(fine, weights * fine) == pytest.approx(np.vdot(q, weights * fine), abs=1e-13)  # Q^T Mp Q = Q^T Mp
    total = projection.extend(nodal) + fine
    kinetic = np.vdot(nodal, projection.apply_gram(nodal)) + np.vdot(q, weights * fine)
    assert np.vdot(total, weights * total) == pytest.approx(kinetic, rel=1e-12)  # the energy splits in two


def test_rank_is_the_number_of_supported_nodes_and_a_lumped_matrix_breaks_the_projector():
    _, points, interpolation, masses, inertias, _ = cloud("quadrilateral")
    projection = Projection(interpolation.matrix, masses, inertias)
    unit = np.zeros((len(points), len(points), 3))
    unit[np.arange(len(points)), np.arange(len(points)), 0] = 1.0
    dense = np.column_stack([projection.project(column)[:, 0] for column in unit])
    assert np.linalg.matrix_rank(dense) == projection.supported.sum() == 9
    n = interpolation.matrix.toarray()
    lumped = n @ np.diag(1.0 / (n.T @ masses)) @ n.T @ np.diag(masses)
    assert np.abs(lumped @ lumped - lumped).max() > 0.01


def test_too_few_particles_leave_the_projector_a_projector():
    body = Body(domains.rectangle((0, 0), (2, 1), (2, 1)), Cosserat(1e6, 0.2, 1e5, 0.1, density=1.0))
    points = np.array([[0.3, 0.4], [0.6, 0.7], [0.31, 0.42]])  # three particles, four nodes
    interpolation = Interpolation(body, points)
    projection = Projection(interpolation.matrix, np.ones(3), np.ones(3))
    q = np.random.default_rng(0).standard_normal((3, 3))
    np.testing.assert_allclose(projection.project(projection.project(q)), projection.project(q), atol=1e-6)
    np.testing.assert_allclose(projection.project(q), q, atol=1e-6)  # range of N is everything here


def test_sparse_and_dense_solvers_agree():
    random = np.random.default_rng(1)
    rough = sparse.random(300, 300, 0.02, random_state=1)
    matrix = sparse.csr_matrix(rough @ rough.T + sparse.diags(np.geomspace(1e-3, 1e3, 300)))
    right = random.standard_normal((300, 2))
    np.testing.assert_allclose(
        SymmetricSolver(matrix).solve(right), np.linalg.solve(matrix.toarray(), right), rtol=1e-9
    )


def test_particles_outside_the_mesh_are_refused():
    body = Body(domains.rectangle((0, 0), (2, 1), (2, 1)), Cosserat(1e6, 0.2, 1e5, 0.1, density=1.0))
    with pytest.raises(ValueError, match="1 particles lie outside the mesh"):
        Interpolation(body, np.array([[0.5, 0.5], [2.5, 0.5]]))
