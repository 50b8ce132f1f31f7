"""Changes of elements while a run goes on, with the energies that they lose in the account."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from bridge.manifold.kinds import PARTICLES

if TYPE_CHECKING:
    from bridge.manifold.body import Manifold


@contextmanager
def booked(body: Manifold, name: str) -> Iterator[None]:
    """What a change inside takes from the kinetic and the elastic energy is booked as `name`_kinetic and `name`_strain."""
    body.prepare()
    before = body._account()
    yield
    body._ready = False
    body._settle()
    after = body._account()
    lost = before[0] - after[0], before[1] - after[1]
    body._lost[f"{name}_kinetic"] += lost[0]
    body._lost[f"{name}_strain"] += lost[1]
    body._base += after[2] + sum(lost) - before[2]


def exchange(body: Manifold, elements: np.ndarray, changed: np.ndarray) -> None:
    """Everything that depends on which elements are left to particles.

    Args:
        body: with its kinds as they are now.
        elements: those that have been left to particles, or taken from them.
        changed: further elements that have changed.
    """
    near, free = body.grid.around(elements), body._free_rows()
    body.lattice.refresh(free, ~free, body.grid.sites_of(near))
    body._arrange(np.union1d(changed, near))


def release(body: Manifold, elements: np.ndarray) -> None:
    """See `Manifold.release`."""
    elements = np.asarray(elements, dtype=np.int64)
    elements = elements[body.kind[elements] != PARTICLES]
    if len(elements) == 0:
        return
    with booked(body, "release"):
        state, sites = body.lattice._state, body.grid.sites_of(elements)
        nodes, shape = body.grid.nodes[body.grid.element[sites]], body._shape[body.grid.slot[sites]]
        for own, nodal in ((state.displacement, body._nodes.displacement), (state.velocity, body._nodes.velocity)):
            own[:, sites] = np.einsum("sc,asc->as", shape, nodal[:, nodes])
        body._add_mass(elements, -1.0)
        body.kind[elements] = PARTICLES
        exchange(body, elements, body._surround(body.kind, elements))
        body.first_released = body.first_released if body.released else elements
        body.released += len(elements)
        body.release_log.append((body.time, body.released))
