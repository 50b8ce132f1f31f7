import numpy as np
import pytest

from meshes import Box, Cylinder, Disc, HalfPlane, HalfSpace, Sphere


def test_box_distance_area_and_edges():
    box = Box((6, 6), (12, 9))
    points = np.array([(9, 8.5), (12, 9), (13, 10), (6.0, 7.0), (5.0, 7.0), (12 + 1e-9, 9), (12.1, 7)])
    assert box.distance(points) == pytest.approx([-0.5, 0, np.sqrt(2), 0, 1, 1e-9, 0.1])
    assert box.contains(points).tolist() == [True, True, False, True, False, True, False]  # closed, 1e-9 x 6 m
    assert not box.contains(points[5:6], tolerance=0.0)
    assert box.area == 18 and box.bounds.tolist() == [[6, 6], [12, 9]]
    edge = np.roll(box.corners, -1, axis=0) - box.corners
    assert np.sum(box.corners[:, 0] * edge[:, 1] - box.corners[:, 1] * edge[:, 0]) == 2 * 18  # counter-clockwise


def test_disc_and_half_plane():
    disc = Disc((1, 2), 0.5)
    assert disc.distance([(1, 2), (2, 2)]) == pytest.approx([-0.5, 0.5])
    assert disc.area == pytest.approx(np.pi / 4)
    below = HalfPlane((0, 3), (0, 2))
    assert below.distance([(7, 2), (7, 5)]) == pytest.approx([-1, 2])
    assert below.bounds.tolist() == [[-np.inf, -np.inf], [np.inf, 3]]


def test_combinations():
    box, disc = Box((0, 0), (2, 1)), Disc((2, 1), 0.5)
    points = np.array([(0.5, 0.5), (1.9, 0.9), (2.2, 1.1), (3, 3)])
    assert (box | disc).contains(points).tolist() == [True, True, True, False]
    assert (box & disc).contains(points).tolist() == [False, True, False, False]
    assert (box - disc).contains(points).tolist() == [True, False, False, False]
    assert (box - disc).area == pytest.approx(2 - np.pi / 16, rel=2e-3)
    assert (box | disc).bounds.tolist() == [[0, 0], [2.5, 1.5]]


SOLIDS = [
    (Box((0, -1, 0), (2, 1, 3)), 12.0),
    (Sphere((1, 2, 3), 0.5), np.pi / 6),
    (Cylinder((1, 0, 0), (1, 3, 4), 0.5), 5 * np.pi / 4),
]


@pytest.mark.parametrize("solid, volume", SOLIDS)
def test_distance_in_3d_is_that_of_the_nearest_point_of_the_surface(solid, volume):
    """|grad d| = 1 and x - d grad d lies on the surface, wherever the nearest point is unique; volumes in closed form."""
    lower, upper = solid.bounds
    points = np.random.default_rng(0).uniform(lower - 1, upper + 1, (2000, 3))
    distance, step = solid.distance(points), 1e-5
    gradient = np.column_stack(
        [(solid.distance(points + e) - solid.distance(points - e)) / 2e-5 for e in step * np.eye(3)]
    )
    smooth = np.abs(np.linalg.norm(gradient, axis=1) - 1) < 1e-6
    assert smooth.mean() > 0.99  # the rest lies within a step of an edge's bisector
    nearest = points - distance[:, None] * gradient
    assert np.abs(solid.distance(nearest[smooth])).max() < 1e-5
    assert (solid.contains(points) == (distance <= 0)).all()
    assert ((points >= lower) & (points <= upper)).all(axis=1)[distance <= 0].all()
    assert solid.measure == pytest.approx(volume)
    # whatever combination equals it has its volume, by samples: 160 cells across, faces within half a cell
    assert (solid & Box(lower - 0.01, upper + 0.01)).measure == pytest.approx(volume, rel=0.02)


def test_combinations_in_3d():
    bored = Box((0, 0, 0), (2, 2, 1)) - Cylinder((1, 1, 0), (1, 1, 1), 0.5)
    assert bored.contains([(0.1, 0.1, 0.5), (1, 1, 0.5), (1.6, 1, 0.5)]).tolist() == [True, False, True]
    assert bored.measure == pytest.approx(4 - np.pi / 4, rel=5e-3)
    half = Sphere((0, 0, 0), 1.0) & HalfSpace((0, 0, 0), (0, 0, 2))
    assert half.bounds.tolist() == [[-1, -1, -1], [1, 1, 0]]
    assert half.measure == pytest.approx(2 / 3 * np.pi, rel=5e-3)
    assert Box((0, 0, 0), (1, 1, 1)).corners.shape == (8, 3)


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: Box((1, 0), (1, 2)), "must lie below and left of"),
        (lambda: Box((0, np.nan), (1, 2)), "must be two finite numbers"),
        (lambda: Disc((0, 0), -1), "radius=-1 must be positive"),
        (lambda: Cylinder((0, 0), (1, 1), 1), "start=.* must be three finite numbers"),
        (lambda: Cylinder((0, 0, 0), (0, 0, 0), 1), "must differ from start"),
        (lambda: Box((0, 0), (1, 1, 1)), "upper=.* must be two finite numbers"),
        (lambda: Box((0, 0), (1, 1)) | Sphere((0, 0, 0), 1), "must both be plane or both be in 3D"),
        (lambda: Sphere((0, 0, 0), 1).area, "has a volume"),
        (lambda: HalfPlane((0, 0), (0, 0)), "must not be zero"),
        (lambda: Box((0, 0), (1, 1)).contains([1.0, 2.0]), "must have the shape"),
    ],
)
def test_bad_regions_are_named(make, words):
    with pytest.raises(ValueError, match=words):
        make()
