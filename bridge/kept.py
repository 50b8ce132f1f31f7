"""What bodies and couplings carry from one step to the next, as named arrays on rank 0, and back on any number of ranks.

Nodes are known by their places, which are the same however the mesh is spread. Sums that each rank keeps for itself go back
to the same ranks where there are as many, otherwise all to rank 0. Every function is collective.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from particles import state as particle_state

Array = NDArray[np.float64]
State = dict[str, Any]

MOTION = ("displacement", "velocity", "acceleration")
NEAREST = 1e-9  # of the extent of the mesh: places that are nearer are one


def gathered(comm: Any, values: Array) -> Array | None:
    """Rows of all ranks in their order on rank 0, None elsewhere."""
    parts = comm.gather(np.asarray(values), root=0)
    return None if parts is None else np.concatenate(parts)


def of_nodes(comm: Any, places: Array, arrays: dict[str, Array]) -> State:
    """Arrays (nodes of this rank, ...) with the places (nodes, axes) that they belong to."""
    return {"places": gathered(comm, places)} | {name: gathered(comm, values) for name, values in arrays.items()}


def to_nodes(places: Array, state: State, arrays: dict[str, Array]) -> None:
    """Write what `of_nodes` kept into the arrays of this rank, in place.

    Raises:
        ValueError: a node of this rank is not among those of the state.
    """
    if not len(places):
        return
    known = state["places"]
    distance, which = cKDTree(known).query(places) if len(known) else (np.full(len(places), np.inf), None)
    extent = np.ptp(known, axis=0).max() if len(known) else 1.0
    if not distance.max() <= NEAREST * extent:
        place = ", ".join(f"{component:.6g}" for component in places[int(np.argmax(distance))])
        raise ValueError(f"state has no node at ({place}) m: the mesh is another one; make the same scene")
    for name, values in arrays.items():
        values[:] = state[name][which].reshape(values.shape)


def of_ranks(comm: Any, numbers: Any) -> Array | None:
    """Numbers (k,) of each rank as (ranks, k) on rank 0."""
    parts = comm.gather(np.asarray(numbers, dtype=float), root=0)
    return None if parts is None else np.array(parts)


def to_ranks(comm: Any, numbers: Array) -> Array:
    """The numbers (k,) of this rank; with another number of ranks all sums are rank 0's."""
    if len(numbers) == comm.size:
        return numbers[comm.rank]
    return numbers.sum(axis=0) if comm.rank == 0 else np.zeros(numbers.shape[1])


# ------------------------------------------------------------------------------------------------------------ body


def body_state(body: Any) -> State:
    """Motion of a body and the account of its energies; complete on rank 0."""
    motion, at = body.motion, body.boundaries.fixed_flat
    reaction = np.zeros(body.mass.size)
    if len(motion._reaction):
        reaction[at] = motion._reaction
    arrays = {name: getattr(body, name) for name in MOTION}
    arrays |= {"damping": motion._damping, "reaction": reaction.reshape(body.mass.shape)}
    numbers = [*motion._sums.values(), motion._reference, motion._known.imbalance]
    return {
        "time": body.time, "nodes": of_nodes(body.comm, body.coordinates, arrays), "sums": of_ranks(body.comm, numbers),
        "settings": np.array([*motion._known.settings, motion.mass_damping, motion._step]),
    }  # fmt: skip


def restore_body(body: Any, state: State) -> None:
    """Put a state of `body_state` back."""
    motion, at = body.motion, body.boundaries.fixed_flat
    reaction = np.zeros_like(body.mass)
    arrays = {name: getattr(body, name) for name in MOTION} | {"damping": motion._damping, "reaction": reaction}
    to_nodes(body.coordinates, state["nodes"], arrays)
    motion._reaction = reaction.ravel()[at]
    *sums, motion._reference, imbalance = (float(value) for value in to_ranks(body.comm, state["sums"]))
    motion._sums = dict(zip(motion._sums, sums, strict=True))
    revision, damping, motion.mass_damping, motion._step = state["settings"].tolist()
    kept = tuple(array.copy() for array in motion._state())
    motion._known = motion._known._replace(state=kept, settings=(int(revision), damping), imbalance=imbalance)
    body.time = float(state["time"])
    body.update_ghosts()


# -------------------------------------------------------------------------------------------------------- coupling


def _split(rule: Any) -> tuple[dict[str, Array], list[str]]:
    """Attributes that a coarse step changes: arrays of nodes by name, names of sums."""
    values = {name: getattr(rule, name) for name in rule.ATTRIBUTES if name != "moves_prescribed"}
    nodal = {name: value for name, value in values.items() if np.ndim(value) == 2}
    return nodal, [name for name in values if name not in nodal]


def _interface(coupled: Any) -> tuple[Array, dict[str, Array]]:
    """Places and arrays of the nodes that step with the particles, where one coarse step hands something on."""
    places = coupled.exchange.gather(np.ascontiguousarray(coupled.body.coordinates))
    if not hasattr(coupled.fine, "interface"):
        return places[:0], {}
    fine = coupled.fine
    return places[fine.interface], {"acceleration": fine.nodal_acceleration, "link": fine.nodes.link}


def for_all_ranks(comm: Any, state: State) -> State:
    """A state of `coupled_state` that rank 0 has, on every rank; without what each rank has of the particles, which is for it alone."""
    return comm.bcast(None if comm.rank else state | {"particles": particle_state.without_ranks(state["particles"])}, root=0)  # type: ignore[no-any-return]


def coupled_state(coupled: Any) -> State:
    """All of a `BridgingScale` or `Overlap`, its body and its particles; complete on rank 0."""
    comm, rule, fine = coupled.body.comm, coupled.rule, coupled.fine
    nodal, names = _split(rule)
    sums = [float(np.ravel(getattr(rule, name))[0]) for name in names]
    own = fine.own_arrays()
    numbers = [float(array[0]) for array in own if array.shape == (1,)]
    numbers += [0.0] * (comm.allreduce(len(numbers), op=MPI.MAX) - len(numbers))  # ranks without particles
    places, interface = _interface(coupled)
    return {
        "coarse_steps": coupled.coarse_steps, "body": body_state(coupled.body),
        "nodes": of_nodes(comm, coupled.body.coordinates, nodal), "sums": of_ranks(comm, sums),
        "interface": of_nodes(comm, places, interface), "own_sums": of_ranks(comm, numbers),
        "fine": {f"array_{k}": array for k, array in enumerate(own) if array.ndim == 2},
        "particles": particle_state.state_of(coupled.soil), "initial": np.array(list(coupled._initial.values())),
    }  # fmt: skip


def restore_coupled(coupled: Any, state: State) -> None:
    """Put a state of `coupled_state` back; particles only where this rank has any."""
    comm, rule, fine = coupled.body.comm, coupled.rule, coupled.fine
    if coupled.soil.count:
        particle_state.restore(coupled.soil, state["particles"])
        fine.rearrange()
    restore_body(coupled.body, state["body"])
    nodal, names = _split(rule)
    to_nodes(coupled.body.coordinates, state["nodes"], nodal)
    for name, value in zip(names, (float(value) for value in to_ranks(comm, state["sums"])), strict=True):
        if np.ndim(getattr(rule, name)):
            getattr(rule, name)[0] = value
        else:
            setattr(rule, name, value)
    places, interface = _interface(coupled)
    to_nodes(places, state["interface"], interface)
    own, numbers = fine.own_arrays(), iter([float(value) for value in to_ranks(comm, state["own_sums"])])
    for k, array in enumerate(own):
        if array.size:
            array[:] = next(numbers) if array.shape == (1,) else state["fine"][f"array_{k}"]
    coupled.count(int(state["coarse_steps"]) - coupled.coarse_steps)
    coupled._initial = dict(zip(coupled._initial, np.asarray(state["initial"]).tolist(), strict=True))
    rule.motion_was_restored()
