"""Partly covered elements: exact over the uncovered part."""

from types import SimpleNamespace

import numpy as np
import pytest

from continuum import Body, cells, cuts
from meshes import Box, Disc, HalfPlane, domains


def interpolation(coarse, fine):
    """Dense matrix from the coarse body's nodal values to the fine body's nodes."""
    nodes, values, found = coarse.shape_functions(fine.coordinates)
    assert found.all()
    matrix = np.zeros((fine.count, coarse.count))
    np.add.at(matrix, (np.arange(fine.count)[:, None], nodes), values)
    return matrix


def stiffness(body):
    size = body.mass.size
    return np.array([body.internal_force(row.reshape(body.mass.shape)).ravel() for row in np.eye(size)])


@pytest.mark.parametrize("box", [Box((0.5, 0.5), (1.5, 2.0)), Box((0.3, 0.8), (1.2, 1.6)), Box((0.9, 0.1), (2.0, 1.9))])
def test_cut_elements_equal_the_elements_of_a_mesh_that_follows_the_cut(box, cell, material):
    """K_coarse = N^T K_fine N and m_coarse = N^T m_fine, the fine mesh having the outline as element edges.

    Both sides integrate the same polynomials over the same set, so they agree to rounding.
    """
    coarse = Body(domains.rectangle((0, 0), (2, 2), (2, 2), cell), material, "physical", 0.05, excluded=box)
    fine = Body(domains.rectangle((0, 0), (2, 2), (20, 20), cell), material, "physical", 0.05, excluded=box)
    assert set(np.round(fine.cell_fractions, 12)) == {0.0, 1.0}
    assert np.any((coarse.cell_fractions > 0) & (coarse.cell_fractions < 1))
    n = interpolation(coarse, fine)
    assert np.abs(coarse.mass - n.T @ fine.mass).max() < 1e-12 * coarse.mass.max()
    assert coarse.mass[:, 0].sum() == pytest.approx(2042 * (4 - box.area), rel=1e-12)
    wide = np.kron(n, np.eye(coarse.components))
    expected = wide.T @ stiffness(fine) @ wide
    assert np.abs(stiffness(coarse) - expected).max() < 1e-12 * np.abs(expected).max()
    trial = np.random.default_rng(0).standard_normal(coarse.displacement.shape)
    by_form = coarse.internal_force(trial, method="form")
    assert np.abs(by_form - coarse.internal_force(trial)).max() < 1e-13 * np.abs(by_form).max()


def test_region_of_the_foundation(make_material):
    """7.0 x 3.5 m in squares of 1 m: half a square is left at the sides, a quarter less at the lower corners."""
    body = Body(domains.rectangle((0, 0), (18, 9)), make_material("cosserat"), excluded=Box((5.5, 5.5), (12.5, 9)))
    values, counts = np.unique(np.round(body.cell_fractions, 12), return_counts=True)
    # 6 x 3 squares covered; 2 x 3 sides and 6 below half; 2 corners three quarters
    assert dict(zip(values, counts)) == {0.0: 18, 0.5: 12, 0.75: 2, 1.0: 130}
    x, y = body.coordinates.T
    inside = (x > 6.5) & (x < 11.5) & (y > 6.5)
    assert np.all(body.mass[inside] == 0) and np.all(body.mass[~inside] > 0)


def test_region_along_element_edges_cuts_nothing(make_material):
    body = Body(domains.rectangle((0, 0), (18, 9)), make_material("cosserat"), excluded=Box((6, 6), (12, 9)))
    assert np.count_nonzero(body.cell_fractions == 0.0) == 18
    assert np.count_nonzero(body.cell_fractions == 1.0) == 144


QUADRILATERAL = np.array([(0.0, 0.0), (1.2, 0.1), (0.2, 0.9), (0.9, 1.4)])  # convex, no two sides parallel


def element_energy(material, corners, weights_of, displacement):
    """1/2 u K u of one element by the rule of cut cells with given factors, in numpy."""
    from continuum._compat import quadrature_rule

    points, weights = quadrature_rule("quadrilateral", cuts.CUT_DEGREE["quadrilateral"])
    return quadratic_form(
        material, corners, points, weights * cells.determinants(corners, points) * weights_of, displacement
    )


def quadratic_form(material, corners, points, measure, displacement):
    gradient = np.einsum("qni,nj->qij", cells.gradients(corners, points), displacement[:, :2])
    rotation = cells.shape_functions(points, 4) @ displacement[:, 2]
    gradient[:, 0, 1] -= rotation
    gradient[:, 1, 0] += rotation
    density = 0.5 * np.einsum("ijkl,qij,qkl->q", material.stiffness, gradient, gradient)
    return float(measure @ density)


def test_cut_of_a_distorted_quadrilateral_is_exact(make_material):
    """The line xi = 0.37 is straight in a bilinear map; the energy left of it by 40 x 40 Gauss points is the reference."""
    split = 0.37
    corners, material = QUADRILATERAL, make_material("cosserat")
    low, high = (cells.shape_functions(np.array([[split, s]]), 4)[0] @ corners for s in (0.0, 1.0))
    along = high - low
    away = np.array([along[1], -along[0]])  # to the side of larger xi
    region = SimpleNamespace(
        corners=np.array([low - along, low - along + 9 * away, high + along + 9 * away, high + along])
    )
    fractions, factors = cuts.uncovered(corners[None], region)
    gauss, weight = np.polynomial.legendre.leggauss(40)
    x, y = (a.ravel() for a in np.meshgrid(split * (gauss + 1) / 2, (gauss + 1) / 2, indexing="ij"))
    points = np.column_stack((x, y))
    measure = (split / 4 * np.outer(weight, weight)).ravel() * cells.determinants(corners, points)
    assert fractions[0] == pytest.approx(measure.sum() / cells.areas(corners[None])[0], rel=1e-12)
    for seed in range(3):
        displacement = np.random.default_rng(seed).standard_normal((4, 3))
        expected = quadratic_form(material, corners, points, measure, displacement)
        assert element_energy(material, corners, factors[0], displacement) == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("region", [Disc((0.7, 0.9), 0.45), Box((0.2, 0.3), (0.9, 1.1)) - Disc((0.5, 0.5), 0.2)])
def test_other_regions_by_subcells(region, cell, make_domain, make_material):
    """16 x 16 sub-cells: area to about 1 %; no element with negative energy or mass, so the motion stays stable."""
    body = Body(make_domain(cell), make_material("cosserat"), excluded=region)
    assert body.mass[:, 0].sum() / 2042 == pytest.approx(3.0 - region.area, rel=0.01)
    assert body.mass.min() >= 0
    eigenvalues = np.linalg.eigvalsh(stiffness(body))
    assert eigenvalues[0] > -1e-11 * eigenvalues[-1]
    impose = body.coordinates @ np.array([[1.0, 0.3], [0.3, -0.5]])
    displacement = np.column_stack((impose, np.zeros(body.count)))
    density = body.internal_force(displacement).ravel() @ displacement.ravel() / body.mass[:, 0].sum() * 2042
    gradient = np.array([[1.0, 0.3], [0.3, -0.5]])
    expected = np.einsum("ijkl,ij,kl", body.material.stiffness, gradient, gradient)
    assert density == pytest.approx(expected, rel=1e-11)  # uniform strain: energy over mass knows no error of the cut


def test_thin_slivers_are_stable(cell, make_domain, make_material):
    """A cut that leaves 1e-6 of a cell: no negative energy."""
    body = Body(
        domains.rectangle((0, 0), (2, 1), (2, 1), cell), make_material("cosserat"), excluded=Box((1e-6, -1), (1.7, 2))
    )
    eigenvalues = np.linalg.eigvalsh(stiffness(body))
    assert eigenvalues[0] > -1e-11 * eigenvalues[-1]
    assert body.mass[:, 0].sum() / 2042 == pytest.approx(0.3 + 1e-6, rel=1e-12)


@pytest.mark.parametrize(
    "region", [Box((0.5, 1.0), (1.3, 5.0)), HalfPlane((0, 1.9), (0, -1)) & Box((0.5, 1.0), (1.3, 3.0))]
)
def test_tractions_act_on_the_uncovered_part(region, make_material):
    """Force and moment of the part of the edge outside x in [0.5, 1.3]; sub-cells (1/64) for the second."""
    body = Body(domains.rectangle((0, 0), (2, 2), (2, 2)), make_material("cauchy"), excluded=region)
    body.traction("top", (0.0, -1e3))
    load, x = body.external_force(), body.coordinates[:, 0]
    tolerance = 1e-12 if isinstance(region, Box) else 1.0 / 64
    assert load[:, 1].sum() == pytest.approx(-1e3 * 1.2, rel=tolerance)
    assert load[:, 1] @ x == pytest.approx(-1e3 * (2.0 - 0.8 * 0.9), rel=2 * tolerance)
