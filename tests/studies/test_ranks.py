"""A run under mpirun ends on all ranks when one of them fails, and says why; too many threads are refused."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MPIRUN = ("mpirun", "--allow-run-as-root", "--oversubscribe", "-n", "2", sys.executable)


MPI = ("OMPI_", "OPAL_", "ORTE_", "PMIX", "PMI_", "PRTE_")  # a process that has initialised MPI by itself sets such variables
SHARED_MEMORY = {"OMPI_MCA_btl": "^tcp", "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe"}


def run(*arguments, **environment):
    plain = {name: value for name, value in os.environ.items() if not name.startswith(MPI)} | SHARED_MEMORY
    return subprocess.run(
        [*MPIRUN, *arguments], cwd=ROOT, env=plain | environment, capture_output=True, text=True, timeout=120, check=False
    )


FAILING = """
import sys
from mpi4py import MPI
from studies import __main__ as front, foundation_command
def fail(*ignored):
    if MPI.COMM_WORLD.rank == 1:
        raise {error}("no more of it")
    MPI.COMM_WORLD.Barrier()
foundation_command.run_and_report = fail
front.PATIENCE = 0.5
sys.argv = ["studies", "foundation", "--method", "fem", "--output", "{output}"]
front.main()
"""


def test_a_rank_that_fails_alone_ends_the_run_with_its_reason(tmp_path):
    for error in ("RuntimeError", "ValueError"):
        ended = run("-c", FAILING.format(error=error, output=tmp_path / "out"))
        assert ended.returncode != 0 and "no more of it" in ended.stderr, ended.stderr


def test_more_threads_than_cores_are_refused(tmp_path):
    ended = run("-m", "studies", "foundation", "--output", str(tmp_path / "out"), OMP_NUM_THREADS="1000")
    assert ended.returncode == 2 and "threads=1000" in ended.stderr and not (tmp_path / "out").exists()
