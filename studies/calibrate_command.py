"""The command `calibrate`: micro parameters of bonded rock that give wanted moduli and strengths."""

from __future__ import annotations

from typing import Any

import click

from studies.calibrate import NOT_OPTIONS, TITLE, Targets
from studies.leading import led, started
from studies.options import (
    checkpoint_option,
    click_options,
    no_figures_option,
    output_option,
    quiet_option,
    resume_option,
)
from studies.rock import Compression

HELP = f"""{TITLE}.

Runs of `ucs` (and of `brazilian`, where a tensile strength is wanted) over a grid of k_t / k_n and R_t / R_n give the
dimensionless relations of Rojek & Onate (2007, eqs 57-59). They are inverted for the target, the result is corrected by
further runs on the same packings, and checked on others.
"""


@click.command("calibrate", help=HELP, context_settings={"max_content_width": 118})
@click_options(Targets)
@click_options(Compression, without=NOT_OPTIONS)
@output_option("calibrate")
@no_figures_option
@checkpoint_option
@resume_option
@quiet_option
@click.pass_context
def command(
    context: click.Context, output: str, no_figures: bool, checkpoint_every: float, resume: str | None, quiet: bool, **values: Any
) -> int:
    """Check everything, then run; returns the exit status."""
    target = Targets(**{name: values.pop(name) for name in Targets.__dataclass_fields__})
    specimen, figures = Compression(**values), not no_figures
    folder, start = started(context, output, resume, "calibrate", Targets)
    if start is not None:
        target, specimen, figures = start.parameters, Compression(**start.options["specimen"]), start.options["figures"]

    def script() -> str:
        from studies.calibrate_run import carry_out

        summary = carry_out(
            target, specimen, folder, figures=figures, progress=not quiet, checkpoint_every=checkpoint_every, start=start
        )
        if not quiet:
            click.echo(report(summary))
            click.echo(f"results in {folder}")
        return ""

    return led(script)


def report(summary: dict[str, Any]) -> str:
    """Micro parameters and the check as a table."""
    lines = [f"{'micro parameter':30s}{'value':>12s}{'std. error':>12s}{'relations':>12s}{'published':>12s}"]
    for name, entry in summary["results"].items():
        head = f"{name.replace('_', ' ')} {entry['unit'].replace('1', '')}".strip()
        numbers = (entry["value"], entry["standard_error"], entry["from_relations"], entry["published"])
        lines.append(f"{head:30s}" + "".join(f"{number:12.4g}" for number in numbers))
    lines.append(f"{'check on other packings':30s}{'target':>12s}{'mean':>12s}{'deviation':>12s}{'off by, %':>12s}")
    for name, entry in summary["check"].items():
        scale, unit = (1e-6, " MPa") if entry["unit"] == "Pa" else (1.0, "")
        off = 100.0 * (entry["value"] / entry["target"] - 1.0) if entry["target"] else float("nan")
        numbers = (scale * entry["target"], scale * entry["value"], scale * entry["deviation"], off)
        lines.append(f"{name.replace('_', ' ') + unit:30s}" + "".join(f"{number:12.4g}" for number in numbers))
    lines.append("seconds: " + ", ".join(f"{name} {value:.1f}" for name, value in summary["seconds"].items()))
    return "\n".join(lines)
