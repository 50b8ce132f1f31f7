"""The command `column`: collapse of columns of several aspect ratios, and the runout over all of them."""

from __future__ import annotations

from typing import Any

import click
import numpy as np

from studies.column import TITLE, Parameters, lube, staron_hinch
from studies.leading import led, shown, started
from studies.options import (
    brief,
    checkpoint_option,
    click_options,
    no_fields_option,
    no_figures_option,
    output_option,
    quiet_option,
    resume_option,
)

HELP = f"""{TITLE}.

Each column settles between two smooth walls without friction, the right one vanishes, and the column spreads over a floor
as rough as the discs. The run ends when the heap is at rest. Published: Lube et al. (2005) for sand, Staron & Hinch (2005)
for discs without rolling resistance.
"""


@click.command("column", help=HELP, context_settings={"max_content_width": 118})
@click_options(Parameters)
@output_option("column")
@click.option("--samples", default=100, type=int, metavar="NUMBER", help="Rows of history.csv a column.  [default: 100]")
@click.option("--frames", default=6, type=int, metavar="NUMBER", help="Times of the field files a column.  [default: 6]")
@no_fields_option
@no_figures_option
@checkpoint_option
@resume_option
@quiet_option
@click.pass_context
def command(
    context: click.Context, output: str, samples: int, frames: int, no_fields: bool, no_figures: bool, checkpoint_every: float,
    resume: str | None, quiet: bool, **values: Any,
) -> int:  # fmt: skip
    """Check everything, then run; returns the exit status."""
    for option, value, most in (("samples", samples, 1_000_000), ("frames", frames, 10_000)):
        if not 1 <= value <= most:
            raise ValueError(f"{option}={brief(value)} must be between 1 and {most}")
    p = Parameters(**values)
    folder, start = started(context, output, resume, "column", Parameters)
    options = {"samples": samples, "frames": 0 if no_fields else frames, "figures": not no_figures}
    p, options = (p, options) if start is None else (start.parameters, start.options)

    def script() -> str:
        from studies.column_run import carry_out

        summary = carry_out(p, folder, **options, progress=not quiet, checkpoint_every=checkpoint_every, start=start)
        return shown(summary, report, folder, quiet)

    return led(script)


def report(summary: dict[str, Any]) -> str:
    """Runs of all columns as a table."""
    lines = [f"{'a':>6s}{'runout':>10s}{'sand (Lube)':>14s}{'discs (Staron)':>16s}{'height/L0':>12s}{'angle':>9s}"]
    results = summary["results"]
    for k, a in enumerate(results["aspects"]["value"]):
        row = [results[name]["value"][k] for name in ("runout", "final_height", "heap_angle")]
        lines.append(f"{a:6.2f}{row[0]:10.2f}{lube(np.array(a)):14.2f}{staron_hinch(np.array(a)):16.2f}{row[1]:12.2f}{row[2]:8.1f}°")
    lines.append(f"energy balance error {summary['energy']['balance_error']:.2e}")
    lines.append("seconds: " + ", ".join(f"{name} {value:.1f}" for name, value in summary["seconds"].items()))
    return "\n".join(lines)
