"""The loop of a run: steps, samples and frames, seconds by phase, progress, blow-up; for any model."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar

import numpy as np
from mpi4py import MPI

import continuum
import particles
from particles.dispatch import compiled_seconds

PHASES = ("setup", "compile", "stepping", "coupling", "output")
LONGEST_CHUNK = 50  # steps between two looks for blow-up
Result = TypeVar("Result")


class Model(Protocol):
    """What a run needs of a model; every method is collective."""

    @property
    def time(self) -> float: ...  # s

    step: float  # s, of one `advance` step

    def advance(self, steps: int) -> None: ...

    def sample(self) -> dict[str, float]: ...  # named scalars of the history, the unit ends the name

    def energies(self) -> dict[str, float]: ...  # terms since the start, J


class Watcher(Protocol):
    """Who looks at a run between its steps."""

    def look(self) -> None: ...  # collective; may raise to end the run


class Stopwatch:
    """Wall seconds by phase; what Numba compiles or loads meanwhile counts as `compile`; `part` is time within a phase."""

    def __init__(self) -> None:
        self.seconds = dict.fromkeys(PHASES, 0.0)
        self.parts: dict[str, float] = {}

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Add the time of the block to a phase."""
        start, before = time.perf_counter(), compiled_seconds()
        try:
            yield
        finally:
            compiled = compiled_seconds() - before
            self.seconds["compile"] += compiled
            self.seconds[name] += time.perf_counter() - start - compiled

    def part(self, name: str, work: Callable[..., Result]) -> Callable[..., Result]:
        """The same function, with its time added to `parts[name]` (without compilation)."""
        self.parts.setdefault(name, 0.0)

        def timed(*arguments: Any, **options: Any) -> Result:
            start, before = time.perf_counter(), compiled_seconds()
            try:
                return work(*arguments, **options)
            finally:
                self.parts[name] += time.perf_counter() - start - (compiled_seconds() - before)

        return timed


@dataclass
class Outcome:
    """How a run ended."""

    steps: int = 0
    stable: bool = True
    message: str = ""
    history: list[dict[str, float]] = field(default_factory=list)

    def column(self, name: str) -> np.ndarray:
        """One column of the history as an array."""
        return np.array([row[name] for row in self.history])


def run(
    model: Model,
    steps: int,
    *,
    samples: int = 200,
    frames: Sequence[int] = (),
    on_sample: Callable[[dict[str, float]], None] | None = None,
    on_frame: Callable[[], None] | None = None,
    until: Callable[[dict[str, float]], bool] | None = None,
    stopwatch: Stopwatch | None = None,
    label: str = "",
    progress: bool = True,
    outcome: Outcome | None = None,
    watcher: Watcher | None = None,
) -> Outcome:
    """Advance a model, with samples evenly spread over the run and frames after given numbers of steps (collective).

    Args:
        model: What is advanced.
        steps: Number of its steps.
        samples: Rows of the history beside the initial one; never more than one a step.
        frames: Steps after which `on_frame` is called.
        on_sample: Called with each new row (on every rank).
        on_frame: Called at each frame (on every rank).
        until: Asked with each new row (on every rank): true ends the run there.
        stopwatch: Takes the seconds of the phases `stepping` and `output`.
        label: Text before the progress bar.
        progress: A bar with the time left, where standard error is a terminal; rank 0 only.
        outcome: Of the part of the run that is done already, when it is resumed; the model is in the state of its last step.
        watcher: Asked to look after every 50 steps at most, when samples and frames up to there are taken.

    Returns:
        The history, and whether the run was stable; a blow-up ends it without an exception, its message says what, where
        and when.
    """
    watch = stopwatch or Stopwatch()
    outcome = outcome or Outcome()
    resumed = outcome.steps if outcome.history else -1
    sampled = set(np.unique(np.round(np.linspace(0, steps, min(samples, steps) + 1)).astype(int)).tolist())
    framed = set(int(step) for step in frames)
    bar = _bar(steps, label, progress)
    try:
        if bar is not None:
            bar.update(outcome.steps)
        for stop in sorted(stop for stop in sampled | framed | {steps} if stop > resumed):
            while outcome.steps < stop:
                chunk = min(stop - outcome.steps, LONGEST_CHUNK)
                with watch.phase("stepping"):
                    model.advance(chunk)
                outcome.steps += chunk
                if bar is not None:
                    bar.update(chunk)
                if watcher is not None and outcome.steps < stop:
                    with watch.phase("output"):
                        watcher.look()
            with watch.phase("output"):
                if stop in sampled:
                    outcome.history.append(model.sample())
                    if on_sample is not None:
                        on_sample(outcome.history[-1])
                if stop in framed and on_frame is not None:
                    on_frame()
            if stop in sampled and until is not None and until(outcome.history[-1]):
                break
            if watcher is not None and stop < steps:
                with watch.phase("output"):
                    watcher.look()
    except (particles.Unstable, continuum.Unstable) as unstable:
        outcome.stable, outcome.message = False, str(unstable)
    finally:
        if bar is not None:
            bar.close()
    return outcome


def _bar(steps: int, label: str, progress: bool) -> Any:
    if not progress or MPI.COMM_WORLD.rank > 0 or not sys.stderr.isatty():
        return None
    from tqdm import tqdm

    layout = "{desc}: {percentage:3.0f}% |{bar}| {n_fmt}/{total_fmt} steps, {remaining} left"
    return tqdm(total=steps, desc=label or "run", leave=False, bar_format=layout)


def on_root(comm: Any, work: Callable[[], Result]) -> Result:
    """Result of a function that only rank 0 calls, on every rank; its ValueError or OSError too (collective)."""
    result: Any = None
    error: Exception | None = None
    if comm.rank == 0:
        try:
            result = work()
        except (ValueError, OSError) as failure:
            error = failure
    if comm.size > 1:
        result, error = comm.bcast((result, error), root=0)
    if error is not None:
        raise error
    return result
