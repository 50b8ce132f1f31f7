"""Runs of several columns, one after the other, and what they leave behind."""

from __future__ import annotations

import contextlib
import sys
import warnings
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mpi4py import MPI

from bridge import output
from bridge.run import Outcome, Stopwatch
from particles.crew import ranks
from particles.spread import parallel
from studies.column import Parameters, lube, staron_hinch
from studies.column_model import Column
from studies.resuming import Runs, Start

FILES = ("summary.json", "history.csv", "runout.png", "collapse.png", "fronts.png")
AT_REST = 1e-4  # kinetic energy at rest, as a share of the potential energy of the column
LARGEST_ERROR = 0.01  # of the energy balance, as a share of the work of gravity


class Frame(NamedTuple):
    """A column at one time."""

    time: float  # s
    places: np.ndarray  # (n, 2), m


@dataclass
class Fallen:
    """One column after its run."""

    column: Column
    outcome: Outcome
    places: list[np.ndarray]  # positions (n, 2) at the frames, m

    @property
    def at_rest(self) -> bool:
        """Whether the kinetic energy of the heap is negligible against the potential energy of the column."""
        return self.column.heap_kinetic < AT_REST * self.column.potential


def carry_out(
    p: Parameters, folder: Path, *, samples: int = 100, frames: int = 6, figures: bool = True, progress: bool = True,
    checkpoint_every: float = 0.0, start: Start | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Let all columns fall and write what the runs leave behind; returns the content of summary.json.

    Args:
        p: parameters.
        folder: for the results, made if need be.
        samples: rows of the history, a column.
        frames: times of the field files, a column; 0 writes none.
        figures: whether pictures are drawn.
        progress: show a bar on terminals.
        checkpoint_every: seconds of wall time between checkpoints; 0 for none but at Ctrl-C or SIGTERM.
        start: where the study was stopped.
    """
    watch = Stopwatch()
    folder = output.prepare_folder(folder, MPI.COMM_SELF)
    names = [f"particles_{aspect:g}" for aspect in p.ratios]
    if start is None:
        output.clear(folder, FILES, names)
    options = {"samples": samples, "frames": frames, "figures": figures}
    runs = Runs("column", p, options, folder, watch, checkpoint_every, start)
    history = output.HistoryFile(folder / "history.csv")
    fallen: list[Fallen] = []
    with warnings.catch_warnings(record=True) as caught, contextlib.closing(history), runs:
        warnings.simplefilter("always", UserWarning)
        for aspect, name in zip(p.ratios, names):
            with watch.phase("setup"):
                column = Column(p, aspect, runs.begun(name))
            series = output.Series(folder / "fields", name) if frames else None
            fallen.append(fall(column, aspect, name, history, series, runs, samples, frames, progress))
            if not fallen[-1].outcome.stable:
                break
    heard = [str(w.message) for w in caught if w.category is UserWarning] + doubts(fallen)
    for words in heard:
        print(f"Warning: {words}", file=sys.stderr)
    if figures and fallen[-1].outcome.stable:
        with watch.phase("output"):
            from studies import column_figures

            column_figures.draw(fallen, folder)
    summary = summarise(p, fallen, watch, heard)
    output.write_json(folder / "summary.json", summary)
    if summary["stable"]:
        runs.finished()
    return summary


def fall(
    column: Column, aspect: float, name: str, history: output.HistoryFile, series: output.Series | None, runs: Runs,
    samples: int, frames: int, progress: bool,
) -> Fallen:  # fmt: skip
    """Release one column."""
    found: list[Frame] = []
    soil = column.soil

    def on_frame() -> None:
        found.append(Frame(column.time, soil.positions))
        if series is not None:
            moved = soil.displacements
            data = {"radius": soil.radii, "displacement": moved[:, :2], "rotation": moved[:, 2],
                    "velocity": soil.velocities[:, :2]}  # fmt: skip
            series.write(column.time, found[-1].places, ("vertex", np.arange(soil.count)[:, None]), data)

    def enter(frame: Frame) -> None:
        if series is not None:
            series.enter(frame.time)

    outcome = runs.run(
        name, column, found, Frame, lambda steps: np.linspace(0, steps, max(frames, 4) + 1), samples=samples, enter=enter,
        on_sample=lambda row: history.write({"aspect": aspect} | row), on_frame=on_frame, label=f"a = {aspect:g}", progress=progress,
    )  # fmt: skip
    return Fallen(column, outcome, [frame.places for frame in found])


def doubts(fallen: list[Fallen]) -> list[str]:
    """What the runs have to say against themselves."""
    found = []
    for one in fallen:
        if not one.outcome.stable:
            continue
        if not one.at_rest:
            found.append(f"the column with a={one.column.aspect:.3g} is not yet at rest at the end")
        error = balance_error(one)
        if not error <= LARGEST_ERROR:
            found.append(
                f"the energy balance of the column with a={one.column.aspect:.3g} is off by {100 * error:.1f} % of the work "
                "of gravity; take a smaller step_ratio"
            )
    return found


def balance_error(one: Fallen) -> float:
    """Of the energy, as a share of the work of gravity."""
    terms = one.column.energies()
    return abs(terms["balance"] / terms["external_work"])


def summarise(p: Parameters, fallen: list[Fallen], watch: Stopwatch, heard: list[str]) -> dict[str, Any]:
    """The content of summary.json; results are lists, one entry a column."""
    aspects = np.array([one.column.aspect for one in fallen])
    last = [one.outcome.history[-1] for one in fallen]
    steps = [one.outcome.steps for one in fallen]
    counts = [one.column.soil.count for one in fallen]
    lists: dict[str, tuple[Any, str, Any]] = {
        "aspects": (aspects, "1", None), "runout": ([row["runout"] for row in last], "1", lube(aspects)),
        "runout_discs": (staron_hinch(aspects), "1", None),
        "final_height": ([row["height_m"] / one.column.width for row, one in zip(last, fallen)], "1", None),
        "heap_angle": ([one.column.heap_angle() for one in fallen], "deg", None),
        "energy_error": ([balance_error(one) for one in fallen], "1", None),
    }  # fmt: skip
    stepping, outcome = watch.seconds["stepping"], fallen[-1].outcome
    names = fallen[0].column.energies()
    energy = {name: sum(one.column.energies()[name] for one in fallen) for name in names}
    return {
        "study": "column", "method": "dem", "seed": p.seed, "parameters": asdict(p), "versions": output.versions(),
        "ranks": ranks(), "threads": 1, "counts": {"particles": sum(counts), "columns": len(fallen), "fine_steps": sum(steps)},
        "steps": {"fine": [one.column.step for one in fallen], "fine_critical": [one.column.step / p.step_ratio for one in fallen]},
        "seconds": watch.seconds | {"total": sum(watch.seconds.values())},
        "particle_steps_per_second": float(np.dot(counts, steps)) / stepping if stepping > 0.0 else 0.0,
        "results": {
            name: {"value": value, "unit": unit, "published": published} for name, (value, unit, published) in lists.items()
        },
        "parallel": [parallel(one.column.soil) for one in fallen],
        "energy": energy | {"balance_error": max(balance_error(one) for one in fallen)},
        "stable": outcome.stable, "message": outcome.message, "warnings": heard,
    }  # fmt: skip
