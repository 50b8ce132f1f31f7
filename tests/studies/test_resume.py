"""A run that is stopped, or killed, goes on from its checkpoint and leaves behind what an undisturbed one does."""

import json
import os
import signal

import h5py
import numpy as np
import pytest
from click.testing import CliRunner
from mpi4py import MPI

from benchmarks import kills
from bridge import checkpoint, output
from bridge.run import Outcome
from studies.foundation import Parameters
from studies.foundation_command import command
from studies.foundation_resume import put_back, read_start
from studies.foundation_run import carry_out, set_up
from studies.resuming import describe

SCENE = {"radius": 0.2, "displacement": 0.024, "region": "6x3"}
QUIET = {"figures": False, "progress": False}


class Stopped(Exception):
    """In place of a kill."""


def same_files(whole, parts):
    """Assert that two folders hold the same files with the same bits, but for the seconds in summary.json."""
    files = sorted(file.relative_to(whole) for file in whole.rglob("*.*"))
    assert files == sorted(file.relative_to(parts) for file in parts.rglob("*.*"))
    for file in files:
        if file.name != "summary.json":
            assert (whole / file).read_bytes() == (parts / file).read_bytes(), file


def stop_at(monkeypatch, looks):
    """Let a run end right after the checkpoint of that look."""
    seen = []

    def look(keeper):
        seen.append(1)
        if len(seen) == looks:
            keeper.write()
            raise Stopped

    monkeypatch.setattr(checkpoint.Keeper, "look", look)


@pytest.mark.parametrize(
    "options",
    [
        {"method": "dem"}, {"method": "fem", "element_size": 0.5}, {"method": "overlap"}, {"method": "bridging"},
        {"method": "bridging", "variant": "respa"}, {"method": "bridging", "variant": "multiplier"},
        {"method": "bridging", "variant": "paper"}, {"method": "bridging", "variant": "resync"},
    ],
)  # fmt: skip
def test_a_resumed_run_leaves_the_same_bits(tmp_path, monkeypatch, options):
    p = Parameters(**SCENE | options)
    whole = carry_out(set_up(p), tmp_path / "whole", samples=20, **QUIET)
    with monkeypatch.context() as patch, pytest.raises(Stopped):
        stop_at(patch, 9)
        carry_out(set_up(p), tmp_path / "parts", samples=20, **QUIET)
    (tmp_path / "parts" / "history.csv").write_text("torn")  # as a kill may leave it
    start = read_start(tmp_path / "parts")
    assert start.parameters == p and 0 < start.state["steps"] < whole.outcome.steps
    again = carry_out(set_up(p), tmp_path / "parts", progress=False, start=start, **start.options)
    assert again.outcome.history == whole.outcome.history
    same_files(tmp_path / "whole", tmp_path / "parts")
    kept = ("results", "energy", "counts", "steps")
    one, two = (json.loads((tmp_path / name / "summary.json").read_text()) for name in ("whole", "parts"))
    for content in (one, two):
        del content["results"]["total_time"]
    assert {name: one[name] for name in kept} == {name: two[name] for name in kept}


def test_killed_runs_lose_no_more_than_a_period(tmp_path):
    """The script runs 50 kills; here two, each at a random moment of a run that writes a checkpoint every 0.2 s.

    How many come before the run ends is a matter of the machine's speed.
    """
    found = kills.survive(tmp_path, number=2, period=0.2, seed=1)
    assert found.kills >= 1 and found.same
    assert found.largest_loss < 0.2 + kills.SLACK


def test_a_signal_ends_the_run_with_a_checkpoint(tmp_path, monkeypatch):
    look, times = checkpoint.Keeper.look, []

    def signalled(keeper):
        times.append(1)
        if len(times) == 5:
            os.kill(os.getpid(), signal.SIGTERM)
        look(keeper)

    monkeypatch.setattr(checkpoint.Keeper, "look", signalled)
    p = Parameters(method="fem", **SCENE)
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(checkpoint.Interrupted, match="SIGTERM.*--resume"):
        carry_out(set_up(p), tmp_path, **QUIET)
    assert signal.getsignal(signal.SIGTERM) is before
    assert read_start(tmp_path).state["steps"] > 0


def test_a_crash_while_writing_leaves_the_old_checkpoint(tmp_path, monkeypatch):
    """Whatever is on the disk under the name is whole: half a file never gets it."""
    path = tmp_path / checkpoint.NAME
    checkpoint.write(path, {"run": 1}, {"values": np.arange(5)})
    for step in ("_put", "_to_disk"):
        with monkeypatch.context() as patch, pytest.raises(Stopped):

            def crash(*arguments):
                raise Stopped

            patch.setattr(checkpoint, step, crash)
            checkpoint.write(path, {"run": 2}, {"values": np.arange(9)})
        about, state = checkpoint.read(path)
        assert about == {"run": 1} and np.array_equal(state["values"], np.arange(5))


def damaged(path):
    path.write_bytes(path.read_bytes()[:300])


def foreign(path):
    with h5py.File(path, "a") as file:
        file.attrs["format"] = "something else"


def newer(path):
    with h5py.File(path, "a") as file:
        file.attrs["version"] = checkpoint.VERSION + 1


@pytest.mark.parametrize("change, words", [(damaged, "cannot be read"), (foreign, "no checkpoint"), (newer, f"has version {checkpoint.VERSION + 1}")])
def test_what_cannot_be_read_is_refused_with_a_word(tmp_path, change, words):
    path = tmp_path / checkpoint.NAME
    checkpoint.write(path, {"study": "foundation"}, {"values": np.arange(100.0)})
    change(path)
    with pytest.raises(ValueError, match=words):
        read_start(tmp_path)


def test_checkpoints_of_others_are_refused(tmp_path):
    with pytest.raises(ValueError, match="holds no checkpoint.h5"):
        read_start(tmp_path)
    about = describe("foundation", Parameters(), {}, MPI.COMM_SELF)
    path = tmp_path / checkpoint.NAME
    checkpoint.write(path, about | {"study": "column"}, {"model": {}})
    with pytest.raises(ValueError, match="of the study column"):
        read_start(tmp_path)
    checkpoint.write(path, about | {"parameters": {"radius": 1.0}}, {"model": {}})
    with pytest.raises(ValueError, match="other parameters"):
        read_start(tmp_path)
    checkpoint.write(path, about, {"model": {"time": 0.0}, "steps": 0})
    with pytest.raises(ValueError, match="lacks 'coarse_steps'|lacks 'particles'|lacks"):
        put_back(read_start(tmp_path), set_up(Parameters(radius=0.2)), [])


def test_options_that_do_not_go_with_resume_are_refused(tmp_path):
    result = CliRunner().invoke(command, ["--resume", str(tmp_path), "--radius", "0.1"], standalone_mode=False)
    assert isinstance(result.exception, ValueError) and "radius= does not go with resume" in str(result.exception)
    result = CliRunner().invoke(command, ["--checkpoint-every", "-1"], standalone_mode=False)
    assert "checkpoint_every=-1.0 must be zero or positive" in str(result.exception)


def test_a_full_disk_does_not_end_the_run(tmp_path, monkeypatch, capsys):
    def full(*arguments):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(checkpoint, "write", full)
    done = carry_out(set_up(Parameters(method="fem", **SCENE)), tmp_path, checkpoint_every=1e-9, **QUIET)
    assert done.outcome.stable and "No space left" in capsys.readouterr().err
    assert isinstance(done.outcome, Outcome) and output.check_folder(tmp_path)
