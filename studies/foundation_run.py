"""One run of the foundation from parameters to the files that it leaves behind."""

from __future__ import annotations

import contextlib
import functools
import math
import sys
import warnings
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from bridge import checkpoint, output
from bridge.run import Outcome, Stopwatch, run
from studies.foundation import PAPER_STATES, Parameters
from studies.foundation_coupled import MODELS
from studies.foundation_resume import STUDY, put_back, run_state
from studies.resuming import Start, describe
from studies.snapshots import Snapshot

PICTURES = (
    "load_displacement.png", "volumetric_stress.png", "effective_stress.png", "volumetric_strain.png",
    "effective_strain.png", "contact_forces.png", "velocities.png",
)  # fmt: skip
FILES = ("summary.json", "history.csv", *PICTURES)  # of a run, beside the series
SERIES = ("particles", "contacts", "continuum")
LARGEST_ERROR = 0.01  # of the energy balance, as a share of the external work, before a run is called doubtful
LARGEST_GAIN = 0.1  # of the external work, from the interface, before a run is called doubtful
# Li & Wan (2010), table 2 (assembly A, end of loading) and the peak of assembly A in figure 3
PUBLISHED = {
    "dem": {
        "load": 1674.19e3, "min_volumetric_stress": -3.9193e6, "max_effective_stress": 5.9198e6,
        "min_volumetric_strain": -0.06528, "max_effective_strain": 0.3765, "total_time": 15139.28, "peak_displacement": 0.038,
    },
    "bridging": {
        "load": 1691.12e3, "min_volumetric_stress": -4.0868e6, "max_effective_stress": 6.2195e6,
        "min_volumetric_strain": -0.06737, "max_effective_strain": 0.3845, "total_time": 1578.64, "peak_displacement": 0.038,
    },
    "overlap": {}, "fem": {},
}  # fmt: skip
UNITS = {
    "peak_load": "N", "peak_displacement": "m", "load": "N", "min_volumetric_stress": "Pa", "max_effective_stress": "Pa",
    "min_volumetric_strain": "1", "max_effective_strain": "1", "total_time": "s",
}  # fmt: skip


@dataclass
class Finished:
    """A run that has ended; results, history and snapshots are on rank 0."""

    parameters: Parameters
    summary: dict[str, Any]
    outcome: Outcome
    snapshots: list[Snapshot]

    @property
    def results(self) -> dict[str, float]:
        """Results by name, in the units of `UNITS`."""
        return {name: entry["value"] for name, entry in self.summary["results"].items()}


def frame_steps(p: Parameters, step: float, steps: int, frames: int) -> list[int]:
    """Steps at which fields are taken: the start, `frames` even parts of the run, and the paper's states on the way."""
    wanted = np.linspace(0.0, p.displacement, frames + 1)[1:] if frames else np.array([])
    gap = 0.5 * p.displacement / max(frames, 1)
    states = np.array([state for state in PAPER_STATES if state < p.displacement - 1e-9] + [p.displacement])
    even = [value for value in wanted if np.abs(states - value).min() > gap]
    places = np.concatenate([[0.0] if frames else [], even, states])
    return sorted(set(np.clip(np.round(places / (p.speed * step)), 0, steps).astype(int).tolist()))


@dataclass
class Prepared:
    """A model that is ready to run."""

    parameters: Parameters
    model: Any
    watch: Stopwatch
    heard: list[str]  # warnings of the set-up
    growth: Any = None  # result of the growth test
    parallel: dict[str, Any] = field(default_factory=dict)  # how a run was spread over the ranks


def set_up(p: Parameters, growth_test: bool = False, comm: Any = MPI.COMM_WORLD) -> Prepared:
    """Make the model, and on request test whether the bridging scheme grows (collective); warnings go to standard error.

    Raises:
        ValueError: parameters that do not go together.
    """
    watch = Stopwatch()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        with watch.phase("setup"):
            model = MODELS[p.method](p, watch, comm)
            # on a model of its own: the test takes thousands of steps
            growth = MODELS[p.method](p, Stopwatch(), comm).grows() if growth_test and p.method == "bridging" else None
    heard = list(dict.fromkeys(str(w.message) for w in caught if w.category is UserWarning))
    if comm.rank == 0:
        for words in heard:
            print(f"Warning: {words}", file=sys.stderr)
    return Prepared(p, model, watch, heard, growth)


def carry_out(
    prepared: Prepared,
    folder: Path | None = None,
    *,
    samples: int = 120,
    frames: int = 8,
    figures: bool = True,
    progress: bool = True,
    checkpoint_every: float = 0.0,
    start: Start | None = None,
) -> Finished:
    """Run a model and write what it leaves behind (collective).

    Args:
        prepared: By `set_up`.
        folder: Output folder, made if need be; None writes nothing.
        samples: Rows of the history.
        frames: Times of the field files, beside the paper's states; 0 writes no fields.
        figures: Whether pictures are drawn.
        progress: Show a bar on terminals.
        checkpoint_every: Seconds of wall time between checkpoints; 0 for none but at Ctrl-C or SIGTERM.
        start: Where a run that was stopped goes on, from its checkpoint.

    Raises:
        Interrupted: Ctrl-C or SIGTERM; the checkpoint is written.
    """
    p, model, watch = prepared.parameters, prepared.model, prepared.watch
    if folder is not None:
        folder = output.prepare_folder(folder, model.comm)
    snapshots: list[Snapshot] = []
    root = model.comm.rank == 0
    writes = folder if root else None
    if writes is not None and start is None:
        output.clear(writes, FILES, SERIES)
        checkpoint.remove(writes / checkpoint.NAME)
    begun = Outcome()
    if start is not None:
        begun = put_back(start, prepared, snapshots)
    history = output.HistoryFile(writes / "history.csv") if writes else None
    series = FieldSeries(writes / "fields") if writes and frames else None
    if history is not None:
        for row in begun.history:
            history.write(row)
    if series is not None:
        for snapshot in snapshots:
            series.enter(snapshot)

    def on_frame() -> None:
        snapshot = model.snapshot()
        if root:
            snapshots.append(snapshot)
        if series is not None:
            series.write(snapshot)

    def summary(outcome: Outcome, energy: dict[str, float]) -> dict[str, Any]:
        content = summarise(prepared, outcome, snapshots, energy)
        if writes is not None:
            output.write_json(writes / "summary.json", content)
        return content

    def last_words(message: str) -> None:
        if root:
            summary(Outcome(model.coupled.coarse_steps, False, message), {})
            print(f"Error: {message}", file=sys.stderr, flush=True)

    model.last_words = last_words
    take = frame_steps(p, model.step, model.steps, frames) if frames or figures else [model.steps]
    options = {"samples": samples, "frames": frames, "figures": figures}
    with contextlib.ExitStack() as stack:
        if history is not None:
            stack.callback(history.close)
        keeper = None
        if folder is not None:
            about = describe(STUDY, p, options, model.comm)
            take_state = functools.partial(run_state, prepared, begun, snapshots)
            keeper = stack.enter_context(
                checkpoint.Keeper(take_state, folder / checkpoint.NAME, about, checkpoint_every, model.comm)
            )
        outcome = run(
            model, model.steps, samples=samples, frames=take, on_sample=history.write if history else None,
            on_frame=on_frame, stopwatch=watch, label=p.method, progress=progress, outcome=begun, watcher=keeper,
        )  # fmt: skip
    energy = model.energies()
    prepared.parallel = model.parallel()
    for doubt in doubts(energy) if outcome.stable else []:
        prepared.heard.append(doubt)
        if root:
            print(f"Warning: {doubt}", file=sys.stderr)
    done = Finished(p, {}, outcome, snapshots)
    if writes and figures and outcome.stable:
        with watch.phase("output"):
            from studies import foundation_figures

            foundation_figures.draw(done, writes)
    done.summary = summary(outcome, energy)
    if writes is not None and outcome.stable:
        checkpoint.remove(writes / checkpoint.NAME)
    return done


def doubts(energy: dict[str, float]) -> list[str]:
    """What to say about the energies of a run: an interface that feeds the system, a balance that does not close."""
    work = energy["external_work"]
    if not work > 0.0:
        return []
    found = []
    gain, error = -energy["interface"] / work, abs(energy["balance"]) / work
    if gain > LARGEST_GAIN:
        found.append(
            f"the interface has put {100 * gain:.1f} % of the external work into the system: the scheme grows, do not trust "
            "the results; take variant=subcycling, fewer substeps or more damping"
        )
    if not error <= LARGEST_ERROR:
        found.append(f"the energy balance is off by {100 * error:.1f} % of the external work; take a smaller step")
    return found


class FieldSeries:
    """ParaView series of particles, contacts and continuum on one time axis."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._series: dict[str, output.Series] = {}

    def _of(self, name: str) -> output.Series:
        if name not in self._series:
            self._series[name] = output.Series(self._folder, name)
        return self._series[name]

    def _write(self, name: str, *arguments: Any) -> None:
        self._of(name).write(*arguments)

    def enter(self, s: Snapshot) -> None:
        """List a snapshot that an earlier part of the run has written."""
        for name in SERIES:
            if getattr(s, name) is not None:
                self._of(name).enter(s.time)

    def write(self, s: Snapshot) -> None:
        """Add a snapshot."""
        if s.particles is not None:
            data = s.particles._asdict()
            points = data.pop("positions")
            self._write("particles", s.time, points, ("vertex", np.arange(len(points))[:, None]), data)
        if s.contacts is not None:
            ends, *forces = s.contacts
            lines = np.arange(2 * len(ends)).reshape(-1, 2)
            data = dict(zip(("normal_force", "tangential_force"), forces, strict=True))
            self._write("contacts", s.time, ends.reshape(-1, 2), ("line", lines), None, data)
        if s.continuum is not None:
            c = s.continuum
            data = {"displacement": c.displacement[:, :2], "micro_rotation": c.displacement[:, 2],
                    "velocity": c.velocity[:, :2], "spin": c.velocity[:, 2]}  # fmt: skip
            kind = "quad" if c.cells.shape[1] == 4 else "triangle"
            self._write("continuum", s.time, c.nodes, (kind, c.cells), data, c.cell_fields)


def extremes(s: Snapshot) -> dict[str, float]:
    """Table 2's extreme stresses and strains, of the particles where there are any."""
    fields = s.particles._asdict() if s.particles is not None else s.continuum.cell_fields if s.continuum else {}
    return {
        "min_volumetric_stress": float(np.nanmin(fields["volumetric_stress"])),
        "max_effective_stress": float(np.nanmax(fields["effective_stress"])),
        "min_volumetric_strain": float(np.nanmin(fields["volumetric_strain"])),
        "max_effective_strain": float(np.nanmax(fields["effective_strain"])),
    }


def summarise(
    prepared: Prepared, outcome: Outcome, snapshots: list[Snapshot], energy: dict[str, float]
) -> dict[str, Any]:
    """The content of summary.json."""
    p, model, watch = prepared.parameters, prepared.model, prepared.watch
    values: dict[str, float] = {}
    if outcome.history:
        load, moved = outcome.column("load_N"), outcome.column("displacement_m")
        peak = int(np.argmax(load))
        values |= {"peak_load": load[peak], "peak_displacement": moved[peak], "load": load[-1]}
    if snapshots:
        values |= extremes(snapshots[-1])
    seconds = watch.seconds | {"total": sum(watch.seconds.values())}
    particle_loop = watch.parts.get("particles", 0.0)
    seconds["coupling"] = max(0.0, seconds["stepping"] - particle_loop) if p.method in ("bridging", "overlap") else 0.0
    values["total_time"] = seconds["total"]
    published = PUBLISHED[p.method] if p.is_papers_scene else {}
    done = outcome.steps / model.steps
    counts = {name: round(done * value) if name.endswith("_steps") else value for name, value in model.counts.items()}
    if snapshots and snapshots[-1].contacts is not None:
        counts["contacts"] = len(snapshots[-1].contacts.ends)
    work = energy.get("external_work", 0.0)
    discs = counts.get("particles", 0) + counts.get("ghosts", 0)
    rate = discs * counts.get("fine_steps", 0) / seconds["stepping"] if seconds["stepping"] > 0.0 else 0.0
    resolved = asdict(p) | {"radius": p.lattice_radius}
    if "fine" in model.step_sizes:
        resolved["step"] = model.step_sizes["fine"]
    if p.method in ("bridging", "overlap"):
        resolved["substeps"] = model.coupled.substeps
    grown = prepared.growth
    checks = {} if grown is None else {"growth_rate": {"value": grown.rate, "unit": "1/s", "published": None}}
    return {
        "study": "foundation", "method": p.method, "parameters": resolved, "seed": p.seed,
        "versions": output.versions(), "ranks": model.comm.size, "threads": 1,
        "counts": counts, "steps": model.step_sizes, "seconds": seconds, "particle_steps_per_second": rate,
        "results": {
            name: {"value": value, "unit": UNITS[name], "published": published.get(name)} for name, value in values.items()
        } | checks,
        "parallel": prepared.parallel,
        "energy": energy | {"balance_error": abs(energy["balance"]) / work if work > 0.0 else math.nan} if energy else {},
        "stable": outcome.stable, "message": outcome.message, "warnings": prepared.heard,
    }  # fmt: skip
