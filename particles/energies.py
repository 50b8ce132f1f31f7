"""Energies by term and their balance (stored + dissipated = put in)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from particles import system as entries
from particles.network import contacts
from particles.network import stored as stored_in
from particles.walls import motion
from particles.walls.rows import GIVEN

if TYPE_CHECKING:
    from particles.assembly import Assembly

_DISSIPATED = {
    "friction_sliding": entries.FRICTION_SLIDING,
    "friction_rolling": entries.FRICTION_ROLLING,
    "friction_moment": entries.FRICTION_MOMENT,
    "viscous": entries.VISCOUS,
    "contact_loss": entries.LOSS,
    "breaking": entries.BREAKING,
    "mass_damping": entries.MASS_DAMPING,
    "local_damping": entries.LOCAL_DAMPING,
}
_WORKS = {
    "gravity_work": entries.GRAVITY,
    "external_work": entries.EXTERNAL,
    "wall_work": entries.WALLS,
    "held_work": entries.HELD,
    "cell_work": entries.CELL,
}


def kinetic(soil: Assembly) -> float:
    """Kinetic energy of all particles, J."""
    system = soil._system
    masses, inertias = soil._masses[soil._ids], soil._inertias[soil._ids]
    square = system.velocity[:, :3] ** 2
    if system.spin is None:
        return float(0.5 * (masses @ (square[:, 0] + square[:, 1]) + inertias @ square[:, 2]))
    return float(0.5 * (masses @ square.sum(axis=1) + inertias @ (system.spin[:, :3] ** 2).sum(axis=1)))


def stored(soil: Assembly) -> dict[str, float]:
    """Kinetic and elastic energies, J (elastic: histories and overlaps of pairs and walls; walls: the free ones)."""
    elastic = stored_in(soil, contacts(soil, with_walls=True, with_forces=False))
    walls = soil._system.walls
    return {
        "kinetic": kinetic(soil), **{f"elastic_{name}": energy for name, energy in elastic.items()},
        "kinetic_walls": 0.0 if walls is None else motion.kinetic(walls.body),
    }  # fmt: skip


def table(soil: Assembly) -> dict[str, float]:
    """All terms, J; "wall_work" is that of what moves the walls, loads and gravity on free ones included; "imposed" is what the initial state and assignments of the caller put in."""
    sums = soil._system.sums
    terms = stored(soil)
    terms.update({name: float(sums[entry]) for name, entry in {**_DISSIPATED, **_WORKS}.items()})
    walls = soil._system.walls
    terms["imposed"] = soil._imposed + (0.0 if walls is None else float(walls.body[:, GIVEN].sum()))
    return terms


def balance(soil: Assembly) -> float:
    """Stored and dissipated energy minus the work put in, J: zero but for the error of time integration."""
    return balance_of(table(soil))


def balance_of(terms: dict[str, float]) -> float:
    """The same from a table of all terms."""
    works = sum(terms[name] for name in _WORKS) + terms["imposed"]
    return sum(energy for name, energy in terms.items() if name not in _WORKS and name != "imposed") - works
