"""Interface and full coverage: patch test, exactness, momentum, ghosts, waves (Li & Wan 2010, eqs 15-17, 25-34)."""

import numpy as np
import pytest

from bridge import BridgingScale
from bridge.linear import LinearSystem
from continuum import Body, Cosserat
from meshes import Box, domains
from particles import Assembly, Plate, listing
from particles.system import SKIN_SCALE, TRAVEL_LIMIT
from tests.bridge.scenes import ELASTIC, GRANULAR, lattice, lattice_moduli, scene

STRAINS = {"compression": [[-1e-4, 0.0], [0.0, -3e-4]], "shear": [[0.0, 2e-4], [2e-4, 0.0]]}
LATTICES = {  # radius that puts whole numbers of spacings between nodes
    "square": 0.125,
    "square_45": 0.25 / np.sqrt(2.0),
    "hexagonal": 0.125,
}


@pytest.mark.parametrize("strain", STRAINS)
@pytest.mark.parametrize("kind", LATTICES)
def test_uniform_strain_passes_the_interface(kind, strain):
    """Forces on nodes and particles away from the outer edge vanish to rounding, relative to those of the continuum alone."""
    coupled, _ = scene(kind, radius=LATTICES[kind], fixed=(), step=1e-5, substeps=1, variant="resync")
    body, soil, gradient = coupled.body, coupled.soil, np.array(STRAINS[strain])
    body.displacement[:, :2] = body.coordinates @ gradient
    displacement = np.zeros((soil.count, 3))
    displacement[:, :2] = soil.reference @ gradient
    forces = -(soil.stiffness_matrix(contact_range=1e-6) @ displacement.ravel()).reshape(-1, 3)
    coupled.rule.update_continuum_force()
    total = coupled.rule.continuum_force.copy()
    alone = np.abs(total).max()
    coupled.exchange.scatter(coupled.interpolation.matrix.T @ forces, total)
    x, y = body.coordinates.T
    inner = (x > 1.5) & (x < 4.5) & (y > 0.5) & (y < 4.5)
    assert np.abs(total[inner]).max() < 1e-12 * alone
    assert (
        np.abs(coupled.rule.continuum_force[np.isclose(y, 3.0)]).max() > 0.1 * alone
    )  # each side alone is out of balance


def full_coverage(law, substeps, variant="paper", lumped=False):
    region = Box((-1.0, -1.0), (3.0, 3.0))
    body = Body(domains.rectangle((0, 0), (2, 2), (2, 2)), Cosserat(1e8, 0.2, 1e7, 0.1, density=1.0), excluded=region)
    random = np.random.default_rng(5)
    grid = np.stack(np.meshgrid(*[np.arange(0.1, 2.0, 0.2)] * 2), axis=-1).reshape(-1, 2)
    soil = Assembly(grid + random.uniform(-0.004, 0.004, grid.shape), 0.1, 2600.0, law)
    soil.velocities = random.standard_normal((len(grid), 3)) * [0.3, 0.3, 1.0]
    return BridgingScale(
        body, soil, np.zeros(soil.count, bool), step=2e-5 * substeps, substeps=substeps, variant=variant
    )


def test_full_coverage_is_exact_for_any_contact_law():
    """Coarse and fine motion stay one and the same: N d = P q after 300 steps with slip, opening contacts and dashpots."""
    coupled = full_coverage(GRANULAR, 1)
    fine, body, exchange = coupled.fine, coupled.body, coupled.exchange
    projection = fine.projection

    def onto_nodes(values, owned):
        coupled.rule.assign(owned, projection.coarse(values), np.ones(len(exchange.nodes), dtype=bool))

    coupled.advance(1)
    onto_nodes(fine.displacement(), body.displacement)
    onto_nodes(fine.velocity(), body.velocity)
    onto_nodes(coupled.soil.system.acceleration[:, :3], body.acceleration)
    coupled.advance(300)
    moved = np.abs(fine.displacement()).max(axis=0)
    mesh = projection.extend(exchange.gather(body.displacement))
    np.testing.assert_array_less(np.abs(mesh - projection.project(fine.displacement())).max(axis=0), 1e-10 * moved)
    assert coupled.soil.energies()["friction_sliding"] > 0.0 and coupled.soil.energies()["contact_loss"] > 0.0


def shaken(variant, **options):
    """The scene with moving nodes and resting particles."""
    coupled, _ = scene(law=GRANULAR, step=4e-4, substeps=4, variant=variant, mass_damping=100.0, **options)
    coupled.body.velocity[:, 1] = 0.1 * np.sin(coupled.body.coordinates[:, 0]) * (coupled.body.mass[:, 0] > 0)
    coupled.body.velocity[coupled.body.fixed] = 0.0
    return coupled


@pytest.mark.parametrize("variant", ["paper", "respa", "subcycling"])
def test_ghosts_follow_the_mesh_to_rounding(variant):
    """Li & Wan (2010), eqs 25-26 with the constant coarse acceleration end at N d of the new time."""
    coupled = shaken(variant)
    coupled.advance(50)
    assert np.abs(coupled.body.displacement).max() > 1e-5
    assert coupled.mismatch() < 1e-13


def test_tied_ghosts_stay_with_the_mesh():
    """Velocities are tied, positions drift and are taken back: below 1 % of the largest displacement here (2 % untied)."""
    coupled = shaken("multiplier")
    coupled.advance(200)
    assert coupled.mismatch() < 0.01 * np.abs(coupled.body.displacement).max()


def free_body(variant, substeps, law=GRANULAR):
    """The scene that nothing holds, particle and coarse steps up to 0.7 of the critical ones; and masses of particles."""
    coupled, _ = scene(fixed=(), law=law, step=min(2e-4 * substeps, 1.6e-3), substeps=substeps, variant=variant)
    soil = coupled.soil
    masses = np.column_stack([soil.masses, soil.masses, soil.inertias])
    if variant != "multiplier":
        masses[coupled.fine.ids] = 0.0  # their share is on the nodes
    return coupled, masses


@pytest.mark.parametrize(
    "variant, substeps", [*((v, m) for v in ("subcycling", "respa") for m in (1, 4, 11)), ("multiplier", 1)]
)
def test_linear_momentum_is_kept(variant, substeps):
    """Momentum of nodes and particles together stays to rounding, with friction, dashpots and contacts that open.

    (`multiplier` with substeps does not keep it: the nodes get the multiplier of the coarse time, the ghosts one in every
    substep.)
    """
    coupled, masses = free_body(variant, substeps)
    body, soil = coupled.body, coupled.soil
    velocity = 0.01 * np.random.default_rng(2).standard_normal((soil.count, 3)) * (masses > 0.0)
    soil.velocities = velocity

    def momentum():
        return (masses * soil.velocities)[:, :2].sum(axis=0) + (coupled.mass * body.velocity)[:, :2].sum(axis=0)

    before, scale = momentum(), np.sum(masses * np.abs(velocity))
    coupled.advance(200)
    energies = coupled.energies()
    assert min(energies[name] for name in ("friction", "viscous", "contact_loss")) > 0.0
    assert np.abs(body.velocity).max() > 0.1 * np.abs(velocity).max()
    np.testing.assert_allclose(momentum(), before, rtol=0.0, atol=1e-12 * scale)


@pytest.mark.parametrize("substeps", [1, 4, 11])
def test_the_exchange_has_no_net_moment(substeps):
    """Infinitesimal motion about the reference: angular momentum of nodes and particles stays, to rounding.

    One coarse step of the linear system from random displacements and velocities. (Motion of finite size adds a
    moment of the order of the displacements, because N is that of the reference positions.)
    """
    coupled, masses = free_body("subcycling", substeps, ELASTIC)
    body, soil = coupled.body, coupled.soil

    def moments(points, momentum):
        return np.column_stack([points[:, 0] * momentum[:, 1], -points[:, 1] * momentum[:, 0], momentum[:, 2]])

    def angular_momentum():
        parts = moments(soil.reference, masses * soil.velocities), moments(body.coordinates, coupled.mass * body.velocity)
        return np.concatenate(parts)

    with LinearSystem(coupled, soil.stiffness_matrix(contact_range=1e-6), scale=1e-3) as linear:
        linear.write(np.random.default_rng(3).standard_normal(len(linear.read())))
        linear.step()  # brings accelerations in line with displacements
        before = angular_momentum()
        linear.step()
        after = angular_momentum()
    assert np.abs(after - before).sum() > 0.1 * np.abs(before).sum()
    assert abs(after.sum() - before.sum()) < 1e-12 * np.abs(before).sum()


@pytest.mark.parametrize("variant", ["respa", "subcycling"])
def test_a_translation_of_everything_stays_one(variant):
    """Sides (prescribed), nodes and particles move evenly: nothing strains.

    Positions of metres round by 1e-15 m a step, which the contacts answer to: 1e-12 m after 200 particle steps.
    """
    coupled, _ = scene(step=8e-4, substeps=4, variant=variant, velocity=(0.3, -0.2))
    body, soil = coupled.body, coupled.soil
    body.velocity[:, :2] = (0.3, -0.2)
    soil.velocities = np.broadcast_to([0.3, -0.2, 0.0], (soil.count, 3))
    coupled.advance(50)
    for moved in (soil.displacements, body.displacement):
        np.testing.assert_allclose(moved - [0.012, -0.008, 0.0], 0.0, atol=1e-12)


def test_rows_may_be_sorted_anew_within_a_coarse_step(monkeypatch):
    """Sums over contacts come in the order of the rows: equal to rounding of 40 particle steps, dashpots included."""
    still, sorted_often = shaken("paper"), shaken("paper")
    still.advance(10)
    monkeypatch.setattr(listing, "holds", lambda soil: False)
    monkeypatch.setattr(listing, "_sort_if_worth_it", lambda soil, changed: listing._sort(soil, 0.3 + 0.01 * soil.rebuilds, changed))
    soil = sorted_often.soil
    soil._system.clock[SKIN_SCALE], soil._system.clock[TRAVEL_LIMIT] = 0.0, 1e-6  # a new list in nearly every particle step
    sorted_often.advance(10)
    assert soil.rebuilds > 20 and still.soil.rebuilds < 20
    scale = np.abs(still.soil.displacements).max()
    np.testing.assert_allclose(soil.displacements, still.soil.displacements, rtol=0.0, atol=1e-11 * scale)


def test_many_steps_at_once_are_those_one_by_one():
    runs = [shaken("subcycling") for _ in range(2)]
    runs[0].advance(30)
    for _ in range(30):
        runs[1].advance(1)
    for name in ("displacement", "velocity", "acceleration"):
        np.testing.assert_array_equal(getattr(runs[0].body, name), getattr(runs[1].body, name))
    np.testing.assert_array_equal(runs[0].soil.displacements, runs[1].soil.displacements)
    assert runs[0].time == runs[1].time and runs[0].energies() == runs[1].energies()


@pytest.mark.parametrize("variant", ["paper", "resync", "respa", "multiplier", "subcycling"])
def test_coupled_and_full_particles_coincide_until_the_wave_has_come_back(variant):
    """A plate pushes the free surface: its load is that of particles alone until waves return from the interface.

    The fastest wave of the lattice, sqrt(stiffness / density), needs 2 x 3 m / c. A hundredth of the peak remains for the
    numerical forerunners and for what has entered the continuum.
    """
    radius, law, step = 0.25 / np.sqrt(2.0), GRANULAR, 2e-4
    region = ((-1.0, 3.0), (7.0, 7.0))
    plate = ((2.0, 6.0 + radius), (4.0, 6.5), (0.0, -1.0))
    coupled, _ = scene(
        law=law, region=region, plate=plate, step=2 * step, substeps=2, variant=variant, mass_damping=100.0
    )
    sites = lattice("square_45", Box((0.0, 0.0), (6.0, 6.0)), radius, (0.0, 3.0))
    full = Assembly(sites, radius, 2600.0, law)
    full.add_wall(Plate.rectangle(*plate[:2], velocity=plate[2]))
    full.hold(np.flatnonzero(sites[:, 1] < 0.1), "xyr")
    for soil in (full, coupled.soil):
        soil.hold(np.flatnonzero(np.abs(soil.reference[:, 0] - 3.0) > 2.9), "xyr")
    stiffness, _ = lattice_moduli("square_45", radius, law)
    speed = np.sqrt(stiffness[1, 1, 1, 1] / (2600.0 * np.pi / 4.0))
    loads = []
    for _ in range(int(2.0 * 2.5 / speed / (2 * step))):
        coupled.advance(1)
        full.advance(2, step, mass_damping=100.0)
        loads.append([coupled.soil.plates[0].force[1], full.plates[0].force[1]])
    loads = np.array(loads)
    first = len(loads) // 2  # until the front meets the interface
    assert np.abs(loads[:first, 0] - loads[:first, 1]).max() < 1e-5 * loads.max()
    assert np.abs(loads[:, 0] - loads[:, 1]).max() < 1e-2 * loads.max()
