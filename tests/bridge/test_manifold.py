"""Particle-based manifold elements beside particles and continuum, and their release (Zhao et al. 2012, section 3)."""

import math

import numpy as np
import pytest

from bridge.manifold import CONTINUUM, MANIFOLD, PARTICLES, Manifold, bond_limits, principal, ultimate_strain
from bridge.manifold.criterion import Probe
from continuum import bricks
from meshes import Box, packings
from particles.lattice import Lattice, LatticeMaterial
from particles.lattice.state import FORCE_BLOCKS, FORCE_RUNS, MOVING_RUNS, STRAIN_RUNS

ROCK = LatticeMaterial(12.5e9, 0.2, 2650.0)


def lattice(size, material=ROCK, **options):
    return Lattice(packings.simple_cubic(Box((0, 0, 0), size), 0.5), 1.0, material, **options)


def layers(below):
    """Elements whose centre lies below a level."""
    return lambda x: x[:, 2] < below


def inner_element(per_element, material=ROCK):
    """Stiffness of a manifold element with neighbours on all sides, and of the brick of the material."""
    body = Manifold(lattice((3 * per_element,) * 3, material), per_element, continuum=False)
    middle = int(np.argmin(np.abs(body.centres - body.centres.mean(axis=0)).sum(axis=1)))
    found = body._elements.stiffness[body._elements.kind[middle]]
    return found, bricks.stiffness(body.size, material.young_modulus, material.poisson_ratio), body


@pytest.mark.filterwarnings("ignore:poisson_ratio")
@pytest.mark.parametrize("per_element", [1, 2, 5])
@pytest.mark.parametrize("poisson_ratio", [0.2, 0.3])
def test_a_manifold_element_has_the_energy_of_hex8_in_uniform_strain(per_element, poisson_ratio):
    own, wanted, body = inner_element(per_element, LatticeMaterial(12.5e9, poisson_ratio, 2650.0))
    corners = np.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]) * body.size
    for gradient in np.random.default_rng(1).standard_normal((4, 3, 3)):
        u = (corners @ gradient.T).ravel()
        assert u @ own @ u == pytest.approx(u @ wanted @ u, rel=1e-12)
    values = np.linalg.eigvalsh(own)
    assert np.sum(np.abs(values) < 1e-10 * values[-1]) == 6


@pytest.mark.filterwarnings("ignore:poisson_ratio")
@pytest.mark.parametrize("poisson_ratio, low, high", [(0.2, 0.976, 1.033), (0.3, 0.936, 1.050)])
def test_its_other_modes_differ_little(poisson_ratio, low, high):
    """With five particles along an edge; the difference falls with the square of their number."""
    material = LatticeMaterial(12.5e9, poisson_ratio, 2650.0)
    ratios = {}
    for per_element in (5, 10):
        own, wanted, _ = inner_element(per_element, material)
        values, modes = np.linalg.eigh(wanted)
        basis = modes[:, values > 1e-9 * values[-1]]
        whitened = basis / np.sqrt(values[values > 1e-9 * values[-1]])
        ratios[per_element] = np.linalg.eigvalsh(whitened.T @ own @ whitened)
    assert ratios[5].min() == pytest.approx(low, abs=2e-3) and ratios[5].max() == pytest.approx(high, abs=2e-3)
    assert np.abs(ratios[10] - 1).max() == pytest.approx(0.25 * np.abs(ratios[5] - 1).max(), rel=0.1)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("continuum", [True, False])
def test_patch_test_across_all_layers(continuum, axis):
    """Any uniform strain, across interfaces of any direction: no force inside, 1e-12."""
    n = 5
    high = np.where(np.arange(3) == axis, 6 * n, 5 * n)
    body = Manifold(lattice(tuple(high)), n, free=lambda x: x[:, axis] < 2 * n, continuum=continuum)
    for gradient in np.random.default_rng(10).standard_normal((3, 3, 3)):
        body.set_motion(lambda x: x @ gradient.T)
        body.prepare()
        x, force = body.node_reference, body._nodes.force.T
        inner = np.all((x > n + 1) & (x < high - 2 * n + 1), axis=1) & body.alive
        assert inner.sum() > 8 and np.abs(force[inner]).max() < 1e-12 * np.abs(force).max()
        x, force = body.lattice.reference, body.lattice._state.force.T
        inner = np.all((x > 2) & (x < 5 * n - 2), axis=1) & body.lattice.free
        assert np.abs(force[inner]).max() < 1e-12 * np.abs(force).max()


def test_patch_test_round_particles_inside():
    """Where the interface has edges, forces of 0.2 E e h^2 / n^2 are left on the nodes of the elements there, h the size of elements:
    a bond across an edge is strained as at its midpoint. On faces and on the particles none are."""
    for n in (2, 4):
        body = Manifold(lattice((8 * n, 8 * n, 5 * n)), n, free=Box((2 * n, 2 * n, 2 * n), (6 * n, 6 * n, 3 * n)))
        gradient = np.random.default_rng(11).uniform(-1, 1, (3, 3))
        body.set_motion(lambda x: x @ gradient.T)
        body.prepare()
        x, force, scale = body.node_reference / n, np.abs(body._nodes.force.T), ROCK.young_modulus * n**2
        inside = np.all((x > 0.9) & (x < (7.1, 7.1, 4.1)), axis=1) & body.alive
        edge = inside & (np.sum((abs(x - 2) < 1.1) | (abs(x - (6, 6, 3)) < 1.1), axis=1) > 1)
        assert (inside & ~edge).any() and force[inside & ~edge].max() < 1e-12 * scale
        assert 0.02 * scale < force[edge].max() * n**2 < 0.25 * scale
        assert np.abs(body.lattice._state.force[:, body.lattice.free]).max() < 1e-12 * scale


def test_elements_at_free_faces_are_as_soft_as_the_lattice():
    """In uniform strain manifold elements there have the energy of the bonds that are there, continuum elements that of the volume;
    those round a hole and at its edges, too."""
    bodies = {}
    region = Box((0, 0, 0), (16, 12, 16)) - Box((4, 4, -1), (8, 8, 17))
    for faces in ("lattice", "manifold", "continuum"):
        alone = Lattice(packings.simple_cubic(region, 0.5), 1.0, ROCK)
        bodies[faces] = alone if faces == "lattice" else Manifold(alone, 4, free=layers(4), faces=faces)
    gradient = 1e-4 * np.random.default_rng(7).standard_normal((3, 3))
    bodies["lattice"].displacement = bodies["lattice"].reference @ gradient.T
    for faces in ("manifold", "continuum"):
        bodies[faces].set_motion(lambda x: x @ gradient.T)
    soft, same, stiff = (one.energies()["elastic"] for one in bodies.values())
    assert same == pytest.approx(soft, rel=1e-12) and stiff > 1.05 * soft


def test_only_elements_inside_are_continuum_with_manifold_faces():
    body = Manifold(lattice((12, 15, 18)), 3, faces="manifold")
    inside = np.all((body.grid.cells > 0) & (body.grid.cells < body.grid.shape - 1), axis=1)
    assert np.array_equal(body.kind == CONTINUUM, inside)


def test_elements_left_to_particles_altogether_are_the_lattice():
    """Every bond explicit: the same forces and, after steps, the same motion as the lattice alone."""
    motion = 1e-3 * np.random.default_rng(2).standard_normal((6 * 6 * 9, 3))
    alone, body = lattice((6, 6, 9)), Manifold(lattice((6, 6, 9)), 3, free=layers(99))
    alone.velocity, body.lattice.velocity = motion, motion
    alone.advance(40)
    body.advance(40)
    assert np.abs(alone.displacement - body.lattice.displacement).max() < 1e-12 * np.abs(alone.displacement).max()


def test_what_is_released_costs_what_its_particles_cost():
    """Elements that have all been released leave the lists of the lattice alone: the same runs and rows, no element, no row carried."""
    alone, body = lattice((6, 6, 9)), Manifold(lattice((6, 6, 9)), 3, continuum=False)
    body.release(np.arange(body.grid.count))
    alone.prepare(), body.prepare()
    one, two = alone._state, body.lattice._state
    assert len(body._elements.active) == len(body._elements.carried) == 0
    for name in ("counts", "strain_kind", "force_kind", "moving", "bonds"):
        assert np.array_equal(getattr(one, name), getattr(two, name))
    for lists, number in (("strain_runs", STRAIN_RUNS), ("force_runs", FORCE_RUNS), ("force_blocks", FORCE_BLOCKS), ("moving_runs", MOVING_RUNS)):
        count = one.counts[number]
        assert np.array_equal(getattr(one, lists)[:count], getattr(two, lists)[:count])


def test_nothing_is_arranged_in_steps_without_a_release():
    body = Manifold(lattice((6, 6, 9)), 3, free=layers(3), release=ultimate_strain(1.0))
    body.set_motion(velocity=lambda x: 1e-3 * np.sin(x))
    body.advance(10)
    elements, lists = body._elements, body.lattice._state
    kept = [values.ctypes.data for values in (*elements[2:-1], *lists) if values is not None]
    body.advance(50)
    assert body._elements is elements and body.released == 0
    assert [values.ctypes.data for values in (*body._elements[2:-1], *body.lattice._state) if values is not None] == kept


def test_an_element_that_repeats_onto_itself_is_one_of_a_thicker_body():
    """One element across that repeats has four nodes in place of eight: what does not vary across moves as with two elements across,
    and noise stays bounded at the critical step of the elements, which have no modes across."""
    bodies = []
    for across in (1, 2):
        alone = lattice((8, 12, 2 * across), periodic="z")
        body = Manifold(alone, (4, 4, 2), free=lambda x: x[:, 0] < 4, mass="higher-order", step=1e-5)
        body.set_motion(velocity=lambda x: 1e-3 * np.sin(x[:, [1, 1, 0]] * (0.5, 0.3, 0.7)))
        bodies.append(body)
        body.advance(60)
    one, two = bodies
    assert len(one._elements.corners) == 4 and len(two._elements.corners) == 8
    level = np.abs(two.node_reference[:, 2] - one.node_reference[0, 2]) < 1e-9
    moved = two.displacement[level]
    assert np.abs(one.displacement - moved).max() < 1e-10 * np.abs(moved).max()
    assert two.energies()["elastic"] == pytest.approx(2 * one.energies()["elastic"], rel=1e-10)
    flat = Manifold(lattice((8, 12, 2), periodic="z"), (4, 4, 2), mass="higher-order", continuum=False)
    assert flat.critical_step > 1.2 * Manifold(lattice((8, 12, 4), periodic="z"), (4, 4, 2), mass="higher-order", continuum=False).critical_step
    flat.step = 0.99 * flat.critical_step
    flat.set_motion(velocity=lambda x: 1e-9 * np.random.default_rng(1).standard_normal(x.shape))
    flat.advance(300)
    assert np.abs(flat.velocity).max() < 1e-8


def shaken(**options):
    body = Manifold(lattice((10, 10, 25), force="variational"), 5, free=layers(5), **options)
    body.set_motion(velocity=lambda x: 1e-3 * np.sin(0.3 * x[:, [1, 2, 0]]))
    return body


@pytest.mark.parametrize("mass", ["lumped", "higher-order"])
def test_energy_is_kept_to_rounding_and_a_release_is_booked(mass):
    body = shaken(mass=mass)
    body.lattice.absorb(lambda x: x[:, 0] > 9, "x")
    body.lattice.load(lambda x: x[:, 1] < 1, (1e2, 0, 0), lambda t: math.sin(3e3 * t))
    body.hold(lambda x: (x[:, 2] > 10) & (x[:, 1] > 9), "x")
    body.hold(layers(0.6), "xy", lambda t: 1e-3 * math.sin(4e3 * t))
    body.lattice.load(lambda x: x[:, 2] > 24, (0, 0, 1e3), lambda t: math.cos(2e3 * t))
    body.advance(150)
    given = body.energies()
    body.release(np.flatnonzero(body.kind == MANIFOLD))
    assert body.released == 4
    body.advance(150)
    energy = body.energies()
    assert energy["release_kinetic"] > 0
    size = energy["kinetic"] + energy["elastic"]
    assert abs(given["balance"]) < 1e-12 * size and abs(energy["balance"]) < 1e-12 * size
    assert abs(energy["release_kinetic"]) + abs(energy["release_strain"]) < 0.1 * (given["kinetic"] + given["elastic"])


@pytest.mark.parametrize("mass", ["lumped", "higher-order"])
def test_momentum_is_kept_exactly_by_steps_and_releases(mass):
    body = shaken(mass=mass)
    started = body.momentum()
    for _ in range(3):
        body.advance(20)
        before = body.momentum()
        mass = body.node_mass.sum() + body.lattice.mass[body.lattice.free].sum()
        body.release(np.flatnonzero(body.kind == MANIFOLD)[:3])
        assert np.abs(body.momentum() - before).max() < 1e-13 * np.abs(before).max()
        assert np.abs(before - started).max() < 1e-11 * np.abs(before).max()
        assert body.node_mass.sum() + body.lattice.mass[body.lattice.free].sum() == pytest.approx(mass, rel=1e-13)


@pytest.mark.parametrize("width", [1, 2])
def test_a_manifold_layer_stays_between_particles_and_continuum(width):
    body = Manifold(lattice((20, 20, 20)), 2, free=Box((0, 0, 0), (4, 4, 4)), layers=width)
    rng = np.random.default_rng(3)
    for _ in range(5):
        manifold = np.flatnonzero(body.kind == MANIFOLD)
        body.release(rng.choice(manifold, 4, replace=False))
        near = np.flatnonzero(body.kind == PARTICLES)
        for _ in range(width):
            near = body.grid.around(near)
        assert not np.any(body.kind[near] == CONTINUUM)
    assert np.any(body.kind == CONTINUUM)


def test_releasing_one_after_the_other_gives_the_body_that_is_released_at_once():
    """The order of releases at rest leaves no trace in stiffness and masses."""
    bodies = [Manifold(lattice((12, 12, 12)), 3, free=Box((0, 0, 0), (3, 3, 3))) for _ in range(2)]
    chosen = np.flatnonzero(bodies[0].kind == MANIFOLD)[:6]
    bodies[0].release(chosen)
    for element in chosen[::-1]:
        bodies[1].release(np.array([element]))
    motion = np.random.default_rng(4).standard_normal((3, 3, 3))
    for body in bodies:
        body.set_motion(lambda x: np.sin(x @ motion[0]) @ motion[1])
        body.prepare()
    one, two = bodies
    assert np.array_equal(one.kind, two.kind)
    assert np.abs(one.node_mass - two.node_mass).max() < 1e-13 * one.node_mass.max()
    assert np.abs(one._nodes.force - two._nodes.force).max() < 1e-12 * np.abs(one._nodes.force).max()
    assert np.abs(one.lattice._state.force - two.lattice._state.force).max() < 1e-12 * np.abs(one.lattice._state.force).max()


def test_a_long_pulse_passes_all_layers():
    """One column that repeats: of a pulse of ten elements' length less than 2 % come back, what elements of this size reflect anyway."""
    n, length = 4, 400
    body = Manifold(lattice((4, 4, length), periodic="xy"), n, free=layers(length / 2))
    body.hold(lambda x: x[:, 2] > -1, "xy")
    period = 10 * n / ROCK.wave_speed
    body.hold(layers(0.6), "z", lambda t: math.sin(math.pi * t / period) ** 2 if t < period else 0.0)
    body.advance(int((length / 2 + 2.5 * 10 * n) / ROCK.wave_speed / body.step))
    z, v = body.lattice.reference[:, 2], body.particle_motion()[1][:, 2]
    assert np.abs(v[z > length / 2]).max() == pytest.approx(1.0, abs=0.03)
    assert np.abs(v[z < length / 2 - 10]).max() < 0.02


@pytest.mark.parametrize("mass, order", [("lumped", 2), ("higher-order", 4)])
def test_waves_along_an_axis_have_the_dispersion_of_a_chain(mass, order):
    """Closed form: w^2 = (2 c / h)^2 s^2, with the higher-order mass times 1 + s^2 / 3, s = sin kh / 2: an error of the speed of
    (kh)^2 / 24 against (kh)^4 / 180."""
    body = Manifold(lattice((2, 2, 32), periodic="xyz"), 2, mass=mass)
    size, errors = body.size[2], []
    for waves in (1, 2, 4, 8):
        k = 2 * math.pi * waves / 32
        body.set_motion(lambda x, k=k: np.cos(k * x[:, 2:]) * (0, 0, 1))
        body.prepare()
        rate = -body._nodes.force[2] * body._nodes.lightness  # w^2 u
        s = math.sin(0.5 * k * size) ** 2
        wanted = (2 * ROCK.wave_speed / size) ** 2 * s * (1 if mass == "lumped" else 1 + s / 3)
        assert rate == pytest.approx(wanted * body._nodes.displacement[2], abs=1e-11 * wanted)
        errors.append(abs(math.sqrt(wanted) / (k * ROCK.wave_speed) - 1))
    assert math.log2(errors[1] / errors[0]) == pytest.approx(order, abs=0.1)
    assert errors[0] == pytest.approx((2 * math.pi / 16) ** order / (24 if order == 2 else 180), rel=0.05)


def test_the_critical_step_of_the_higher_order_mass_is_on_the_safe_side():
    """Noise in elements stays bounded just below it, and grows above the limit of a chain with its side motion held, 4 c / sqrt(3) h."""
    for share, stable in ((0.999, True), (1.15, False)):
        body = Manifold(lattice((6, 6, 24), periodic="xyz"), 3, mass="higher-order")
        chain = math.sqrt(3) / 2 * body.size[2] / ROCK.wave_speed
        assert body.critical_step < chain
        body.step = share * (body.critical_step if stable else chain)
        rng = np.random.default_rng(9)
        body.set_motion(velocity=lambda x: 1e-9 * rng.standard_normal(x.shape))
        body.advance(400)
        assert (np.abs(body.velocity).max() < 1e-7) == stable


def test_one_repeating_layer_is_plane_strain():
    """Elements of one layer, no motion across: the same displacements in a uniform load as the isotropic body in plane strain."""
    body = Manifold(lattice((24, 24, 1), periodic="z", local_damping=0.8), (4, 4, 1))
    body.hold(lambda x: x[:, 2] > -9, "z")
    body.hold(lambda x: x[:, 1] < 0.6, "y")
    body.hold(lambda x: x[:, 0] < 0.6, "x")
    body.lattice.traction(lambda x: x[:, 1] > 23, (0, 1e6, 0))
    body.advance(3000)
    nu = ROCK.poisson_ratio
    stretch = 1e6 * (1 - nu**2) / ROCK.young_modulus
    moved = body.particle_motion()[0]
    ends = body.lattice.reference[:, 1] > 23
    assert moved[ends, 1].mean() == pytest.approx(23.5 * stretch, rel=0.02)
    side = (body.lattice.reference[:, 0] > 23) & (body.lattice.reference[:, 1] < 22)  # the last half layer lies outside the load
    assert moved[side, 0].mean() == pytest.approx(-23.5 * stretch * nu / (1 - nu), rel=0.02)


def test_the_criterion_takes_the_largest_principal_strain():
    rng = np.random.default_rng(5)
    strain = rng.standard_normal((50, 6))
    tensors = strain[:, [[0, 5, 4], [5, 1, 3], [4, 3, 2]]]
    assert principal(strain) == pytest.approx(np.linalg.eigvalsh(tensors)[:, -1], rel=1e-12)
    assert np.array_equal(ultimate_strain(2.0, 0.5)(strain), principal(strain) > 1.0)


def test_no_particle_is_strained_more_than_those_in_the_corners_of_an_element():
    body = Manifold(lattice((4, 5, 3)), (4, 5, 3), continuum=False)
    body._nodes.displacement[:] = np.random.default_rng(8).standard_normal((3, 8))
    inside = (body.lattice.reference - body.lattice.reference.min(axis=0) + 0.5) / body.size
    everywhere = principal(bricks.strain_matrix(inside, body.size) @ body.displacement[body.grid.nodes[0]].ravel())
    found = principal(Probe("particles", body.grid.per_element, body.size).strains(body._nodes, body._elements, np.array([0]))[0])
    assert len(found) == 8 and found.max() == pytest.approx(everywhere.max(), rel=1e-13)


def test_elements_are_released_within_a_region_alone():
    body = Manifold(lattice((3, 3, 18)), 3, continuum=False, release=ultimate_strain(1e-4), within=layers(9), margin=1, check_every=1)
    body.set_motion(displacement=lambda x: x * (0, 0, 2e-4))
    assert np.array_equal(body.overstrained(), np.flatnonzero(body.centres[:, 2] < 9))


def test_a_margin_round_overstrained_particles_is_released():
    """Bent elements, of which one has overstrained particles and none is overstrained in its centre."""
    options = {"continuum": False, "release": ultimate_strain(1e-4, 1.0)}
    for strain_at, margin, wanted in (("centre", 0, 0), ("particles", 0, 1), ("particles", 1, 3)):
        body = Manifold(lattice((3, 3, 12)), 3, strain_at=strain_at, margin=margin, **options)
        body.set_motion(displacement=lambda x: np.where(x[:, 2:] > 8.9, 1.0, 0.0) * np.where(x[:, :1] > 1, 3.2e-4, 0.0) * (0, 0, 1))
        assert len(body.overstrained()) == wanted


@pytest.mark.parametrize("strain, reached", [((0, 0, 1, 0, 0, 0), 1.0), ((0, 0, 0, 0, 0, 1), 2**0.5), ((0, 0, -1, 0, 0, 0), 2**-0.5)])
def test_the_criterion_of_bonds_is_met_where_the_first_bond_comes_near_its_limit(strain, reached):
    """A strain e stretches an axial bond by e d, a shear e_xy an oblique one by sqrt(2) e_xy d; a compression e shears oblique ones by
    e d / sqrt(2)."""
    strain, limit = np.array([strain], dtype=float), 1e-3
    met = bond_limits(LatticeMaterial(12.5e9, 0.2, 2650.0, limit), 1.0, 0.8)
    assert not met(0.999 * 0.8 * limit / reached * strain)[0] and met(1.001 * 0.8 * limit / reached * strain)[0]
    only_tension = bond_limits(LatticeMaterial(12.5e9, 0.2, 2650.0, limit, 1.0), 1.0, 0.8)
    assert not only_tension(-limit * np.array([(0, 0, 1, 0, 0, 0)]))[0]


def test_overstrained_elements_are_released_while_the_run_goes_on():
    """A uniform strain above the limit: one layer of manifold elements after the other, at each look at the criterion."""
    body = Manifold(lattice((6, 6, 30)), 3, free=layers(6), release=ultimate_strain(1e-4), check_every=5)
    body.set_motion(displacement=lambda x: x * (0, 0, 0.9e-4))
    for looks in (1, 2):
        body.advance(5)
        assert body.released == 4 * looks and np.sum(body.kind == MANIFOLD) == 4
    assert np.any(body.kind == CONTINUUM)


@pytest.mark.parametrize(
    "force, mass, axes", [("variational", "lumped", 3), ("pairwise", "lumped", 3), ("pairwise", "higher-order", 3), ("pairwise", "higher-order", 2)]
)
def test_releases_in_a_run_keep_momentum_and_are_booked_to_rounding(force, mass, axes):
    """Elements released by the criterion, a few at a time and only near them looked at; published forces with what they do beyond
    their energy. What is held, loaded and absorbed goes on."""
    if axes == 3:
        alone = lattice((6, 6, 90), force=force, audit=force == "pairwise")
    else:
        alone = Lattice(packings.hexagonal(Box((0, 0), (8, 100)), 0.5), 1.0, ROCK, audit=True)
    high = alone.reference[:, -1].max()
    body = Manifold(alone, 3 if axes == 3 else (4, 4), free=lambda x: x[:, -1] < 9, mass=mass, release=ultimate_strain(2e-6), check_every=3)
    body.set_motion(velocity=lambda x: 1e-1 * np.sin(0.3 * x[:, ::-1]) * np.exp(-((x[:, -1:] / 15) ** 2)))
    before = body.momentum()
    body.advance(30)
    assert 4 < body.released < 0.7 * body.grid.count
    assert np.abs(body.momentum() - before).max() < 1e-11 * np.abs(before).max()
    alone.load(lambda x: x[:, 0] < 1, np.ones(axes), lambda t: math.sin(3e3 * t))
    alone.absorb(lambda x: x[:, -1] > high - 0.5, "xyz"[axes - 1])
    body.hold(lambda x: x[:, -1] < 0.6, "xy", lambda t: 1e-2 * math.sin(4e3 * t))
    body.hold(lambda x: x[:, -1] > high - 9, "x")
    started = body.energies()["balance"]
    for _ in range(3):
        body.advance(40)
        energy = body.energies()
        assert abs(energy["balance"] - started) < 1e-11 * (energy["kinetic"] + energy["elastic"])
    assert body.released > 15 and energy["release_kinetic"] > 0 < energy["release_strain"]
    assert energy["absorbed"] != 0 != energy["held_work"]


@pytest.mark.parametrize("force", ["variational", "pairwise"])
def test_a_release_in_a_run_is_one_between_two_steps(force):
    """In the middle of a step half of the kick is that of the forces before it, half that of those after it: the same motion to rounding."""
    bodies = []
    for release in (lambda strain: np.ones(len(strain), dtype=bool), None):
        body = Manifold(lattice((8, 8, 40), force=force), 4, free=layers(8), release=release, check_every=20)
        body.hold(layers(0.6), "xy")
        body.set_motion(lambda x: 1e-3 * np.sin(0.2 * x[:, [2, 0, 1]]), lambda x: 0.1 * np.cos(0.3 * x))
        body.advance(20)
        bodies.append(body)
    inside, between = bodies
    between.release(np.flatnonzero((inside.kind == PARTICLES) & (between.kind != PARTICLES)))
    for steps in (0, 19):
        for body in bodies:
            body.advance(steps)
        for mine, wanted in zip(inside.particle_motion(), between.particle_motion()):
            assert np.abs(mine - wanted).max() < 1e-12 * np.abs(wanted).max()
    assert inside.released == between.released == 4


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: Manifold(lattice((4, 4, 4)), 0), "per_element=0"),
        (lambda: Manifold(lattice((4, 4, 4)), 2, layers=-1), "layers=-1"),
        (lambda: Manifold(lattice((4, 4, 5), periodic="z"), 2), "must divide the number of sites"),
        (lambda: Manifold(lattice((4, 4, 4)), 2, free=layers(-1)), "names no particle"),
        (lambda: Manifold(lattice((4, 4, 4)), 2, faces="free"), 'faces="free"'),
        (lambda: Manifold(lattice((4, 4, 4)), 2, strain_at="corners"), 'strain_at="corners"'),
        (lambda: Manifold(lattice((4, 4, 4)), 2, margin=-1), "margin=-1"),
        (lambda: Manifold(lattice((4, 4, 4)), 2, mass="consistent"), 'mass="consistent"'),
        (lambda: Manifold(lattice((4, 4, 4), local_damping=0.5), 2, mass="higher-order"), "with local_damping=0.5"),
        (lambda: ultimate_strain(-1.0), "limit=-1"),
        (lambda: ultimate_strain(1.0, 1.5), "reduction=1.5"),
        (lambda: Manifold(lattice((4, 4, 4)), 2).hold(layers(-5), "x"), "neither nodes nor particles"),
    ],
)
def test_bad_input_is_refused_in_one_sentence(make, words):
    with pytest.raises(ValueError, match=words):
        make()
