"""The loop of a run and its files: chunks, samples, blow-up, phases, atomic summary, scores."""

import json
import time
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

import continuum
import particles
from bridge import accuracy, output
from bridge.run import LONGEST_CHUNK, Stopwatch, on_root, run


class Counter:
    """A model that counts its steps and blows up at one of them."""

    step = 0.5

    def __init__(self, last=10**9, error=particles.Unstable):
        self.done, self.last, self.error, self.chunks = 0, last, error, []

    @property
    def time(self):
        return self.done * self.step

    def advance(self, steps):
        self.chunks.append(steps)
        if self.done + steps >= self.last:
            raise self.error(f"particle 7 runs away in step {self.last}")
        self.done += steps

    def sample(self):
        return {"time_s": self.time, "load_N": 2.0 * self.done}

    def energies(self):
        return {}


def test_a_run_ends_where_a_row_says_so():
    model, asked = Counter(), []
    outcome = run(model, 1000, samples=10, until=lambda row: asked.append(row["time_s"]) or row["load_N"] >= 600.0)
    assert outcome.stable and outcome.steps == model.done == 300
    assert asked == outcome.column("time_s").tolist() == [0.0, 50.0, 100.0, 150.0]


def test_samples_are_even_and_frames_are_where_they_are_wanted():
    model, seen = Counter(), []
    outcome = run(model, 1000, samples=10, frames=[0, 333, 1000], on_frame=lambda: seen.append(model.done))
    assert outcome.stable and outcome.steps == 1000
    assert outcome.column("time_s").tolist() == [50.0 * k for k in range(11)]
    assert seen == [0, 333, 1000]
    assert max(model.chunks) <= LONGEST_CHUNK


def test_there_is_never_more_than_a_sample_a_step():
    assert len(run(Counter(), 3, samples=200).history) == 4


@pytest.mark.parametrize("error", [particles.Unstable, continuum.Unstable])
def test_a_blow_up_ends_the_run_and_keeps_what_there_was(tmp_path, error):
    history = output.HistoryFile(tmp_path / "history.csv")
    outcome = run(Counter(last=210, error=error), 1000, samples=100, on_sample=history.write)
    assert not outcome.stable and "particle 7" in outcome.message
    rows = (tmp_path / "history.csv").read_text().splitlines()
    assert rows[0] == "time_s,load_N" and len(rows) == 1 + 21  # samples of steps 0, 10, ..., 200, on disk at once


def test_other_errors_are_not_taken_for_a_blow_up():
    with pytest.raises(ZeroDivisionError):
        run(Counter(last=5, error=ZeroDivisionError), 10)


def test_phases_hold_the_time_of_their_blocks():
    watch = Stopwatch()
    with watch.phase("setup"):
        time.sleep(0.02)
    part = watch.part("particles", lambda: time.sleep(0.02))
    with watch.phase("stepping"):
        part()
        time.sleep(0.02)
    assert watch.seconds["setup"] >= 0.02 and watch.seconds["compile"] == 0.0
    assert watch.seconds["stepping"] - watch.parts["particles"] >= 0.02


def test_compilation_is_no_part_of_the_phase_that_causes_it():
    from numba import njit

    watch = Stopwatch()
    function = watch.part("particles", njit(lambda x: x + 1.0))
    with watch.phase("stepping"):
        function(1.0)
    assert watch.seconds["compile"] > watch.seconds["stepping"] > watch.parts["particles"] > 0.0


def test_json_has_no_numbers_that_json_does_not_know(tmp_path):
    output.write_json(
        tmp_path / "a.json", {"a": np.float64(np.nan), "b": np.arange(2), "c": (True, None), "d": Path("x")}
    )
    assert json.loads((tmp_path / "a.json").read_text()) == {"a": None, "b": [0, 1], "c": [True, None], "d": "x"}
    assert [file.name for file in tmp_path.iterdir()] == ["a.json"]


def test_a_folder_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ValueError, match="output="):
        output.prepare_folder(tmp_path / "file" / "below")


def test_clearing_spares_what_a_run_did_not_write(tmp_path):
    written = {"summary.json", "load.png", "fields/discs.pvd", "fields/discs_0000.vtu", "fields/discs_012.vtu"}
    own = {
        "mine.png",
        "comparison.json",
        "fields/discs_mine.vtu",
        "fields/discs_0000_mine.vtu",
        "fields/other_0000.vtu",
    }
    for name in written | own:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("")
    output.clear(tmp_path, ["summary.json", "load.png", "never.csv"], ["discs"])
    assert {str(file.relative_to(tmp_path)) for file in tmp_path.rglob("*.*")} == own


@pytest.mark.parametrize("name", ["", "  "])
def test_a_folder_without_a_name_is_refused(name):
    with pytest.raises(ValueError, match="output= is empty"):
        output.check_folder(name)


def test_checking_a_folder_does_not_make_it(tmp_path):
    assert output.check_folder(tmp_path / "a" / "b") == tmp_path / "a" / "b"
    assert not list(tmp_path.iterdir())


def test_errors_of_rank_0_reach_the_caller():
    assert on_root(MPI.COMM_WORLD, lambda: 3) == 3

    def refuse():
        raise ValueError("no")

    with pytest.raises(ValueError, match="no"):
        on_root(MPI.COMM_WORLD, refuse)


def test_scores_are_shares_of_the_references_peak():
    control = np.linspace(0.0, 1.0, 101)
    reference = accuracy.Curve(control, control, 10.0, 0.0)
    coarse = np.linspace(0.0, 1.0, 6)
    one = accuracy.score("+10 %", accuracy.Curve(coarse, 1.1 * coarse, 2.0, 1e-3), reference)
    assert one.peak_error == pytest.approx(0.1) and one.speed_up == pytest.approx(5.0)
    assert one.curve_error == pytest.approx(0.1 * np.sqrt(np.mean(coarse**2)))
    with pytest.raises(ValueError, match="ends at 0.5"):
        accuracy.score("short", accuracy.Curve(0.5 * coarse, coarse, 1.0, 0.0), reference)


@pytest.mark.parametrize("count", [3, 40])
def test_few_and_many_scores_are_drawn(tmp_path, count):
    scores = [accuracy.Score(f"s{k}", 1.0, 0.01 * (k + 1), 0.02, 0.0, 1.0, 1.0 + k) for k in range(count)]
    kinds = [(f"region {k % 4}", f"variant {k % 5}", f"moduli {k % 2}") for k in range(count)]
    accuracy.plot(scores, kinds, "title", tmp_path / "a.png")
    assert (tmp_path / "a.png").stat().st_size > 10_000
