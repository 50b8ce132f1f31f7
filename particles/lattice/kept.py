"""What a lattice carries from one step to the next, as named arrays, and back.

Lists, clusters and strains follow from it. The scene (sites, materials, loads, held rows) is made again by the script.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from particles.lattice.lattice import Lattice

State = dict[str, Any]

KEPT = ("displacement", "velocity", "force", "acting", "stored", "sums")


def state_of(lattice: Lattice) -> State:
    """State of a lattice, or of the particles of a body that elements carry, too; forces are made ready."""
    if not lattice.carried.any():
        lattice.prepare()
    state = lattice._state
    arrays = {name: getattr(state, name) for name in ("bonds", *KEPT)}
    if lattice._owner is not None:  # sums of energies go by ranks
        arrays["owner"], arrays["ranks"] = lattice._owner
    return arrays | {"free": lattice.free, "carried": lattice.carried, "numbers": np.array([lattice.time, lattice._base])}


def restore(lattice: Lattice, kept: State) -> None:
    """Put a state of `state_of` back, from where steps go on to the same bits.

    Raises:
        ValueError: it is not of this lattice.
    """
    state = lattice._state
    if kept["bonds"].shape != state.bonds.shape:
        raise ValueError(f"state has {len(kept['bonds'])} particles on the lattice, this one {lattice.count}: make the same scene")
    state.bonds[:] = kept["bonds"]
    lattice.refresh(np.asarray(kept["free"], dtype=bool), np.asarray(kept["carried"], dtype=bool))
    for name in KEPT:
        getattr(state, name)[:] = kept[name]
    lattice.time, lattice._base = (float(number) for number in kept["numbers"])
    lattice.driving.arrange(lattice.free)
    lattice._ready, lattice._parts = True, None
    lattice._owner = (np.array(kept["owner"]), int(kept["ranks"])) if "owner" in kept else None
