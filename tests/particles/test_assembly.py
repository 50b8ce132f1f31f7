"""The assembly's door: bad input is named; properties in the caller's order."""

import numpy as np
import pytest

from particles import Assembly, LiChu, Plate
from tests.particles.scenes import PAPER, cloud

GOOD = {"positions": [[0.0, 0.0], [1.0, 0.0]], "radii": 0.05, "law": PAPER}


@pytest.mark.parametrize(
    "change, message",
    [
        ({"radii": -1.0}, "radii=-1 must be positive"),
        ({"radii": [0.1, float("nan")]}, "radii must be finite"),
        ({"radii": [0.1]}, r"radii of shape \(1,\)"),
        ({"positions": [[0.0] * 4, [1.0] * 4]}, "positions of shape"),
        ({"positions": [[0.0, 0.0], [float("inf"), 0.0]]}, "positions must be finite"),
        ({"density": 0.0}, "density=0 must be positive"),
        ({"law": None}, "law must be a contact law"),
        ({"law": {(0, 0): PAPER}, "materials": [0, 1]}, r"no entry for materials \(0, 1\)"),
        ({"skin": -1.0}, "skin=-1"),
    ],
)
def test_bad_assemblies_are_named(change, message):
    with pytest.raises(ValueError, match=message):
        Assembly(**{**GOOD, **change})


def test_bad_calls_are_named():
    soil = Assembly(**GOOD)
    cases = {
        "step=0": lambda: soil.advance(1, 0.0),
        "steps=-1": lambda: soil.advance(-1, 1e-5),
        "local_damping=1.5": lambda: soil.advance(1, 1e-5, local_damping=1.5),
        "mass_damping=nan": lambda: soil.advance(1, 1e-5, mass_damping=float("nan")),
        "gravity must be finite": lambda: soil.advance(1, 1e-5, gravity=(0.0, float("nan"))),
        "components='z'": lambda: soil.hold([0], "z"),
        "ids must be": lambda: soil.hold([2], "x"),
        "velocities must be finite": lambda: setattr(soil, "velocities", np.full((2, 3), np.nan)),
        "displacements of shape": lambda: setattr(soil, "displacements", np.zeros((2, 2))),
        "channel": lambda: Assembly([[0, 0]], 0.05, law=LiChu(1e8)).add_wall(Plate.rectangle((0, 1), (1, 2), law=PAPER)),
    }
    for message, call in cases.items():
        with pytest.raises(ValueError, match=message):
            call()


def test_properties_are_copies_in_the_callers_order():
    soil = cloud(40)
    radii, places = soil.radii, soil.positions
    np.testing.assert_allclose(soil.masses, 2600 * np.pi * radii**2)
    np.testing.assert_allclose(soil.inertias, 0.5 * soil.masses * radii**2)
    np.testing.assert_array_equal(places, soil.reference)
    soil.positions[:] = 0.0
    soil.reference[:] = 0.0
    soil.velocities[:] = 0.0
    np.testing.assert_array_equal(soil.positions, places)
    assert np.abs(soil.velocities).max() > 0
    np.testing.assert_array_equal(soil.system.position[soil.rows, 3], radii)


def test_displacements_can_be_set_and_imposed_energy_is_booked():
    soil = cloud(40)
    soil.advance(100, 1e-5)
    new = soil.displacements + 1e-4
    soil.displacements = new
    np.testing.assert_allclose(soil.displacements, new, rtol=1e-12, atol=1e-16)
    assert all((values == 0).all() for values in soil.contacts().history.values())
    scale = soil.energies()["imposed"]
    balance = soil.energy_balance()
    soil.velocities = 0.5 * soil.velocities
    assert soil.energy_balance() == pytest.approx(balance, abs=1e-12 * scale)


@pytest.mark.parametrize(
    ("positions", "radii", "word"), [("abc", 0.1, "positions of kind str"), (None, 0.1, "positions"), ([[0, 0]], "big", "radii")]
)
def test_what_is_no_array_of_numbers_is_refused_by_name(positions, radii, word):
    with pytest.raises(ValueError, match=f"^{word}"):
        Assembly(positions, radii)
