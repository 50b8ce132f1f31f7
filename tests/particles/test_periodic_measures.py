"""What is measured in a periodic cell does not depend on where the cell is cut, and the whole cell is its mean stress."""

from dataclasses import dataclass

import numpy as np
import pytest

from particles import Assembly, measures
from particles.images import images_near
from tests.particles.scenes import ALL, packed, stacked


@dataclass
class Ball:
    """A region known by its bounds and `contains`."""

    centre: np.ndarray
    radius: float

    @property
    def bounds(self):
        return np.array([self.centre - self.radius, self.centre + self.radius])

    def contains(self, points):
        return np.linalg.norm(points - self.centre, axis=1) < self.radius


def sheared(make):
    """The packing after some shear and compression: loaded contacts in a cell that leans."""
    soil = make()
    gradient = np.zeros((soil.axes, soil.axes))
    gradient[0, -1], gradient[-1, -1] = 20.0, -0.5
    soil.deform(gradient)
    soil.advance(600, 1e-5)
    return soil


def again(soil, shift):
    """The same packing moved by a vector (in the cell as it is now, at its start)."""
    cell = type(soil.cell)(np.diag(soil.cell.matrix))
    cell.arrays.matrix[: soil.axes, : soil.axes] = soil.cell.matrix
    cell.at_start.matrix[:] = cell.arrays.matrix
    return Assembly(soil.positions + shift, soil.radii, law=ALL, cell=cell)


every_packing = pytest.mark.parametrize("make", [packed, stacked], ids=["discs", "spheres"])


@every_packing
def test_whole_cell_by_boxes_and_by_name_is_the_mean_stress_of_the_cell(make):
    soil = sheared(make)
    stress, volume = soil.cell_stress(), soil.cell.volume
    assert abs(soil.cell.matrix[0, -1]) > 0.1 * soil.cell.matrix[0, 0]
    scale = np.abs(stress).max()
    np.testing.assert_allclose(measures.region_average(soil, soil.cell), stress, atol=1e-12 * scale)
    # a leaning cell is, as a lattice, the box of its edges' lengths along the axes, wherever that lies
    sizes = np.diag(soil.cell.matrix)
    for lower in (np.zeros(soil.axes), np.full(soil.axes, -0.237), 3.3 * sizes):
        found = measures.region_average(soil, (lower, lower + sizes))
        np.testing.assert_allclose(found, stress, atol=1e-11 * scale)
    solid = measures.volumes(soil.radii, soil.axes).sum()
    assert measures.porosity_in(soil, soil.cell) == pytest.approx(1.0 - solid / volume, abs=1e-13)
    assert measures.porosity(soil, np.zeros(soil.axes), sizes) == pytest.approx(1.0 - solid / volume, abs=1e-12)


@every_packing
def test_averages_move_with_the_lattice_and_with_the_packing(make):
    """Boxes, balls and regions over faces and corners, larger than the cell too: lattice vectors change nothing."""
    soil = sheared(make)
    edges = soil.cell.matrix
    plain = again(soil, np.zeros(soil.axes))
    scale = np.abs(plain.cell_stress()).max()
    corner = edges.sum(axis=1)
    for move in (edges[:, 0], edges @ np.arange(-1, soil.axes - 1), -3.0 * corner):
        shifted = again(soil, move)  # the packing elsewhere, and the volume with it or not
        for lower, upper in ((corner - 0.11, corner + 0.07), (corner - 0.5, corner + 0.83)):
            one = measures.region_average(plain, (lower, upper))
            np.testing.assert_allclose(measures.region_average(plain, (lower + move, upper + move)), one, atol=1e-12 * scale)
            np.testing.assert_allclose(measures.region_average(shifted, (lower, upper)), one, atol=1e-12 * scale)
        points = corner + np.array([[0.0], [0.2], [-0.31]]) * np.ones(soil.axes)
        one = measures.averaged_stress(plain, points)
        for other in (measures.averaged_stress(plain, points + move), measures.averaged_stress(shifted, points)):
            np.testing.assert_allclose(other, one, atol=1e-12 * scale)
        ball = measures.region_average(plain, Ball(corner, 0.13), volume=1.0)
        for region, where in ((Ball(corner + move, 0.13), plain), (Ball(corner, 0.13), shifted)):
            np.testing.assert_allclose(measures.region_average(where, region, volume=1.0), ball, atol=1e-12 * scale)
    some = np.full(soil.axes, 0.037)  # anywhere, packing and volume together
    moved = measures.region_average(again(soil, some), (corner - 0.11 + some, corner + 0.07 + some))
    np.testing.assert_allclose(moved, measures.region_average(plain, (corner - 0.11, corner + 0.07)), atol=1e-9 * scale)


@every_packing
def test_a_ball_larger_than_the_cell_counts_each_image(make):
    """Volume of all images in a box of 3 x 3 (x 3) cells is that of 9 (27) cells; a large ball comes near the mean."""
    soil = make()
    sizes = np.diag(soil.cell.matrix)
    values = np.ones(soil.count)
    solid = measures.volumes(soil.radii, soil.axes).sum()
    found = measures.region_average(soil, (-0.4 * sizes, 2.6 * sizes), volume=1.0, values=values)
    assert found == pytest.approx(3**soil.axes * solid, rel=1e-12)
    share = solid / soil.cell.volume
    assert measures.averaged_stress(soil, 0.1 * sizes, radius=2.5 * sizes[0], values=values)[0] == pytest.approx(share, rel=5e-3)


def test_images_near_a_box_are_all_there_and_none_twice():
    soil = sheared(packed)
    places = np.array([[0.0, 0.0], [0.3, 9.0]])
    particle, images, edges = images_near(soil.cell, places, (-1.0, -1.0), (2.0, 1.0), 0.1)
    np.testing.assert_allclose(places[particle] + edges @ soil.cell.matrix.T, images, atol=1e-12)
    steps = np.stack(np.meshgrid(np.arange(-40, 41), np.arange(-40, 41)), axis=-1).reshape(-1, 2) @ soil.cell.matrix.T
    for k, place in enumerate(places):
        every = place + steps
        every = every[((every >= [-1.1, -1.1]) & (every <= [2.1, 1.1])).all(axis=1)]
        own = images[particle == k]
        assert len(own) == len(every)
        assert np.linalg.norm(own[:, None] - every[None], axis=2).min(axis=1).max() < 1e-12


@every_packing
def test_strain_of_a_homogeneous_motion_is_exact_through_the_faces(make):
    """F of the cell at every particle, whatever the shear (beyond one cell, where edges are taken back), and its rate."""
    soil = make()
    soil.velocities = np.zeros((soil.count, soil.freedoms))
    rates = np.triu(np.full((soil.axes, soil.axes), 0.3))
    rates[0, -1] = 30.0
    soil.deform(rates)
    pairs = measures.reference_pairs(soil, 0.05)
    step, steps = 1e-4, 500
    gradient = np.eye(soil.axes)
    for _ in range(steps):  # the field alone, without the contacts' answer: the particles are carried by the cell
        gradient = gradient + step * rates @ gradient
    cell = soil.cell.arrays
    cell.matrix[: soil.axes, : soil.axes] = gradient @ soil.cell.start
    soil.displacements = np.hstack(
        [soil.reference @ (gradient - np.eye(soil.axes)).T, np.zeros((soil.count, soil.freedoms - soil.axes))]
    )
    assert abs(soil.cell.matrix[0, -1]) < 0.6 * soil.cell.matrix[0, 0] < gradient[0, -1] * soil.cell.start[-1, -1]
    strain = measures.nominal_strain(soil, pairs=pairs)
    np.testing.assert_allclose(strain.gradient, np.broadcast_to(gradient, strain.gradient.shape), atol=1e-11)
    velocities = np.zeros((soil.count, soil.freedoms))
    velocities[:, : soil.axes] = soil.positions @ rates.T
    soil.velocities = velocities
    rate = measures.gradient_rate(soil, pairs=pairs)
    np.testing.assert_allclose(rate, np.broadcast_to(rates @ gradient, rate.shape), atol=1e-9)


@every_packing
def test_strain_moves_with_the_packing(make):
    """A moved packing, cut elsewhere, has the same neighbours and the same strains."""
    found = []
    for shift in (0.0, 0.333):
        soil = make()
        soil = Assembly(soil.reference + shift, soil.radii, law=ALL, cell=type(soil.cell)(np.diag(soil.cell.matrix)))
        moved = 1e-4 * np.random.default_rng(3).normal(size=(soil.count, soil.freedoms))
        soil.displacements = moved
        pairs = np.sort(measures.reference_pairs(soil, 0.02), axis=1)
        found.append((np.sort(pairs @ [soil.count, 1]), measures.nominal_strain(soil, 0.02)))
    np.testing.assert_array_equal(found[0][0], found[1][0])
    assert not np.isnan(found[0][1].volumetric).any()
    np.testing.assert_allclose(found[1][1].gradient, found[0][1].gradient, atol=1e-11)


def test_regions_without_bounds_are_named():
    class Everywhere:
        def contains(self, points):
            return np.ones(len(points), dtype=bool)

    with pytest.raises(ValueError, match="must have finite `bounds`"):
        measures.region_average(packed(), Everywhere(), volume=1.0)
    with pytest.raises(ValueError, match="must have finite `bounds`"):
        measures.porosity(packed(), (0.0, 0.0), (np.inf, 1.0))
