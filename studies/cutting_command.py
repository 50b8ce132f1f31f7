"""The command `cutting`: options, one run or the comparison of both methods."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import click

from studies.cutting import METHODS, TITLE, Parameters
from studies.leading import led, started
from studies.options import (
    checkpoint_option,
    click_options,
    no_fields_option,
    no_figures_option,
    output_option,
    quiet_option,
    resume_option,
)
from studies.rock_command import check_counts

HELP = f"""{TITLE}.

A rigid pick on an arm of 0.7 m turns at 1.6204 rad/s about an axis that moves along the surface at 0.2 m/s: it goes in, is
deepest in the middle of the block and comes out again. Bonds are elastic and perfectly brittle. The paper gives neither the
size of the block nor the depth of cut, the shape of the pick or the mesh: these are marked (free). The cutting force is the
work of the pick over the way of its tip.
"""


@click.command("cutting", help=HELP, context_settings={"max_content_width": 118})
@click_options(Parameters)
@click.option("--compare", is_flag=True, help="Run both methods and compare mean force and time.")
@output_option("cutting")
@click.option("--samples", default=400, type=int, metavar="NUMBER", help="Rows of history.csv.  [default: 400]")
@click.option("--frames", default=12, type=int, metavar="NUMBER", help="States kept for fields and figures.  [default: 12]")
@no_fields_option
@no_figures_option
@checkpoint_option
@resume_option
@quiet_option
@click.pass_context
def command(
    context: click.Context, compare: bool, output: str, samples: int, frames: int, no_fields: bool, no_figures: bool,
    checkpoint_every: float, resume: str | None, quiet: bool, **values: Any,
) -> int:  # fmt: skip
    """Check everything, then run; returns the exit status."""
    check_counts(samples=samples)
    if not 3 <= frames <= 10_000:
        raise ValueError(f"frames={frames} must be between 3 and 10000")
    parameters = Parameters(**values)
    folder, start = started(context, output, resume, "cutting", Parameters)
    options: dict[str, Any] = {"samples": samples, "frames": frames, "fields": not no_fields, "figures": not no_figures}
    if start is not None:
        parameters, options = start.parameters, start.options
    wanted = [dataclasses.replace(parameters, method=method) for method in METHODS] if compare else [parameters]

    def script() -> str:
        from studies.cutting_run import Finished, carry_out

        runs: list[Finished] = []
        for p in wanted:
            place = folder / p.method if compare else folder
            done = carry_out(p, place, **options, progress=not quiet, checkpoint_every=checkpoint_every, start=start)
            if not done.outcome.stable:
                return done.outcome.message
            runs.append(done)
        text = compare_runs(runs, folder, not no_figures) if compare else report(runs[0].summary)
        if not quiet:
            click.echo(text)
            click.echo(f"results in {folder}")
        return ""

    return led(script)


def compare_runs(runs: list[Any], folder: Path, figures: bool) -> str:
    """Compare runs of both methods, write that into the folder; the table."""
    from bridge.output import write_json, write_text

    found = comparison(*(done.summary for done in runs))
    write_json(folder / "comparison.json", found)
    write_text(folder / "comparison.txt", compared(found))
    if figures:
        from studies.cutting_figures import force

        force(runs, folder / "comparison.png")
    return compared(found)


def comparison(dem: dict[str, Any], overlap: dict[str, Any]) -> dict[str, Any]:
    """Rows of both methods with the difference as a share of the particles' value; seconds and their ratio."""
    rows = []
    for name, entry in dem["results"].items():
        one, other = entry["value"], overlap["results"][name]["value"]
        rows.append({"quantity": name, "unit": entry["unit"], "dem": one, "overlap": other, "difference": other / one - 1.0 if one else None})
    seconds = {part: {"dem": dem["seconds"][part], "overlap": overlap["seconds"][part]} for part in ("setup", "stepping", "total")}
    return {
        "study": "cutting", "parameters": overlap["parameters"], "rows": rows, "seconds": seconds,
        "particles": {"dem": dem["counts"]["particles"], "overlap": overlap["counts"]["particles"]},
        "time_share": seconds["stepping"]["overlap"] / seconds["stepping"]["dem"],
        "balance_error": {"dem": dem["energy"]["balance_error"], "overlap": overlap["energy"]["balance_error"]},
    }  # fmt: skip


def compared(found: dict[str, Any]) -> str:
    """The comparison as a table."""
    lines = [f"{'cutting':24s}{'':>6s}{'particles':>12s}{'overlap':>12s}{'diff.':>9s}"]
    for row in found["rows"]:
        share = "-" if row["difference"] is None else f"{100.0 * row['difference']:.1f}%"
        unit = row["unit"].replace("1", "") if row["unit"] == "1" else row["unit"]
        lines.append(f"{row['quantity'].replace('_', ' '):24s}{unit:>6s}{row['dem']:12.4g}{row['overlap']:12.4g}{share:>9s}")
    lines.append(f"{'discs':30s}{found['particles']['dem']:12d}{found['particles']['overlap']:12d}")
    for part, both in found["seconds"].items():
        lines.append(f"{part + ', s':30s}{both['dem']:12.1f}{both['overlap']:12.1f}")
    lines.append(f"{'energy unaccounted for':30s}{found['balance_error']['dem']:12.1e}{found['balance_error']['overlap']:12.1e}")
    lines.append(f"stepping takes {found['time_share']:.2f} of the time of particles alone")
    return "\n".join(lines) + "\n"


def report(summary: dict[str, Any]) -> str:
    """What the command prints after a run."""
    counts = ", ".join(f"{value} {name.replace('_', ' ')}" for name, value in summary["counts"].items())
    lines = [f"cutting, {summary['method']}: {counts}"]
    for name, entry in summary["results"].items():
        unit = "" if entry["unit"] == "1" else entry["unit"]
        lines.append(f"{name.replace('_', ' '):24s}{entry['value']:12.4g} {unit}")
    lines.append(f"energy balance error {summary['energy']['balance_error']:.2e} of the work of the pick")
    lines.append("seconds: " + ", ".join(f"{name} {value:.1f}" for name, value in summary["seconds"].items()))
    return "\n".join(lines)
