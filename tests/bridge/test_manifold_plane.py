"""Elements over the hexagonal lattice, in plane strain and plane stress: the plane's share of what holds over the cubic one."""

import math

import numpy as np
import pytest

from bridge.manifold import CONTINUUM, MANIFOLD, PARTICLES, Manifold, Recoarsening, ultimate_strain
from continuum import bricks
from particles.lattice import Lattice, LatticeMaterial

ROCK = LatticeMaterial(12.5e9, 0.2, 2650.0)
CENTRAL = LatticeMaterial(12.5e9, 0.25, 2650.0)  # no shear springs in plane strain: the published forces have an energy


def sheet(along, double_rows, material=ROCK, **options):
    """A lattice of rows that begin and end half a spacing apart, so that it fills elements."""
    i, j = np.meshgrid(np.arange(along), np.arange(2 * double_rows), indexing="xy")
    sites = np.column_stack(((i + 0.5 * (j % 2)).ravel(), (math.sqrt(0.75) * j).ravel()))
    return Lattice(sites, 1.0, material, **options)


def below(level):
    return lambda x: x[:, 1] < level


def inner_element(per_element, plane, material=ROCK):
    """Stiffness of a manifold element with neighbours on all sides, and of Q4."""
    n, m = per_element
    body = Manifold(sheet(3 * n, 3 * m, material, plane=plane), per_element, continuum=False)
    middle = int(np.argmin(np.abs(body.centres - body.centres.mean(axis=0)).sum(axis=1)))
    own = body._elements.stiffness[body._elements.kind[middle]]
    return own, bricks.stiffness(body.size, material.young_modulus, material.poisson_ratio, plane), body


@pytest.mark.parametrize("per_element", [(1, 1), (3, 2), (7, 4)])
@pytest.mark.parametrize("plane", ["strain", "stress"])
def test_an_element_has_the_energy_of_q4_in_uniform_strain(per_element, plane):
    own, wanted, body = inner_element(per_element, plane)
    assert body.grid.full().all() and len(own) == 8
    corners = np.array([(x, y) for y in (0, 1) for x in (0, 1)]) * body.size
    for gradient in np.random.default_rng(1).standard_normal((4, 2, 2)):
        u = (corners @ gradient.T).ravel()
        assert u @ own @ u == pytest.approx(u @ wanted @ u, rel=1e-12)
    values = np.linalg.eigvalsh(own)
    assert np.sum(np.abs(values) < 1e-10 * values[-1]) == 3


@pytest.mark.parametrize("plane", ["strain", "stress"])
def test_its_other_modes_come_near_those_of_q4_with_the_square_of_its_sites(plane):
    ratios = []
    for per_element in ((4, 2), (8, 4)):
        own, wanted, _ = inner_element(per_element, plane)
        values, modes = np.linalg.eigh(wanted)
        kept = values > 1e-9 * values[-1]
        whitened = modes[:, kept] / np.sqrt(values[kept])
        ratios.append(np.abs(np.linalg.eigvalsh(whitened.T @ own @ whitened) - 1).max())
    assert ratios[0] < 0.06 and ratios[1] == pytest.approx(0.25 * ratios[0], rel=0.1), ratios


@pytest.mark.parametrize("plane", ["strain", "stress"])
def test_patch_test_across_all_layers(plane):
    """Strains along and across the interface, shear: no force inside, on nodes and on free particles."""
    n, m = 4, 2
    body = Manifold(sheet(5 * n, 6 * m, plane=plane), (n, m), free=below(2 * m * math.sqrt(3.0)))
    for gradient in np.diag([1, -2]) * 1e-4, np.array([[0, 1], [1, 0]]) * 1e-4:
        body.set_motion(lambda x: x @ gradient.T)
        body.prepare()
        for x, force, there in (
            (body.node_reference, body._nodes.force[:2].T, body.alive),
            (body.lattice.reference, body.lattice._state.force[:2].T, body.lattice.free),
        ):
            nodes = body.node_reference
            low, high = nodes.min(axis=0) + 1.5 * body.size, nodes.max(axis=0) - 1.5 * body.size  # bonds lack in elements at free faces
            inner = np.all((x > low) & (x < high), axis=1) & there
            assert inner.sum() >= 6 and np.abs(force[inner]).max() < 1e-12 * np.abs(force).max()


def test_energy_is_kept_to_rounding_and_momentum_exactly_by_a_release_and_a_return():
    body = Manifold(sheet(16, 16, CENTRAL), (4, 2), free=below(7), recoarsen=Recoarsening(1.0, 1.0))
    assert set(body.kind) == {CONTINUUM, MANIFOLD, PARTICLES} and body.critical_step <= body.lattice.critical_step
    body.set_motion(velocity=lambda x: 1e-3 * np.sin(0.4 * x[:, ::-1]))
    body.advance(100)
    chosen = np.flatnonzero(body.kind == MANIFOLD)
    for change in (body.release, body.recoarsener.take_back):
        before, mass = body.momentum(), body.node_mass.sum() + body.lattice.mass[body.lattice.free].sum()
        change(chosen)
        assert np.abs(body.momentum() - before).max() < 1e-12 * np.abs(before).max() and len(before) == 2
        assert body.node_mass.sum() + body.lattice.mass[body.lattice.free].sum() == pytest.approx(mass, rel=1e-13)
        body.advance(100)
    energy = body.energies()
    assert body.released == 4 and energy["release_kinetic"] > 0
    assert abs(energy["balance"]) < 1e-12 * (energy["kinetic"] + energy["elastic"])


@pytest.mark.parametrize("free", [99.0, 100.0])
def test_a_long_pulse_passes_all_layers_of_a_column_that_repeats(free):
    """By particles alone as by all layers: height and arrival; of a pulse of ten elements' length less than 2 % come back."""
    n, m, rows = 4, 2, 100
    height = rows * math.sqrt(3.0)
    body = Manifold(sheet(n, rows, periodic="x"), (n, m), free=below(height * free / 200.0))
    body.hold(lambda x: x[:, 1] > -1, "x")
    period = 20 * m / ROCK.wave_speed
    body.hold(below(0.5), "y", lambda t: math.sin(math.pi * t / period) ** 2 if t < period else 0.0)
    time = (0.5 * height + 2.0 * 20 * m) / ROCK.wave_speed
    body.advance(int(time / body.step))
    y, v = body.lattice.reference[:, 1], body.particle_motion()[1][:, 1]
    peak = y[np.argmax(v)]
    assert v.max() == pytest.approx(1.0, abs=0.03)
    assert peak == pytest.approx(ROCK.wave_speed * (body.time - 0.5 * period), abs=0.02 * peak)
    assert np.abs(v[y < 0.5 * height - 10]).max() < 0.02


def test_overstrained_elements_are_released():
    body = Manifold(sheet(8, 20), 4, free=below(6), release=ultimate_strain(1e-4), check_every=5)
    assert np.array_equal(body.size, (4, 2 * math.sqrt(3.0)))
    body.set_motion(displacement=lambda x: x * (0, 0.9e-4))
    body.advance(5)
    assert body.released == 2


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: Manifold(sheet(4, 4), (4, 2, 1)), r"per_element=\(4, 2, 1\) must be at least 1, one whole number or 2"),
        (lambda: Manifold(sheet(4, 4), 2.5), "per_element=2.5"),
        (lambda: Manifold(sheet(6, 4, periodic="x"), (4, 2)), "must divide"),
        (lambda: Manifold(sheet(4, 4), (1, 1), recoarsen=Recoarsening(1e-5, 1.0)), r"per_element=\(1, 1\) must be at least 2"),
    ],
)
def test_bad_input_is_refused_in_one_sentence(make, words):
    with pytest.raises(ValueError, match=words):
        make()
