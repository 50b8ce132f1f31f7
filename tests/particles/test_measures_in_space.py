"""Measures of spheres, representative volumes of any shape, force chains: known states and closed forms."""

from dataclasses import dataclass

import meshio
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from particles import Assembly, LiChu, measures
from particles.chains import force_chains, write_chains
from particles.volumes import common_volume, parts_inside, volume_in_box
from tests.particles.scenes import square_lattice

ELASTIC = LiChu(1e8, 5e7, 1e6, 7e2, torsion_stiffness=3e2, sliding_friction=1.0, rolling_friction=1.0, moment_friction=1.0)
RADIUS = 0.05


def cubic_lattice(size, spacing=2 * RADIUS):
    """Centres of a simple cubic lattice."""
    return spacing * np.stack(np.meshgrid(*[np.arange(size)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)


@dataclass
class Ball:
    """A region that is known by `contains` alone."""

    centre: tuple
    radius: float

    def contains(self, points):
        return np.linalg.norm(points - np.array(self.centre), axis=1) < self.radius


def test_volumes_of_parts_of_spheres():
    """Half, quarter, eighth; caps of height h, pi h^2 (3 r - h) / 3; any box from any side; a lens of two equal balls."""
    one, whole = np.zeros((1, 3)), 4 / 3 * np.pi
    for lower, share in (((-2, -2, 0), 2), ((-2, 0, 0), 4), ((0, 0, 0), 8), ((-2, -2, -2), 1)):
        assert volume_in_box(one, np.ones(1), lower, (2, 2, 2))[0] == pytest.approx(whole / share, rel=1e-13)
    for axis in range(3):
        lower = np.full(3, -2.0)
        lower[axis] = 0.4
        assert volume_in_box(one, np.ones(1), lower, (2, 2, 2))[0] == pytest.approx(np.pi * 0.36 * 2.4 / 3, rel=1e-13)
    rng = np.random.default_rng(0)
    centres, radii, box = rng.uniform(-1.5, 1.5, (300, 3)), rng.uniform(0.2, 1.5, 300), np.array([[-0.9, -0.5, -0.7], [0.6, 0.8, 0.4]])
    plain = volume_in_box(centres, radii, *box)
    assert np.sum((plain > 0.0) & (plain < 0.9 * whole * radii**3)) > 150
    for order in ([1, 2, 0], [2, 0, 1]):
        np.testing.assert_allclose(volume_in_box(centres[:, order], radii, *box[:, order]), plain, rtol=1e-9, atol=1e-10)
    assert common_volume(1.0, 1.0, 1.0) == pytest.approx(2 * np.pi * 0.25 * 2.5 / 3)
    np.testing.assert_allclose(common_volume([0.0, 0.2, 3.0], 1.0, [0.5, 0.8, 1.0]), [whole / 8, whole * 0.512, 0.0], atol=1e-12)
    # samples of a region against the closed form
    part = parts_inside(np.array([[0.7, 0.2, -0.3]]), np.ones(1), Ball((0, 0, 0), 1.1))
    assert part[0] == pytest.approx(common_volume(np.sqrt(0.62), 1.0, 1.1), rel=5e-3)


def test_stress_of_a_compressed_cubic_lattice():
    """Overlap delta in each contact: -k delta / spacing^2 on average, by balls, by a box of whole cells, by a region."""
    delta, size = 1e-4, 7
    spacing = 2 * RADIUS - delta
    positions = cubic_lattice(size, spacing)
    soil = Assembly(positions, RADIUS, law=LiChu(1e8))
    middle = positions.mean(axis=0)
    expected = -1e8 * delta / spacing**2 * np.eye(3)
    fraction = 4 / 3 * np.pi * RADIUS**3 / spacing**3
    average = measures.averaged_stress(soil, middle, solid_fraction=fraction)[0]
    np.testing.assert_allclose(average, expected, rtol=1e-9, atol=1e-6)
    # spheres reach over the faces of the box by half the overlap: caps of 1e-6 of them
    box = (middle - 1.5 * spacing, middle + 1.5 * spacing)
    np.testing.assert_allclose(measures.region_average(soil, box), expected, rtol=1e-4, atol=1e-6)
    region = Ball(tuple(middle), 0.27)
    ball = measures.region_average(soil, region, volume=4 / 3 * np.pi * 0.27**3)
    plain = measures.averaged_stress(soil, middle, radius=0.27)[0]
    np.testing.assert_allclose(ball, plain, rtol=2e-3, atol=1e-6)
    with pytest.raises(ValueError, match="volume is needed"):
        measures.region_average(soil, region)


def _spun():
    """Spheres that have rolled and twisted against each other."""
    rng = np.random.default_rng(4)
    soil = Assembly(cubic_lattice(3, 0.0995) + rng.uniform(-2e-4, 2e-4, (27, 3)), RADIUS, law=ELASTIC)
    soil.velocities = rng.normal(size=(27, 6)) * ([0.05] * 3 + [3.0] * 3)
    soil.advance(20, 1e-5)
    return soil


def test_stress_and_couple_stress_add_up_to_the_sums_over_contacts():
    """Sum of V_p stress = sum of branch (x) force, of V_p couple stress = sum of branch (x) couple; and they turn."""
    soil = _spun()
    found = soil.contacts()
    branch = (found.first_arm + found.second_arm)[:, None] * found.normal
    volume = 4 / 3 * np.pi * RADIUS**3
    for values, action in (
        (measures.particle_stress(soil), found.force), (measures.particle_couple_stress(soil), found.moment)
    ):  # fmt: skip
        assert values.shape == (27, 3, 3) and np.abs(action).max() > 0
        total = branch.T @ action
        np.testing.assert_allclose(volume * values.sum(axis=0), total, atol=1e-12 * np.abs(action).sum())
    everything = (np.full(3, -1.0), np.full(3, 1.0))
    np.testing.assert_allclose(8.0 * measures.region_average(soil, everything), branch.T @ found.force, atol=1e-10)
    matrix = Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix()
    plain, turned = (
        Assembly(soil.positions @ frame.T, RADIUS, law=LiChu(1e8)) for frame in (np.eye(3), matrix)
    )  # fmt: skip
    stress = measures.particle_stress(plain)
    np.testing.assert_allclose(measures.particle_stress(turned), matrix @ stress @ matrix.T, atol=1e-8 * np.abs(stress).max())


def test_gradient_and_its_rate_of_a_homogeneous_motion_are_exact():
    soil = Assembly(cubic_lattice(3), RADIUS, law=ELASTIC)
    gradient = np.array([[1.02, 0.01, 0.0], [-0.02, 0.97, 0.03], [0.01, 0.0, 1.01]])
    flow = np.array([[0.1, -0.3, 0.2], [0.0, 0.4, 0.1], [0.5, 0.0, -0.2]])
    moved = np.zeros((27, 6))
    moved[:, :3] = soil.reference @ (gradient - np.eye(3)).T
    soil.displacements = moved
    velocity = np.zeros((27, 6))
    velocity[:, :3] = soil.positions @ flow.T
    soil.velocities = velocity
    strain = measures.nominal_strain(soil)
    np.testing.assert_allclose(strain.gradient, np.broadcast_to(gradient, (27, 3, 3)), atol=1e-12)
    np.testing.assert_allclose(strain.volumetric, np.linalg.det(gradient) - 1, atol=1e-12)
    green = 0.5 * (gradient.T @ gradient - np.eye(3))
    deviator = green - np.trace(green) / 3 * np.eye(3)
    np.testing.assert_allclose(strain.effective, np.sqrt(2 / 3 * np.sum(deviator**2)), rtol=1e-10)
    np.testing.assert_allclose(measures.gradient_rate(soil), np.broadcast_to(flow @ gradient, (27, 3, 3)), atol=1e-12)
    flat = Assembly(np.column_stack([square_lattice(3, 3), np.zeros(9)]), RADIUS, law=ELASTIC)
    assert np.isnan(measures.nominal_strain(flat).volumetric).all()


def test_coordination_fabric_and_porosity_of_a_cubic_lattice():
    soil = Assembly(np.vstack([cubic_lattice(3), [[0.3, 0.0, 0.0]], [[9.0, 9.0, 9.0]]]), RADIUS, law=ELASTIC)
    # 54 contacts in the cube, one more of the sphere that hangs on it: that one and the lone one are rattlers
    assert measures.coordination(soil, 1e-6) == pytest.approx(2 * 55 / 29)
    assert measures.coordination(soil, 1e-6, rattlers=False) == pytest.approx(2 * 54 / 27)
    cube = Assembly(cubic_lattice(3), RADIUS, law=ELASTIC)
    assert measures.coordination(cube, 1e-6, rattlers=False, fewest=4) == 0.0  # corners have three, then edges, ...
    np.testing.assert_allclose(measures.fabric(cube, 1e-6), np.eye(3) / 3)
    for lower, upper in ((-0.05, 0.25), (0.0, 0.2)):  # whole spheres; halves, quarters and eighths
        assert measures.porosity(cube, [lower] * 3, [upper] * 3) == pytest.approx(1 - np.pi / 6, abs=1e-4)
    region = Ball((0.1, 0.1, 0.1), 0.05)  # the middle sphere, and nothing else
    assert measures.porosity_in(cube, region, 4 / 3 * np.pi * 0.05**3) == pytest.approx(0.0, abs=5e-3)


def test_moduli_of_an_isotropic_network_are_the_closed_forms():
    """A sphere and twelve around it in the corners of an icosahedron, whose directions are isotropic up to fifth order.

    lambda = 4 N r^2 / 15 V (k_N - k_s), G = 2 N r^2 / 15 V (2 k_N + 3 k_s), G_c = 2 N r^2 / 3 V k_s, and for equal
    stiffness about all axes B = 4 N r^2 / 3 V k_rot.
    """
    golden = (1 + np.sqrt(5)) / 2
    corners = np.array([np.roll([0, a, b * golden], k) for k in range(3) for a in (-1, 1) for b in (-1, 1)])
    places = np.vstack([np.zeros(3), 2 * RADIUS * corners / np.sqrt(1 + golden**2)])
    rotational = 7e2 + (RADIUS / 2) ** 2 * 1e6
    law = LiChu(1e8, 5e7, 1e6, 7e2, torsion_stiffness=rotational, sliding_friction=1.0, rolling_friction=1.0, moment_friction=1.0)
    soil = Assembly(places, RADIUS, law=law)
    elastic, couple = measures.moduli(soil, volume := 0.01)
    share = 12 * RADIUS**2 / volume
    lame, shear, cosserat = share * 4 / 15 * 5e7, share * 2 / 15 * 3.5e8, share * 2 / 3 * 5e7
    delta = np.eye(3)
    straight, crossed = np.einsum("ik,jl->ijkl", delta, delta), np.einsum("il,jk->ijkl", delta, delta)
    expected = lame * np.einsum("ij,kl->ijkl", delta, delta) + (shear + cosserat) * straight + (shear - cosserat) * crossed
    np.testing.assert_allclose(elastic, expected, atol=1e-9 * shear)
    np.testing.assert_allclose(couple, share * 4 / 3 * rotational * straight, atol=1e-9 * share * rotational)


@pytest.mark.parametrize("axes", [2, 3])
def test_force_chains_are_the_contacts_above_the_mean(axes, tmp_path):
    """Four in a row with overlaps of 1, 4 and 2 (1e-4 m): the mean is 7/3, one contact lies above it."""
    positions = np.zeros((4, axes))
    positions[1:, 0] = np.cumsum(0.1 - 1e-4 * np.array([1.0, 4.0, 2.0]))
    soil = Assembly(positions, RADIUS, law=LiChu(1e8))
    chains = force_chains(soil)
    np.testing.assert_allclose(chains.force, [4e4], rtol=1e-9)
    np.testing.assert_allclose(np.sort(chains.ends[0, :, 0]), positions[[1, 2], 0], atol=1e-15)
    every = force_chains(soil, above=0.0)
    np.testing.assert_allclose(every.force, [1e4, 2e4, 4e4], rtol=1e-9)
    np.testing.assert_allclose(every.width, RADIUS * np.array([0.25, 0.5, 1.0]), rtol=1e-9)
    write_chains(tmp_path / "chains.vtu", every)
    mesh = meshio.read(tmp_path / "chains.vtu")
    assert mesh.cells[0].type == "line" and len(mesh.cells[0].data) == 3
    np.testing.assert_allclose(mesh.cell_data["normal_force"][0], every.force)
    np.testing.assert_allclose(mesh.points[mesh.cells[0].data][:, :, :axes], every.ends)
    assert force_chains(Assembly(positions * 2, RADIUS, law=LiChu(1e8))).ends.shape == (0, 2, axes)
