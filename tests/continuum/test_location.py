"""Shape functions at points: partition of unity, reproduction of linear fields, ties, edges."""

import numpy as np
import pytest

from continuum import Body
from meshes import domains


@pytest.fixture
def body(cell, make_domain, make_material):
    return Body(make_domain(cell), make_material("cosserat"))


def points_inside(count=500):
    return np.random.default_rng(5).random((count, 2)) * [2.0, 1.5]


def test_partition_of_unity_and_linear_reproduction(body):
    """To the accuracy of Newton's method in the reference cell, a few roundings."""
    points = points_inside()
    nodes, values, found = body.shape_functions(points)
    assert found.all() and nodes.dtype == np.int64
    assert np.abs(values.sum(axis=1) - 1).max() < 1e-14
    assert np.abs(np.einsum("kn,knj->kj", values, body.coordinates[nodes]) - points).max() < 1e-13
    assert values.min() > -1e-7


def test_nodes_and_edges_belong_to_one_cell(body):
    """A node takes its own value only; repeated and reordered points give the same rows."""
    nodes, values, found = body.shape_functions(body.coordinates)
    assert found.all()
    own = nodes == np.arange(body.count)[:, None]
    assert np.all(own.sum(axis=1) == 1)
    assert np.abs(values[own] - 1).max() < 1e-12 and np.abs(values[~own]).max() < 1e-12
    again = body.shape_functions(body.coordinates[::-1])
    assert np.array_equal(again[0][::-1], nodes) and np.array_equal(again[1][::-1], values)


def test_shared_edge_goes_to_the_cell_made_first(make_material):
    body = Body(domains.rectangle((0, 0), (2, 1), (2, 1)), make_material("cosserat"))
    nodes, _, _ = body.shape_functions([[1.0, 0.5]])
    assert body.coordinates[nodes[0], 0].max() == 1.0


def test_outer_edge_has_a_tolerance_and_outside_is_not_found(body):
    """1e-8 of a cell beyond the edge is still inside; a hundredth of a cell is not."""
    points = np.array([[1.0, 1.5], [1.0, 1.5 + 1e-10], [2.0 + 1e-10, 0.4], [1.0, 1.505], [-0.01, 0.2], [50.0, 50.0]])
    nodes, values, found = body.shape_functions(points)
    assert found.tolist() == [True, True, True, False, False, False]
    assert np.all(nodes[~found] == -1) and np.all(values[~found] == 0)
    assert np.abs(np.einsum("kn,knj->kj", values[found], body.coordinates[nodes[found]]) - points[found]).max() < 1e-13


def test_no_points(body):
    nodes, values, found = body.shape_functions([])
    assert nodes.shape == values.shape == (0, nodes.shape[1]) and found.shape == (0,)
