"""Random dense packings: sizes, porosity, equilibrium without locked-in stress, repeatability."""

import numpy as np
import pytest

from meshes import Box, Cylinder, Disc, HalfPlane, Sphere
from particles import Assembly, LiChu
from particles.measures import coordination
from particles.packing import OVERLAP, NotReached, equilibrium, power_law, random_dense
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
    one, two, other = (random_dense(((0, 0), (1, 1)), seed=seed, porosity=0.185) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one[0], two[0])
    np.testing.assert_array_equal(one[1], two[1])
    assert len(other[1]) != len(one[1]) or not np.allclose(other[1], one[1])


@pytest.mark.parametrize(
    "region, options, isostatic",
    [
        (((0, 0), (2.5, 2.5)), {"porosity": 0.14}, 4.0),
        (((0, 0, 0), (0.6, 0.6, 0.6)), {"radius_range": (0.03, 0.05), "porosity": 0.36}, 6.0),
    ],
)
def test_jammed_without_walls(region, options, isostatic):
    """Frictionless and just touching: 2 x dimension contacts a particle (Maxwell), in equilibrium, at the porosity.

    What is lost to finite overlap and size: N d - d + 1 contacts at jamming, and weak ones that are opened by the
    tolerance of the equilibrium; together less than 3 %.
    """
    positions, radii = random_dense(region, periodic=True, **options)
    found = equilibrium(positions, radii, region, periodic=True)
    assert 0.96 * isostatic < found.coordination < 1.01 * isostatic
    assert found.mean_overlap < OVERLAP and found.largest_overlap < 30 * OVERLAP  # forces decay exponentially
    assert found.unbalanced < 5e-3
    assert found.porosity == pytest.approx(options["porosity"], abs=2e-3)


@pytest.mark.parametrize(
    "region",
    [
        Disc((1, 2), 1.0),
        Box((0, 0), (2, 2)) - Disc((0, 0), 1.0),
        (Box((0, 0), (2, 2)) - Box((1, 1), (3, 3))),  # a re-entrant corner
        Box((0, 0), (2, 2)) & HalfPlane((1, 1), (1, 2)),
        Cylinder((0, 0, 0), (0, 0.2, 0.6), 0.25),
        Sphere((0, 0, 0), 0.3),
    ],
)
def test_packings_lie_within_their_outline_and_lean_on_it(region):
    """No point of a surface lies outside by more than the overlaps; and the outline holds particles on all its sides."""
    porosity = 0.17 if region.axes == 2 else 0.41
    positions, radii = random_dense(region, porosity=porosity)
    direction = np.random.default_rng(0).normal(size=(400, region.axes))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    surface = positions[:, None] + radii[:, None, None] * direction
    depth = region.distance(surface.reshape(-1, region.axes)).max() / radii.mean()
    found = equilibrium(positions, radii, region)
    assert depth < 100 * OVERLAP and found.mean_overlap < OVERLAP and found.unbalanced < 1e-2
    assert found.porosity == pytest.approx(porosity, abs=3e-3)
    # walls hold with fewer contacts: each of theirs counts for one particle only
    assert 0.85 < found.coordination / (2 * region.axes) < 1.0


def test_porosity_of_rock_at_any_length_scale():
    """4979 discs of 0.262 to 0.653 mm at 13 % in 50 mm x 50 mm (Rojek & Onate 2007): density of radii r^-3.56."""
    for scale in (1.0, 1e-3):
        side, sizes = 50.0 * scale, (0.262 * scale, 0.653 * scale)
        positions, radii = random_dense(((0, 0), (side, side)), sizes, 0.13, exponent=3.56)
        assert len(radii) == pytest.approx(4979, rel=0.015)
        assert 1 - np.pi * np.sum(radii**2) / side**2 == pytest.approx(0.13, abs=1e-3)
        assert sizes[0] <= radii.min() and radii.max() <= sizes[1]


def test_size_distribution_has_its_moments():
    """Density r^-a on (l, h): mean of r^k is (1 - a) / (k + 1 - a) (h^(k+1-a) - l^(k+1-a)) / (h^(1-a) - l^(1-a))."""
    low, high = 0.02, 0.05
    for a in (0.0, 1.5, 2.2, 3.56):
        radii = power_law((low, high), a)(np.random.default_rng(0), 200_000)
        for k in (1, 2, 3):
            mean = (
                (1 - a) / (k + 1 - a) * (high ** (k + 1 - a) - low ** (k + 1 - a)) / (high ** (1 - a) - low ** (1 - a))
            )
            assert (radii**k).mean() == pytest.approx(mean, rel=5e-3)  # 3 standard errors of the third moment
    even = power_law((low, high), 1.0)(np.random.default_rng(0), 200_000)
    assert np.log(even).mean() == pytest.approx(0.5 * np.log(low * high), rel=1e-3)


def test_own_sizes():
    """Two sizes, half of each: they come out but for a common factor within 0.002 and the rattlers taken out."""

    def two_sizes(rng, count):
        return np.where(rng.random(count) < 0.5, 1.0, 1.4)

    positions, radii = random_dense(((0, 0), (60, 60)), sampler=two_sizes, porosity=0.165, periodic=True)
    large = radii > 1.2
    assert np.ptp(radii[large]) < 1e-9 and np.ptp(radii[~large]) < 1e-9
    assert radii[large][0] / radii[~large][0] == pytest.approx(1.4, rel=1e-9)
    assert radii[~large][0] == pytest.approx(1.0, abs=4e-3)
    assert large.mean() == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("porosity, why", [(0.08, "no denser"), (0.4, "can spare no more particles")])
def test_unreachable_porosity_says_what_was_reached(porosity, why):
    """One error with what was reached and in how many steps; with `nearest` the same packing comes out."""
    region = ((0, 0), (1, 1))
    message = rf"porosity={porosity} could not be reached: 0\.\d+ after \d+ steps of relaxation.*{why}"
    with pytest.raises(NotReached, match=message) as failure:
        random_dense(region, porosity=porosity)
    positions, radii = random_dense(region, porosity=porosity, nearest=True)
    assert equilibrium(positions, radii, region).porosity == pytest.approx(failure.value.porosity, abs=1e-12)
    assert 100 < failure.value.steps < 1_000_000
    again, _ = random_dense(region, porosity=failure.value.porosity)  # what it says can be reached
    assert len(again) > 0.9 * len(positions)


def test_default_sizes_suit_assembly_c():
    """Assembly C: 6835 discs of 0.02-0.05 m at 16 % in 7 m x 3.5 m, so that r_rms is 0.031 m (Li & Wan 2010)."""
    radii = power_law((0.02, 0.05), 2.2)(np.random.default_rng(0), 200_000)
    assert np.sqrt((radii**2).mean()) == pytest.approx(np.sqrt(24.5 * 0.84 / (6835 * np.pi)), rel=0.015)


class Unbounded:
    bounds = ((0, 0), (1, 1))

    def contains(self, points):
        return np.ones(len(points), dtype=bool)


@pytest.mark.parametrize(
    "options, message",
    [
        ({"porosity": 0.9}, "porosity=0.9"),
        ({"radius_range": (0.05, 0.02)}, "radius_range="),
        ({"exponent": np.nan}, "exponent=nan"),
        ({"region": ((0, 0), (0.1, 1.0))}, "region from"),
        ({"region": ((0, 0), (0.1, np.inf))}, "region=.* must be a finite region"),
        ({"region": Unbounded()}, "must have a method distance"),
        ({"region": Disc((0, 0), 1.0), "periodic": True}, "periodic=True needs a box"),
        ({"sampler": lambda rng, count: -np.ones(count)}, "sampler must give 1000 positive"),
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
