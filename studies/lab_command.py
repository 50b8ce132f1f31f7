"""The commands of the element tests: `biaxial`, `triaxial` and `shear`."""

from __future__ import annotations

from typing import Any

import click

from studies.lab import Biaxial, Parameters, Shear, Triaxial
from studies.leading import led, shown, started
from studies.options import (
    brief,
    checkpoint_option,
    click_options,
    no_fields_option,
    no_figures_option,
    quiet_option,
    resume_option,
)

HELP = """A dense random packing in a periodic cell is compressed isotropically to the confining stress and then {what}, so
slowly that results depend on friction, size distribution and stiffness level only. Strains are logarithmic; axial strain
and stresses are positive in compression, volumetric strain in dilation.
"""
WHAT = {
    "biaxial": "compressed along y at a constant rate, with the stress along x held by a servo",
    "triaxial": "compressed along z at a constant rate, with the stresses along x and y held by a servo",
    "shear": "sheared along x at a constant rate, with the stress along y held by a servo and no strain along x",
}


def _command(kind: type[Parameters]) -> click.Command:
    name = kind.study

    @click.command(
        name, help=f"{kind.title}.\n\n{HELP.format(what=WHAT[name])}", context_settings={"max_content_width": 118}
    )
    @click_options(kind)
    @click.option(
        "--output", default=f"out/{name}", metavar="FOLDER", help=f"Folder for the results.  [default: out/{name}]"
    )
    @click.option("--samples", default=400, type=int, metavar="NUMBER", help="Rows of history.csv.  [default: 400]")
    @click.option("--frames", default=6, type=int, metavar="NUMBER", help="Times of the field files.  [default: 6]")
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
        for option, value, most in (("samples", samples, 1_000_000), ("frames", frames, 10_000)):
            if not 1 <= value <= most:
                raise ValueError(f"{option}={brief(value)} must be between 1 and {most}")
        parameters = kind(**values)
        folder, start = started(context, output, resume, name, kind)
        options = {"samples": samples, "frames": 0 if no_fields else frames, "figures": not no_figures}
        p, options = (parameters, options) if start is None else (start.parameters, start.options)

        def script() -> str:
            from studies.lab_run import carry_out

            done = carry_out(p, folder, **options, progress=not quiet, checkpoint_every=checkpoint_every, start=start)
            return shown(done.summary, report, folder, quiet)

        return led(script)

    return command


def report(summary: dict[str, Any]) -> str:
    """A run's numbers as text."""
    counts = ", ".join(f"{value} {name.replace('_', ' ')}" for name, value in summary["counts"].items())
    lines = [f"{summary['study']}: {counts}"]
    for name, entry in summary["results"].items():
        unit = entry["unit"].replace("1", "")
        lines.append(f"{name.replace('_', ' '):26s}{entry['value']:12.5g} {unit}".rstrip())
    lines.append(f"energy balance error {summary['energy']['balance_error']:.2e}")
    lines.append("seconds: " + ", ".join(f"{name} {value:.1f}" for name, value in summary["seconds"].items()))
    return "\n".join(lines)


biaxial, triaxial, shear = _command(Biaxial), _command(Triaxial), _command(Shear)
