"""Studies of lattice particles and elements go on from their checkpoints and leave behind what an undisturbed run does."""

import json

import pytest
from click.testing import CliRunner

from bridge import checkpoint
from studies.lattice import command
from tests.studies.test_resume import Stopped, same_files, stop_at

pytestmark = pytest.mark.filterwarnings("ignore:poisson_ratio")
SMALL = "--width 0.04 --height 0.06 --notch 0.01 --spacing 0.0025 --per-element 2 --ultimate-deformation 1.25e-6 --speed 0.1".split()
CASES = {
    "notch": (1, ("--samples", "60", *SMALL), 0.5),  # while elements are released and bonds break
    "wave": (2, ("--width", "0.01", "--length", "0.03"), 0.5),  # in the second of three models
}


def answer(name, folder, *options):
    return CliRunner().invoke(getattr(command, f"{name}_command"), [*options, "--output", str(folder), "--quiet"], standalone_mode=False)


@pytest.mark.parametrize("study", CASES)
def test_a_resumed_study_leaves_the_same_bits(tmp_path, monkeypatch, study):
    begun_runs, options, share = CASES[study]
    looks: list = []
    with monkeypatch.context() as patch:
        patch.setattr(checkpoint.Keeper, "look", lambda keeper: looks.append(1))
        assert answer(study, tmp_path / "whole", *options).exit_code == 0
    with monkeypatch.context() as patch:
        stop_at(patch, int(share * len(looks)))
        assert isinstance(answer(study, tmp_path / "parts", *options).exception, Stopped)
    state = checkpoint.read(tmp_path / "parts" / checkpoint.NAME)[1]
    assert len(state["runs"]) == begun_runs
    if study == "notch":
        begun = state["runs"]["release"]
        assert not begun["ended"] and begun["model"]["released"] > 0 and begun["history"]["broken_bonds_1"][-1] > 0
    made = CliRunner().invoke(getattr(command, f"{study}_command"), ["--resume", str(tmp_path / "parts"), "--quiet"], standalone_mode=False)
    assert made.exit_code == 0, made.exception
    same_files(tmp_path / "whole", tmp_path / "parts")
    one, two = (json.loads((tmp_path / name / "summary.json").read_text()) for name in ("whole", "parts"))
    for content in (one, two):
        content["results"] = {name: value for name, value in content["results"].items() if "seconds" not in name and "time_share" not in name}
    for name in ("results", "energy", "counts", "steps", "warnings"):
        assert one[name] == two[name], name


def test_a_resumed_run_keeps_its_parameters(tmp_path):
    made = CliRunner().invoke(command.wave_command, ["--resume", str(tmp_path), "--width", "0.01"], standalone_mode=False)
    assert "does not go with resume" in str(made.exception)
