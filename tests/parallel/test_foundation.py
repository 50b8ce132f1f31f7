"""The foundation on any number of ranks gives the serial numbers; errors reach every rank."""

import numpy as np
import pytest
from mpi4py import MPI

from bridge.run import Stopwatch, on_root
from particles import Unstable
from studies.foundation import Parameters
from studies.foundation_coupled import MODELS
from studies.foundation_run import carry_out, extremes, set_up

COMM = MPI.COMM_WORLD
SCENE = {"radius": 0.2, "displacement": 0.012, "region": "6x3"}


@pytest.mark.parametrize(
    "method, mesh", [("dem", "structured"), ("bridging", "structured"), ("bridging", "graded"), ("fem", "structured")]
)
def test_every_number_is_that_of_one_rank(method, mesh):
    """Sums over ranks are in another order: equal to rounding, which 60 steps of contacts do not amplify beyond 1e-8."""
    p = Parameters(method=method, mesh=mesh, **SCENE)
    shared = carry_out(set_up(p, comm=COMM), samples=20, figures=False, progress=False)
    alone = carry_out(set_up(p, comm=MPI.COMM_SELF), samples=20, figures=False, progress=False)
    assert len(shared.outcome.history) == len(alone.outcome.history)
    for name in ("displacement_m", "load_N", "external_work_J", "kinetic_J", "strain_J"):
        mine, theirs = shared.outcome.column(name), alone.outcome.column(name)
        assert np.allclose(mine, theirs, rtol=1e-8, atol=1e-8 * np.abs(theirs).max()), name
    assert shared.summary["counts"] == alone.summary["counts"] or COMM.rank > 0
    if COMM.rank == 0:
        for name, value in extremes(alone.snapshots[-1]).items():
            assert extremes(shared.snapshots[-1])[name] == pytest.approx(value, rel=1e-7), name
        if method != "dem" and mesh == "structured":  # covered nodes show the projection of all ranks' particles; the graded
            # mesh has elements with hardly a disc in them, where rounding is amplified by 1e9
            mine, theirs = (sorted_nodes(run.snapshots[-1].continuum) for run in (shared, alone))
            np.testing.assert_allclose(mine, theirs, rtol=0.0, atol=1e-10 * np.abs(theirs).max())


def sorted_nodes(continuum):
    """Displacements of the nodes, in the order of their places."""
    return continuum.displacement[np.lexsort(np.round(continuum.nodes, 6).T)]


def test_only_rank_0_writes(tmp_path):
    folder = on_root(COMM, lambda: tmp_path)
    carry_out(
        set_up(Parameters(method="bridging", radius=0.2, displacement=0.002)), folder, figures=False, progress=False
    )
    COMM.Barrier()
    assert (folder / "summary.json").exists() and (folder / "history.csv").exists()
    if COMM.rank > 0:
        assert not list(tmp_path.iterdir())


def test_bad_input_is_refused_on_every_rank():
    with pytest.raises(ValueError, match="region=2x0.4 holds no particle"):
        MODELS["bridging"](Parameters(radius=0.5, region="2x0.4"), Stopwatch())
    with pytest.raises(ValueError, match="critical step"):
        MODELS["dem"](Parameters(method="dem", radius=0.2, step=1.0), Stopwatch())


def test_particles_that_blow_up_on_rank_0_stop_every_rank():
    model = MODELS["dem"](Parameters(method="dem", radius=0.2), Stopwatch())
    model.step = 50.0 * model.step_sizes["fine_critical"]
    with pytest.raises(Unstable, match="particle"):
        model.advance(2000)
