"""Random dense packings: sizes, porosity, equilibrium without locked-in stress, repeatability."""

import numpy as np
import pytest

from particles import Assembly, LiChu
from particles.measures import coordination
from particles.packing import random_dense
from tests.particles.scenes import PAPER

BOX = ((0.0, 0.0), (4.0, 2.0))


@pytest.fixture(scope="module")
def packed():
    return random_dense(BOX, porosity=0.165, seed=4)


def test_sizes_and_porosity_are_as_asked(packed):
    positions, radii = packed
    assert 0.02 <= radii.min() and radii.max() <= 0.05
    assert radii.min() < 0.021 and radii.max() > 0.047
    assert 1 - np.pi * np.sum(radii**2) / 8.0 == pytest.approx(0.165, abs=2e-3)
    assert (positions - radii[:, None] > -1e-6).all() and (positions + radii[:, None] < np.array(BOX[1]) + 1e-6).all()


def test_discs_just_touch_and_are_jammed(packed):
    soil = Assembly(*packed, law=LiChu(2.5e8))
    overlap = soil.contacts().overlap / soil.radii.mean()
    assert 0 < overlap.mean() < 1e-5 and overlap.max() < 1e-4
    # isostatic without friction: 4 contacts a disc but for walls (they hold with fewer) and finite size
    assert 3.6 < coordination(soil, rattlers=False) < 4.1
    # unbalanced force against the mean contact force, discs away from the walls
    forces = np.hypot(*soil.trial_forces(np.zeros((soil.count, 3)), np.zeros((soil.count, 3)))[soil.rows][:, :2].T)
    inner = ((soil.positions > 0.1) & (soil.positions < np.array(BOX[1]) - 0.1)).all(axis=1)
    mean = soil.contacts().push.mean()
    assert np.sqrt((forces[inner] ** 2).mean()) < 0.05 * mean


def test_the_same_seed_gives_the_same_packing():
    one, two, other = (random_dense(((0, 0), (1, 1)), seed=seed, porosity=0.18) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one[0], two[0])
    assert len(other[1]) != len(one[1]) or not np.allclose(other[1], one[1])


def test_unreachable_porosity_says_what_was_reached():
    with pytest.warns(UserWarning, match=r"porosity 0\.1\d+ was reached, not 0\.12"):
        random_dense(((0, 0), (1, 1)), porosity=0.12)


def test_default_sizes_suit_assembly_c():
    """Li & Wan's C: 6835 discs of 0.02-0.05 m at 16 % in 7 m x 3.5 m, so that r_rms is 0.031 m (methods E-LW-15)."""
    from particles.packing import _draw

    radii = _draw(200_000, (0.02, 0.05), 2.2, np.random.default_rng(0))
    assert np.sqrt((radii**2).mean()) == pytest.approx(np.sqrt(24.5 * 0.84 / (6835 * np.pi)), rel=0.015)


@pytest.mark.parametrize(
    "options, message",
    [
        ({"porosity": 0.9}, "porosity=0.9"),
        ({"radius_range": (0.05, 0.02)}, "radius_range="),
        ({"region": ((0, 0), (0.1, 1.0))}, "region from"),
    ],
)
def test_bad_packings_are_named(options, message):
    with pytest.raises(ValueError, match=message):
        random_dense(**{"region": BOX, **options})


def test_packing_stays_where_it_is_when_released():
    """Nothing is locked in: without the box the discs move by no more than some overlaps."""
    positions, radii = random_dense(((0, 0), (1, 1)), seed=2, porosity=0.18)
    soil = Assembly(positions, radii, law=PAPER)
    soil.advance(500, 0.5 * soil.critical_step())
    # stored: overlaps of 2e-6 r; they could move discs by no more than that
    assert np.hypot(*soil.displacements[:, :2].T).max() < 1e-3 * radii.mean()
