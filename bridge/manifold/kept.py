"""What a body of particles and elements carries from one step to the next, as named arrays, and back.

Stiffnesses, lists and driving follow from it. The scene is made again by the script.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from bridge.manifold.body import LOST, Manifold
from particles.lattice import kept as lattice_kept

State = dict[str, Any]

KEPT = ("displacement", "velocity", "force", "sums", "couples")


def state_of(body: Manifold) -> State:
    """State of a body; forces are made ready."""
    body.prepare()
    nodes, back = body._nodes, body.recoarsener
    found = {
        "lattice": lattice_kept.state_of(body.lattice), "kind": body.kind, "node_mass": body.node_mass,
        "nodes": {name: getattr(nodes, name) for name in KEPT}, "release_log": np.array(body.release_log),
        "first_released": body.first_released, "lost": np.array([body._lost[name] for name in LOST]),
        "numbers": np.array([body.time, body._base]), "released": body.released, "unseen": body.unseen,
    }  # fmt: skip
    if body._inertia is not None:
        found["before"] = body._inertia.before
    if back is not None:
        found["recoarsening"] = {"since": back.since, "steps": back.steps, "returned": back.returned}
    return found


def restore(body: Manifold, kept: State) -> None:
    """Put a state of `state_of` back, from where steps go on to the same bits.

    Raises:
        ValueError: it is not of this body.
    """
    if kept["kind"].shape != body.kind.shape or kept["node_mass"].shape != body.node_mass.shape:
        raise ValueError(f"state has {len(kept['kind'])} elements, this body {len(body.kind)}: make the same scene")
    lattice_kept.restore(body.lattice, kept["lattice"])
    body.kind[:], body.node_mass[:] = kept["kind"], kept["node_mass"]
    body._arrange(np.arange(body.grid.count))
    for name in KEPT:
        getattr(body._nodes, name)[:] = kept["nodes"][name]
    body.release_log = [(float(time), int(count)) for time, count in kept["release_log"]]
    body.first_released, body.released = np.asarray(kept["first_released"]), int(kept["released"])
    body.unseen = int(kept["unseen"])
    body._lost = dict(zip(LOST, (float(value) for value in kept["lost"])))
    body.time, body._base = (float(number) for number in kept["numbers"])
    if body._inertia is not None:
        body._inertia.before[:] = kept["before"]
    if body.recoarsener is not None:
        back = kept["recoarsening"]
        body.recoarsener.since[:] = back["since"]
        body.recoarsener.steps, body.recoarsener.returned = int(back["steps"]), int(back["returned"])
    body._arrange_driving()
    body._ready, body._parts = True, None
