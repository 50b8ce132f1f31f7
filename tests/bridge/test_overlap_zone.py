"""The zone: the continuum's share from the distances to two faces, of any shape, in the plane and in space."""

import numpy as np
import pytest

from bridge import OverlapZone
from meshes import Box, Disc, HalfPlane, HalfSpace, Sphere


def test_parallel_faces_give_the_published_share():
    """alpha = g / L between the faces (Rojek & Onate 2007, eqs 63-67)."""
    zone = OverlapZone(HalfPlane((1.0, 0.0), (1.0, 0.0)), HalfPlane((3.0, 0.0), (1.0, 0.0)))
    x = np.array([0.0, 1.0, 1.5, 2.0, 3.0, 4.0])
    np.testing.assert_allclose(zone(np.column_stack([x, x])), [0.0, 0.0, 0.25, 0.5, 1.0, 1.0], atol=1e-15)


@pytest.mark.parametrize("axes", [2, 3])
def test_rings_and_shells(axes):
    centre = (0.5,) * axes
    zone = OverlapZone((Disc if axes == 2 else Sphere)(centre, 1.0), (Disc if axes == 2 else Sphere)(centre, 3.0))
    points = np.random.default_rng(1).uniform(-4.0, 4.0, (200, axes))
    radius = np.linalg.norm(points - centre, axis=1)
    np.testing.assert_allclose(zone(points), np.clip((radius - 1.0) / 2.0, 0.0, 1.0), atol=1e-14)


def test_a_band_inside_a_region():
    region = Box((-9.0, 0.0), (9.0, 4.0))
    points = np.array([[0.0, 2.0], [0.0, 0.0], [0.0, 0.25], [8.6, 2.0], [9.5, 2.0]])
    np.testing.assert_allclose(OverlapZone.within(region, 1.0)(points), [0.0, 1.0, 0.75, 0.6, 1.0], atol=1e-12)


def test_faces_need_not_be_parallel():
    """A share that depends on the ratio of the distances: one half along the bisector of two planes."""
    zone = OverlapZone(HalfSpace((0, 0, 0), (1, 0, 0)), HalfSpace((0, 0, 0), (0, -1, 0)))
    points = np.array([[1.0, 1.0, 5.0], [2.0, 2.0, -3.0], [3.0, 1.0, 0.0]])
    np.testing.assert_allclose(zone(points), [0.5, 0.5, 0.75])


def test_the_smooth_profile_has_no_kink_at_the_faces():
    faces = HalfPlane((0.0, 0.0), (1.0, 0.0)), HalfPlane((1.0, 0.0), (1.0, 0.0))
    points = np.column_stack([[1e-4, 0.5, 1.0 - 1e-4], np.zeros(3)])
    share = OverlapZone(*faces, profile="smooth")(points)
    np.testing.assert_allclose(share, [3e-8, 0.5, 1.0 - 3e-8], rtol=1e-3)


@pytest.mark.parametrize("arguments, word", [((1.0, 2.0), "inner"), ((HalfPlane((0, 0), (1, 0)), 2.0), "outer")])
def test_faces_that_are_no_regions_are_refused(arguments, word):
    with pytest.raises(ValueError, match=word):
        OverlapZone(*arguments)
    with pytest.raises(ValueError, match="width"):
        OverlapZone.within(Disc((0, 0), 1.0), -1.0)
    with pytest.raises(ValueError, match="profile"):
        OverlapZone.within(Disc((0, 0), 1.0), 0.5, "cubic")
