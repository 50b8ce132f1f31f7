"""Packings as text: exact round trip, and one sentence about what is wrong with a file."""

import numpy as np
import pytest

from particles.files import read_packing, write_packing


@pytest.mark.parametrize("axes", [2, 3])
def test_round_trip_is_exact(tmp_path, axes):
    rng = np.random.default_rng(0)
    positions, radii = rng.normal(size=(50, axes)) * 1e-7, rng.uniform(1e-9, 1e9, 50)
    file = tmp_path / "packing.txt"
    write_packing(file, positions, radii, comment="sand\nseed 1", unit="mm")
    assert file.read_text().startswith("# sand\n# seed 1\n# 50 particles: x y " + "z " * (axes - 2) + "r (mm)\n")
    again = read_packing(file)
    np.testing.assert_array_equal(again[0], positions)
    np.testing.assert_array_equal(again[1], radii)


def test_other_separators_and_comments(tmp_path):
    file = tmp_path / "packing.csv"
    file.write_text("# head\n\n1, 2, 0.5  # first\n3;4;0.25\n")
    positions, radii = read_packing(file)
    assert positions.tolist() == [[1, 2], [3, 4]] and radii.tolist() == [0.5, 0.25]


@pytest.mark.parametrize(
    "text, words",
    [
        ("", "must have at least one line"),
        ("1 2\n", "line 1: 2 columns must be 3 columns"),
        ("# x y r\n1 2 3\n1 2 3 4\n", "line 3: 4 columns must be 3 columns like"),
        ("1 2 -3\n", "line 1: radius -3 must be positive"),
        ("1 nan 3\n", "line 1: '1 nan 3' must be finite"),
        ("x y r\n", "line 1: 'x y r' must be numbers"),
    ],
)
def test_bad_files_are_named(tmp_path, text, words):
    file = tmp_path / "bad.txt"
    file.write_text(text)
    with pytest.raises(ValueError, match=f"bad.txt.*{words}"):
        read_packing(file)
    with pytest.raises(ValueError, match="missing.txt could not be read"):
        read_packing(tmp_path / "missing.txt")


@pytest.mark.parametrize(
    "positions, radii, words",
    [
        ([[1, 2, 3, 4]], [1], "positions of shape"),
        ([[1, 2]], [1, 2], "radii of shape"),
        ([[1, 2]], [0], "radii positive"),
    ],
)
def test_bad_packings_are_not_written(tmp_path, positions, radii, words):
    with pytest.raises(ValueError, match=words):
        write_packing(tmp_path / "packing.txt", positions, radii)
    assert not (tmp_path / "packing.txt").exists()
