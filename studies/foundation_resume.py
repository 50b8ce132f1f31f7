"""What a checkpoint of the foundation holds, and how a run goes on from it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mpi4py import MPI

from bridge.run import Outcome
from studies.foundation import Parameters
from studies.resuming import (
    Start,
    history_of,
    history_state,
    packed,
    read_checkpoint,
    restore_watch,
    unpacked,
    watch_state,
)
from studies.snapshots import Snapshot

STUDY = "foundation"


def run_state(prepared: Any, outcome: Outcome, snapshots: list[Snapshot]) -> dict[str, Any]:
    """All that a run needs to go on; complete on rank 0 (collective)."""
    kept = {"model": prepared.model.state(), "snapshots": packed(snapshots)}
    return kept | history_state(outcome) | watch_state(prepared.watch)


def put_back(start: Start, prepared: Any, snapshots: list[Snapshot]) -> Outcome:
    """Bring model, clock of the phases and snapshots (on rank 0) to where they were; the outcome so far (collective).

    Raises:
        ValueError: the state does not belong to the model.
    """
    state = start.state
    start.trying(lambda: prepared.model.restore(state["model"]))
    restore_watch(prepared.watch, state)
    if prepared.model.comm.rank == 0:
        snapshots.extend(unpacked(list[Snapshot], state["snapshots"]))
    return history_of(state)


def read_start(folder: Path, comm: Any = MPI.COMM_WORLD) -> Start:
    """The checkpoint of a folder (collective).

    Raises:
        ValueError: there is none, or it cannot be read.
    """
    return read_checkpoint(folder, STUDY, Parameters, comm, _without_particles)


def _without_particles(state: dict[str, Any]) -> dict[str, Any]:
    """What all ranks need: everything but particles and pictures, which are rank 0's."""
    model = {name: part for name, part in state["model"].items() if name not in ("particles", "fine")}
    return {name: part for name, part in state.items() if name != "snapshots"} | {"model": model}
