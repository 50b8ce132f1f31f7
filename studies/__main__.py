"""The command line: `python -m studies` lists the studies, `python -m studies STUDY --help` explains one."""

from __future__ import annotations

import importlib
import re
import sys
import time
import traceback

import click

STUDIES = {
    "foundation": ("studies.foundation_command", "foundation under a strip plate: particles, continuum and both"),
    "biaxial": ("studies.lab_command:biaxial", "biaxial compression of discs in a periodic cell"),
    "triaxial": ("studies.lab_command:triaxial", "triaxial compression of spheres in a periodic cell"),
    "shear": ("studies.lab_command:shear", "simple shear of discs in a periodic cell at constant normal stress"),
    "column": ("studies.column_command", "collapse of columns of discs: runout against aspect ratio"),
    "interface": ("studies.interface_command", "a pulse through the overlap of particles and continuum: reflection"),
    "ucs": ("studies.rock_command:ucs", "unconfined compression of bonded rock over several random packings"),
    "brazilian": ("studies.rock_command:brazilian", "Brazilian test of bonded rock over several random packings"),
    "cutting": ("studies.cutting_command", "rock cutting by a pick: particles, and particles with a continuum"),
    "calibrate": ("studies.calibrate_command", "micro parameters of bonded rock from its moduli and strengths"),
    "tension": ("studies.lattice.command:tension_command", "a bar in tension: lattice particles, manifold elements, continuum"),
    "wave": ("studies.lattice.command:wave_command", "a pulse along a bar of lattice particles, manifold elements, continuum"),
    "cantilever": ("studies.lattice.command:cantilever_command", "a cantilever of particles and elements against Hex8"),
    "plate": ("studies.lattice.command:plate_command", "a plate with a hole in tension: particles round the hole, or elements"),
    "notch": ("studies.lattice.command:notch_command", "a notched specimen torn apart: elements released as the crack comes"),
    "cavern": ("studies.lattice.command:cavern_command", "a blast in a cavern: particles near the walls, absorbing faces"),
    "tunnel": ("studies.lattice.command:tunnel_command", "a tunnel behind a weak layer under a blast: damage"),
    "accuracy": ("studies.accuracy", "speed against error of a study over a list of settings"),
}
USAGE_ERROR = 2
PATIENCE = 10.0  # s that a rank waits for the others to refuse, too


class _Studies(click.Group):
    """Commands that are imported when they are called: a list or a help text needs no dolfinx."""

    def list_commands(self, context: click.Context) -> list[str]:
        return list(STUDIES)

    def get_command(self, context: click.Context, name: str) -> click.Command | None:
        if name not in STUDIES:
            return None
        module, _, command = STUDIES[name][0].partition(":")
        return getattr(importlib.import_module(module), command or "command")

    def resolve_command(self, context: click.Context, arguments: list[str]):
        if arguments[0] not in STUDIES:
            raise click.UsageError(f"study '{arguments[0]}' is unknown; known are {', '.join(STUDIES)}")
        return super().resolve_command(context, arguments)

    def format_commands(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Studies"):
            formatter.write_dl([(name, text) for name, (_, text) in STUDIES.items()])


@click.group(cls=_Studies, invoke_without_command=True, help="Coupled discrete and continuum mechanics: the studies.")
@click.pass_context
def commands(context: click.Context) -> None:
    if context.invoked_subcommand is None:
        for name, (_, text) in STUDIES.items():
            click.echo(f"{name:12s} {text}")
        click.echo("\npython -m studies STUDY --help explains one.")


def main() -> None:
    """Run the command line: one sentence and exit status 2 for bad input, 3 for a run that became unstable."""
    try:
        status = commands.main(prog_name="python -m studies", standalone_mode=False)
    except click.ClickException as error:
        status = _refuse(error.format_message())
    except ValueError as error:
        status = _refuse(str(error))
    except (KeyboardInterrupt, click.Abort):
        click.echo("Interrupted.", err=True)
        status = 130
    except Exception:
        _end_all_ranks()
        raise
    sys.exit(status or 0)


def _end_all_ranks() -> None:
    """After a programming error on one of several ranks, which would leave the others waiting: show it and end the run."""
    from mpi4py import MPI

    if MPI.COMM_WORLD.size > 1:
        traceback.print_exc()
        MPI.COMM_WORLD.Abort(1)


def _refuse(sentence: str) -> int:
    """Print the sentence on one line, once however many ranks there are; a rank that alone refuses ends the others."""
    from mpi4py import MPI

    short = re.sub(r"(\d{10})\d{20,}", r"\1...", " ".join(sentence.split()))
    if MPI.COMM_WORLD.rank == 0:
        click.echo(f"Error: {short}", err=True)
    others = MPI.COMM_WORLD.Ibarrier()  # mpirun ends the others as soon as one rank leaves with an error
    until = time.monotonic() + PATIENCE
    while not others.Test():
        if time.monotonic() > until:
            click.echo(f"Error on rank {MPI.COMM_WORLD.rank}: {short}", err=True)
            MPI.COMM_WORLD.Abort(USAGE_ERROR)
        time.sleep(0.01)
    return USAGE_ERROR


if __name__ == "__main__":
    main()
