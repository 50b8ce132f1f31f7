"""Laws by pair of material ids."""

import numpy as np
import pytest

from particles import Assembly, LiChu, Plate

FULL = LiChu(1e8, 5e7, 1e6, 7e2, 40.0, 30.0, 20.0, 0.1, 0.5, 0.05, 5e-3)
WITHOUT_DASHPOTS = LiChu(1e8, 5e7, 1e6, 7e2, sliding_friction=0.5, rolling_friction=0.05, moment_friction=5e-3)
SLIDING = LiChu(1e8, 5e7, sliding_friction=0.5)


def shaken(law, materials=None):
    random = np.random.default_rng(3)
    grid = np.stack(np.meshgrid(np.arange(6), np.arange(6)), axis=-1).reshape(-1, 2) * 0.099
    soil = Assembly(grid, 0.05, 2600.0, law, materials=materials)
    soil.velocities = random.standard_normal((len(grid), 3)) * [0.3, 0.3, 3.0]
    soil.advance(200, 2e-5)
    return soil


@pytest.mark.parametrize("law", [FULL, WITHOUT_DASHPOTS, SLIDING, LiChu(1e8)], ids=["full", "no dashpots", "sliding", "normal"])
def test_alike_materials_move_as_one(law):
    """The table of laws gives the same numbers as the one law, bit for bit up to the order of a few operations."""
    materials = np.arange(36) % 2
    several = shaken({(0, 0): law, (0, 1): law, (1, 1): law}, materials)
    one = shaken(law)
    np.testing.assert_allclose(several.displacements, one.displacements, rtol=0.0, atol=1e-12)
    assert np.abs(one.displacements[:, :2]).max() > 1e-4


def test_each_pair_has_its_own_law():
    """Three discs in a row, 10 mm overlaps: forces by the stiffness of the pair, with and without a sliding channel."""
    laws = {(0, 0): FULL, (0, 1): SLIDING, (1, 1): LiChu(3e6)}
    soil = Assembly([(0.0, 0.0), (0.99, 0.0), (1.98, 0.0)], 0.5, 2600.0, laws, materials=[0, 1, 1])
    soil.advance(1, 1e-9)
    np.testing.assert_allclose(soil.forces[:, 0], [-1e8 * 0.01, 1e8 * 0.01 - 3e6 * 0.01, 3e6 * 0.01], rtol=1e-6)


def test_plates_and_discs_that_cannot_be_are_refused():
    plate = Plate.rectangle((0.0, -2.0), (1.0, -1.0), name="floor")
    soil = Assembly([(0.0, 0.0)], 0.5, 2600.0, FULL)
    with pytest.raises(ValueError, match="wall=5 must be a Wall"):
        soil.add_wall(5)
    soil.add_wall(plate)
    for other in (soil, Assembly([(0.0, 0.0)], 0.5, 2600.0, FULL)):
        with pytest.raises(ValueError, match="floor belongs to an assembly already"):
            other.add_wall(plate)
    with pytest.raises(ValueError, match="particles 0 and 2 are the same"):
        Assembly([(0.0, 0.0), (1.0, 0.0), (0.0, 0.0)], 0.5, 2600.0, FULL)
    with pytest.raises(ValueError, match="steps=1.5 must be a whole number"):
        soil.advance(1.5, 1e-6)
