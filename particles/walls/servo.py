"""What the servo control of walls needs to know of the contacts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from particles.laws.touch import FLAT
from particles.network import contacts, dashpots, stiffnesses
from particles.walls.rows import DASHPOT, GAIN, OWNER, STIFFNESS

if TYPE_CHECKING:
    from particles.assembly import Assembly

SLIGHT = 1e-3  # overlap of a contact that is yet to come, in mean radii


def set_contact_constants(soil: Assembly) -> None:
    """Tell controlled walls the stiffness and dashpot of one contact: the largest of those that are and of one to come."""
    walls = soil.system.walls
    if walls is None or not (walls.body[:, GAIN : GAIN + 3] > 0.0).any():
        return
    found = contacts(soil, with_walls=True)
    now = np.column_stack([stiffnesses(soil, found)[:, 0], dashpots(soil, found)[:, 0]])
    radius, mass = np.array([soil._mean_radius]), np.array([soil._mean_mass])
    flat = np.column_stack([radius, [FLAT]])
    for b, body in enumerate(walls.body):
        own = np.flatnonzero(walls.wall[:, OWNER] == b)
        laws = [soil.all_laws[k] for k in soil._plate_laws[own].ravel()]
        values = [now[np.isin(found.plate, own)]]
        for law in laws:
            stiffness = law.stiffness(SLIGHT * radius, flat, radius)[:, :1]
            values.append(np.hstack([stiffness, law.damping(SLIGHT * radius, flat, radius, mass)[:, :1]]))
        body[STIFFNESS], body[DASHPOT] = np.concatenate(values).max(axis=0)
