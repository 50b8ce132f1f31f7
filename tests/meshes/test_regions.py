import numpy as np
import pytest

from meshes import Box, Disc, HalfPlane


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


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: Box((1, 0), (1, 2)), "must lie below and left of"),
        (lambda: Box((0, np.nan), (1, 2)), "must be two finite numbers"),
        (lambda: Disc((0, 0), -1), "radius=-1 must be positive"),
        (lambda: HalfPlane((0, 0), (0, 0)), "must not be zero"),
        (lambda: Box((0, 0), (1, 1)).contains([1.0, 2.0]), "must have the shape"),
    ],
)
def test_bad_regions_are_named(make, words):
    with pytest.raises(ValueError, match=words):
        make()
