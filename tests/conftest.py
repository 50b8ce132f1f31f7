"""For every test: no windows, and under mpirun a rank that fails or hangs takes the others down with it.

Tests are imported from the repository's root, so a helper is `from tests.particles.naive import ...`.
"""

import faulthandler
import os
import sys
import tempfile
from pathlib import Path

import matplotlib
import pytest

matplotlib.use("Agg")

# From the launcher's environment (Open MPI, MPICH): a serial run then starts mpirun itself without being in MPI.
RANKS = int(os.environ.get("OMPI_COMM_WORLD_SIZE", os.environ.get("PMI_SIZE", "1")))
SECONDS_PER_TEST = 300  # under mpirun: longer than any, compilation included

if RANKS > 1:
    from mpi4py import MPI

    STDERR = pytest.StashKey[int]()

    @pytest.hookimpl(tryfirst=True)
    def pytest_configure(config: pytest.Config) -> None:
        """Rank 0 reports; the true standard error stays within reach of every rank while its output is captured."""
        config.stash[STDERR] = os.dup(2)
        if MPI.COMM_WORLD.rank > 0:
            sys.stdout = open(os.devnull, "w")
        # Temporary folders of its own: ranks that clear old ones together get in each other's way.
        folder = Path(tempfile.gettempdir()) / f"pytest-{os.getuid()}-rank-{MPI.COMM_WORLD.rank}"
        folder.mkdir(exist_ok=True)
        os.environ["PYTEST_DEBUG_TEMPROOT"] = str(folder)

    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_protocol(item: pytest.Item):
        """Ranks that wait for each other for ever print where they stand and end the run."""
        faulthandler.dump_traceback_later(SECONDS_PER_TEST, exit=True, file=item.config.stash[STDERR])
        yield
        faulthandler.cancel_dump_traceback_later()

    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_makereport(item: pytest.Item):
        """The other ranks would wait in the next collective call for a rank that failed."""
        outcome = yield
        if outcome.get_result().failed:
            abort(item.config, item.nodeid, outcome.get_result().longreprtext)

    @pytest.hookimpl(hookwrapper=True)
    def pytest_make_collect_report(collector: pytest.Collector):
        """The same for a test module that one rank cannot import."""
        outcome = yield
        if outcome.get_result().failed:
            abort(collector.config, collector.nodeid, outcome.get_result().longreprtext)

    def pytest_internalerror(excrepr: object) -> None:
        """The same for an error in the test machinery itself."""
        os.write(2, f"{excrepr}\n".encode())
        MPI.COMM_WORLD.Abort(1)

    def abort(config: pytest.Config, where: str, text: str) -> None:
        message = f"\n{where} failed on rank {MPI.COMM_WORLD.rank} of {RANKS}:\n{text}\n"
        os.write(config.stash[STDERR], message.encode())
        MPI.COMM_WORLD.Abort(1)
