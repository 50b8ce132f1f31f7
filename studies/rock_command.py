"""The commands of the rock tests: `ucs` and `brazilian`."""

from __future__ import annotations

from typing import Any

import click

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
from studies.rock import Brazilian, Compression, Parameters

HELP = """Discs in random dense packings are bonded as they lie, without force, and pressed between two rigid plates until
they break, one run a packing. Bonds are elastic and perfectly brittle. Defaults: Rojek & Onate (2007), with plates that are
faster than published (as slow as that by --speed 0.001). Stress along the load is positive in compression.
"""
WHAT = {
    "ucs": "Young's modulus and Poisson's ratio come from the strain of an inner volume, the strength from the peak load.",
    "brazilian": "The tensile strength is 2 P / (pi D) with the peak load P of a disc of diameter D.",
}


def check_counts(**counts: int) -> None:
    """Refuse numbers of samples and the like that make no sense.

    Raises:
        ValueError: names option, value and rule.
    """
    for option, value in counts.items():
        if not 10 <= value <= 1_000_000:
            raise ValueError(f"{option}={brief(value)} must be between 10 and 1000000")


def _command(kind: type[Parameters]) -> click.Command:
    name = kind.study

    @click.command(name, help=f"{kind.title}.\n\n{HELP}\n{WHAT[name]}", context_settings={"max_content_width": 118})
    @click_options(kind)
    @output_option(name)
    @click.option("--samples", default=600, type=int, metavar="NUMBER", help="Rows of history.csv over --strain, a packing.  [default: 600]")
    @click.option("--frames", default=20, type=int, metavar="NUMBER", help="States kept over --strain, a packing.  [default: 20]")
    @no_fields_option
    @no_figures_option
    @checkpoint_option
    @resume_option
    @quiet_option
    @click.pass_context
    def command(
        context: click.Context, output: str, samples: int, frames: int, no_fields: bool, no_figures: bool,
        checkpoint_every: float, resume: str | None, quiet: bool, **values: Any,
    ) -> int:  # fmt: skip
        """Check everything, then run; returns the exit status."""
        check_counts(samples=samples, frames=frames)
        parameters = kind(**values)
        folder, start = started(context, output, resume, name, kind)
        options = {"samples": samples, "frames": frames, "fields": not no_fields, "figures": not no_figures}
        p, options = (parameters, options) if start is None else (start.parameters, start.options)

        def script() -> str:
            from studies.rock_run import carry_out

            summary = carry_out(p, folder, **options, progress=not quiet, checkpoint_every=checkpoint_every, start=start)
            return shown(summary, report, folder, quiet)

        return led(script)

    return command


def report(summary: dict[str, Any]) -> str:
    """Mean, deviation and each packing as a table."""
    counts = ", ".join(f"{value} {name.replace('_', ' ')}" for name, value in summary["counts"].items())
    lines = [f"{summary['study']}: {counts}", f"{'':28s}{'mean':>11s}{'deviation':>11s}{'published':>11s}   each"]
    for name, entry in summary["results"].items():
        scale, unit = (1e-6, "MPa") if entry["unit"] == "Pa" else (1.0, entry["unit"].replace("1", ""))
        head = f"{name.replace('_', ' ')} {unit}".strip()
        published = "" if entry["published"] is None else f"{scale * entry['published']:.4g}"
        each = " ".join(f"{scale * value:.4g}" for value in entry["each"])
        lines.append(f"{head:28s}{scale * entry['value']:11.4g}{scale * entry['deviation']:11.2g}{published:>11s}   {each}")
    lines.append(f"energy balance error {summary['energy']['balance_error']:.2e}")
    lines.append("seconds: " + ", ".join(f"{name} {value:.1f}" for name, value in summary["seconds"].items()))
    return "\n".join(lines)


ucs, brazilian = _command(Compression), _command(Brazilian)
