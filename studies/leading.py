"""How a study of particles alone runs on several ranks: rank 0 leads, all ranks move the particles."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from studies.foundation_command import stopped, unstable
from studies.options import check_cores, check_resume


def led(script: Callable[[], str]) -> int:
    """Exit status of a study on all ranks (collective).

    Args:
        script: runs the study and says what it found, on rank 0; returns what made it unstable, or nothing.
    """
    check_cores()

    from bridge.checkpoint import Interrupted
    from particles import Unstable
    from particles.crew import lead
    from particles.driving import NotSettled

    try:
        message = lead(script)
    except (NotSettled, Unstable) as failure:  # before the run itself
        message = str(failure)
    except Interrupted as stop:
        return stopped(stop)
    return unstable(message) if message else 0


def shown(summary: dict[str, Any], report: Callable[[dict[str, Any]], str], folder: Path, quiet: bool) -> str:
    """Print what a stable run has found; what made it unstable, or nothing (for `led`)."""
    if summary["stable"] and not quiet:
        click.echo(report(summary))
        click.echo(f"results in {folder}")
    return str(summary["message"])


def started(context: click.Context, folder: str, resume: str | None, study: str, kind: type) -> tuple[Path, Any]:
    """Folder of the results, and where a study goes on that is resumed (None for a new one) (collective).

    Raises:
        ValueError: a folder that cannot be written to, options that do not go with `resume`, no checkpoint that can be read.
    """
    check_resume(context, resume, context.params["checkpoint_every"])

    from bridge.output import check_folder

    if resume is None:
        return check_folder(folder), None

    from studies.resuming import read_checkpoint

    path = check_folder(resume)
    return path, read_checkpoint(path, study, kind)
