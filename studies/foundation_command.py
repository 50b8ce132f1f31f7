"""The command `foundation`: options, one run or the comparison of the three methods."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import click

from studies.foundation import COMPARED, TITLE, Parameters
from studies.options import (
    brief,
    check_cores,
    check_resume,
    checkpoint_option,
    click_options,
    no_fields_option,
    no_figures_option,
    quiet_option,
    resume_option,
)

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
@checkpoint_option
@resume_option
@quiet_option
@click.pass_context
def command(
    context: click.Context, compare: bool, growth_test: bool, output: str, samples: int, frames: int, no_fields: bool,
    no_figures: bool, checkpoint_every: float, resume: str | None, quiet: bool, **values: Any,
) -> int:  # fmt: skip
    """Check everything, then run; returns the exit status."""
    check_resume(context, resume, checkpoint_every)
    check_cores()
    if resume is not None:
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
        return stopped(stop)
    if not done.outcome.stable:
        return unstable(done.outcome.message)
    if not quiet and MPI.COMM_WORLD.rank == 0:
        click.echo(report(done, folder))
    return 0


def stopped(stop: Any) -> int:
    """Say that a signal ended the run and where it goes on (rank 0); the exit status for it."""
    from mpi4py import MPI

    if MPI.COMM_WORLD.rank == 0:
        click.echo(f"Run {stop}", err=True)
    MPI.COMM_WORLD.Barrier()
    return 128 + stop.number


def unstable(message: str) -> int:
    """Say what blew up (rank 0); the exit status for it."""
    from mpi4py import MPI

    if MPI.COMM_WORLD.rank == 0:
        click.echo(f"Error: {message}", err=True)
    MPI.COMM_WORLD.Barrier()
    return 3
