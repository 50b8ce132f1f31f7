"""Energies by term and their balance (stored + dissipated = put in)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from particles import system as entries
from particles.network import contacts

if TYPE_CHECKING:
    from particles.assembly import Assembly

_STORED = ("elastic_normal", "elastic_sliding", "elastic_rolling", "elastic_moment")
_DISSIPATED = {
    "friction_sliding": entries.FRICTION_SLIDING,
    "friction_rolling": entries.FRICTION_ROLLING,
    "friction_moment": entries.FRICTION_MOMENT,
    "viscous": entries.VISCOUS,
    "contact_loss": entries.LOSS,
    "mass_damping": entries.MASS_DAMPING,
    "local_damping": entries.LOCAL_DAMPING,
}
_WORKS = {
    "gravity_work": entries.GRAVITY,
    "external_work": entries.EXTERNAL,
    "wall_work": entries.WALLS,
    "held_work": entries.HELD,
}


def kinetic(state: np.ndarray) -> float:
    """Kinetic energy of all rows, J."""
    mass = 1.0 / state[:, 6]
    spin = 0.5 * (state[:, 4] * state[:, 5]) ** 2
    return float(0.5 * np.sum(mass * (state[:, 2] ** 2 + state[:, 3] ** 2 + spin)))


def stored(soil: Assembly) -> dict[str, float]:
    """Kinetic and elastic energies, J (elastic: histories and overlaps of pairs and plates)."""
    found = contacts(soil, with_walls=True)
    stiffness = found.constants[:, [0, 2, 5, 8]]
    parts = np.where(stiffness > 0.0, 0.5 * found.elastic**2 / np.where(stiffness > 0.0, stiffness, 1.0), 0.0)
    return {"kinetic": kinetic(soil._system.state), **dict(zip(_STORED, parts.sum(axis=0).tolist()))}


def table(soil: Assembly) -> dict[str, float]:
    """All terms, J; "imposed" is what the initial state and assignments of the caller put in."""
    sums = soil._system.sums
    terms = stored(soil)
    terms.update({name: float(sums[entry]) for name, entry in {**_DISSIPATED, **_WORKS}.items()})
    terms["imposed"] = soil._imposed
    return terms


def balance(soil: Assembly) -> float:
    """Stored and dissipated energy minus the work put in, J: zero but for the error of time integration."""
    terms = table(soil)
    works = sum(terms[name] for name in _WORKS) + terms["imposed"]
    return sum(terms[name] for name in ("kinetic", *_STORED, *_DISSIPATED)) - works
