"""How a study goes on that was stopped: its runs, one after the other, in one checkpoint with all that they need.

For studies that one rank leads (`particles.crew`); a study whose ranks go side by side has more to say about who keeps what
(`studies.foundation_resume`), but writes and reads its checkpoint in the same way.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Self, get_args, get_type_hints

import numpy as np
from mpi4py import MPI

from bridge import checkpoint, output
from bridge.run import Outcome, Stopwatch, on_root, run

State = dict[str, Any]


# Named tuples and lists as nested mappings of arrays ---------------------------------------------------------------------


def packed(value: Any) -> Any:
    """Named tuples, mappings and lists (by number) as nested mappings; None is left out."""
    if hasattr(value, "_asdict"):
        value = value._asdict()
    elif isinstance(value, list):
        value = {f"{k:06d}": one for k, one in enumerate(value)}
    if isinstance(value, dict):
        return {name: packed(one) for name, one in value.items() if one is not None}
    return value


def unpacked(kind: Any, state: Any) -> Any:
    """What was `packed`: a named tuple of this kind, or a list of them for `list[kind]`; arrays as they are."""
    if kind is float:
        return float(state)
    if getattr(kind, "__origin__", None) is list:
        return [unpacked(get_args(kind)[0], one) for _, one in sorted(state.items())]
    if not hasattr(kind, "_fields"):
        return state
    hints, found = get_type_hints(kind), {}
    for name in kind._fields:
        kinds = [one for one in get_args(hints[name]) if one is not type(None)] if type(None) in get_args(hints[name]) else [hints[name]]
        found[name] = unpacked(kinds[0], state[name]) if name in state else None
    return kind(**found)


def history_state(outcome: Outcome) -> State:
    """Steps and history of a run."""
    rows = outcome.history
    return {
        "steps": outcome.steps, "history": {name: outcome.column(name) for name in rows[0]} if rows else {},
        "columns": np.array(list(rows[0]) if rows else [], dtype="S"),
    }  # fmt: skip


def history_of(state: State) -> Outcome:
    """The outcome so far."""
    names = [name.decode() for name in state["columns"].tolist()]
    columns = [state["history"][name].tolist() for name in names]
    return Outcome(int(state["steps"]), history=[dict(zip(names, row)) for row in zip(*columns)])


def watch_state(watch: Stopwatch) -> State:
    """Seconds so far."""
    return {"seconds": dict(watch.seconds), "parts": dict(watch.parts)}


def restore_watch(watch: Stopwatch, state: State) -> None:
    """Add seconds of the earlier part of a run."""
    for name, seconds in state["seconds"].items():
        watch.seconds[name] += float(seconds)
    for name, seconds in state["parts"].items():
        watch.parts[name] = watch.parts.get(name, 0.0) + float(seconds)


# Checkpoints of a study ---------------------------------------------------------------------------------------------------


def describe(study: str, p: Any, options: dict[str, Any], comm: Any) -> dict[str, Any]:
    """What a checkpoint says about its run."""
    return {"study": study, "parameters": asdict(p), "options": options, "versions": output.versions(), "ranks": comm.size}


@dataclass
class Start:
    """Where a study goes on: its parameters and options, and its state (on rank 0; elsewhere what all ranks need)."""

    parameters: Any
    options: dict[str, Any]
    path: Path
    state: State

    def trying(self, restore: Callable[[], Any]) -> Any:
        """Result of a function that puts something of the state back.

        Raises:
            ValueError: the state does not belong to the model.
        """
        try:
            return restore()
        except KeyError as missing:
            raise ValueError(f"resume={self.path} lacks {missing}: it was written by another version; start anew") from None
        except ValueError as failure:
            raise ValueError(f"resume={self.path}: {failure}") from None


def read_checkpoint(
    folder: Path, study: str, kind: type, comm: Any = MPI.COMM_WORLD, common: Callable[[State], State] = lambda state: {}
) -> Start:
    """The checkpoint of a folder (collective).

    Args:
        folder: of the run.
        study: whose checkpoint it must be.
        kind: class of its parameters.
        comm: the ranks.
        common: the part of the state that all ranks need.

    Raises:
        ValueError: there is none, or it cannot be read.
    """
    path = folder / checkpoint.NAME
    whole: list[Any] = []

    def read() -> tuple[Any, State]:
        about, state = checkpoint.read(path)
        if about.get("study") != study:
            raise ValueError(f"resume={path} is of the study {about.get('study')}, not of {study}")
        unknown = set(about["parameters"]) ^ {field.name for field in fields(kind)}
        if unknown:
            raise ValueError(
                f"resume={path} was written with other parameters ({', '.join(sorted(unknown))}), by another version of "
                "grainbridge: start anew"
            )
        whole.append(state)
        return about, common(state)

    about, state = on_root(comm, read)
    return Start(kind(**about["parameters"]), about["options"], path, whole[0] if whole else state)


class _Parts:
    """Parts of a study on the rank that leads, whose checkpoint is written when it is time to.

    Args:
        study: its name.
        p: its parameters, a dataclass.
        options: what else `carry_out` was called with and is to be called with again.
        folder: of the results.
        watch: seconds of all runs.
        every: seconds of wall time between checkpoints; 0 for none but at Ctrl-C or SIGTERM.
        start: where the study was stopped.
    """

    def __init__(
        self, study: str, p: Any, options: dict[str, Any], folder: Path, watch: Stopwatch, every: float = 0.0,
        start: Start | None = None,
    ) -> None:  # fmt: skip
        self._start, self._watch, self._path = start, watch, folder / checkpoint.NAME
        self.keeper = checkpoint.Keeper(self._state, self._path, describe(study, p, options, MPI.COMM_SELF), every, MPI.COMM_SELF)
        if start is None:
            checkpoint.remove(self._path)
        else:
            restore_watch(watch, start.state)

    def __enter__(self) -> Self:
        self.keeper.__enter__()
        return self

    def __exit__(self, *exception: object) -> None:
        self.keeper.__exit__(*exception)

    def _state(self) -> State:
        return self._parts() | watch_state(self._watch)

    def _parts(self) -> State:
        """What has been done so far."""
        raise NotImplementedError

    def finished(self) -> None:
        """The study has left all its results: nothing is to be resumed."""
        checkpoint.remove(self._path)


class Runs(_Parts):
    """The runs of a study, one after the other; a checkpoint may come between any two steps."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        self._ended: State = {}
        self._take: Callable[[], State] = dict
        super().__init__(*arguments, **options)

    def _parts(self) -> State:
        return {"runs": self._ended | self._take()}

    def begun(self, name: str) -> State | None:
        """State of the model of a run that was begun before, to make the model by; None for one that was not."""
        run_of = None if self._start is None else self._start.state.get("runs", {}).get(name)
        return None if run_of is None else run_of["model"]

    def run(
        self, name: str, model: Any, frames: list[Any], kind: Any, marks: Callable[[int], np.ndarray], *,
        on_sample: Callable[[dict[str, float]], None], enter: Callable[[Any], None] = lambda frame: None, **options: Any,
    ) -> Outcome:  # fmt: skip
        """Advance a model, see `bridge.run.run`, or go on with it.

        Args:
            name: of the run in the study.
            model: with `steps`, `state` and `restore`.
            frames: what is kept of it; `on_frame` of the options adds to it.
            kind: of the frames, a named tuple or an array.
            marks: steps at which frames are taken, in a run of so many steps; they are rounded.
            on_sample: called with each row, those of an earlier part, too.
            enter: called with each frame of an earlier part.
        """
        outcome, ended = Outcome(), False
        if self._start is not None and self.begun(name) is not None:
            state = self._start.state["runs"][name]
            self._start.trying(lambda: model.restore(state["model"]))
            outcome, ended = history_of(state), bool(state["ended"])
            frames.extend(unpacked(list[kind], state.get("frames", {})))
            for row in outcome.history:
                on_sample(row)
            for frame in frames:
                enter(frame)

        def take(done: bool = False) -> State:
            return {name: history_state(outcome) | {"model": model.state(), "frames": packed(frames), "ended": done}}

        self._take = take
        if not ended:
            take_at = np.unique(np.round(marks(model.steps)).astype(int)).tolist()
            outcome = run(
                model, model.steps, frames=take_at, on_sample=on_sample, stopwatch=self._watch, outcome=outcome,
                watcher=self.keeper, **options,
            )  # fmt: skip
        if outcome.stable:
            self._ended |= _copied(take(True))
        self._take = dict
        return outcome


class Results(_Parts):
    """Results of the parts of a study, one after the other; those that a checkpoint has are not sought again.

    For studies of many short runs: what is lost is a part that has not ended.
    """

    def __init__(self, *arguments: Any, **options: Any) -> None:
        self._done: list[np.ndarray] = []
        self._known: list[np.ndarray] = []
        super().__init__(*arguments, **options)
        if self._start is not None:
            self._known = [values for _, values in sorted(self._start.state["done"].items())]

    def _parts(self) -> State:
        return {"done": packed(self._done + self._known[len(self._done) :])}

    def once(self, find: Callable[[], np.ndarray]) -> np.ndarray:
        """Numbers that the next part finds, or found before; after it a checkpoint is written when it is time to."""
        return self.some([None], lambda left: [find()])[0]

    def some(self, parts: list[Any], find: Callable[[list[Any]], list[np.ndarray]]) -> list[np.ndarray]:
        """Numbers of the next parts: those that were found before, the others found together."""
        known = self._known[len(self._done) : len(self._done) + len(parts)]
        self._done += known
        if len(known) < len(parts):
            self._done += find(parts[len(known) :])
            self.keeper.look()
        return self._done[-len(parts) :]


def _copied(state: Any) -> Any:
    if isinstance(state, dict):
        return {name: _copied(value) for name, value in state.items()}
    return np.array(state) if isinstance(state, np.ndarray) else state
