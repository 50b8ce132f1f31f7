"""Held components of particles: rows of infinite mass, and the list of them by which the work of the holders is booked."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from particles.system import MASS, Held

if TYPE_CHECKING:
    from particles.assembly import Assembly


def compose(soil: Assembly) -> None:
    """Set one over masses and inertias of all rows, zero where a component is held, and find the held rows."""
    system = soil._system
    set_lightness(soil, system.lightness, system.nimbleness, soil._ids)
    soil._held_ids = np.fromiter(soil._held, dtype=np.int64, count=len(soil._held))
    soil._held_free = free = np.array(list(soil._held.values())).reshape(-1, soil.freedoms)
    rows = soil._rows[soil._held_ids]
    for values, part in ((system.lightness, free[:, :3]), (system.nimbleness, free[:, 3:])):
        if values is not None:
            values[rows, :3] *= part
    system.acceleration[rows, :3] *= free[:, :3]
    if system.angular is not None:
        system.angular[rows, :3] *= free[:, 3:]
    place(soil)


def place(soil: Assembly) -> None:
    """Find the held particles in the present order of the rows."""
    held = None
    if soil._held:
        rows = soil._rows[soil._held_ids]
        order = np.argsort(rows)
        held = Held(rows[order], soil._held_free[order])
    soil._system = soil._system._replace(held=held)


def set_lightness(soil: Assembly, lightness: np.ndarray, nimbleness: np.ndarray | None, ids: np.ndarray) -> None:
    """One over masses and inertias for rows of these ids, all free."""
    masses, inertias = soil._masses[ids], soil._inertias[ids]
    lightness[:, :3], lightness[:, MASS] = 1.0 / masses[:, None], masses
    if nimbleness is None:
        lightness[:, 2] = 1.0 / inertias
    else:
        nimbleness[:, :3], nimbleness[:, MASS] = 1.0 / inertias[:, None], inertias
