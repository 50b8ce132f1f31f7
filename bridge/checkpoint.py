"""Checkpoints: the whole state of a run in one HDF5 file, written so that a crash loses nothing older.

A new file is written beside the old one, brought to the disk and only then given its name. Its root has the attributes
`format`, `version` and `about` (JSON: the study, its parameters, versions, ranks); groups and data sets below are named as in
`bridge.kept` and `particles.state`.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

import h5py
import numpy as np
from mpi4py import MPI

from bridge.run import on_root

NAME = "checkpoint.h5"  # in the folder of a run
FORMAT, VERSION = "grainbridge checkpoint", 3

State = dict[str, Any]


def write(path: Path, about: State, state: State) -> None:
    """Write a checkpoint; whoever reads meanwhile, or after a crash, finds the old one whole or the new one whole.

    Args:
        path: of the file.
        about: what JSON can say.
        state: arrays, numbers, or the same in further mappings, by name.
    """
    partial = path.with_name(f".{path.name}.partial")
    with h5py.File(partial, "w") as file:
        file.attrs.update(format=FORMAT, version=VERSION, about=json.dumps(about))
        _put(file, state)
    _to_disk(partial)
    os.replace(partial, path)
    _to_disk(path.parent)  # the new name, too


def _to_disk(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _put(group: h5py.Group, state: State) -> None:
    for name, value in state.items():
        if isinstance(value, dict):
            _put(group.create_group(name), value)
        else:
            group.create_dataset(name, data=value)


def read(path: Path) -> tuple[State, State]:
    """What `write` was given: about and state.

    Raises:
        ValueError: there is no such file, or it is no checkpoint that this version can read.
    """
    if not path.is_file():
        raise ValueError(
            f"resume={path.parent} holds no {path.name}: there is nothing to go on from (a run that has finished removes it)"
        )
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("format") != FORMAT:
                raise ValueError(f"resume={path} is no checkpoint of grainbridge")
            version = int(file.attrs["version"])
            if version != VERSION:
                raise ValueError(
                    f"resume={path} has version {version} of the format, this is version {VERSION}: go on with the version of "
                    "grainbridge that wrote it, or start anew"
                )
            return json.loads(file.attrs["about"]), _get(file)
    except (OSError, KeyError, RuntimeError) as failure:
        raise ValueError(f"resume={path} cannot be read ({str(failure).splitlines()[0]}); start anew") from None


def _get(group: h5py.Group) -> State:
    return {name: _get(item) if isinstance(item, h5py.Group) else item[()] for name, item in group.items()}


def remove(path: Path) -> None:
    """Remove a checkpoint, and one that was being written."""
    for file in (path, path.with_name(f".{path.name}.partial")):
        file.unlink(missing_ok=True)


class Interrupted(KeyboardInterrupt):
    """The run was asked to stop (Ctrl-C, SIGTERM) and has written its checkpoint.

    Args:
        number: of the signal.
        message: for the user.
    """

    def __init__(self, number: int, message: str) -> None:
        super().__init__(message)
        self.number = number

    def __reduce__(self) -> Any:
        return type(self), (self.number, str(self))


class Keeper:
    """Writes checkpoints in a run: every so many seconds, and when the run is asked to stop.

    Args:
        take: The state, complete on rank 0 (collective).
        path: Of the checkpoint.
        about: Parameters and versions.
        every: Seconds of wall time from one to the next; 0 writes none but at a signal.
        comm: The ranks of the run.
    """

    SIGNALS = (signal.SIGINT, signal.SIGTERM)

    def __init__(self, take: Callable[[], State], path: Path, about: State, every: float, comm: Any = MPI.COMM_WORLD):
        self._take, self._path, self._about, self._every, self._comm = take, path, about, every, comm
        self._asked, self._last = 0, time.monotonic()
        self._before: dict[int, Any] = {}
        self.written = 0

    def __enter__(self) -> Keeper:
        """From now on the signals only leave a mark; a second one acts as ever."""
        try:
            self._before = {number: signal.signal(number, self._ask) for number in self.SIGNALS}
        except ValueError:  # not the main thread: signals are somebody else's
            self._before = {}
        return self

    def __exit__(self, *exception: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _ask(self, number: int, frame: FrameType | None) -> None:
        self._asked = number
        signal.signal(number, self._before[number])

    def look(self) -> None:
        """Write a checkpoint if it is time to (collective: all ranks do what one of them finds).

        Raises:
            Interrupted: a signal has come; the checkpoint is written.
        """
        due = self._every > 0.0 and time.monotonic() - self._last >= self._every
        asked = self._asked
        if self._comm.size > 1:
            found = np.array([due, asked], dtype=np.int64)
            self._comm.Allreduce(MPI.IN_PLACE, found, op=MPI.MAX)
            due, asked = bool(found[0]), int(found[1])
        if not (due or asked):
            return
        try:
            self.write()
        except OSError as failure:  # the run is worth more than its checkpoint
            self._last = time.monotonic()
            if self._comm.rank == 0:
                print(f"Warning: {self._path} could not be written ({failure})", file=sys.stderr, flush=True)
            if asked:
                raise Interrupted(asked, f"stopped by {signal.Signals(asked).name} without a new checkpoint") from None
        if asked:
            raise Interrupted(
                asked, f"stopped by {signal.Signals(asked).name}; the state is in {self._path}: --resume {self._path.parent}"
            )

    def write(self) -> None:
        """Write a checkpoint now (collective)."""
        state = self._take()
        on_root(self._comm, lambda: write(self._path, self._about, state))
        self.written += 1
        self._last = time.monotonic()
