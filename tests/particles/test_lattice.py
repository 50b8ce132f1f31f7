"""Distinct lattice springs (Zhao et al. 2012, section 2.2): moduli, waves, balances and failure."""

import math

import numpy as np
import pytest

from meshes import Box, packings
from particles import Unstable
from particles.lattice import Lattice, LatticeMaterial, geometry
from particles.lattice.part import cut_all, touched
from particles.lattice.state import JOINED, STRAIN_BLOCKS

ROCK = LatticeMaterial(12.5e9, 0.2, 2650.0)
PHASES = np.linspace(-np.pi, np.pi, 9)


def block(size=(5, 6, 7), material=ROCK, **options):
    """A free cuboid of the cubic lattice with unit spacing."""
    return Lattice(packings.simple_cubic(Box((0, 0, 0), size), 0.5), 1.0, material, **options)


def sheet(material=ROCK, **options):
    return Lattice(packings.hexagonal(Box((0, 0), (9, 8)), 0.5), 1.0, material, **options)


def cell(axes=3, material=ROCK, **options):
    """A few sites that repeat along all axes: the infinite lattice."""
    if axes == 3:
        return block((4, 4, 4), material, periodic="xyz", **options)
    steps = np.stack(np.meshgrid(range(4), range(4), indexing="ij"), axis=-1).reshape(-1, 2)
    return Lattice(steps @ np.array([(1.0, 0.0), (0.5, math.sqrt(0.75))]), 1.0, material, periodic="xy", **options)


def stiffness(lattice):
    """Matrix of the bond forces (freedoms, freedoms), N/m."""
    n, axes = lattice.displacement.shape
    columns = []
    for k in range(n * axes):
        lattice.displacement = np.eye(n * axes)[k].reshape(n, axes)
        columns.append(-lattice.internal_force().ravel())
    return np.array(columns).T


def isotropic_energy(strain, material, plane="strain"):
    """Energy density (J/m3) of the isotropic body."""
    e, nu = material.young_modulus, material.poisson_ratio
    shear = e / (2.0 * (1.0 + nu))
    lame = e * nu / (1.0 + nu) / ((1.0 - nu) if plane == "stress" else (1.0 - 2.0 * nu))
    return 0.5 * lame * np.trace(strain) ** 2 + shear * np.sum(strain**2)


@pytest.mark.filterwarnings("ignore:poisson_ratio")
@pytest.mark.parametrize("poisson_ratio", [0.0, 0.2, 0.25, 0.3, 0.4])
@pytest.mark.parametrize("force", ["pairwise", "variational"])
def test_the_moduli_of_the_cubic_lattice_are_exact_in_every_direction(poisson_ratio, force):
    """Interior bonds of a block under a uniform strain hold the energy of the isotropic body: exact, to rounding."""
    material = LatticeMaterial(12.5e9, poisson_ratio, 2650.0)
    lattice = block((7, 7, 7), material, force=force)
    rng = np.random.default_rng(1)
    for _ in range(3):
        strain = rng.standard_normal((3, 3)) * 1e-4
        strain = strain + strain.T
        lattice.displacement = lattice.reference @ strain
        lattice.strain()
        assert interior_energy(lattice, 3) == pytest.approx(isotropic_energy(strain, material), rel=1e-12)


def interior_energy(lattice, axes):
    """Half of the energies of the bonds of the particle in the middle over its volume, written out."""
    u, x, e = lattice.displacement, lattice.reference, lattice.strain()
    i = int(np.argmin(((x - x.mean(axis=0)) ** 2).sum(axis=1)))
    normal, shear = lattice._terms.normal[0], lattice._terms.shear[0]
    total = 0.0
    for j in lattice._state.near[i]:
        arm = x[j] - x[i]
        n = arm / np.linalg.norm(arm)
        mean = 0.5 * (e[i] + e[j])
        tensor = np.array([(mean[0], mean[5], mean[4]), (mean[5], mean[1], mean[3]), (mean[4], mean[3], mean[2])])[:axes, :axes]
        across = tensor @ arm - n * (n @ tensor @ arm)
        total += 0.25 * (normal * (n @ (u[j] - u[i])) ** 2 + shear * across @ across)
    return total / (1.0 if axes == 3 else math.sqrt(0.75))


@pytest.mark.parametrize("plane, poisson_ratio", [("strain", 0.0), ("strain", 0.25), ("stress", 0.1), ("stress", 1 / 3)])
def test_the_moduli_of_the_hexagonal_lattice_are_exact(plane, poisson_ratio):
    material = LatticeMaterial(12.5e9, poisson_ratio, 2650.0)
    lattice = sheet(material, plane=plane)
    strain = np.array([(2.0, -0.7), (-0.7, -1.1)]) * 1e-4
    lattice.displacement = lattice.reference @ strain
    assert interior_energy(lattice, 2) == pytest.approx(isotropic_energy(strain, material, plane), rel=1e-12)


@pytest.mark.parametrize("make", [block, sheet])
@pytest.mark.parametrize("force", ["pairwise", "variational"])
def test_a_linear_field_gives_its_strain_everywhere_and_no_force_inside(make, force):
    """Patch test, 1e-12: least squares are exact for linear fields on any cluster, and the interior is in equilibrium."""
    lattice = make(force=force)
    gradient = np.random.default_rng(2).standard_normal((lattice.axes, lattice.axes)) * 1e-3
    lattice.displacement = lattice.reference @ gradient.T
    strain = 0.5 * (gradient + gradient.T)
    wanted = [strain[0, 0], strain[1, 1], 0, 0, 0, strain[0, 1]]
    if lattice.axes == 3:
        wanted[2:5] = strain[2, 2], strain[1, 2], strain[0, 2]
    assert np.abs(lattice.strain() - wanted).max() < 1e-12 * np.abs(gradient).max()
    edge = lattice.reference - lattice.reference.min(axis=0), lattice.reference.max(axis=0) - lattice.reference
    inner = np.minimum(*edge).min(axis=1) > 1.9
    assert inner.any()
    force = lattice.internal_force()
    assert np.abs(force[inner]).max() < 1e-12 * np.abs(force).max()


@pytest.mark.parametrize("force", ["pairwise", "variational"])
@pytest.mark.parametrize("make", [block, sheet])
def test_runs_and_tables_compute_the_same_forces(make, force):
    """The loops over runs against each bond by its own (to rounding), with two materials, whose interface has mixed bonds."""
    soft = LatticeMaterial(3e9, 0.1, 2000.0)
    options = {"force": force, "material": [ROCK, soft], "layer": lambda x: x[:, 0] > 3.1}
    lattice = make(**options)
    lattice.displacement = np.random.default_rng(3).standard_normal(lattice.displacement.shape)
    wanted = naive_forces(lattice)
    assert np.abs(lattice.internal_force() - wanted).max() < 1e-12 * np.abs(wanted).max()


def naive_forces(lattice):
    """Zhao et al. (2012), eqs 3-8, bond by bond with numpy's least squares; or minus the gradient of its shear energy."""
    n, axes = lattice.reference.shape
    x, u, near = lattice.reference, lattice.displacement, lattice._state.near
    normal, shear = (table[lattice.layer] for table in (lattice._terms.normal, lattice._terms.shear))
    operators = []  # strain = sum over the cluster of u (x) g
    for i in range(n):
        cluster = [i, *near[i][near[i] >= 0]]
        arm = x[cluster] - x[cluster].mean(axis=0)
        operators.append((cluster, arm @ np.linalg.pinv(arm.T @ arm, rcond=1e-8, hermitian=True)))
    strain = np.array([sum(np.outer(u[k], w) for k, w in zip(c, g)) for c, g in operators])
    strain = 0.5 * (strain + strain.transpose(0, 2, 1))
    force, moment = np.zeros((n, axes)), np.zeros((n, axes, axes))
    for i in range(n):
        for j in near[i][near[i] >= 0]:
            arm = x[j] - x[i]
            along = arm / np.linalg.norm(arm)
            force[i] += 0.5 * (normal[i] + normal[j]) * (along @ (u[j] - u[i])) * along
            stretch = 0.5 * (strain[i] + strain[j]) @ arm
            across = 0.5 * (shear[i] + shear[j]) * (stretch - along * (along @ stretch))
            if lattice._state.moment is None:
                force[i] += across
            else:
                moment[i] += 0.25 * (np.outer(across, arm) + np.outer(arm, across))
    if lattice._state.moment is not None:
        for i, (cluster, weights) in enumerate(operators):
            for k, weight in zip(cluster, weights):
                force[k] -= moment[i] @ weight
    return force


@pytest.mark.filterwarnings("ignore:poisson_ratio")
@pytest.mark.parametrize("poisson_ratio", [0.2, 0.3])
def test_a_free_block_has_six_zero_modes_and_no_negative_ones(poisson_ratio):
    matrix = stiffness(block((5, 5, 5), LatticeMaterial(12.5e9, poisson_ratio, 2650.0), force="variational"))
    assert np.abs(matrix - matrix.T).max() < 1e-12 * np.abs(matrix).max()
    values = np.linalg.eigvalsh(matrix)
    assert np.sum(np.abs(values) < 1e-10 * values[-1]) == 6 and values[0] > -1e-10 * values[-1]


@pytest.mark.parametrize("make", [block, sheet])
def test_the_corotational_form_is_objective(make):
    """A turn by a radian is free of force (the small form has the strain cos 1 - 1), and the force of a strained body turns with it."""
    lattice = make(corotational=True)
    c, s = math.cos(1.0), math.sin(1.0)
    turn = np.array([(c, -s), (s, c)]) if lattice.axes == 2 else np.array([(c, -s, 0), (0.6 * s, 0.6 * c, -0.8), (0.8 * s, 0.8 * c, 0.6)])
    x = lattice.reference
    scale = lattice._terms.normal[0]
    lattice.displacement = x @ turn.T - x
    assert np.abs(lattice.internal_force()).max() < 1e-12 * scale
    strained = x + 0.05 * np.sin(x[:, ::-1])
    lattice.displacement = strained - x
    force = lattice.internal_force()
    lattice.displacement = strained @ turn.T - x
    assert np.abs(lattice.internal_force() - force @ turn.T).max() < 1e-11 * np.abs(force).max()
    small = make()
    small.displacement = lattice.displacement = 1e-7 * np.sin(x)
    assert np.abs(small.internal_force() - lattice.internal_force()).max() < 1e-5 * np.abs(small.internal_force()).max()


def test_only_the_variational_force_has_no_torque():
    """Both have no resultant; the published one has a torque at free surfaces."""
    motion = np.random.default_rng(4).standard_normal((5 * 6 * 7, 3))
    for force, most in (("variational", 1e-12), ("pairwise", np.inf)):
        lattice = block(force=force)
        lattice.displacement = motion
        forces = lattice.internal_force()
        assert np.abs(forces.sum(axis=0)).max() < 1e-12 * np.abs(forces).sum()
        torque = np.abs(np.cross(lattice.reference, forces).sum(axis=0)).max() / np.abs(np.cross(lattice.reference, forces)).sum()
        assert torque < most and (force == "variational" or torque > 1e-6)


@pytest.mark.filterwarnings("ignore:poisson_ratio")
@pytest.mark.parametrize("poisson_ratio, factor", [(0.2, 1.054), (0.25, 1.0), (0.3, 0.947), (0.4, 0.845)])
def test_the_critical_step_is_met_from_both_sides(poisson_ratio, factor):
    """Noise in the infinite lattice stays bounded just below 2 / omega_max = sqrt(m / 3 k_n) and grows just above."""
    material = LatticeMaterial(12.5e9, poisson_ratio, 2650.0)
    assert cell(material=material).critical_step * material.wave_speed == pytest.approx(factor, abs=1e-3)
    grown = []
    for share in (0.995, 1.005):
        lattice = cell(material=material)
        lattice.step = share * lattice.critical_step
        lattice.velocity = 1e-12 * np.random.default_rng(5).standard_normal((lattice.count, 3))
        lattice.advance(120)
        grown.append(np.abs(lattice.velocity).max() / 1e-12)
    assert grown[0] < 100 and grown[1] > 1e6


@pytest.mark.parametrize("poisson_ratio", [0.0, 0.25])
def test_the_critical_step_of_the_hexagonal_lattice_is_met_from_both_sides(poisson_ratio):
    grown = []
    for share in (0.995, 1.005):
        lattice = cell(2, LatticeMaterial(12.5e9, poisson_ratio, 2650.0))
        lattice.step = share * lattice.critical_step
        lattice.velocity = 1e-12 * np.random.default_rng(5).standard_normal((lattice.count, 2))
        lattice.advance(120)
        grown.append(np.abs(lattice.velocity).max() / 1e-12)
    assert grown[0] < 100 and grown[1] > 1e6


def test_energy_is_kept_to_rounding_by_the_variational_force():
    lattice = block(force="variational")
    lattice.velocity = 1e-3 * np.random.default_rng(6).standard_normal((lattice.count, 3))
    lattice.hold(lambda x: x[:, 2] < 1, "xyz", lambda t: 1e-3 * math.sin(3e3 * t))
    lattice.load(lambda x: x[:, 2] > 6, (0, 0, 1e3), lambda t: math.cos(2e3 * t))
    lattice.absorb(lambda x: x[:, 0] > 4, "x")
    lattice.advance(200)
    energy = lattice.energies()
    given = abs(energy["external_work"]) + abs(energy["held_work"]) + energy["absorbed"]
    assert min(abs(energy["external_work"]), abs(energy["held_work"]), energy["absorbed"]) > 1e-3 * given
    assert abs(energy["balance"]) < 1e-12 * (given + energy["kinetic"])


def softness_of_a_bar(n, material):
    """E over the modulus of a free square bar of n particles across, less 1: the energy of the bonds that are there (of those across
    free faces n - 1 of n) in a uniform strain, least over the strains across. About 0.75 / n."""
    normal, shear = material.springs(1.0, 3)
    energy = np.zeros((3, 3))  # by strains xx, yy, zz
    for step in geometry.directions(3)[::2].astype(float):
        along = step**2 / np.linalg.norm(step)
        across = np.diag(step) - np.outer(step, along) / np.linalg.norm(step)
        left = (1 - 1 / n) ** np.count_nonzero(step[:2])
        energy += left * (normal * np.outer(along, along) + shear * across.T @ across)
    modulus = energy[2, 2] - energy[2, :2] @ np.linalg.solve(energy[:2, :2], energy[:2, 2])
    return material.young_modulus / modulus - 1


@pytest.mark.filterwarnings("ignore:poisson_ratio")
def test_free_faces_are_soft_by_the_bonds_that_they_lack():
    for poisson_ratio, ten, twenty in ((0.2, 0.0772, 0.0373), (0.3, 0.0719, 0.0350)):
        material = LatticeMaterial(12.5e9, poisson_ratio, 2650.0)
        assert softness_of_a_bar(10**9, material) == pytest.approx(0.0, abs=1e-8)
        assert softness_of_a_bar(10, material) == pytest.approx(ten, abs=1e-4)
        assert softness_of_a_bar(20, material) == pytest.approx(twenty, abs=1e-4)


def test_local_damping_is_booked_and_finds_the_equilibrium_of_a_bar():
    """Strain in the middle of a laterally free bar: that of the closed form, but for strains that vary a little across."""
    lattice = block((6, 6, 14), local_damping=0.8)
    lattice.hold(lambda x: x[:, 2] < 1, "z")
    lattice.traction(lambda x: x[:, 2] > 13, (0, 0, 1e6))
    lattice.advance(1500)
    energy = lattice.energies()
    assert energy["kinetic"] < 1e-6 * energy["elastic"]
    assert energy["local_damping"] > 0 and abs(energy["balance"]) < 0.01 * energy["external_work"]
    z, moved = lattice.reference[:, 2], lattice.displacement[:, 2]
    strain = (moved[abs(z - 8.5) < 0.1].mean() - moved[abs(z - 5.5) < 0.1].mean()) / 3
    assert strain * 12.5e9 / 1e6 - 1 == pytest.approx(softness_of_a_bar(6, ROCK), abs=2e-3)


def test_a_bond_breaks_at_its_limit_and_then_only_pushes():
    material = LatticeMaterial(12.5e9, 0.2, 2650.0, normal_limit=1e-4)
    lattice = Lattice([(0, 0, 0), (0, 0, 1)], 1.0, material)
    stiff = material.springs(1.0, 3)[0]
    for stretch, wanted in ((0.9e-4, 0.9e-4), (1.1e-4, 1.1e-4), (0.5e-4, 0.0), (-0.5e-4, -0.5e-4)):
        lattice.displacement = [(0, 0, 0), (0, 0, stretch)]
        force = lattice.internal_force()[0, 2]
        assert force == pytest.approx(stiff * wanted, abs=1e-6)
        lattice.prepare()  # an evaluation, after which bonds may break
    assert lattice.energies()["broken_bonds"] == 1 and lattice.energies()["breaking"] == pytest.approx(0.5 * stiff * 1.1e-4**2)
    assert len(lattice.broken_bonds()) == 1


def test_breaking_leaves_clusters_of_what_is_intact():
    """After a cut through a block both halves turn and stretch freely, and the strain is still exact for linear fields."""
    material = LatticeMaterial(12.5e9, 0.2, 2650.0, normal_limit=1e-3, shear_limit=1.0)
    lattice = block((5, 5, 8), material)
    upper = lattice.reference[:, 2] > 4
    lattice.displacement = np.where(upper[:, None], (0, 0, 0.1), (0, 0, 0))
    lattice.prepare()
    assert lattice.energies()["broken_bonds"] == 25 + 4 * 20  # straight and oblique bonds across the cut
    gradient = 1e-5 * np.arange(9).reshape(3, 3)
    lattice.displacement = lattice.reference @ gradient.T + np.where(upper[:, None], (0, 0, 0.1), (0, 0, 0))
    strain = 0.5 * (gradient + gradient.T)
    assert np.abs(lattice.strain()[:, :3] - np.diag(strain)).max() < 1e-15


@pytest.mark.parametrize("force, audit, most", [("variational", False, 1e-4), ("pairwise", True, 1e-12)])
def test_breaking_is_booked(force, audit, most):
    """A bar torn apart: what its bonds lose is in the balance. Faces that meet again push with a kink, which the first one has not."""
    material = LatticeMaterial(12.5e9, 0.2, 2650.0, normal_limit=1e-4)
    lattice = block((3, 3, 9), material, force=force, audit=audit)
    lattice.hold(lambda x: x[:, 2] < 1, "xyz")
    lattice.hold(lambda x: x[:, 2] > 8, "xyz", 0.5)
    lattice.advance(600)
    energy = lattice.energies()
    assert energy["broken_bonds"] > 9 and energy["breaking"] > 0
    assert abs(energy["balance"]) < most * energy["held_work"]


def test_excess_work_is_that_of_the_forces_which_are_no_gradient():
    """What the published forces do beyond those of the same energy, (F - F') . dx by the trapezoidal rule, is booked to rounding."""
    lattice, same = block(audit=True), block(force="variational")
    lattice.velocity = 1e-3 * np.random.default_rng(6).standard_normal((lattice.count, 3))
    lattice.advance(0)
    work, before, place = 0.0, 0.0, lattice.displacement.copy()
    for _ in range(40):
        lattice.advance(1)
        same.displacement = lattice.displacement
        beyond = lattice.internal_force() - same.internal_force()
        work += 0.5 * np.sum((before + beyond) * (lattice.displacement - place))
        before, place = beyond, lattice.displacement.copy()
    energy = lattice.energies()
    assert abs(work) > 1e-5 * energy["kinetic"]
    assert energy["excess_work"] == pytest.approx(work, rel=1e-9)
    assert abs(energy["balance"]) < 1e-12 * energy["kinetic"]


@pytest.mark.parametrize("axes", [2, 3])
def test_clusters_of_any_neighbours_have_the_pseudo_inverse_of_their_moments(axes):
    """All that are left of the neighbours in any way: in space, in a plane, in a line, none; against singular values."""
    rng, ranks = np.random.default_rng(3), set()
    lattice = block((8, 8, 9)) if axes == 3 else Lattice(packings.hexagonal(Box((0, 0), (20, 20)), 0.5), 1.0, ROCK)
    state = lattice._state
    share = 1.0 - rng.random(lattice.count) ** 2  # of its bonds that a row loses
    cut = np.argwhere((state.near[:, ::2] >= 0) & (rng.random(state.near[:, ::2].shape) < share[:, None])) * (1, 2)
    cut_all(state, lattice._terms, cut, touched(state, cut)[0])
    for row in range(lattice.count):
        arms = np.vstack((np.zeros(3), lattice._terms.vectors[(state.bonds[row] & JOINED) > 0]))
        mean = arms.mean(axis=0)
        moments = (arms - mean).T @ (arms - mean)
        wanted = np.linalg.pinv(moments, rcond=1e-9, hermitian=True)
        xx, yy, zz, yz, xz, xy = state.cluster[:6, row]
        assert np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) == pytest.approx(wanted, rel=1e-10, abs=1e-10 * np.abs(wanted).max())
        assert state.cluster[6:, row] == pytest.approx(mean, abs=1e-12)
        ranks.add(int(np.linalg.matrix_rank(moments, tol=1e-9)))
    assert ranks == set(range(axes + 1))


def test_rows_that_lie_together_in_memory_move_as_others_do():
    """A hole, two rocks and one that does not break: sites asked for first come first, and what happens is the same."""
    region = Box((0, 0, 0), (14, 9, 30)) - Box((4, 3, 8), (8, 6, 20))
    sites = packings.simple_cubic(region, 0.5)
    weak = LatticeMaterial(8e9, 0.2, 2650.0, 2e-5, 4e-5)
    bodies = []
    for first in (None, Box((2, 2, 4), (11, 7, 23)), lambda x: x[:, 2] > 15):
        body = Lattice(sites, 1.0, [ROCK, weak], layer=lambda x: x[:, 2] > 12, first=first)
        back = np.argsort(body.order)
        body.velocity = 0.1 * np.sin(0.4 * body.reference[:, [2, 0, 1]])
        body.advance(60)
        bodies.append((body.displacement[back], body.energies(), body.broken()[back]))
        if isinstance(first, Box):
            assert first.contains(body.reference[:1000]).mean() > 0.5 and not first.contains(body.reference[-1000:]).any()
    for moved, energy, broken in bodies[1:]:
        assert np.abs(moved - bodies[0][0]).max() < 1e-10 * np.abs(moved).max() and broken.sum() > 200
        assert np.array_equal(broken, bodies[0][2])
        assert energy == pytest.approx(bodies[0][1], rel=1e-9, abs=1e-9 * energy["kinetic"])


@pytest.mark.filterwarnings("ignore:poisson_ratio")
@pytest.mark.parametrize("poisson_ratio", [0.2, 0.3])
def test_rows_in_blocks_are_those_one_by_one(poisson_ratio):
    """Rocks of two stiffnesses, one of them with a part that does not break and lies elsewhere in memory, round a hole, a third of their
    bonds broken: strains, forces and energy by the loops over blocks against those over single rows, and which bonds are looked at
    when limits are near."""
    region = Box((0, 0, 0), (21, 7, 5)) - Box((8, 2, -1), (13, 4, 6))
    sites = packings.simple_cubic(region, 0.5)
    rocks = [LatticeMaterial(12.5e9, poisson_ratio, 2650.0, 1e-3, 2e-3), LatticeMaterial(3e9, 0.1, 2000.0, 2e-3, 1e-3)]
    rocks.append(LatticeMaterial(12.5e9, poisson_ratio, 2650.0))
    rng = np.random.default_rng(9)
    found = {}
    for way in ("blocks", "rows"):
        lattice = Lattice(sites, 1.0, rocks, layer=lambda x: (x[:, 0] > 17.1) + 2 * (x[:, 0] < 12.1) * (x[:, 1] > 4.1), periodic="z")
        state = lattice._state
        assert len(state.strays) > 20
        if way == "rows":
            state.stretch_of[:], state.stray[:] = -1, 0
            state = lattice._state = state._replace(strays=state.strays[:0])
            lattice.refresh(lattice.free, lattice.carried)
        cut = np.argwhere((state.near[:, ::2] >= 0) & (rng.random((lattice.count, 9)) < 0.3)) * (1, 2)
        found.setdefault("cut", cut)
        cut_all(state, lattice._terms, found["cut"], touched(state, found["cut"])[0])
        assert (state.counts[STRAIN_BLOCKS] > 0.1 * lattice.count / 8) == (way == "blocks")
        lattice.displacement = found.setdefault("moved", 3e-4 * rng.standard_normal((lattice.count, 3)))
        force, strain = lattice.internal_force(), lattice.strain().copy()
        energy = lattice.energies()
        bonds = lattice.broken_bonds()
        found[way] = force, strain, energy["elastic"], bonds
    for mine, wanted in zip(found["blocks"], found["rows"]):
        assert np.abs(mine - wanted).max() <= 1e-12 * np.abs(wanted).max()
    assert len(found["rows"][3]) > len(found["cut"]) + 10


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_rocks_of_one_stiffness_break_at_their_own_limits(axis):
    """A layer that can fail in rock that cannot: of the bonds of a strained block those break that end in it and stretch; rows beside it
    and in it go through one loop, and what is left is what the same rocks leave where their stiffness differs in the last digits."""
    found = []
    for other in (1.0, 1.0 + 1e-13):
        rocks = [ROCK, LatticeMaterial(other * ROCK.young_modulus, 0.2, 2650.0, 1e-5, 1e-5)]
        lattice = block((9, 10, 30), rocks, layer=lambda x: (x[:, 2] > 9.0) & (x[:, 2] < 13.0) | (x[:, 0] > 7.1))
        strained = np.zeros((lattice.count, 3))
        strained[:, axis] = 1e-4 * lattice.reference[:, axis]
        lattice.displacement = strained
        weak, state = lattice.layer == 1, lattice._state
        bonds = np.argwhere(state.near[:, ::2] >= 0) * (1, 2)
        ends = bonds[:, 0], state.near[bonds[:, 0], bonds[:, 1]]
        stretched = lattice.reference[ends[0], axis] != lattice.reference[ends[1], axis]
        lattice.prepare()
        expected = np.count_nonzero((weak[ends[0]] | weak[ends[1]]) & stretched)
        assert lattice.energies()["broken_bonds"] == expected > 1000
        lattice.advance(30)
        found.append((lattice.broken_bonds(), lattice.displacement.copy(), lattice._terms.smallest))
    (mine, moved, smallest), (theirs, wanted, _) = found
    np.testing.assert_array_equal(mine, theirs)
    np.testing.assert_allclose(moved, wanted, rtol=0.0, atol=1e-9 * np.abs(wanted).max())
    assert len(smallest) == 2


def test_an_absorbing_end_swallows_a_plane_wave():
    """Of a wave of frequency w comes back w d / 4 c: the half particle outside the last centre is beyond the dashpot."""
    lattice = Lattice(packings.simple_cubic(Box((0, 0, 0), (1, 1, 80)), 0.5), 1.0, ROCK, periodic="xy")
    lattice.hold(lambda x: x[:, 2] > -1, "xy")
    period = 40 / ROCK.wave_speed
    lattice.hold(lambda x: x[:, 2] < 1, "z", lambda t: math.sin(math.pi * t / period) ** 2 if t < period else 0.0)
    lattice.absorb(lambda x: x[:, 2] > 79, "z")
    lattice.advance(int(150 / ROCK.wave_speed / lattice.step))
    assert np.abs(lattice.velocity).max() < 2 * math.pi / 40 / 4


def test_a_plane_wave_travels_at_the_speed_of_compression_waves():
    """One layer that repeats: the peak of a long pulse moves at sqrt((lambda + 2 G) / rho), within 0.5 %."""
    lattice = Lattice(packings.simple_cubic(Box((0, 0, 0), (1, 1, 120)), 0.5), 1.0, ROCK, periodic="xy")
    lattice.hold(lambda x: x[:, 2] > -1, "xy")
    period = 30 / ROCK.wave_speed
    lattice.hold(lambda x: x[:, 2] < 1, "z", lambda t: math.sin(math.pi * t / period) ** 2 if t < period else 0.0)
    lattice.advance(int(100 / ROCK.wave_speed / lattice.step))
    z, v = lattice.reference[:, 2], lattice.velocity[:, 2]
    near = np.argmax(v) + np.arange(-5, 6)
    a, b, _ = np.polyfit(z[near] - z[np.argmax(v)], v[near], 2)
    travelled = z[np.argmax(v)] - 0.5 * b / a - 0.5
    assert travelled / (lattice.time - 0.5 * period) == pytest.approx(ROCK.wave_speed, rel=0.005)


@pytest.mark.parametrize("sound", [True, False])
def test_bonds_of_the_plane_fail_at_their_limits_wherever_they_are(sound):
    """Random displacements in a sheet that repeats, against the closed form of each bond: stretch and shear, those just above."""
    rng = np.random.default_rng(8)
    moved = 1e-4 * rng.standard_normal((16, 2))
    free = cell(2)
    free.displacement = moved
    near, strain = free._state.near, free.strain()
    arm = free._terms.vectors[::2, :2]
    tensor = strain[:, [[0, 5], [5, 1]]]
    mean = 0.5 * (tensor[:, None] + tensor[near[:, ::2]])
    stretch = np.einsum("nka,ka->nk", moved[near[:, ::2]] - moved[:, None], arm)
    shear = np.einsum("nkab,kb->nka", mean, arm)
    shear = np.linalg.norm(shear - np.einsum("nka,ka,kb->nkb", shear, arm, arm), axis=-1)
    for limits in ((stretch.max(), 1.0), (1.0, shear.max())):
        factor = 1.0 + 1e-6 if sound else 1.0 - 1e-6
        brittle = cell(2, LatticeMaterial(12.5e9, 0.2, 2650.0, *(factor * limit for limit in limits)))
        brittle.displacement = moved
        brittle.prepare()
        assert brittle.energies()["broken_bonds"] >= (not sound) and (brittle.broken().sum() == 0) == sound


@pytest.mark.parametrize("periodic, rows, lacking", [("x", 6, 2 * 2 * 4), ("y", 6, 2 * 6 + 2 * 6), ("xy", 6, 0), ("xy", 4, 0)])
def test_upright_sheets_of_the_hexagonal_lattice_repeat(periodic, rows, lacking):
    """Rows one after the other shifted by half a spacing: neighbours across the ends are each other's, none is left out."""
    i, j = np.meshgrid(np.arange(4), np.arange(rows), indexing="ij")
    sites = np.column_stack(((i + 0.5 * (j % 2)).ravel(), (math.sqrt(0.75) * j).ravel()))
    near = Lattice(sites, 1.0, ROCK, periodic=periodic)._state.near
    assert np.sum(near < 0) == lacking
    for way in range(6):
        row = np.flatnonzero(near[:, way] >= 0)
        assert np.array_equal(near[near[row, way], way ^ 1], row)
    with pytest.raises(ValueError, match="even number of rows"):
        Lattice(sites[j.ravel() < rows - 1], 1.0, ROCK, periodic="y")


def test_waves_blow_up_with_a_sentence():
    lattice = block(step=2e-4 * 5)
    lattice.velocity = 1e-3 * np.random.default_rng(7).standard_normal((lattice.count, 3))
    with pytest.raises(Unstable, match="moves by more than half a spacing"):
        lattice.advance(5000)


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: LatticeMaterial(-1, 0.2, 1), "young_modulus=-1"),
        (lambda: LatticeMaterial(1, 0.5, 1), "poisson_ratio=0.5"),
        (lambda: LatticeMaterial(1, 0.2, 1, normal_limit=0), "normal_limit=0"),
        (lambda: sheet(LatticeMaterial(1e9, 0.3, 1)), "hexagonal lattice"),
        (lambda: Lattice([(0, 0, 0), (0.3, 0, 0)], 1.0, ROCK), "lies beside the cubic lattice"),
        (lambda: Lattice([(0, 0, 0), (0, 0, 0)], 1.0, ROCK), "each site must be given once"),
        (lambda: block(force="other"), "pairwise"),
        (lambda: block(local_damping=1), "local_damping=1"),
        (lambda: block(force="variational", corotational=True), "corotational=True"),
        (lambda: block(periodic="w"), "periodic"),
        (lambda: block().hold("x" == "y", "x"), "must give one bool"),
        (lambda: block().hold(lambda x: x[:, 0] > 99, "x"), "names no particle"),
        (lambda: block().absorb(lambda x: x[:, 0] > 1, "w"), 'normal="w"'),
    ],
)
def test_bad_input_is_refused_in_one_sentence(make, words):
    with pytest.raises(ValueError, match=words):
        make()


def test_negative_shear_springs_are_warned_of():
    with pytest.warns(UserWarning, match="poisson_ratio=0.3 above 0.25"):
        block(material=LatticeMaterial(12.5e9, 0.3, 2650.0))
