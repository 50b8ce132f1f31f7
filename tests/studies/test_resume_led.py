"""Element tests, columns, rock and cutting go on from their checkpoints and leave behind what an undisturbed run does."""

import json
import math
from types import SimpleNamespace

import pytest

from bridge import checkpoint
from studies import (
    calibrate_run,
    column,
    column_run,
    cutting,
    cutting_run,
    interface,
    interface_run,
    lab,
    lab_run,
    rock,
    rock_run,
)
from studies.calibrate import Targets
from studies.calibration import Micro
from studies.resuming import read_checkpoint
from tests.studies.test_calibration import RADIUS, SMALL, hexagonal
from tests.studies.test_resume import Stopped, same_files, stop_at

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
    same_files(tmp_path / "whole", tmp_path / "parts")
    one, two = (json.loads((tmp_path / name / "summary.json").read_text()) for name in ("whole", "parts"))
    for name in ("results", "energy", "counts", "steps", "warnings"):
        assert one[name] == two[name], name


def short_map(folder, start=None, **options):
    p = interface.Parameters(elements="0.004", overlaps="0.01,0.03", wavelengths="0.02", couplings="lagrange")
    return interface_run.carry_out(p, folder, start=start, **({"samples": 20} | options), progress=False)


def table(folder, start=None, figures=False, **options):
    """A calibration by specimens of the hexagonal lattice, whose responses are known."""
    target = Targets(young_modulus=2e10, poisson_ratio=0.2, compressive_strength=1e7, packings=2, check_packings=2)
    return calibrate_run.carry_out(target, SMALL, folder, figures=figures, start=start, progress=False)


def lattice_test(p, seed, samples, **options):
    young, poisson, *strength = hexagonal(Micro(p.normal_stiffness, p.shear_stiffness / p.normal_stiffness, p.tensile_strength, 1.0))
    numbers = (math.exp(young) * (1.0 + 1e-3 * seed), poisson, *map(math.exp, strength))
    outcome = SimpleNamespace(stable=True, history=[{}])
    model = SimpleNamespace(is_broken=lambda row: seed % 2 == 0, radius=RADIUS)
    return SimpleNamespace(outcome=outcome, model=model, results={name: (value,) for name, value in zip(calibrate_run.NAMES, numbers)})


@pytest.mark.parametrize("study, kind, run, made", [("interface", interface.Parameters, short_map, "passage"), ("calibrate", Targets, table, "tested")])
def test_of_many_short_runs_those_that_have_ended_are_not_made_again(tmp_path, monkeypatch, study, kind, run, made):
    module = {"interface": interface_run, "calibrate": calibrate_run}[study]
    if study == "calibrate":
        monkeypatch.setattr(module, "tested", lattice_test)
    calls, work = [], getattr(module, made)
    monkeypatch.setattr(module, made, lambda *arguments, **options: (calls.append(1), work(*arguments, **options))[1])
    whole, once = run(tmp_path / "whole", figures=False), len(calls)
    calls.clear()
    looks: list = []

    def look(keeper):
        looks.append(len(calls))
        if looks[-1] == 2:
            keeper.write()
            raise Stopped

    with monkeypatch.context() as patch, pytest.raises(Stopped):
        patch.setattr(checkpoint.Keeper, "look", look)
        run(tmp_path / "parts", figures=False)
    start = read_checkpoint(tmp_path / "parts", study, kind)
    assert len(start.state["done"]) == 2
    again = run(tmp_path / "parts", start, **{name: value for name, value in start.options.items() if name != "specimen"})
    assert len(calls) == once and not (tmp_path / "parts" / checkpoint.NAME).exists()
    for name in ("results", "counts", "warnings"):
        assert repr(again[name]) == repr(whole[name])  # NaN, too
    for file in (tmp_path / "whole").glob("*.csv"):
        if file.name != "map.csv":  # it has seconds
            assert file.read_bytes() == (tmp_path / "parts" / file.name).read_bytes(), file.name
