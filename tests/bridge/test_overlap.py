"""Overlap coupling: patch test, momentum, energy, both constraints, critical step (Rojek & Onate 2007, section 5)."""

import numpy as np
import pytest

from bridge import Overlap, OverlapZone
from continuum import Body, Cauchy
from meshes import Disc, domains, packings
from particles import Assembly, Bonded
from tests.bridge.overlap_scenes import FACES, LENGTH, coupled, faces, masses, momentum, parts, spectral_radius
from tests.bridge.scenes import ELASTIC, GRANULAR

STRAINS = {"compression": [[-1e-4, 0.0], [0.0, -3e-4]], "shear": [[0.0, 2e-4], [2e-4, 0.0]]}
TIES = [("lagrange", "micro"), ("lagrange", "free"), ("lagrange", "curl"), ("penalty", "micro"), ("penalty", "free")]


def residual(kind, strain, **scene):
    """Largest force out of balance on nodes and on particles away from free edges, to the traction on a cell.

    Uniform strain of everything, contacts linear.
    """
    made = coupled(kind, **scene)
    soil, body, mesh, tie = made.soil, made.body, made.mesh, made.tie
    gradient = np.array(STRAINS[strain])
    moved = np.zeros((soil.count, 3))
    moved[:, :2] = soil.reference @ gradient
    body.displacement[:, :2] = body.coordinates @ gradient
    mesh.receive()
    force = -(soil.stiffness_matrix(contact_range=1e-6) @ moved.ravel()).reshape(-1, 3)
    nodal = -mesh.internal_force(mesh.displacement)
    scale = np.abs(nodal).max()
    tied = np.zeros((soil.count, 3), dtype=bool)
    tied[tie.ids] = tie.tied
    made.exchange.scatter((tie.matrix.T @ np.where(tied, force, 0.0)[tie.ids].ravel()).reshape(-1, 3), nodal)
    x, y = body.coordinates.T
    alone = np.where(tied, 0.0, force)[(np.abs(soil.reference[:, 1] - 1.0) < 0.6) & (soil.reference[:, 0] > 0.4)]
    return np.abs(nodal[(np.abs(y - 1.0) < 0.1) & (x < LENGTH - 0.1)]).max() / scale, np.abs(alone).max() / scale


@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
@pytest.mark.parametrize("strain", STRAINS)
def test_uniform_strain_passes_where_each_bond_lies_in_one_element(strain, cell):
    """The lattice at 45 degrees integrates the products of share and shape functions exactly: balance to rounding."""
    nodes, particles = residual("square_45", strain, radius=0.125 / np.sqrt(2.0), cell=cell)
    assert nodes < 1e-12 and particles < 1e-12


def test_uniform_compression_of_the_square_lattice_passes():
    nodes, particles = residual("square", "compression")
    assert nodes < 1e-12 and particles < 1e-12


@pytest.mark.parametrize("n", [8, 16])
def test_shear_of_the_square_lattice_leaves_the_moment_of_its_kinks(n):
    """Discs on a face have unlike shares on both sides, so a moment: 1/2n^2 of the traction by half the curl, n spacings in the zone.

    A free rotation takes it itself: the nodes are in balance, the disc's moment is t s^2 / 2n for a traction t on cells of n/4 spacings s.
    """
    nodes, discs = residual("square", "shear", radius=1.0 / n, rotation="curl")
    assert nodes == pytest.approx(0.5 / n**2, rel=1e-6) and discs < 1e-12
    nodes, discs = residual("square", "shear", radius=1.0 / n, rotation="free")
    assert nodes < 1e-12 and discs == pytest.approx(2.0 / n**3, rel=1e-6)


@pytest.mark.parametrize("strain", STRAINS)
def test_bonds_across_elements_disturb_uniform_strain_little(strain):
    """A lattice anywhere, 25 spacings in the zone: below 2e-3 on the nodes; particles that are free are in balance."""
    nodes, particles = residual("hexagonal", strain, radius=0.04, anchor=(0.01, 0.02))
    assert nodes < 2e-3 and particles < 1e-12


@pytest.mark.parametrize("substeps", [1, 3])
@pytest.mark.parametrize("constraint, rotation", TIES)
def test_linear_momentum_is_kept(constraint, rotation, substeps):
    """Friction, dashpots, opening contacts: what particles and nodes have together stays to rounding."""
    made = coupled(law=GRANULAR, constraint=constraint, rotation=rotation, substeps=substeps)
    soil, body = made.soil, made.body
    velocity = 0.01 * np.random.default_rng(2).standard_normal((soil.count, 3))
    velocity[made.tie.ids] = 0.0
    soil.velocities = velocity
    before, scale = momentum(made), np.sum(masses(made) * np.abs(velocity))
    made.advance(150)
    energies = made.energies()
    assert min(energies[name] for name in ("friction", "viscous", "contact_loss")) > 0.0
    assert np.abs(body.velocity).max() > 0.02 * np.abs(velocity).max()
    np.testing.assert_allclose(momentum(made), before, rtol=0.0, atol=1e-12 * scale)


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
@pytest.mark.parametrize("constraint", ["lagrange", "penalty"])
def test_a_round_zone_in_a_disordered_packing(constraint, cell):
    """Faces that cut through elements and particles: momentum to rounding, energy to the turn of the bonds."""
    zone = OverlapZone(Disc((0.0, 0.0), 1.0), Disc((0.0, 0.0), 2.0))
    body = Body(domains.rectangle((-3, -3), (3, 3), (24, 24), cell), Cauchy(2e8, 0.2, 2000.0), share=zone)
    random = np.random.default_rng(1)
    sites = packings.hexagonal(Disc((0.0, 0.0), 1.99), 0.06)
    places = 0.999 * sites + random.uniform(-1e-3, 1e-3, sites.shape)
    soil = Assembly(places, 0.06 * random.uniform(0.97, 1.0, len(sites)), 2300.0, bonded())
    soil.bond(0.06)
    limit = Overlap(body, soil, zone, constraint=constraint, step=1e-9).critical_step(sharp=True)
    made = Overlap(body, soil, zone, constraint=constraint, step=0.8 * limit)
    distance = np.linalg.norm(body.coordinates, axis=1)[:, None]
    body.velocity[:] = -1e-3 * body.coordinates * np.exp(-(((distance - 2.6) / 0.25) ** 2)) * (distance > 2.05)
    start, before = made.energies()["kinetic"], momentum(made)
    made.advance(600)
    energies = made.energies()
    assert energies["elastic"] > 0.01 * start
    assert abs(energies["balance"] - start) < 1e-5 * start
    scale = np.sum(np.abs(body.mass * body.velocity)) + np.sum(np.abs(masses(made) * soil.velocities))
    np.testing.assert_allclose(momentum(made), before, rtol=0.0, atol=1e-12 * scale)


def shaken(**scene):
    """Nodes beyond the zone in motion; small, and all contacts closed, so that everything is linear."""
    made = coupled(**scene)
    x, y = made.body.coordinates.T
    made.body.velocity[:, 1] = 1e-3 * np.sin(2.0 * x + y) * (x > FACES[1] + 0.1)
    return made


@pytest.mark.parametrize("mass_damping", [0.0, 20.0])
@pytest.mark.parametrize("constraint, rotation", TIES)
def test_energy_is_accounted_for_with_one_substep(constraint, rotation, mass_damping):
    """With the kinetic energy of central differences the account of an elastic system closes at every time.

    Bonds are nonlinear only by the change of their directions, a share of the order of the strain, 1e-5.
    """
    made = shaken(law=bonded(), constraint=constraint, rotation=rotation, ratio=0.8, mass_damping=mass_damping)
    start = made.energies()["kinetic"]
    made.soil.bond(0.01)
    errors, elastic = [], []
    for _ in range(60):
        made.advance(10)
        errors.append(made.energies()["balance"] - start)
        elastic.append(made.energies()["elastic"])
    assert max(elastic) > 1e-3 * start
    assert (made.energies()["mass_damping"] > 0.1 * start) == (mass_damping > 0.0)
    assert np.abs(errors).max() < 1e-4 * start


def test_damping_against_the_motion_of_free_particles_is_booked():
    """It takes a share of the force on what does not follow the mesh (Rojek & Onate, eqs 25-26); booked to second order."""
    errors = []
    for ratio in (0.5, 0.25):
        made = shaken(law=bonded(), constraint="lagrange", rotation="free", ratio=ratio, vector_damping=(0.2, 0.2))
        made.soil.bond(0.01)
        start = made.energies()["kinetic"]
        made.advance(round(300 / ratio))
        energies = made.energies()
        assert energies["local_damping"] > 0.5 * start
        errors.append(energies["balance"] - start)
    assert abs(errors[1]) < 2e-3 * start
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)


def bonded():
    return Bonded(2.5e8, 5e7, np.inf, np.inf)


@pytest.mark.parametrize("constraint", ["lagrange", "penalty"])
def test_what_substeps_take_is_booked(constraint):
    """The loss at the edge of the zone is a term of its own; what is left unaccounted is below a thousandth."""
    made = shaken(law=bonded(), constraint=constraint, substeps=4)
    start = made.energies()["kinetic"]
    made.soil.bond(0.01)
    made.advance(300)
    energies = made.energies()
    assert 0.0 < energies["interface"] < 0.5 * start
    assert abs(energies["balance"] - start) < 1e-3 * start


@pytest.mark.parametrize("rotation", ["micro", "free", "curl"])
def test_stiff_springs_are_the_elimination(rotation):
    """Motions differ by the stretch of the springs, which is inverse to their stiffness."""
    runs = {}
    for name, options in {"tied": {}, "soft": {"penalty": 50.0}, "stiff": {"penalty": 5000.0}}.items():
        body, soil, zone = parts(law=bonded())
        soil.bond(0.01)
        made = Overlap(
            body, soil, zone, constraint="penalty" if options else "lagrange", rotation=rotation, step=2e-6, **options
        )
        x, _ = body.coordinates.T
        body.velocity[:, 0] = 1e-3 * np.exp(-((x - 4.0) ** 2) / 0.5) * (x > FACES[1] + 0.1)
        made.advance(1500)
        runs[name] = body.displacement.copy()
        largest = made.mismatch()
    moved = np.abs(runs["tied"][:, :2]).max()
    soft, stiff = (np.abs(runs[name] - runs["tied"])[:, :2].max() / moved for name in ("soft", "stiff"))
    assert soft < 0.02 and stiff < 0.05 * soft
    assert largest < 1e-3 * moved


@pytest.mark.parametrize("constraint, rotation", TIES)
def test_the_critical_step_is_met_from_both_sides(constraint, rotation):
    """One per cent below nothing grows; above, the fastest mode does (w h = 2.02: radius of the map 1.33)."""
    scene = {"constraint": constraint, "rotation": rotation, "radius": 0.25}
    assert spectral_radius(coupled(**scene, ratio=0.99)) < 1.0 + 1e-8
    body, soil, zone = parts(radius=0.25)
    made = Overlap(body, soil, zone, constraint=constraint, rotation=rotation, step=1e-6)
    made.step = made.rule.step = made.fine.step = 1.01 * made.critical_step(sharp=True)
    assert spectral_radius(made) > 1.2


@pytest.mark.parametrize("kind", ["square", "hexagonal"])
@pytest.mark.parametrize("constraint, rotation", TIES)
def test_the_bound_of_the_critical_step_is_safe_and_not_far(constraint, rotation, kind):
    made = coupled(kind, constraint=constraint, rotation=rotation)
    bound, sharp = made.critical_step(), made.critical_step(sharp=True)
    assert 0.4 * sharp < bound <= sharp


@pytest.mark.parametrize("substeps", [2, 5])
@pytest.mark.parametrize("constraint", ["lagrange", "penalty"])
def test_substeps_do_not_grow(constraint, substeps):
    """Largest eigenvalue of one coarse step at 0.7 of the critical steps: one, to the accuracy of the eigenvalues."""
    made = coupled(constraint=constraint, substeps=substeps, ratio=0.7, radius=0.25)
    assert spectral_radius(made) < 1.0 + 1e-8


@pytest.mark.parametrize("constraint, rotation", TIES)
@pytest.mark.parametrize("cosserat", [True, False])
def test_everything_falls_together(constraint, rotation, cosserat):
    """Both parts of every mass and every weight: a free body gains g t everywhere and nothing strains."""
    if rotation == "micro" and not cosserat:
        pytest.skip("a Cauchy body has no micro-rotation")
    made = coupled(constraint=constraint, rotation=rotation, cosserat=cosserat, gravity=(3.0, -9.81))
    made.advance(50)
    for moved in (made.soil.velocities[:, :2], made.body.velocity[:, :2]):
        np.testing.assert_allclose(moved / made.time, np.broadcast_to([3.0, -9.81], moved.shape), rtol=1e-9)
    energies = made.energies()
    assert abs(energies["balance"]) < 1e-9 * energies["external"]


@pytest.mark.parametrize("substeps", [1, 4])
def test_multipliers_are_what_acts_on_the_mesh(substeps):
    """M_F a = f + G^T lambda at the nodes."""
    made = coupled(substeps=substeps, gravity=(0.0, -9.81), fixed=(("right", "xyr"),))
    made.advance(20)
    body, tie = made.body, made.tie
    force = np.zeros_like(body.mass)
    made.exchange.scatter((tie.matrix.T @ made.multipliers().ravel()).reshape(-1, 3), force)
    made.exchange.scatter((tie.matrix.T @ made.fine.load.ravel()).reshape(-1, 3), force)
    on = np.zeros_like(body.mass)
    made.exchange.scatter(np.ones((len(made.exchange.nodes), 3)), on)
    these = (on > 0.0) & ~body.fixed
    due = body.mass * body.acceleration - (body.external_force() - body.internal_force())
    np.testing.assert_allclose(force[these], due[these], rtol=0.0, atol=1e-9 * np.abs(due[these]).max())


def test_substeps_follow_the_same_motion():
    """A wave that the coarse step resolves: displacements with four substeps are those with one, to two per cent."""
    runs = []
    for substeps in (1, 4):
        body, soil, zone = parts(law=bonded())
        soil.bond(0.01)
        made = Overlap(body, soil, zone, step=2e-5 * substeps, substeps=substeps)
        x, _ = body.coordinates.T
        body.velocity[:, 0] = 1e-3 * np.exp(-((x - 4.0) ** 2) / 0.5)
        made.advance(200 // substeps)
        runs.append(soil.displacements[:, 0])
    assert np.abs(runs[0] - runs[1]).max() < 0.02 * np.abs(runs[0]).max()


WRONG = [
    ({"constraint": "glue"}, "constraint"), ({"rotation": "fixed"}, "rotation"), ({"penalty": 0.0}, "penalty"),
    ({"step": 1.0}, "critical step"), ({"substeps": 0}, "substeps"), ({"mass_damping": -1.0}, "mass_damping"),
    ({"constraint": "penalty", "vector_damping": (0.2, 0.2)}, "vector_damping"), ({"vector_damping": 0.2}, "vector_damping=0.2"),
    ({"step": "1"}, "step='1' must be positive"), ({"penalty": "4"}, "penalty='4'"), ({"substeps": np.nan}, "substeps=nan must be"),
]  # fmt: skip


@pytest.mark.parametrize("options, word", WRONG)
def test_bad_input_is_named(options, word):
    body, soil, zone = parts()
    with pytest.raises(ValueError, match=word):
        Overlap(body, soil, zone, **{"step": 1e-6} | options)


def test_parts_that_do_not_go_together_are_refused():
    body, soil, zone = parts()
    with pytest.raises(ValueError, match="share=zone"):
        Overlap(body, soil, faces(), step=1e-6)
    beyond = Assembly(np.vstack([soil.reference, [3.5, 1.0]]), 0.125, 2600.0, ELASTIC)
    with pytest.raises(ValueError, match="lies beyond the zone"):
        Overlap(body, beyond, zone, step=1e-6)
    outside = Assembly(np.vstack([soil.reference, [1.5, 2.5]]), 0.125, 2600.0, ELASTIC)
    with pytest.raises(ValueError, match="outside the mesh"):
        Overlap(body, outside, zone, step=1e-6)
    alone = Assembly([[0.2, 0.2]], 0.125, 2600.0, ELASTIC)
    with pytest.raises(ValueError, match="no particle lies in the overlap zone"):
        Overlap(body, alone, zone, step=1e-6)
    soil.hold([int(np.argmax(soil.reference[:, 0]))])
    with pytest.raises(ValueError, match="is held"):
        Overlap(body, soil, zone, step=1e-6)
    cauchy, soil, zone = parts(cosserat=False)
    with pytest.raises(ValueError, match="needs a Cosserat body"):
        Overlap(cauchy, soil, zone, rotation="micro", step=1e-6)


def test_loads_must_not_change_afterwards():
    made = coupled()
    made.soil.external_forces = np.ones((made.soil.count, 3))
    with pytest.raises(ValueError, match="must be set before Overlap"):
        made.advance(1)
