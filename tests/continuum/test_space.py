"""Bodies in space: patch test, moduli, rigid motions, loads, shares, stresses, look-ups, refusals."""

import numpy as np
import pytest

from continuum import Body, Cauchy, CosseratModuli
from meshes import Box, domains
from tests.continuum.space import ROCK, SIZE, dense_stiffness, distorted_body, distorted_box, solve, within

STRAIN = 1e-3 * np.array([[1.0, 0.4, -0.3], [-0.2, -0.7, 0.6], [0.5, 0.1, 0.8]])  # u_j,i, not symmetric
VOLUME = np.prod(SIZE)


@pytest.fixture(params=["tetrahedron", "hexahedron"])
def cell(request):
    return request.param


def hooke(strain, material=ROCK):
    """lambda tr(e) 1 + 2 G e of the symmetric part."""
    symmetric = 0.5 * (strain + strain.T)
    return material.lame_modulus * np.trace(symmetric) * np.eye(3) + 2.0 * material.shear_modulus * symmetric


def test_uniform_strain_is_in_equilibrium_on_a_distorted_mesh(cell):
    """Patch test: no force inside, the tractions on the sides, the energy of the volume."""
    body = distorted_body(cell)
    body.displacement[:] = body.coordinates @ STRAIN
    stress, force = hooke(STRAIN), body.internal_force()
    scale = np.abs(stress).max()
    inner = within(body.coordinates)
    assert inner.any() and np.abs(force[inner]).max() < 1e-12 * scale
    for axis in range(3):
        outward = np.eye(3)[axis] * VOLUME / SIZE[axis]
        body.traction(("right", "back", "top")[axis], outward @ stress * SIZE[axis] / VOLUME)
        body.traction(("left", "front", "bottom")[axis], -outward @ stress * SIZE[axis] / VOLUME)
    np.testing.assert_allclose(force, body.external_force(), rtol=0.0, atol=1e-12 * scale)
    assert body.strain_energy() == pytest.approx(0.5 * np.vdot(stress, STRAIN) * VOLUME, rel=1e-12)


def test_prescribed_sides_give_uniform_strain_inside(cell):
    """The solution with u = E x on the whole surface is u = E x, on any mesh."""
    body = distorted_body(cell)
    body.fix(lambda points: ~within(points), "xyz")
    wanted = body.coordinates @ STRAIN
    solve(body, np.where(body.fixed, wanted, 0.0))
    np.testing.assert_allclose(body.displacement, wanted, rtol=0.0, atol=1e-12 * np.abs(wanted).max())


def test_young_modulus_and_poisson_ratio_of_a_pulled_block(cell):
    """Free sides: sigma = E e along, -nu e across."""
    body = distorted_body(cell)
    for side, direction in (("left", "x"), ("front", "y"), ("bottom", "z")):
        body.fix(side, direction)
    body.traction("right", (1e6, 0.0, 0.0))
    solve(body, np.zeros_like(body.mass))
    strain = 1e6 / ROCK.young_modulus * np.array([1.0, -ROCK.poisson_ratio, -ROCK.poisson_ratio])
    np.testing.assert_allclose(body.displacement, body.coordinates * strain, rtol=0.0, atol=1e-11 * 2.0 * strain[0])
    assert body.reaction("left")[:3] == pytest.approx([-1e6 * 1.5, 0.0, 0.0], rel=1e-10, abs=1e-3)


@pytest.mark.parametrize("plane", [(0, 1), (1, 2), (2, 0)])
def test_shear_modulus(cell, plane):
    """Simple shear held on the surface: the force on a side is G gamma times its area."""
    along, normal = plane
    body = distorted_body(cell)
    body.fix(lambda points: ~within(points), "xyz")
    wanted = np.zeros_like(body.mass)
    wanted[:, along] = 1e-3 * body.coordinates[:, normal]
    solve(body, np.where(body.fixed, wanted, 0.0))
    force = body.internal_force()[np.isclose(body.coordinates[:, normal], SIZE[normal])]
    area = VOLUME / SIZE[normal]
    assert force[:, along].sum() == pytest.approx(ROCK.shear_modulus * 1e-3 * area, rel=1e-11)
    assert abs(force[:, normal].sum()) < 1e-9 * ROCK.shear_modulus * 1e-3 * area


def test_six_motions_are_free_of_stress(cell):
    """No more and no fewer zero eigenvalues than rigid motions; nothing negative."""
    values = np.linalg.eigvalsh(dense_stiffness(Body(distorted_box(cell), ROCK)))
    assert np.count_nonzero(np.abs(values) < 1e-12 * values[-1]) == 6
    assert values[6] > 1e-4 * values[-1]


def test_a_single_cell_has_no_more_than_the_six(cell):
    domain = domains.box((0, 0, 0), (1, 1, 1), (1, 1, 1), cell)
    values = np.linalg.eigvalsh(dense_stiffness(Body(domain, ROCK)))
    assert np.count_nonzero(np.abs(values) < 1e-12 * values[-1]) == 6


def test_matrix_action_equals_assembled_form(cell):
    body = distorted_body(cell)
    trial = np.random.default_rng(1).standard_normal(body.mass.shape)
    by_matrix, by_form = body.internal_force(trial), body.internal_force(trial, method="form")
    assert np.abs(by_matrix - by_form).max() < 1e-13 * np.abs(by_matrix).max()


def test_mass_weight_and_moments(cell):
    """Sum of the masses; gravity acts in the centre; reactions of everything held are minus the loads."""
    body = distorted_body(cell)
    assert body.mass.min() > 0.0
    assert body.mass.sum(axis=0) == pytest.approx(np.full(3, 2600.0 * VOLUME), rel=1e-13)
    body.gravity((1.0, 2.0, -9.81))
    body.traction("top", (3e3, 0.0, -2e3))
    weight, push = 2600.0 * VOLUME * np.array([1.0, 2.0, -9.81]), np.array([3e3, 0.0, -2e3]) * 3.0
    centre = 0.5 * SIZE
    moment = np.cross(centre, weight) + np.cross([centre[0], centre[1], SIZE[2]], push)
    everywhere = Box((-1, -1, -1), (3, 3, 3))
    body.fix(everywhere, "xyz")
    assert body.reaction(everywhere) == pytest.approx(-np.concatenate((weight + push, moment)), rel=1e-11)


@pytest.mark.parametrize("poisson_ratio", [0.0, 0.3])
def test_stress_and_strain_measures_of_a_uniform_state(cell, poisson_ratio):
    material = Cauchy(1e9, poisson_ratio, 2000.0)
    body = distorted_body(cell, material)
    body.displacement[:] = body.coordinates @ STRAIN
    stress, strain = hooke(STRAIN, material), 0.5 * (STRAIN + STRAIN.T)
    deviators = [tensor - np.trace(tensor) / 3.0 * np.eye(3) for tensor in (stress, strain)]
    expected = {
        "stress_xy": stress[0, 1], "stress_yz": stress[1, 2], "stress_zx": stress[2, 0], "stress_zz": stress[2, 2],
        "volumetric_stress": np.trace(stress) / 3.0, "effective_stress": np.sqrt(1.5 * np.sum(deviators[0] ** 2)),
        "strain_xz": STRAIN[0, 2], "strain_zx": STRAIN[2, 0], "volumetric_strain": np.trace(strain),
        "effective_strain": np.sqrt(2.0 / 3.0 * np.sum(deviators[1] ** 2)),
    }  # fmt: skip
    functions = body.stress_fields() | body.strain_fields()
    assert len(functions) == 22
    for name, value in expected.items():
        found = functions[name].x.array
        assert found == pytest.approx(np.full(len(found), value), rel=1e-10, abs=1e-10 * np.abs(stress).max() * ("stress" in name))


def test_shape_functions_at_points(cell):
    """Partition of unity; a linear field and its gradient anywhere; nodes themselves; points outside are not found."""
    body = distorted_body(cell)
    points = np.random.default_rng(3).random((400, 3)) * SIZE
    nodes, shape, found = body.shape_functions(points, gradients=True)
    assert found.all() and np.abs(shape[:, :, 0].sum(axis=1) - 1.0).max() < 1e-14
    field = body.coordinates @ [2.0, -3.0, 0.5]
    np.testing.assert_allclose(np.einsum("kn,kn->k", shape[:, :, 0], field[nodes]), points @ [2.0, -3.0, 0.5], atol=1e-13)
    slope = np.einsum("knj,kn->kj", shape[:, :, 1:], field[nodes])
    np.testing.assert_allclose(slope, np.broadcast_to([2.0, -3.0, 0.5], slope.shape), rtol=1e-11)
    nodes, values, found = body.shape_functions(body.coordinates)
    own = nodes == np.arange(body.count)[:, None]
    assert found.all() and np.abs(values[own] - 1.0).max() < 1e-12 and np.abs(values[~own]).max() < 1e-12
    assert body.shape_functions([[2.01, 0.5, 0.5], [1.0, 0.5, 1.0 + 1e-10]])[2].tolist() == [False, True]


def slope(points):
    """From 0 at x = 1 to 1 at x = 4."""
    return np.clip((points[:, 0] - 1.0) / 3.0, 0.0, 1.0)


def test_a_share_weighs_mass_energy_and_loads(cell):
    """Share linear in the cells: (6 - 1 - 3/2) 2 2 m3 of mass and of uniform strain, (6 - 5/2) 2 m2 of the top."""
    body = Body(domains.box((0, 0, 0), (6, 2, 2), (6, 2, 2), cell), ROCK, share=slope)
    assert body.mass[:, 0].sum() == pytest.approx(2600.0 * 14.0, rel=1e-13)
    body.displacement[:] = body.coordinates @ STRAIN
    assert body.strain_energy() == pytest.approx(0.5 * np.vdot(hooke(STRAIN), STRAIN) * 14.0, rel=1e-12)
    body.traction("top", (0.0, 0.0, -1e3))
    assert body.external_force()[:, 2].sum() == pytest.approx(-7e3, rel=1e-12)
    inner = np.all((body.coordinates > [1.5, 0.5, 0.5]) & (body.coordinates < [3.5, 1.5, 1.5]), axis=1)
    pull = -hooke(STRAIN)[0] / 3.0  # -sigma grad(share), times the whole volume of the nodes
    whole = Body(domains.box((0, 0, 0), (6, 2, 2), (6, 2, 2), cell), ROCK).mass[inner, :1] / 2600.0
    np.testing.assert_allclose(body.internal_force()[inner], whole * pull, rtol=1e-10)


def test_a_share_with_faces_anywhere(cell):
    """Distorted cells cut by the faces: mass to 1e-4, never negative energy, and one of all is the whole body."""
    domain = distorted_box(cell)
    body = Body(domain, ROCK, share=lambda points: np.clip((points[:, 0] - 0.3) / 1.3, 0.0, 1.0))
    assert body.mass[:, 0].sum() == pytest.approx(2600.0 * 1.5 * (1.3 / 2 + 0.4), rel=1e-4)
    values = np.linalg.eigvalsh(dense_stiffness(body))
    assert values[0] > -1e-11 * values[-1]
    whole, part = Body(domain, ROCK), Body(domain, ROCK, share=lambda points: np.ones(len(points)))
    np.testing.assert_array_equal(whole.mass, part.mass)


def test_what_a_region_covers_is_left_out(cell):
    """Mass, strain energy, force and area of the rest; exact where the region's faces are faces of sub-cells (hexahedra).

    Sub-cells of tetrahedra lie across the faces: what is wrong is part of one layer of them, a few thousandths of the body.
    """
    region, error = Box((-1.0, -1.0, 0.625), (0.75, 2.0, 2.0)), {"hexahedron": 1e-12, "tetrahedron": 5e-3}[cell]
    body = Body(domains.box((0, 0, 0), SIZE, (4, 3, 3), cell), ROCK, excluded=region)
    volume = VOLUME - 0.75 * 1.5 * 0.375
    assert body.mass[:, 0].sum() == pytest.approx(ROCK.density * volume, rel=error)
    inside = np.all(body.coordinates < (0.4, 2.0, 2.0), axis=1) & (body.coordinates[:, 2] > 0.9)
    assert inside.any() and not body.mass[inside].any()
    body.displacement[:] = body.coordinates @ STRAIN
    work = 0.5 * np.vdot(body.displacement, body.internal_force())
    assert work == pytest.approx(0.5 * np.sum(hooke(STRAIN) * STRAIN) * volume, rel=error)
    body.traction("top", (0.0, 0.0, -1.0))
    assert body.external_force().sum(axis=0)[2] == pytest.approx(-1.25 * 1.5, rel=1e-12)
    values = np.linalg.eigvalsh(dense_stiffness(body))
    assert values[0] > -1e-11 * values[-1]


@pytest.mark.parametrize(
    "options, words",
    [
        (
            dict(material=CosseratModuli(ROCK.stiffness, np.eye(2), 2000.0)),
            r"stiffness of shape \(2, 2, 2, 2\) must have the shape \(3, 3, 3, 3\) on this mesh",
        ),
        (dict(share=lambda points: points), r"each point \(n, 3\)"),
    ],
)
def test_what_bodies_in_space_do_not_have_is_refused(options, words):
    with pytest.raises(ValueError, match=words):
        Body(domains.box((0, 0, 0), (1, 1, 1), (1, 1, 1)), **{"material": ROCK} | options)


@pytest.mark.parametrize(
    "action, words",
    [
        (lambda b: b.fix("top", "xr"), 'directions="xr" must be different letters of "xyz"'),
        (lambda b: b.fix("plate", "x"), 'facets "plate" are unknown in this mesh; known: back, bottom, front'),
        (lambda b: b.traction("top", (1.0, 0.0)), "traction=.* must be three finite numbers"),
        (lambda b: b.gravity((0.0, -9.81)), "acceleration=.* must be three finite numbers"),
        (lambda b: b.shape_functions([[0.0, 0.0]]), r"shape \(k, 3\)"),
    ],
)
def test_bad_input_is_named(action, words):
    with pytest.raises(ValueError, match=words):
        action(Body(domains.box((0, 0, 0), (1, 1, 1), (1, 1, 1)), ROCK))
