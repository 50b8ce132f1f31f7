"""Overlap coupling in space: spheres on lattices, tetrahedra and hexahedra; Cosserat bodies where rotations are micro-rotations."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from bridge import BridgingScale, Overlap, OverlapZone, growth
from continuum import Body, Cauchy
from meshes import Box, Sphere, domains, packings
from particles import Assembly, LiChu
from tests.bridge.scenes import GRANULAR
from tests.bridge.space_scenes import BONDED, DENSITY, TIES, coupled, masses, momentum, parts, shaken

STRAINS = {
    "along": np.diag([1e-4, 0.0, 0.0]),
    "across": np.diag([0.0, 1e-4, -2e-4]),
    "shear across": 1e-4 * np.array([[0, 0, 0], [0, 0, 1], [0, 1, 0]]),
    "shear along": 1e-4 * np.array([[0, 1, 0], [1, 0, 0], [0, 0, 0]]),
}


def residual(strain, rotation, **scene):
    """Largest force out of balance on nodes and on spheres away from the free sides, to the traction on a cell."""
    body, soil, zone = parts(**{"cosserat": rotation == "micro"} | scene, width=2.0, faces=(1.0, 3.0), length=5.0)
    made = Overlap(body, soil, zone, rotation=rotation, step=1e-9)
    tie = made.tie
    moved = np.zeros((soil.count, 6))
    moved[:, :3] = soil.reference @ STRAINS[strain]
    body.displacement[:, :3] = body.coordinates @ STRAINS[strain]
    force = -(soil.stiffness_matrix(contact_range=1e-6) @ moved.ravel()).reshape(-1, 6)
    nodal = -body.internal_force()
    scale = np.abs(nodal).max()
    tied = np.zeros((soil.count, 6), dtype=bool)
    tied[tie.ids] = tie.tied
    made.exchange.scatter((tie.matrix.T @ np.where(tied, force, 0.0)[tie.ids].ravel()).reshape(-1, nodal.shape[1]), nodal)
    inner = np.all(np.abs(body.coordinates[:, 1:] - 1.0) < 0.1, axis=1) & (body.coordinates[:, 0] < 4.9)
    deep = np.all(np.abs(soil.reference[:, 1:] - 1.0) < 0.6, axis=1) & (soil.reference[:, 0] > 0.4)
    return np.abs(nodal[inner]).max() / scale, np.abs(np.where(tied, 0.0, force)[deep]).max() / scale


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
@pytest.mark.parametrize("strain", STRAINS)
@pytest.mark.parametrize("rotation", ["free", "curl", "micro"])
def test_uniform_strain_passes(strain, rotation, cell):
    """Each bond of the simple cubic lattice lies in one cell: to rounding, but for shear along the zone.

    There a sphere on a face has unlike shares on both sides, and so a moment, which falls with the number n of spacings in the zone: as
    1 / 2n^2 where the mesh takes it up by half the curl. A free rotation takes it itself, against the traction on a cell of n / 4 spacings.
    """
    for n in (8, 16) if cell == "hexahedron" and strain == "shear along" else (8,):
        nodes, spheres = residual(strain, rotation, cell=cell, radius=1.0 / n)
        if strain == "shear along" and rotation == "free":
            assert nodes < 1e-12 and spheres == pytest.approx(8.0 / n**4, rel=1e-6)
        elif strain == "shear along":
            assert nodes == pytest.approx(0.5 / n**2, rel=1e-6) and spheres < 1e-12
        else:
            assert nodes < 1e-12 and spheres < 1e-12


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
@pytest.mark.parametrize("strain", ["along", "across", "shear across"])
def test_uniform_strain_passes_with_the_moduli_of_a_packing(strain, cell):
    """Spheres that slide, roll and twist with stiffnesses of their own: a cubic Cosserat continuum, measured on a sample."""
    law = LiChu(1e8, 3e7, 1e6, 7e2, sliding_friction=1e6, rolling_friction=1e6, moment_friction=1e6, torsion_stiffness=5e2, torsion_friction=1e6)
    nodes, spheres = residual(strain, "micro", law=law, cosserat="measured", cell=cell)
    assert nodes < 1e-12 and spheres < 1e-12


@pytest.mark.parametrize("strain", STRAINS)
def test_a_lattice_across_the_cells_disturbs_uniform_strain_little(strain):
    """Face-centred cubic, its cubes a third and two thirds of a cell: bonds cross faces of cells."""
    nodes, spheres = residual(strain, "free", lattice="fcc", radius=1.0 / 12.0, anchor=(0.03, 0.02, 0.05))
    assert nodes < 5e-3 and spheres < 1e-3


@pytest.mark.parametrize("substeps", [1, 3])
@pytest.mark.parametrize("constraint, rotation", TIES)
def test_linear_momentum_is_kept(constraint, rotation, substeps):
    """Friction, dashpots, opening contacts: what spheres and nodes have together stays to rounding."""
    made = coupled(law=GRANULAR, constraint=constraint, rotation=rotation, substeps=substeps)
    soil, body = made.soil, made.body
    velocity = 0.01 * np.random.default_rng(2).standard_normal((soil.count, 6))
    velocity[made.tie.ids] = 0.0
    soil.velocities = velocity
    before, scale = momentum(made), np.sum(soil.masses[:, None] * np.abs(velocity[:, :3]))
    made.advance(150)
    energies = made.energies()
    assert min(energies[name] for name in ("friction", "viscous", "contact_loss")) > 0.0
    assert np.abs(body.velocity).max() > 0.02 * np.abs(velocity[:, :3]).max()
    np.testing.assert_allclose(momentum(made), before, rtol=0.0, atol=1e-12 * scale)


@pytest.mark.parametrize("constraint", ["lagrange", "penalty"])
@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_a_round_zone_anywhere_in_the_cells(cell, constraint):
    """A ball of spheres in a block: faces cut through cells; momentum to rounding, energy to the turn of the bonds."""
    zone = OverlapZone(Sphere((0.0, 0.0, 0.0), 0.5), Sphere((0.0, 0.0, 0.0), 1.0))
    body = Body(domains.box((-1.5,) * 3, (1.5,) * 3, (8, 8, 8), cell), Cauchy(1e9, 0.2, 2000.0), share=zone)
    soil = Assembly(packings.face_centred_cubic(Sphere((0.0, 0.0, 0.0), 0.99), 0.11), 0.11, DENSITY, BONDED)
    soil.bond(0.01)
    limit = Overlap(body, soil, zone, constraint=constraint, step=1e-9).critical_step(sharp=True)
    made = Overlap(body, soil, zone, constraint=constraint, step=0.8 * limit)
    distance = np.linalg.norm(body.coordinates, axis=1)[:, None]
    body.velocity[:] = -1e-3 * body.coordinates * (distance > 1.1)
    start, before = made.energies()["kinetic"], momentum(made)
    made.advance(200)
    energies = made.energies()
    assert energies["elastic"] > 0.003 * start
    assert abs(energies["balance"] - start) < 1e-5 * start
    scale = np.sum(np.abs(body.mass * body.velocity)) + np.sum(np.abs(masses(soil) * soil.velocities))
    np.testing.assert_allclose(momentum(made), before, rtol=0.0, atol=1e-12 * scale)


@pytest.mark.parametrize("mass_damping", [0.0, 20.0])
@pytest.mark.parametrize("constraint, rotation", TIES)
def test_energy_is_accounted_for_with_one_substep(constraint, rotation, mass_damping):
    made = shaken(constraint=constraint, rotation=rotation, ratio=0.8, mass_damping=mass_damping)
    start = made.energies()["kinetic"]
    errors, elastic = [], []
    for _ in range(40):
        made.advance(10)
        errors.append(made.energies()["balance"] - start)
        elastic.append(made.energies()["elastic"])
    assert max(elastic) > 1e-3 * start
    assert (made.energies()["mass_damping"] > 0.1 * start) == (mass_damping > 0.0)
    assert np.abs(errors).max() < 1e-4 * start


@pytest.mark.parametrize("constraint", ["lagrange", "penalty"])
def test_what_substeps_take_is_booked(constraint):
    made = shaken(constraint=constraint, substeps=3)
    start = made.energies()["kinetic"]
    made.advance(200)
    energies = made.energies()
    assert 0.0 < energies["interface"] < 0.5 * start
    assert abs(energies["balance"] - start) < 2e-3 * start


@pytest.mark.parametrize("constraint, rotation", TIES)
def test_everything_falls_together(constraint, rotation):
    made = coupled(constraint=constraint, rotation=rotation, gravity=(3.0, 1.0, -9.81))
    made.advance(50)
    for moved in (made.soil.velocities[:, :3], made.body.velocity[:, :3]):
        np.testing.assert_allclose(moved / made.time, np.broadcast_to([3.0, 1.0, -9.81], moved.shape), rtol=1e-9)
    energies = made.energies()
    assert abs(energies["balance"]) < 1e-9 * energies["external"]


@pytest.mark.parametrize("rotation", ["free", "curl", "micro"])
def test_stiff_springs_are_the_elimination(rotation):
    """Motions differ by the stretch of the springs, which is inverse to their stiffness."""
    runs = {}
    for name, options in {"tied": {}, "soft": {"penalty": 50.0}, "stiff": {"penalty": 5000.0}}.items():
        body, soil, zone = parts(cosserat=rotation == "micro")
        constraint = "penalty" if options else "lagrange"
        made = Overlap(body, soil, zone, constraint=constraint, rotation=rotation, step=4e-6, **options)
        x = body.coordinates[:, 0]
        body.velocity[:, 0] = 1e-3 * (x - 2.0) * (x > 2.1)
        made.advance(300)
        runs[name] = body.displacement[:, :3].copy()
    moved = np.abs(runs["tied"]).max()
    soft, stiff = (np.abs(runs[name] - runs["tied"]).max() / moved for name in ("soft", "stiff"))
    assert soft < 0.03 and stiff < 0.05 * soft


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
@pytest.mark.parametrize("constraint, rotation", TIES)
def test_the_critical_step_is_met_from_both_sides(constraint, rotation, cell):
    """One per cent below nothing grows; above, the fastest mode grows by exp(2 acosh(1.01)) a step. The bound is below both.

    Cauchy hexahedra and Cosserat tetrahedra; micro-rotations need a Cosserat body.
    """
    grown = []
    for factor in (0.99, 1.01):
        body, soil, zone = parts(cell=cell, cosserat=rotation == "micro" or cell == "tetrahedron")
        made = Overlap(body, soil, zone, constraint=constraint, rotation=rotation, step=1e-7)
        sharp = made.critical_step(sharp=True)
        assert 0.4 * sharp < made.critical_step() <= sharp * (1 + 1e-9)
        made.step = made.rule.step = made.fine.step = factor * sharp
        body.velocity[:] = 1e-9 * np.random.default_rng(0).standard_normal(body.velocity.shape)
        made.advance(60)
        grown.append(np.abs(soil.velocities).max() / 1e-9)
    assert grown[0] < 1e2 and grown[1] > 1e4


def pulse_reflected(cell, constraint, size):
    """Displacement that a pulse of 20 mm leaves behind in the spheres, to its height: spheres of 1 mm, zone of 50 mm."""
    radius, height, wavelength, start = 1e-3, 1e-7, 0.02, 0.03
    scene = {"radius": radius, "width": 4e-3, "anchor": (radius,) * 3}
    body, soil, zone = parts(cell=cell, faces=(0.06, 0.11), length=0.22, size=size, **scene)
    alone = Assembly(packings.simple_cubic(Box((0, 0, 0), (0.22, 4e-3, 4e-3)), radius, (radius,) * 3), radius, DENSITY, BONDED)
    alone.bond(0.01)
    speed = np.sqrt(body.material.young_modulus / body.material.density)
    for one in (soil, alone):
        phase = 2.0 * np.pi * (one.reference[:, 0] - start) / wavelength
        within = np.abs(phase) < np.pi
        moved, rates = np.zeros((2, one.count, 6))
        moved[:, 0] = np.where(within, 0.5 * height * (1.0 + np.cos(phase)), 0.0)
        rates[:, 0] = np.where(within, np.pi * height * speed / wavelength * np.sin(phase), 0.0)
        one.displacements, one.velocities = moved, rates
    limit = Overlap(body, soil, zone, constraint=constraint, step=1e-12).critical_step(sharp=True)
    made = Overlap(body, soil, zone, constraint=constraint, step=0.5 * limit)
    ahead = np.flatnonzero(soil.reference[:, 0] < 0.06)
    there = cKDTree(alone.reference).query(soil.reference[ahead])[1]
    largest, steps = 0.0, int(0.0065 / speed / made.step)
    for _ in range(20):
        made.advance(steps)
        alone.advance(steps, made.step)
        change = soil.displacements[ahead, 0] - alone.displacements[there, 0]
        largest = max(largest, np.abs(change).max())
    assert np.abs(alone.displacements[there]).max() < 1e-2 * height < 0.5 * np.abs(made.body.displacement).max()
    return largest / height


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
@pytest.mark.parametrize("constraint, size, most", [("lagrange", 2e-3, 2.5e-3), ("lagrange", 4e-3, 2.5e-2), ("penalty", 2e-3, 8e-3)])
def test_a_pulse_passes_the_zone(constraint, size, most, cell):
    """Ten and five cells in the pulse: what comes back, see docs/overlap.md."""
    assert pulse_reflected(cell, constraint, size) < most


def test_parts_that_do_not_go_together_are_refused():
    body, soil, zone = parts()
    with pytest.raises(ValueError, match="discs with a plane body"):
        Overlap(body, Assembly([[1.5, 0.5]], 0.1, DENSITY, LiChu(1e8, 1e7)), zone, step=1e-6)
    with pytest.raises(ValueError, match="needs a Cosserat body"):
        Overlap(body, soil, zone, rotation="micro", step=1e-6)
    outside = Assembly(np.vstack([soil.reference, [1.5, 0.5, 1.3]]), 0.125, DENSITY, BONDED)
    with pytest.raises(ValueError, match="outside the mesh"):
        Overlap(body, outside, zone, step=1e-6)
    turning, soil, _ = parts(cosserat=True)
    with pytest.raises(ValueError, match="the bridging scale is plane"):
        BridgingScale(turning, soil, np.zeros(soil.count, dtype=bool), step=1e-6)
    body, soil, zone = parts()
    with pytest.raises(ValueError, match="growth test is plane"):
        growth(Overlap(body, soil, zone, step=1e-6))
