"""What a checkpoint of the foundation holds, and how a run goes on from it."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from bridge import checkpoint, output
from bridge.run import Outcome, on_root
from studies.foundation import Parameters
from studies.snapshots import Snapshot, packed, unpacked

STUDY = "foundation"


def describe(p: Parameters, options: dict[str, Any], comm: Any) -> dict[str, Any]:
    """What a checkpoint says about its run."""
    return {
        "study": STUDY, "parameters": asdict(p), "options": options, "versions": output.versions(), "ranks": comm.size
    }  # fmt: skip


def run_state(prepared: Any, outcome: Outcome, snapshots: list[Snapshot]) -> dict[str, Any]:
    """All that a run needs to go on; complete on rank 0 (collective)."""
    rows = outcome.history
    return {
        "model": prepared.model.state(), "steps": outcome.steps,
        "history": {name: outcome.column(name) for name in rows[0]} if rows else {},
        "columns": np.array(list(rows[0]) if rows else [], dtype="S"), "snapshots": packed(snapshots),
        "seconds": prepared.watch.seconds, "parts": prepared.watch.parts,
    }  # fmt: skip


@dataclass
class Start:
    """Where a run goes on: parameters and options of the run, and its state (that of the particles on rank 0)."""

    parameters: Parameters
    options: dict[str, Any]
    path: Path
    state: dict[str, Any]

    def restore(self, prepared: Any, snapshots: list[Snapshot]) -> Outcome:
        """Bring model, clock of the phases and snapshots (on rank 0) to where they were; the outcome so far (collective).

        Raises:
            ValueError: the state does not belong to the model.
        """
        state, comm = self.state, prepared.model.comm
        try:
            prepared.model.restore(state["model"])
        except KeyError as missing:
            raise ValueError(f"resume={self.path} lacks {missing}: it was written by another version; start anew") from None
        except ValueError as failure:
            raise ValueError(f"resume={self.path}: {failure}") from None
        for name, seconds in state["seconds"].items():
            prepared.watch.seconds[name] += float(seconds)
        for name, seconds in state["parts"].items():
            prepared.watch.parts[name] = prepared.watch.parts.get(name, 0.0) + float(seconds)
        if comm.rank == 0:
            snapshots.extend(unpacked(state["snapshots"]))
        names = [name.decode() for name in state["columns"].tolist()]
        columns = [state["history"][name].tolist() for name in names]
        return Outcome(int(state["steps"]), history=[dict(zip(names, row)) for row in zip(*columns)])


def read_start(folder: Path, comm: Any = MPI.COMM_WORLD) -> Start:
    """The checkpoint of a folder (collective).

    Raises:
        ValueError: there is none, or it cannot be read.
    """
    path = folder / checkpoint.NAME

    def read() -> tuple[Any, Any]:
        about, state = checkpoint.read(path)
        if about.get("study") != STUDY:
            raise ValueError(f"resume={path} is of the study {about.get('study')}, not of {STUDY}")
        unknown = set(about["parameters"]) ^ {field.name for field in fields(Parameters)}
        if unknown:
            raise ValueError(
                f"resume={path} was written with other parameters ({', '.join(sorted(unknown))}), by another version of "
                "grainbridge: start anew"
            )
        return about, state

    whole: list[Any] = [None]

    def keep() -> tuple[Any, Any]:
        about, whole[0] = read()
        return about, _without_particles(whole[0])

    about, state = on_root(comm, keep)
    return Start(Parameters(**about["parameters"]), about["options"], path, whole[0] or state)


def _without_particles(state: dict[str, Any]) -> dict[str, Any]:
    """What all ranks need: everything but particles and pictures, which are rank 0's."""
    model = {name: part for name, part in state["model"].items() if name not in ("particles", "fine")}
    return {name: part for name, part in state.items() if name != "snapshots"} | {"model": model}
