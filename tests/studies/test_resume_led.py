"""Element tests, columns, rock and cutting go on from their checkpoints and leave behind what an undisturbed run does."""

import json

import pytest

from bridge import checkpoint
from studies import column, column_run, cutting, cutting_run, lab, lab_run, rock, rock_run
from studies.resuming import read_checkpoint
from tests.studies.test_resume import Stopped, stop_at

QUIET = {"figures": False, "progress": False}
ROCK = {"porosity": 0.18, "size_exponent": 0.0, "speed": 0.5}
BLOCK = {
    "method": "dem", "block": "0.09x0.035", "depth": 0.002, "arm": 0.1, "rotation": 30.0, "porosity": 0.17, "path": 0.02,
}  # fmt: skip
CASES = {
    "shear": (lab_run, lab.Shear(particles=60, strain=0.002, inertial_number=1e-3, stiffness_level=100.0), 0.5, {"samples": 20, "frames": 3}),
    "column": (column_run, column.Parameters(particles=50, aspects="0.5,1"), 0.8, {"samples": 20, "frames": 3}),
    "ucs": (
        rock_run, rock.Compression(width=0.008, height=0.008, packings=2, strain=0.02, smallest_radius=4e-4, **ROCK), 0.8,
        {"samples": 20, "frames": 3},
    ),
    "cutting": (cutting_run, cutting.Parameters(**BLOCK), 0.5, {"samples": 10, "frames": 3}),
}  # fmt: skip


@pytest.mark.parametrize("study", CASES)
def test_a_resumed_study_leaves_the_same_bits(tmp_path, monkeypatch, study):
    """Stopped in the second of two runs where there are two; what was drawn and written before is there once."""
    module, p, share, options = CASES[study]
    looks: list = []
    with monkeypatch.context() as patch:
        patch.setattr(checkpoint.Keeper, "look", lambda keeper: looks.append(1))
        module.carry_out(p, tmp_path / "whole", **options, **QUIET)
    with monkeypatch.context() as patch, pytest.raises(Stopped):
        stop_at(patch, int(share * len(looks)))
        module.carry_out(p, tmp_path / "parts", **options, **QUIET)
    start = read_checkpoint(tmp_path / "parts", study, type(p))
    assert start.parameters == p and start.options == options | {"figures": False} | ({"fields": True} if study in ("ucs", "cutting") else {})
    assert len(start.state["runs"]) == (2 if study in ("column", "ucs") else 1)
    module.carry_out(start.parameters, tmp_path / "parts", **start.options, progress=False, start=start)
    files = sorted(file.relative_to(tmp_path / "whole") for file in (tmp_path / "whole").rglob("*.*"))
    assert files == sorted(file.relative_to(tmp_path / "parts") for file in (tmp_path / "parts").rglob("*.*"))
    for file in files:
        if file.name != "summary.json":  # it has seconds
            assert (tmp_path / "whole" / file).read_bytes() == (tmp_path / "parts" / file).read_bytes(), file
    one, two = (json.loads((tmp_path / name / "summary.json").read_text()) for name in ("whole", "parts"))
    for name in ("results", "energy", "counts", "steps", "warnings"):
        assert one[name] == two[name], name
