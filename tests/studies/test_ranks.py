"""A run under mpirun ends on all ranks when one of them fails, and says why; too many threads are refused."""

import json
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MPIRUN = ("mpirun", "--allow-run-as-root", "--oversubscribe", "-n")

MPI = ("OMPI_", "OPAL_", "ORTE_", "PMIX", "PMI_", "PRTE_")  # a process that has initialised MPI by itself sets such variables
SHARED_MEMORY = {"OMPI_MCA_btl": "^tcp", "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe"}


def run(*arguments, ranks=2, **environment):
    plain = {name: value for name, value in os.environ.items() if not name.startswith(MPI)} | SHARED_MEMORY
    return subprocess.run(
        [*MPIRUN, str(ranks), sys.executable, *arguments], cwd=ROOT, env=plain | environment, capture_output=True, text=True, timeout=120, check=False
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


ROCK = (
    "ucs", "--width", "0.008", "--height", "0.008", "--packings", "1", "--smallest-radius", "4e-4", "--porosity", "0.18", "--size-exponent",
    "0", "--speed", "0.5", "--strain", "0.004", "--samples", "20", "--no-fields", "--no-figures", "--quiet",
)  # fmt: skip


def test_a_study_that_one_rank_leads_runs_on_four(tmp_path):
    """Two of the ranks may have a handful of discs; one rank writes; the modulus is that of one rank."""
    shared = run("-m", "studies", *ROCK, "--output", str(tmp_path / "four"), ranks=4)
    assert shared.returncode == 0, shared.stderr
    subprocess.run([sys.executable, "-m", "studies", *ROCK, "--output", str(tmp_path / "one")], cwd=ROOT, check=True, capture_output=True)
    four, one = (json.loads((tmp_path / name / "summary.json").read_text()) for name in ("four", "one"))
    assert four["ranks"] == 4 and one["ranks"] == 1
    assert sum(four["parallel"][0]["particles"]) == one["counts"]["particles"] == four["counts"]["particles"]
    assert len((tmp_path / "four" / "history.csv").read_text().splitlines()) == 22
    mine, theirs = four["results"]["young_modulus"]["value"], one["results"]["young_modulus"]["value"]
    assert abs(mine - theirs) < 0.01 * theirs  # damping against the velocity of a disc at rest amplifies rounding


LED = """
import sys
from mpi4py import MPI
from particles.exchange import SharedAssembly
from studies import __main__ as front
advance = SharedAssembly.advance
def fail(self, *arguments, **options):
    if MPI.COMM_WORLD.rank == {rank} and self.time > 0.0:
        raise {error}("no more of it")
    advance(self, *arguments, **options)
SharedAssembly.advance = fail
sys.argv = ["studies", *{arguments}]
front.main()
"""


def test_a_rank_that_fails_in_a_led_study_ends_it_with_its_reason(tmp_path):
    arguments = [*ROCK, "--output", str(tmp_path / "out")]
    for rank, error in ((1, "ValueError"), (0, "KeyError")):
        ended = run("-c", LED.format(rank=rank, error=error, arguments=arguments))
        assert ended.returncode != 0 and "no more of it" in ended.stderr, ended.stderr
