"""Interface and full coverage: patch test, exactness, momentum, ghosts, waves (Li & Wan 2010, eqs 15-17, 25-34)."""

import numpy as np
import pytest

from bridge import BridgingScale
from continuum import Body, Cosserat
from meshes import Box, domains
from particles import Assembly, Plate
from tests.bridge.scenes import GRANULAR, lattice, lattice_moduli, scene

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


@pytest.mark.parametrize("variant", ["paper", "respa"])
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


@pytest.mark.parametrize("variant, substeps", [("respa", 1), ("respa", 4), ("multiplier", 1)])
def test_linear_momentum_is_kept(variant, substeps):
    """Nothing holds the body: the momentum of nodes and particles together stays, to rounding.

    (`multiplier` with substeps does not keep it: the nodes get the multiplier of the coarse time, the ghosts one in every
    substep.)
    """
    coupled, _ = scene(fixed=(), law=GRANULAR, step=2e-4 * substeps, substeps=substeps, variant=variant)
    body, soil = coupled.body, coupled.soil
    carried, random = np.array(soil.masses), np.random.default_rng(2)
    velocity = random.standard_normal((soil.count, 3)) * 0.01
    ghosts = coupled.fine.ids
    if variant == "respa":
        carried[ghosts] = 0.0  # massless: their share is on the nodes
    velocity[ghosts] = 0.0
    soil.velocities = velocity

    def momentum():
        return carried @ soil.velocities[:, :2] + (coupled.mass * body.velocity)[:, :2].sum(axis=0)

    before, scale = momentum(), np.sum(soil.masses) * 0.01
    coupled.advance(100)
    assert np.abs(body.velocity).max() > 1e-6
    np.testing.assert_allclose(momentum(), before, rtol=0.0, atol=1e-12 * scale)


@pytest.mark.parametrize("variant", ["paper", "resync", "respa", "multiplier"])
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
