"""Speed against error of the foundation: bridging runs at many settings against particles everywhere."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import click

from studies.foundation import Parameters
from studies.options import brief, click_options

SAMPLES = 240  # of each load curve
FILES = ("accuracy.txt", "accuracy.csv", "accuracy.json", "accuracy.png")
REGIONS = ("6x3", "7x3.5", "8x4", "10x5")
SHORT: list[dict[str, Any]] = [
    *({"region": region} for region in REGIONS),
    *({"region": region, "moduli": "paper"} for region in ("6x3", "7x3.5")),
    *({"region": "8x4", "substeps": m} for m in (1, 2)),
    {"region": "8x4", "mesh": "graded"},
    *({"region": "8x4", "variant": variant} for variant in ("multiplier", "respa", "resync", "paper")),
]
LONG: list[dict[str, Any]] = [
    {"region": region, "moduli": moduli, "variant": variant, "substeps": substeps}
    for region in REGIONS
    for moduli in ("packing", "paper")
    for variant in ("subcycling", "respa", "multiplier", "resync", "paper")
    for substeps in ((1, 2) if variant == "paper" else (1, 2, 5))
] + [
    {"region": region, "mesh": mesh, "element_size": size}
    for region in ("6x3", "8x4")
    for mesh, size in (("structured", 0.5), ("graded", 1.0), ("graded", 0.5))
]

HELP = """Speed against error over a list of settings.

Each setting is a bridging run, measured against particles everywhere: error of the peak load, root mean square error of
the load curve (both as shares of the reference's peak), error of the energy balance, seconds of stepping, and how many
times faster it steps. A table, accuracy.csv, accuracy.json and a plot are written. Options are those of the foundation and
hold for every run; the settings come on top.
"""


@click.command("accuracy", help=HELP, context_settings={"max_content_width": 118})
@click.argument("study", metavar="STUDY", type=click.Choice(["foundation"]))
@click_options(Parameters, without=("method",))
@click.option(
    "--settings", default=None, metavar="FILE", help="JSON list of settings, for instance [{\"region\": \"8x4\", \"substeps\": 2}]."
)  # fmt: skip
@click.option("--full", is_flag=True, help=f"A longer list of settings ({len(LONG)} instead of {len(SHORT)}).")
@click.option(
    "--repeats", default=1, type=int, metavar="NUMBER", help="Runs of each setting; the fastest counts.  [default: 1]"
)
@click.option(
    "--output", default="out/accuracy", metavar="FOLDER", help="Folder for the results.  [default: out/accuracy]"
)
@click.option("--quiet", is_flag=True, help="No progress and no table on standard output.")
def command(study: str, settings: str | None, full: bool, repeats: int, output: str, quiet: bool, **values: Any) -> int:
    """Check every setting, run the reference and all of them; returns the exit status."""
    base = Parameters(method="dem", **values)
    if not 1 <= repeats <= 1000:
        raise ValueError(f"repeats={brief(repeats)} must be between 1 and 1000")
    if settings is not None and full:
        raise ValueError("settings and full exclude each other: a file of settings, or the longer built-in list")
    chosen = read_settings(Path(settings)) if settings is not None else LONG if full else SHORT
    cases = [_case(base, setting) for setting in chosen]

    from mpi4py import MPI

    from bridge import accuracy
    from bridge.output import check_folder, clear, prepare_folder, write_json, write_text
    from studies.foundation_run import carry_out, set_up

    comm = MPI.COMM_WORLD
    folder = check_folder(output)
    first = set_up(base)  # what is wrong with the reference is wrong with all
    prepare_folder(folder)
    if comm.rank == 0:
        clear(folder, FILES)
    scores: list[accuracy.Score] = []
    kept: list[dict[str, Any]] = []
    reference: accuracy.Curve | None = None

    def say(words: str) -> None:
        if comm.rank == 0:
            click.echo(words, err=True)

    for number, (setting, p) in enumerate([({}, base), *zip(chosen, cases)]):
        name = "particles everywhere" if reference is None else label(setting)
        try:
            runs = [
                carry_out(
                    first if p is base and k == 0 else set_up(p),
                    samples=SAMPLES,
                    frames=0,
                    figures=False,
                    progress=not quiet,
                )
                for k in range(repeats)
            ]
        except ValueError as refused:  # steps that do not fit are known only when the scene is there
            say(f"Warning: setting {name} is left out: {refused}")
            continue
        done = min(runs, key=lambda run: run.summary["seconds"]["stepping"])
        if not done.outcome.stable:
            say(f"Warning: setting {name} is left out: {done.outcome.message}")
            if reference is None:
                return 3
            continue
        curve = accuracy.Curve(
            done.outcome.column("displacement_m"), done.outcome.column("load_N"), done.summary["seconds"]["stepping"],
            done.summary["energy"]["balance_error"],
        )  # fmt: skip
        reference = reference or curve
        scores.append(accuracy.score(name, curve, reference))
        kept.append(setting)
        if comm.rank == 0:  # after each setting: an interrupted list keeps what it has
            write_text(folder / "accuracy.txt", accuracy.as_text(scores))
            write_text(folder / "accuracy.csv", accuracy.as_csv(scores, kept))
            rows = [{**one._asdict(), "settings": setting} for one, setting in zip(scores, kept)]
            write_json(folder / "accuracy.json", {"study": study, "parameters": dataclasses.asdict(base), "rows": rows})
        if not quiet:
            say(f"{number}/{len(cases)} {name}")
    if comm.rank == 0:
        title = f"Foundation, assembly {base.assembly}: bridging scale against particles everywhere"
        accuracy.plot(scores[1:], [_kinds(base, setting) for setting in kept[1:]], title, folder / "accuracy.png")
        if not quiet:
            click.echo((folder / "accuracy.txt").read_text(encoding="utf-8") + f"results in {folder}")
    return 0


def _kinds(base: Parameters, setting: dict[str, Any]) -> tuple[str, str, str]:
    """What tells the points of many settings apart."""
    used = dataclasses.asdict(base) | setting
    mesh = "" if used["mesh"] == "structured" and used["element_size"] == 1.0 else f", mesh {used['mesh']}"
    return f"region {used['region']} m", f"variant {used['variant']}{mesh}", f"moduli {used['moduli']}"


def label(setting: dict[str, Any]) -> str:
    """A setting in a few words."""
    words = [f"region {setting['region']}"] if "region" in setting else []
    words += [f"{name.replace('_', ' ')} {value}" for name, value in setting.items() if name != "region"]
    return ", ".join(words) or "default"


def read_settings(path: Path) -> list[dict[str, Any]]:
    """Settings of a JSON file.

    Raises:
        ValueError: it cannot be read or is no list of objects.
    """
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as failure:
        raise ValueError(f"settings={path} cannot be read as JSON ({failure})") from None
    if not (isinstance(found, list) and found and all(isinstance(one, dict) for one in found)):
        raise ValueError(f'settings={path} must hold a list of objects such as [{{"region": "8x4"}}]')
    return found


def _case(base: Parameters, setting: dict[str, Any]) -> Parameters:
    known = {field.name: field for field in dataclasses.fields(Parameters)}
    for name in setting:
        if name not in known or name == "method":
            raise ValueError(
                f"setting {brief(name)}={brief(setting[name])} is unknown; known are {', '.join(sorted(set(known) - {'method'}))}"
            )
    return dataclasses.replace(base, method="bridging", **setting)
