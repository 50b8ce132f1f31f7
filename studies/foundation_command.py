"""The command `foundation`: options, one run or the comparison of the three methods."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from studies.foundation import COMPARED, TITLE, Parameters
from studies.options import brief, check_cores, click_options, no_fields_option, no_figures_option, quiet_option

HELP = f"""{TITLE}.

The discs' constants are those of the paper's table 1. Rolling works over twice the reduced radius, so that the rolling
stiffness of a contact is r^2 k_r + k_w as in the paper's eq 24. The default region of 6 m x 3 m covers whole elements;
7x3.5 holds exactly the 2426 (A) and 6765 (B) discs of the paper. The paper gives neither damping nor time steps; after
the peak the load depends on both, and on any perturbation, by about 30 per cent. The variants subcycling,
multiplier and respa are equally accurate; the first keeps momentum to rounding and balances energy at any number of substeps.
"""


@click.command("foundation", help=HELP, context_settings={"max_content_width": 118})
@click_options(Parameters)
@click.option("--compare", is_flag=True, help="Run all three methods and compare them with the paper's table 2.")
@click.option("--growth-test", is_flag=True, help="Before a bridging run, test whether the scheme grows (5 to 30 s).")
@click.option(
    "--output", default="out/foundation", metavar="FOLDER", help="Folder for the results.  [default: out/foundation]"
)
@click.option("--samples", default=120, type=int, metavar="NUMBER", help="Rows of history.csv, at most one a coarse step.  [default: 120]")
@click.option(
    "--frames",
    default=8,
    type=int,
    metavar="NUMBER",
    help="Times of the field files, beside the paper's states.  [default: 8]",
)
@no_fields_option
@no_figures_option
@click.option(
    "--checkpoint-every", default=600.0, type=float, metavar="s",
    help="Wall time between checkpoints, 0 for none; Ctrl-C and SIGTERM write one, too.  [default: 600 s]",
)
@click.option(
    "--resume", default=None, metavar="FOLDER",
    help="Go on with the run that was stopped in this folder, with its parameters, from checkpoint.h5.",
)
@quiet_option
@click.pass_context
def command(
    context: click.Context, compare: bool, growth_test: bool, output: str, samples: int, frames: int, no_fields: bool,
    no_figures: bool, checkpoint_every: float, resume: str | None, quiet: bool, **values: Any,
) -> int:  # fmt: skip
    """Check everything, then run; returns the exit status."""
    if not 0.0 <= checkpoint_every < math.inf:
        raise ValueError(f"checkpoint_every={checkpoint_every} must be zero or positive (s)")
    check_cores()
    if resume is not None:
        given = [name for name in context.params if context.get_parameter_source(name) is ParameterSource.COMMANDLINE]
        others = sorted(set(given) - {"resume", "checkpoint_every", "quiet"})
        if others:
            raise ValueError(
                f"{others[0]}= does not go with resume={resume}: a resumed run keeps its parameters; leave the option out"
            )
        return go_on(resume, checkpoint_every, quiet)
    for name, value, most in (("samples", samples, 1_000_000), ("frames", frames, 10_000)):
        if not 1 <= value <= most:
            raise ValueError(f"{name}={brief(value)} must be between 1 and {most}")
    parameters = Parameters(**values)
    if compare:  # every method's parameters are checked before the first one runs
        for method in COMPARED:
            dataclasses.replace(parameters, method=method)

    from bridge.output import check_folder

    folder = check_folder(output)  # made when all checks and the set-up have passed
    options: dict[str, Any] = {
        "samples": samples, "frames": 0 if no_fields else frames, "figures": not no_figures, "progress": not quiet
    }  # fmt: skip
    if compare:
        from studies.foundation_compare import compare_methods

        return compare_methods(parameters, folder, options, growth_test, quiet)

    from studies.foundation_run import set_up

    return run_and_report(set_up(parameters, growth_test), folder, quiet, options | {"checkpoint_every": checkpoint_every})


def go_on(resume: str, checkpoint_every: float, quiet: bool) -> int:
    """Resume the run in a folder; returns the exit status."""
    from bridge.output import check_folder
    from studies.foundation_resume import read_start
    from studies.foundation_run import set_up

    folder = check_folder(resume)
    start = read_start(folder)
    options = start.options | {"checkpoint_every": checkpoint_every, "progress": not quiet, "start": start}
    return run_and_report(set_up(start.parameters), folder, quiet, options)


def run_and_report(prepared: Any, folder: Path, quiet: bool, options: dict[str, Any]) -> int:
    """Run, print the report; returns the exit status."""
    from mpi4py import MPI

    from bridge.checkpoint import Interrupted
    from studies.foundation_report import report
    from studies.foundation_run import carry_out

    try:
        done = carry_out(prepared, folder, **options)
    except Interrupted as stop:
        if MPI.COMM_WORLD.rank == 0:
            click.echo(f"Run {stop}", err=True)
        MPI.COMM_WORLD.Barrier()
        return 128 + stop.number
    if not done.outcome.stable:
        return unstable(done.outcome.message)
    if not quiet and MPI.COMM_WORLD.rank == 0:
        click.echo(report(done, folder))
    return 0


def unstable(message: str) -> int:
    """Say what blew up (rank 0); the exit status for it."""
    from mpi4py import MPI

    if MPI.COMM_WORLD.rank == 0:
        click.echo(f"Error: {message}", err=True)
    MPI.COMM_WORLD.Barrier()
    return 3
