"""What these studies share: a body run to its end, with history, fields, seconds and the content of summary.json."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from bridge import output
from bridge.manifold import LOST, PARTICLES, Manifold
from bridge.manifold import kept as manifold_kept
from bridge.run import Outcome, Stopwatch
from particles.crew import ranks
from particles.lattice import Lattice
from particles.lattice import kept as lattice_kept
from studies.resuming import Runs, Start, State

CELLS = {8: ("hexahedron", [0, 1, 3, 2, 4, 5, 7, 6]), 4: ("quad", [0, 1, 3, 2])}  # nodes of an element as VTK wants them
SERIES = ("particles", "elements")


@dataclass
class Body:
    """A lattice alone, or with elements over it, as one model of a run."""

    name: str
    model: Any  # Lattice or Manifold
    follow: Callable[[], dict[str, float]]  # scalars of the history

    def __post_init__(self) -> None:
        self.step: float = self.model.step
        self.steps = 0  # of its run
        self._earlier, self._clock = 0.0, lambda: 0.0

    @property
    def lattice(self) -> Lattice:
        """The particles."""
        return self.model.lattice if isinstance(self.model, Manifold) else self.model

    @property
    def time(self) -> float:
        """s."""
        return self.model.time

    def advance(self, steps: int) -> None:
        """Go on."""
        self.model.advance(steps)

    def energies(self) -> dict[str, float]:
        """Terms in J."""
        return self.model.energies()

    def timed(self, clock: Callable[[], float]) -> None:
        """Take the seconds of its steps from a clock from now on."""
        self._clock = clock

    def seconds(self) -> float:
        """Of its steps so far, in an earlier part of the run, too."""
        return self._earlier + self._clock()

    def state(self) -> State:
        """What it goes on from."""
        model = self.model
        found = manifold_kept.state_of(model) if isinstance(model, Manifold) else lattice_kept.state_of(model)
        return found | {"seconds": self.seconds()}

    def restore(self, state: State) -> None:
        """Put a state back."""
        if isinstance(self.model, Manifold):
            manifold_kept.restore(self.model, state)
        else:
            lattice_kept.restore(self.model, state)
        self._earlier = float(state["seconds"])

    def motion(self, rows: Any = slice(None)) -> tuple[np.ndarray, np.ndarray]:
        """Displacements and velocities (n, 3) of particles, all by default."""
        if isinstance(self.model, Manifold):
            return self.model.particle_motion(rows)
        return self.model.displacement[rows], self.model.velocity[rows]

    def sample(self) -> dict[str, float]:
        """A row of the history."""
        terms = self.energies()
        row = {"time_s": self.time, **self.follow()}
        row |= {f"{name}_J" if name != "broken_bonds" else "broken_bonds_1": value for name, value in terms.items()}
        row["free_particles_1"] = float(self.lattice.free.sum())
        return row

    def balance_error(self) -> float:
        """Energy that is not accounted for, as a share of the work done on the body."""
        terms = self.energies()
        work = max(abs(terms["external_work"]) + abs(terms["held_work"]), terms["kinetic"] + terms["elastic"], 1e-300)
        return abs(terms["balance"]) / work


class Recorder:
    """Runs bodies one after the other and writes what they leave behind.

    Args:
        study: its name.
        p: parameters.
        folder: of the results.
        samples: rows of the history a body.
        fields: whether field files are written.
        figures: whether pictures are drawn.
        progress: show bars on terminals.
        checkpoint_every: seconds of wall time between checkpoints; 0 for none but at Ctrl-C or SIGTERM.
        start: where the study was stopped.
    """

    def __init__(
        self, study: str, p: Any, folder: Path, *, samples: int, fields: bool, figures: bool, progress: bool,
        checkpoint_every: float = 0.0, start: Start | None = None,
    ) -> None:  # fmt: skip
        options = {"samples": samples, "fields": fields, "figures": figures}
        self.study, self.p, self.samples, self.fields, self.progress = study, p, samples, fields, progress
        self.folder = output.prepare_folder(folder, MPI.COMM_SELF)
        self.watch = Stopwatch()
        self._runs = Runs(study, p, options, folder, self.watch, checkpoint_every, start)
        self.results: dict[str, dict[str, Any]] = {}
        self.bodies: dict[str, Body] = {}
        self.outcomes: dict[str, Outcome] = {}
        self.seconds: dict[str, float] = {}
        self.particle_steps = 0.0
        self.summary: dict[str, Any] = {}
        self._history: output.HistoryFile | None = None
        self._heard: list[str] = []

    def __enter__(self) -> Recorder:
        output.clear(self.folder, ("summary.json", "history.csv", *(path.name for path in self.folder.glob("*.png"))), SERIES)
        self._catch = warnings.catch_warnings(record=True)
        self._caught = self._catch.__enter__()
        self._runs.__enter__()
        warnings.simplefilter("default", UserWarning)
        return self

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        self._runs.__exit__(kind, error, trace)
        self._catch.__exit__(kind, error, trace)
        if self._history is not None:
            self._history.close()
        if kind is None:
            for one in self._caught:
                words = str(one.message)
                if words not in self._heard and issubclass(one.category, UserWarning):
                    self._heard.append(words)
            self._finish()

    def build(self, make: Callable[[], Body]) -> Body:
        """Make a body in the phase `setup`."""
        with self.watch.phase("setup"):
            body = make()
        self.bodies[body.name] = body
        return body

    def run(
        self, body: Body, steps: int, until: Callable[[dict[str, float]], bool] | None = None,
        on_sample: Callable[[dict[str, float]], None] = lambda row: None, stages: list[Any] | None = None, kind: Any = float,
    ) -> Outcome:  # fmt: skip
        """Run a body, or go on with it; its rows go to history.csv under its name.

        Args:
            body: at its start.
            steps: of its run.
            until: asked with each new row: true ends the run there.
            on_sample: called with each row before, those of an earlier part, too.
            stages: what `until` keeps of the run, named tuples of a kind; those of an earlier part come first.
            kind: of the stages.
        """
        if self._history is None:
            self._history = output.HistoryFile(self.folder / "history.csv")
        history = self._history
        with self.watch.phase("setup"):
            body.advance(0)
        before, free = self.watch.seconds["stepping"], body.lattice.free.sum()
        body.timed(lambda: self.watch.seconds["stepping"] - before)
        body.steps = steps
        outcome = self._runs.run(
            body.name, body, [] if stages is None else stages, kind, lambda steps: np.empty(0), samples=self.samples, until=until,
            on_sample=on_sample, label=body.name, progress=self.progress,
        )  # fmt: skip
        for row in outcome.history:
            history.write({"model": body.name, **_common(row)})
        self.seconds[body.name] = body.seconds()
        self.particle_steps += 0.5 * float(free + body.lattice.free.sum()) * outcome.steps
        self.outcomes[body.name] = outcome
        if self.fields and outcome.stable:
            with self.watch.phase("output"):
                write_fields(body, self.folder / "fields", body.name)
        return outcome

    def result(self, name: str, value: Any, unit: str, published: Any = None) -> None:
        """A named number of the summary."""
        self.results[name] = {"value": value, "unit": unit, "published": published}

    def _finish(self) -> None:
        stable = all(one.stable for one in self.outcomes.values())
        message = next((one.message for one in self.outcomes.values() if not one.stable), "")
        stepping = self.watch.seconds["stepping"]
        energy = {name: body.energies() for name, body in self.bodies.items() if self.outcomes[name].stable}
        errors = [body.balance_error() for name, body in self.bodies.items() if self.outcomes[name].stable]
        for words in self._heard:
            print(f"Warning: {words}", file=sys.stderr)
        first = next(iter(self.bodies.values()))
        self.summary = {
            "study": self.study, "method": "lattice", "seed": None, "parameters": asdict(self.p), "versions": output.versions(),
            "ranks": ranks(), "threads": 1,
            "counts": {name: _counts(body, self.outcomes[name]) for name, body in self.bodies.items()},
            "steps": {"fine": first.step, "fine_critical": first.model.critical_step},
            "seconds": self.watch.seconds | {"total": sum(self.watch.seconds.values())}, "seconds_by_model": self.seconds,
            "particle_steps_per_second": self.particle_steps / stepping if stepping > 0 else 0.0,
            "results": self.results, "energy": energy | {"balance_error": max(errors, default=0.0)},
            "parallel": {name: found for name, body in self.bodies.items() if (found := body.model.parallel())},
            "stable": stable, "message": message, "warnings": self._heard,
        }  # fmt: skip
        output.write_json(self.folder / "summary.json", self.summary)
        if stable:
            self._runs.finished()


def _common(row: dict[str, float]) -> dict[str, float]:
    """A row with the columns that bodies with and without elements share."""
    lost = {f"{name}_J": row.get(f"{name}_J", 0.0) for name in LOST}
    return lost | {name: value for name, value in row.items() if name not in lost}


def _counts(body: Body, outcome: Outcome) -> dict[str, int]:
    counts = {"particles": int(body.lattice.free.sum()), "sites": body.lattice.count, "fine_steps": outcome.steps}
    if isinstance(body.model, Manifold):
        kinds = np.bincount(body.model.kind, minlength=3)
        counts |= {"continuum_elements": int(kinds[0]), "manifold_elements": int(kinds[1])}
        counts |= {"released": body.model.released, "returned": body.model.returned}
    return counts


def write_fields(body: Body, folder: Path, name: str) -> None:
    """Free particles and elements as they are now, for ParaView."""
    lattice, model = body.lattice, body.model
    moved, speed = body.motion()
    free = lattice.free
    if free.any():
        data = {
            "displacement": moved[free], "velocity": speed[free], "broken_bonds": lattice.broken()[free].astype(float),
            "layer": lattice.layer[free].astype(float),
        }  # fmt: skip
        points = np.arange(int(free.sum()))[:, None]
        output.Series(folder, f"{name}_particles").write(body.time, lattice.reference[free], ("vertex", points), data)
    if isinstance(model, Manifold):
        there = np.flatnonzero(model.kind != PARTICLES)
        if len(there):
            shape, order = CELLS[model.grid.nodes.shape[1]]
            cells = model.grid.nodes[there][:, order]
            output.Series(folder, f"{name}_elements").write(
                body.time, model.node_reference, (shape, cells), {"displacement": model.displacement, "velocity": model.velocity},
                {"kind": model.kind[there].astype(float)},
            )  # fmt: skip


def at_rest(tolerance: float = 1e-7) -> Callable[[dict[str, float]], bool]:
    """Stop of a damped run: kinetic energy below a share of the elastic energy, and both set."""
    return lambda row: row["elastic_J"] > 0 and row["kinetic_J"] < tolerance * row["elastic_J"]
