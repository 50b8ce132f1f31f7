"""The commands of these studies: one shape for all."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click

from studies.lattice import cantilever, cavern, notch, plate, tension, tunnel, wave
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

SOURCE = "Published: Zhao, Khalili, Fang & Zhao (2012), a coupled distinct lattice spring model."


def make(name: str, study: Any) -> click.Command:
    """Command of a study module with TITLE, HELP, Parameters and `carry_out`."""

    @click.pass_context
    def run(
        context: click.Context, output: str, samples: int, no_fields: bool, no_figures: bool, checkpoint_every: float,
        resume: str | None, quiet: bool, **values: Any,
    ) -> int:  # fmt: skip
        """Check everything, then run; returns the exit status."""
        if not 2 <= samples <= 100_000:
            raise ValueError(f"samples={brief(samples)} must be between 2 and 100000")
        parameters = study.Parameters(**values)
        folder, start = started(context, output, resume, name, study.Parameters)
        options = {"samples": samples, "fields": not no_fields, "figures": not no_figures}
        p, options = (parameters, options) if start is None else (start.parameters, start.options)

        def script() -> str:
            from studies.lattice.common import Recorder

            with Recorder(name, p, folder, **options, progress=not quiet, checkpoint_every=checkpoint_every, start=start) as recorder:
                study.carry_out(p, recorder, figures=options["figures"])
            return shown(recorder.summary, report, folder, quiet)

        return led(script)

    decorators: list[Callable[[Any], Any]] = [
        click_options(study.Parameters), output_option(name),
        click.option("--samples", default=400, type=int, metavar="NUMBER", help="Rows of history.csv a model.  [default: 400]"),
        no_fields_option, no_figures_option, checkpoint_option, resume_option, quiet_option,
    ]  # fmt: skip
    for decorate in reversed(decorators):
        run = decorate(run)
    text = f"{study.TITLE}.\n\n{study.HELP}\n\n{SOURCE}"
    return click.command(name, help=text, context_settings={"max_content_width": 118})(run)


def report(summary: dict[str, Any]) -> str:
    """Results, a line each, with the published numbers beside."""
    lines = []
    for name, entry in summary["results"].items():
        value, known = entry["value"], entry["published"]
        if isinstance(value, (int, float)):
            beside = f"   (published {known:.4g})" if known is not None else ""
            lines.append(f"{name:48s} {value:12.5g} {entry['unit']}{beside}")
    lines.append(f"energy balance error {summary['energy']['balance_error']:.1e}")
    lines.append("seconds: " + ", ".join(f"{name} {value:.1f}" for name, value in summary["seconds"].items()))
    return "\n".join(lines)


tension_command = make("tension", tension)
wave_command = make("wave", wave)
cantilever_command = make("cantilever", cantilever)
plate_command = make("plate", plate)
notch_command = make("notch", notch)
cavern_command = make("cavern", cavern)
tunnel_command = make("tunnel", tunnel)
