"""The command `interface`: a pulse through the overlap of particles and cells, and the map of its reflections."""

from __future__ import annotations

from typing import Any

import click

from studies.interface import TITLE, Parameters
from studies.leading import led, shown, started
from studies.options import (
    brief,
    checkpoint_option,
    click_options,
    no_figures_option,
    output_option,
    quiet_option,
    resume_option,
)

HELP = f"""{TITLE}.

The first run is shown: profiles along the strip until the pulse has come back from the fixed end, displacements at two
sections, energies. Then a map: the reflection of every pulse by every mesh and overlap, eliminated and with springs, against
the same lattice without cells, and which zone keeps it below the wanted value. Published: Rojek & Onate (2007), section 7.
"""


@click.command("interface", help=HELP, context_settings={"max_content_width": 118})
@click_options(Parameters)
@output_option("interface")
@click.option("--samples", default=400, type=int, metavar="NUMBER", help="Rows of history.csv.  [default: 400]")
@click.option("--no-map", is_flag=True, help="Only the run that is shown.")
@no_figures_option
@checkpoint_option
@resume_option
@quiet_option
@click.pass_context
def command(
    context: click.Context, output: str, samples: int, no_map: bool, no_figures: bool, checkpoint_every: float, resume: str | None,
    quiet: bool, **values: Any,
) -> int:  # fmt: skip
    """Check everything, then run; returns the exit status."""
    if not 1 <= samples <= 1_000_000:
        raise ValueError(f"samples={brief(samples)} must be between 1 and 1000000")
    parameters = Parameters(**values)
    folder, start = started(context, output, resume, "interface", Parameters)
    options = {"samples": samples, "map_too": not no_map, "figures": not no_figures}
    p, options = (parameters, options) if start is None else (start.parameters, start.options)

    def script() -> str:
        from studies.interface_run import carry_out

        summary = carry_out(p, folder, **options, progress=not quiet, checkpoint_every=checkpoint_every, start=start)
        return shown(summary, report, folder, quiet)

    return led(script)


def report(summary: dict[str, Any]) -> str:
    """The numbers of the run that is shown, and the advice."""
    results = summary["results"]
    lines = [
        f"reflection {100 * results['reflection']['value']:.2g} %, transmission {100 * results['transmission']['value']:.4g} % "
        f"of the height; reflected energy {results['reflected_energy']['value']:.1e}"
    ]
    if "transit_time" in results:
        lines.append(
            f"transit {1e6 * results['transit_time']['value']:.2f} µs (published {1e6 * results['transit_time']['published']:.2f}), "
            f"energy varies by {results['energy_variation']['value']:.1e} of the pulse's"
        )
    lines += summary["advice"]
    lines.append("seconds: " + ", ".join(f"{name} {value:.1f}" for name, value in summary["seconds"].items()))
    return "\n".join(lines)
