"""The three methods on one foundation, and the table of Li & Wan (2010), table 2, with theirs beside ours."""

from __future__ import annotations

import csv
import dataclasses
import io
from pathlib import Path
from typing import Any

import click
from mpi4py import MPI

from bridge import output
from studies.foundation import COMPARED, Parameters
from studies.foundation_command import unstable
from studies.foundation_report import ROWS, number
from studies.foundation_run import PICTURES, PUBLISHED, UNITS, Finished, carry_out, set_up

FILES = ("comparison.txt", "comparison.csv", "comparison.json", *PICTURES)
NOTE = """\
diff. = bridging scale against particles. Loads after the peak scatter by about 30 per cent with any perturbation (time step,
mesh, region): compare peaks. Stresses are averages over circles of 2.5 largest radii, strains those of single discs (in assembly
C a few loose ones decide); the paper defines neither, nor its damping and time steps. Times are those of this machine; ours
include the set-up and the files."""


def compare_methods(p: Parameters, folder: Path, options: dict[str, Any], growth_test: bool, quiet: bool) -> int:
    """Run particles, bridging scale and continuum; print and write the table (collective).

    Returns:
        Exit status: 0, or 3 where a run became unstable.
    """
    comm = MPI.COMM_WORLD
    ready = [set_up(dataclasses.replace(p, method=method), growth_test, comm) for method in COMPARED]
    output.prepare_folder(folder, comm)
    if comm.rank == 0:
        output.clear(folder, FILES)
    runs: list[Finished] = []
    for prepared in ready:  # all are set up before the first one runs: bad input costs no time
        done = carry_out(prepared, folder / prepared.parameters.method, **options)
        if not done.outcome.stable:
            return unstable(done.outcome.message)
        runs.append(done)
    if comm.rank == 0:
        write(runs, folder)
        if options["figures"]:
            from studies.foundation_figures import draw_comparison

            draw_comparison(runs, folder)
        if not quiet:
            click.echo((folder / "comparison.txt").read_text(encoding="utf-8"), nl=False)
            click.echo(f"results in {folder}")
    return 0


def write(runs: list[Finished], folder: Path) -> None:
    """comparison.txt, .csv and .json."""
    rows = table(runs)
    output.write_text(folder / "comparison.txt", as_text(runs, rows))
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, fieldnames=list(rows[0]))
    writer.writeheader()
    writer.writerows(rows)
    output.write_text(folder / "comparison.csv", buffer.getvalue())
    speed = {run.parameters.method: run.summary["seconds"]["stepping"] for run in runs}
    content = {
        "study": "foundation", "parameters": dataclasses.asdict(runs[0].parameters), "rows": rows,
        "stepping_seconds": speed, "speed_up": speed["dem"] / speed["bridging"] if speed["bridging"] else None,
    }  # fmt: skip
    output.write_json(folder / "comparison.json", content)


def table(runs: list[Finished]) -> list[dict[str, Any]]:
    """A row a quantity, SI units: ours by method, our difference, the paper's two and its difference (shares of one)."""
    results = {run.parameters.method: run.results for run in runs}
    ours_beside_theirs = runs[0].parameters.is_papers_scene
    rows = []
    for name, unit in UNITS.items():
        row: dict[str, Any] = {"quantity": name, "unit": unit} | {method: results[method][name] for method in COMPARED}
        row["difference"] = _difference(row["bridging"], row["dem"])
        for method in ("dem", "bridging"):
            row[f"published_{method}"] = PUBLISHED[method].get(name) if ours_beside_theirs else None
        row["published_difference"] = _difference(row["published_bridging"], row["published_dem"])
        rows.append(row)
    return rows


def _difference(value: float | None, reference: float | None) -> float | None:
    """Change of the size of a value against a reference, as a share of it."""
    if value is None or not reference:
        return None
    return abs(value) / abs(reference) - 1.0


def as_text(runs: list[Finished], rows: list[dict[str, Any]]) -> str:
    """The table for people."""
    p = runs[0].parameters
    discs = f"assembly {p.assembly}" if p.radius is None else f"discs of {p.radius:g} m"
    head = (
        f"Foundation, {discs}: plate {p.displacement * 1e3:g} mm at {p.speed:g} m/s, damping {p.damping:g} 1/s; bridging region "
        f"{p.region} m, moduli {p.moduli}, mesh {p.mesh}, variant {p.variant}"
    )
    columns = f"{'':24s}{'':>4s}{'particles':>10s}{'bridging':>10s}{'diff.':>9s}{'continuum':>11s}"
    above = f"{'':24s}{'':>4s}{'':>40s}{'  | Li & Wan 2010, table 2':s}"
    columns += f"{'  | particles':>13s}{'bridging':>10s}{'diff.':>9s}"
    lines = [head, "", above, columns]
    for row in rows:
        name = row["quantity"]
        title, _, unit, _ = ROWS[name]
        lines.append(
            f"{title:24s}{unit:>4s}{number(name, row['dem'])}{number(name, row['bridging'])}{_percent(row['difference'])}"
            f"{number(name, row['fem']):>11s}  |{number(name, row['published_dem'])}"
            f"{number(name, row['published_bridging'])}{_percent(row['published_difference'])}"
        )
    stepping = {run.parameters.method: run.summary["seconds"]["stepping"] for run in runs}
    parts = ", ".join(f"{method} {seconds:.2f} s" for method, seconds in stepping.items())
    faster = f"; bridging is {stepping['dem'] / stepping['bridging']:.1f} times faster" if stepping["bridging"] else ""
    balance = ", ".join(f"{run.parameters.method} {run.summary['energy']['balance_error']:.1e}" for run in runs)
    lines += [
        f"time in stepping alone: {parts}{faster}",
        f"energy balance error: {balance} of the external work",
        "",
        NOTE,
    ]
    return "\n".join(lines) + "\n"


def _percent(share: float | None) -> str:
    return f"{'-':>9s}" if share is None else f"{100.0 * share:8.2f}%"
