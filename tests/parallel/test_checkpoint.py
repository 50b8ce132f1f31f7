"""A checkpoint of several ranks goes on there to the same bits; on one rank, and one of a single rank on several, equal to rounding."""

import shutil

import numpy as np
import pytest
from mpi4py import MPI

from bridge import checkpoint
from bridge.run import on_root
from particles.crew import lead
from studies.foundation import Parameters
from studies.foundation_resume import read_start
from studies.foundation_run import carry_out, set_up
from studies.resuming import read_checkpoint
from tests.studies.test_resume import SCENE, Stopped, same_files, stop_at
from tests.studies.test_resume_led import CASES

COMM, SELF = MPI.COMM_WORLD, MPI.COMM_SELF
QUIET = {"samples": 20, "figures": False, "progress": False}

pytestmark = pytest.mark.skipif(COMM.size == 1, reason="tests.studies.test_resume and test_resume_led have one rank")


@pytest.mark.parametrize(
    "options",
    [
        {"method": "bridging"}, {"method": "bridging", "variant": "paper"}, {"method": "overlap"}, {"method": "dem"},
        {"method": "fem", "mesh": "graded"},
    ],
)  # fmt: skip
def test_runs_go_on_to_the_same_bits_and_on_other_numbers_of_ranks(tmp_path, monkeypatch, options):
    p = Parameters(**SCENE | options)
    shared = on_root(COMM, lambda: tmp_path)
    whole = carry_out(set_up(p, comm=COMM), shared / "whole", **QUIET).outcome.history
    for comm, folder in ((COMM, shared / "of_all"), (SELF, tmp_path / "of_one")):
        with monkeypatch.context() as patch, pytest.raises(Stopped):
            stop_at(patch, 9)
            carry_out(set_up(p, comm=comm), folder, **QUIET)
    COMM.Barrier()
    check_close(resumed(p, shared / "of_all", tmp_path / "2", SELF), whole)
    check_close(resumed(p, shared / "of_one", shared / "3", COMM), whole)
    start = read_start(shared / "of_all", COMM)
    again = carry_out(set_up(p, comm=COMM), shared / "of_all", progress=False, start=start, **start.options)
    assert again.outcome.history == whole
    on_root(COMM, lambda: same_files(shared / "whole", shared / "of_all"))


def resumed(p, source, folder, comm):
    """History of a run that goes on from a checkpoint, in a folder of its own."""
    if comm.rank == 0:
        folder.mkdir()
        shutil.copy(source / checkpoint.NAME, folder)
    start = read_start(folder, comm)
    return carry_out(set_up(p, comm=comm), folder, progress=False, start=start, **start.options).outcome.history


def check_close(one, two):
    """Equal but for the order of sums, which some 30 steps of contacts do not amplify beyond 1e-8."""
    assert len(one) == len(two)
    for name in ("time_s", "displacement_m", "load_N", "external_work_J", "kinetic_J", "elastic_J", "strain_J"):
        mine, theirs = (np.array([row[name] for row in rows]) for rows in (one, two))
        np.testing.assert_allclose(mine, theirs, rtol=0.0, atol=1e-8 * np.abs(theirs).max(), err_msg=name)


class Halted(ValueError):
    """In place of a kill, on all ranks."""


@pytest.mark.parametrize("study", ["shear", "ucs"])
def test_what_one_rank_leads_goes_on_to_the_same_bits(tmp_path, monkeypatch, study):
    module, p, share, options = CASES[study]
    options = options | {"figures": False, "progress": False}
    shared, looks = on_root(COMM, lambda: tmp_path), [0, -1]

    def look(keeper):
        looks[0] += 1
        if looks[0] == looks[1]:
            keeper.write()
            raise Halted("halted")

    def begin(name):
        looks[0] = 0
        lead(lambda: (module.carry_out(p, shared / name, **options), None)[1], COMM)

    def go_on():
        start = read_checkpoint(shared / "parts", study, type(p), SELF)
        module.carry_out(start.parameters, shared / "parts", **start.options, progress=False, start=start)

    with monkeypatch.context() as patch:
        patch.setattr(checkpoint.Keeper, "look", look)
        begin("whole")
        looks[1] = int(share * looks[0])
        with pytest.raises(Halted):
            begin("parts")
    lead(go_on, COMM)
    on_root(COMM, lambda: same_files(shared / "whole", shared / "parts"))
