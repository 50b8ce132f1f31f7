"""One run of the rock cutting study and what it leaves behind."""

from __future__ import annotations

import contextlib
import csv
import math
import sys
import warnings
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mpi4py import MPI

from bridge import output
from bridge.run import Outcome, Stopwatch
from particles.crew import ranks
from studies import cutting as scene
from studies.cracks import cracks
from studies.cutting import Parameters
from studies.cutting_models import MODELS, Block
from studies.resuming import Runs, Start
from studies.snapshots import ContinuumFields, ParticleFields, particle_fields

FILES = ("summary.json", "history.csv", "cracks.csv", "force.png", "states.png", "stress.png")
SERIES = ("particles", "continuum", "pick", "cracks")
AVERAGING = 2.5  # radius of the circles of averaged stresses, in largest radii (Rojek & Onate 2007)
LARGEST_ERROR = 0.02  # of the energy balance, as a share of the work of the pick
POROSITY_TOLERANCE = 0.003
Results = dict[str, tuple[float, str]]  # value and unit


class State(NamedTuple):
    """The block at one time."""

    time: float  # s
    particles: ParticleFields
    continuum: ContinuumFields | None
    fragment: np.ndarray  # (n,); 0 is the block
    pick: np.ndarray  # (3, 2), m
    force: float  # of the pick, N


@dataclass
class Finished:
    """A block after its run."""

    model: Block
    outcome: Outcome
    results: Results
    summary: dict[str, Any]
    states: list[State] = field(default_factory=list)


def set_up(p: Parameters, watch: Stopwatch) -> Block:
    """Make the block.

    Raises:
        ValueError: parameters that do not go together.
    """
    with watch.phase("setup"):
        return MODELS[p.method](p)


def state(model: Block) -> State:
    """The block as it is now."""
    p = model.p
    solid = 1.0 - p.porosity
    particles, _ = particle_fields(model.soil, None, solid, p.poisson_ratio, AVERAGING)
    continuum = model.continuum()
    force = float(np.hypot(*model.pick.force[:2]))
    return State(model.time, particles, continuum, model.loose(), model.pick.vertices, force)


def way(p: Parameters, until: float) -> tuple[float, float]:
    """Length (m) of the path of the tip until a time (s), and the area (m2) between it and the surface."""
    points = np.array([scene.tip_at(p, time) for time in np.linspace(0.0, until, 2001)])
    moved, depth = np.diff(points, axis=0), np.maximum(-0.5 * (points[1:, 1] + points[:-1, 1]), 0.0)
    return float(np.hypot(*moved.T).sum()), float(np.sum(depth * moved[:, 0]))


def results(model: Block, outcome: Outcome) -> Results:
    """Forces, cracks and loose discs; forces are work of the pick over the way of its tip."""
    length, area = way(model.p, model.time)
    work = model.pick.work
    force = outcome.column("cutting_force_N")
    loose = model.loose()
    sizes = np.bincount(loose)[1:]
    return {
        "mean_cutting_force": (work / length, "N"), "peak_cutting_force": (force.max(), "N"),
        "peak_over_mean": (force.max() * length / work if work else math.nan, "1"),
        "specific_energy": (work / area if area else math.nan, "J/m3"), "work": (work, "J"), "path": (length, "m"), "cut_area": (area, "m2"),
        "cracks": (float(len(model.soil.breaks)), "1"), "fragments": (float((sizes > 1).sum()), "1"),
        "loose_discs": (float(sizes.sum()), "1"),
        "loose_area": (math.pi * float(np.sum(model.soil.radii[loose > 0] ** 2)) / (1.0 - model.p.porosity), "m2"),
    }  # fmt: skip


def carry_out(
    p: Parameters, folder: Path, *, samples: int = 400, frames: int = 12, fields: bool = True, figures: bool = True,
    progress: bool = True, checkpoint_every: float = 0.0, start: Start | None = None,
) -> Finished:  # fmt: skip
    """Cut, and write what the run leaves behind.

    Args:
        p: parameters.
        folder: for the results, made if need be.
        samples: rows of the history.
        frames: states kept, beside the first.
        fields: whether field files are written of them.
        figures: whether pictures are drawn.
        progress: show a bar on terminals.
        checkpoint_every: seconds of wall time between checkpoints; 0 for none but at Ctrl-C or SIGTERM.
        start: where the study was stopped.

    Raises:
        ValueError: parameters that do not go together.
    """
    watch = Stopwatch()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        model = set_up(p, watch)
        folder = output.prepare_folder(folder, MPI.COMM_SELF)
        if start is None:
            output.clear(folder, FILES, SERIES)
        kept = {"samples": samples, "frames": frames, "fields": fields, "figures": figures}
        runs = Runs("cutting", p, kept, folder, watch, checkpoint_every, start)
        history = output.HistoryFile(folder / "history.csv")
        states: list[State] = []
        series: dict[str, output.Series] = {}

        def on_frame() -> None:
            states.append(state(model))
            if fields:
                _write_fields(series, folder / "fields", states[-1])

        def enter(earlier: State) -> None:
            if fields:
                for name in ("particles", "pick", *(() if earlier.continuum is None else ("continuum",))):
                    _series(series, folder / "fields", name).enter(earlier.time)

        with contextlib.closing(history), runs:
            outcome = runs.run(
                p.method, model, states, State, lambda steps: np.linspace(0, steps, frames + 1), samples=samples,
                on_sample=history.write, on_frame=on_frame, enter=enter, label=f"cutting, {p.method}", progress=progress,
            )  # fmt: skip
    found = results(model, outcome) if outcome.stable else {}
    heard = [str(w.message) for w in caught if w.category is UserWarning] + (doubts(model, found) if outcome.stable else [])
    for words in heard:
        print(f"Warning: {words}", file=sys.stderr)
    done = Finished(model, outcome, found, {}, states)
    with watch.phase("output"):
        _write_cracks(folder / "cracks.csv", model)
        if fields:
            _write_crack_lines(folder / "fields", model)
        if figures and outcome.stable:
            from studies import cutting_figures

            cutting_figures.draw(done, folder)
    done.summary = summarise(done, watch, heard)
    output.write_json(folder / "summary.json", done.summary)
    if outcome.stable:
        runs.finished()
    return done


def _series(series: dict[str, output.Series], folder: Path, name: str) -> output.Series:
    return series.setdefault(name, output.Series(folder, name))


def _write_fields(series: dict[str, output.Series], folder: Path, now: State) -> None:
    def write(name: str, *content: Any) -> None:
        _series(series, folder, name).write(now.time, *content)

    data = now.particles._asdict() | {"fragment": now.fragment.astype(float)}
    points = data.pop("positions")
    write("particles", points, ("vertex", np.arange(len(points))[:, None]), data)
    write("pick", now.pick, ("triangle", np.arange(3)[None]))
    if now.continuum is not None:
        c = now.continuum
        moved = {"displacement": c.displacement[:, :2], "velocity": c.velocity[:, :2]}
        write("continuum", c.nodes, ("quad", c.cells), moved, c.cell_fields)


def _write_crack_lines(folder: Path, model: Block) -> None:
    found = cracks(model.soil)
    ends = np.arange(2 * len(found.time)).reshape(-1, 2)
    if len(ends):
        data = {"time": found.time, "energy": found.energies}
        output.Series(folder, "cracks").write(model.time, found.lines.reshape(-1, 2), ("line", ends), None, data)


def _write_cracks(path: Path, model: Block) -> None:
    """All cracks, one a row, in the order of time."""
    found = cracks(model.soil)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["time_s", "x_m", "y_m", "normal_x", "normal_y", "energy_J", "first", "second"])
        for k, time in enumerate(found.time):
            numbers = (time, *found.places[k], *found.normals[k], found.energies[k])
            writer.writerow([*(f"{number:.9g}" for number in numbers), *found.pairs[k]])


def doubts(model: Block, found: Results) -> list[str]:
    """What a run has to say against itself."""
    p, said = model.p, []
    centres, radii = scene.sites(p)
    porosity = 1.0 - math.pi * float((radii**2).sum()) / math.prod(p.size)
    if abs(porosity - p.porosity) > POROSITY_TOLERANCE:
        said.append(f"the packing has a porosity of {porosity:.3f} instead of {p.porosity:g}; take a larger block or that porosity")
    energy = model.energies()
    error = abs(energy["balance"]) / energy["external_work"] if energy["external_work"] > 0.0 else 0.0
    if not error <= LARGEST_ERROR:
        said.append(f"the energy balance is off by {100.0 * error:.1f} % of the work of the pick; take a smaller step_ratio")
    if p.method == "overlap":
        shared = scene.zone(p)(model.soil.breaks[:, 3:5]) > 0.0
        if shared.any():
            said.append(
                f"{int(shared.sum())} of {len(shared)} cracks lie in the zone that discs and continuum share, where the continuum is elastic; "
                "take a larger region"
            )
    return said


def summarise(done: Finished, watch: Stopwatch, heard: list[str]) -> dict[str, Any]:
    """The content of summary.json."""
    model, outcome = done.model, done.outcome
    p, part = model.p, outcome.steps / model.steps
    counts = {name: round(part * value) if name.endswith("_steps") else value for name, value in model.counts.items()}
    energy = model.energies()
    work, stepping = energy["external_work"], watch.seconds["stepping"]
    resolved = {"block": "x".join(f"{side:g}" for side in p.size), "depth": p.cut_depth, "region": p.region_text, "element_size": p.cell_size}
    return {
        "study": "cutting", "method": p.method, "parameters": asdict(p) | resolved, "seed": p.seed, "versions": output.versions(),
        "ranks": ranks(), "threads": 1, "counts": counts, "steps": model.step_sizes,
        "seconds": watch.seconds | {"total": sum(watch.seconds.values())},
        "particle_steps_per_second": counts["particles"] * counts["fine_steps"] / stepping if stepping > 0.0 else 0.0,
        "results": {name: {"value": value, "unit": unit, "published": None} for name, (value, unit) in done.results.items()},
        "parallel": model.parallel(),
        "energy": energy | {"balance_error": abs(energy["balance"]) / work if work > 0.0 else math.nan},
        "stable": outcome.stable, "message": outcome.message, "warnings": heard,
    }  # fmt: skip
