"""A checkpoint of several ranks goes on there and on one rank, one of a single rank on several, equal to rounding."""

import shutil

import numpy as np
import pytest
from mpi4py import MPI

from bridge import checkpoint
from bridge.run import on_root
from studies.foundation import Parameters
from studies.foundation_resume import read_start
from studies.foundation_run import carry_out, set_up
from tests.studies.test_resume import SCENE, Stopped, stop_at

COMM, SELF = MPI.COMM_WORLD, MPI.COMM_SELF
QUIET = {"samples": 20, "figures": False, "progress": False}


@pytest.mark.parametrize("method", ["bridging", "overlap", "dem", "fem"])
def test_other_numbers_of_ranks_go_on_with_it(tmp_path, monkeypatch, method):
    p = Parameters(**SCENE | {"method": method})
    whole = carry_out(set_up(p, comm=COMM), **QUIET).outcome.history
    shared = on_root(COMM, lambda: tmp_path)
    for comm, folder in ((COMM, shared / "of_all"), (SELF, tmp_path / "of_one")):
        with monkeypatch.context() as patch, pytest.raises(Stopped):
            stop_at(patch, 9)
            carry_out(set_up(p, comm=comm), folder, **QUIET)
    COMM.Barrier()
    again = resumed(p, shared / "of_all", shared / "1", COMM)
    check_close(again, whole)
    check_close(resumed(p, shared / "of_all", tmp_path / "2", SELF), whole)
    check_close(resumed(p, shared / "of_one", shared / "3", COMM), whole)


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
