"""Runs of a rock test over several random packings, and what they leave behind."""

from __future__ import annotations

import contextlib
import csv
import sys
import warnings
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mpi4py import MPI

from bridge import output
from bridge.run import Outcome, Stopwatch, run
from particles.crew import ranks
from particles.spread import parallel
from studies.cracks import cracks, fragments
from studies.resuming import Runs, Start
from studies.rock import Parameters
from studies.rock_model import Specimen
from studies.rock_results import Results, results, spread
from studies.snapshots import neighbourhood_average

FIGURES = ("curves.png", "specimen.png", "cracks.png")
FILES = ("summary.json", "history.csv", "cracks.csv", *FIGURES)
AVERAGING = 2.5  # radius of the circles of averaged stresses, in largest radii (Rojek & Onate 2007)
LARGEST_ERROR = 0.02  # of the energy balance, as a share of the work of the plates
LARGEST_KINETIC = 0.01  # kinetic over elastic energy of a quasi-static test, at half the peak load
LARGEST_DIFFERENCE = 0.02  # of the forces of both plates, as a share of the peak, while elastic
POROSITY_TOLERANCE = 0.003


class State(NamedTuple):
    """A specimen at one time; stresses in Pa, tension positive, averaged over circles."""

    time: float  # s
    load: float  # N
    positions: np.ndarray  # (n, 2), m
    displacement: np.ndarray  # (n, 2), m
    stress: np.ndarray  # (n, 2, 2)
    fragment: np.ndarray  # (n,)


@dataclass
class Tested:
    """One specimen after its run."""

    model: Specimen
    outcome: Outcome
    results: Results
    states: list[State] = field(default_factory=list)

    @property
    def balance_error(self) -> float:
        """Of the energy, as a share of the work of the plates."""
        terms = self.model.energies()
        return abs(terms["balance"] / terms["external_work"])


def tested(p: Parameters, seed: int, samples: int, **options: Any) -> Tested:
    """Make a specimen and load it until it breaks; `options` are those of `bridge.run.run`.

    Raises:
        ValueError: the inner volume is too small for averages.
    """
    watch = options.setdefault("stopwatch", Stopwatch())
    with watch.phase("setup"):
        model = Specimen(p, seed)
    outcome = run(model, model.steps, samples=samples, until=model.is_broken, label=f"packing {seed}", **options)
    return evaluated(model, outcome)


def evaluated(model: Specimen, outcome: Outcome) -> Tested:
    """A specimen after its run with its results."""
    return Tested(model, outcome, results(model, outcome) if outcome.stable and len(outcome.history) > 2 else {})


def state(model: Specimen) -> State:
    """The specimen as it is now."""
    from particles import measures

    soil = model.soil
    raw = measures.particle_stress(soil).reshape(-1, 4)
    circle = AVERAGING * soil.radii.max()
    smooth = neighbourhood_average(soil.reference, soil.radii, raw, circle).reshape(-1, 2, 2) * (1.0 - model.porosity)
    load = 0.5 * float(model.plates[0].force[1] - model.plates[1].force[1])
    return State(model.time, load, soil.positions, soil.displacements[:, :2], smooth, fragments(soil))


def carry_out(
    p: Parameters, folder: Path, *, samples: int = 600, frames: int = 20, fields: bool = True, figures: bool = True,
    progress: bool = True, checkpoint_every: float = 0.0, start: Start | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Test all packings and write what the runs leave behind; returns the content of summary.json.

    Args:
        p: parameters.
        folder: for the results, made if need be.
        samples: rows of the history over the strain `p.strain`, a packing.
        frames: states kept over the same strain, a packing.
        fields: whether field files are written of them.
        figures: whether pictures are drawn.
        progress: show a bar on terminals.
        checkpoint_every: seconds of wall time between checkpoints; 0 for none but at Ctrl-C or SIGTERM.
        start: where the study was stopped.
    """
    watch = Stopwatch()
    folder = output.prepare_folder(folder, MPI.COMM_SELF)
    seeds = range(p.seed, p.seed + p.packings)
    if start is None:
        output.clear(folder, FILES, [f"{kind}_{seed}" for seed in seeds for kind in ("particles", "cracks")])
    options = {"samples": samples, "frames": frames, "fields": fields, "figures": figures}
    runs = Runs(p.study, p, options, folder, watch, checkpoint_every, start)
    history = output.HistoryFile(folder / "history.csv")
    done: list[Tested] = []
    with warnings.catch_warnings(record=True) as caught, contextlib.closing(history), runs:
        warnings.simplefilter("always", UserWarning)
        for seed in seeds:
            with watch.phase("setup"):
                model = Specimen(p, seed)
            done.append(_followed(model, history, folder if fields else None, runs, samples, frames, progress, watch))
            if not done[-1].outcome.stable:
                break
    heard = [str(w.message) for w in caught if w.category is UserWarning] + [words for one in done for words in doubts(one)]
    for words in heard:
        print(f"Warning: {words}", file=sys.stderr)
    with watch.phase("output"):
        write_cracks(folder / "cracks.csv", done)
        if figures and all(one.results for one in done):
            from studies import rock_figures

            rock_figures.draw(done, folder)
    summary = summarise(p, done, watch, heard)
    output.write_json(folder / "summary.json", summary)
    if summary["stable"]:
        runs.finished()
    return summary


def _followed(
    model: Specimen, history: output.HistoryFile, folder: Path | None, runs: Runs, samples: int, frames: int, progress: bool,
    watch: Stopwatch,
) -> Tested:  # fmt: skip
    """Load one specimen, with rows of the history, states and field files."""
    states: list[State] = []
    series = output.Series(folder / "fields", f"particles_{model.seed}") if folder else None

    def on_frame() -> None:
        states.append(state(model))
        if series is not None:
            now = states[-1]
            data = {
                "radius": model.soil.radii, "displacement": now.displacement, "stress_axial": now.stress[:, 1, 1],
                "stress_lateral": now.stress[:, 0, 0], "fragment": now.fragment.astype(float),
            }  # fmt: skip
            series.write(now.time, now.positions, ("vertex", np.arange(len(data["radius"]))[:, None]), data)

    def enter(earlier: State) -> None:
        if series is not None:
            series.enter(earlier.time)

    outcome = runs.run(
        str(model.seed), model, states, State, lambda steps: np.linspace(0, steps, frames + 1), samples=samples,
        until=model.is_broken, on_sample=lambda row: history.write({"packing": float(model.seed)} | row), on_frame=on_frame, enter=enter,
        label=f"packing {model.seed}", progress=progress,
    )  # fmt: skip
    one = evaluated(model, outcome)
    with watch.phase("output"):
        if not states or states[-1].time != model.time:
            on_frame()
        if folder:
            _write_crack_lines(output.Series(folder / "fields", f"cracks_{model.seed}"), model)
    one.states = states
    return one


def _write_crack_lines(series: output.Series, model: Specimen) -> None:
    found = cracks(model.soil)
    lines = np.arange(2 * len(found.time)).reshape(-1, 2)
    if len(lines):
        series.write(model.time, found.lines.reshape(-1, 2), ("line", lines), None, {"time": found.time, "energy": found.energies})


def write_cracks(path: Path, done: list[Tested]) -> None:
    """All cracks, one a row, in the order of packings and time."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["packing", "time_s", "strain", "x_m", "y_m", "normal_x", "normal_y", "energy_J", "first", "second"])
        for one in done:
            p, found = one.model.parameters, cracks(one.model.soil)
            rate = 2.0 * p.speed / p.size[1]
            for k, time in enumerate(found.time):
                numbers = (time, rate * time, *found.places[k], *found.normals[k], found.energies[k])
                writer.writerow([one.model.seed, *(f"{number:.9g}" for number in numbers), *found.pairs[k]])


def doubts(one: Tested) -> list[str]:
    """What a run has to say against itself."""
    if not one.outcome.stable:
        return []
    p, found, of = one.model.parameters, [], f"packing {one.model.seed}"
    if abs(one.model.porosity - p.porosity) > POROSITY_TOLERANCE:
        found.append(
            f"{of} has a porosity of {one.model.porosity:.3f} instead of {p.porosity:g}, which so few discs of these sizes do not "
            "reach; take smaller radii or that porosity"
        )
    if not one.model.is_broken(one.outcome.history[-1]):
        found.append(f"{of} is not broken at strain={p.strain:g}; take a larger strain")
    difference, kinetic = (one.results[name][0] if one.results else 0.0 for name in ("plate_force_difference", "kinetic_share"))
    if difference > LARGEST_DIFFERENCE or kinetic > LARGEST_KINETIC:
        found.append(
            f"{of} is not quasi-static: while elastic the forces of the plates differ by {100 * difference:.1f} % of the peak, and "
            f"kinetic is {100 * kinetic:.1f} % of elastic energy; take a lower speed than {p.speed:g} m/s"
        )
    if not one.balance_error <= LARGEST_ERROR:
        found.append(
            f"{of}: the energy balance is off by {100 * one.balance_error:.1f} % of the work of the plates; take a smaller step_ratio"
        )
    return found


def summarise(p: Parameters, done: list[Tested], watch: Stopwatch, heard: list[str]) -> dict[str, Any]:
    """The content of summary.json; a result is the mean over the packings, with their deviation and each of them."""
    stepping, last = watch.seconds["stepping"], done[-1].outcome
    whole = [one for one in done if one.results]
    found = {}
    for name, (_, unit) in whole[0].results.items() if whole else ():
        each = [one.results[name][0] for one in whole]
        mean, deviation = spread(each)
        found[name] = {"value": mean, "deviation": deviation, "each": each, "unit": unit, "published": p.published.get(name)}
    energy = {name: sum(one.model.energies()[name] for one in done) for name in done[0].model.energies()}
    count, steps = [one.model.soil.count for one in done], [one.outcome.steps for one in done]
    return {
        "study": p.study, "method": "dem", "seed": p.seed, "parameters": asdict(p), "versions": output.versions(), "ranks": ranks(),
        "threads": 1,
        "counts": {"packings": len(done), "particles": sum(count), "bonds": sum(len(one.model.bonds) for one in done),
                   "fine_steps": sum(steps)},
        "steps": {"fine": [one.model.step for one in done], "fine_critical": [one.model.critical for one in done]},
        "seconds": watch.seconds | {"total": sum(watch.seconds.values())},
        "particle_steps_per_second": float(np.dot(count, steps)) / stepping if stepping > 0.0 else 0.0,
        "results": found, "parallel": [parallel(one.model.soil) for one in done], "energy": energy | {"balance_error": max(one.balance_error for one in done)},
        "stable": last.stable, "message": last.message, "warnings": heard,
    }  # fmt: skip
