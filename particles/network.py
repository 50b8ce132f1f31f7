"""The contact network: pairs, normals, forces; trial forces on copies."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from particles import motion, neighbours, walls
from particles.dispatch import Direct
from particles.laws.li_chu import COLUMNS
from particles.system import PLATE_DX, PLATE_DY, System, Terms

if TYPE_CHECKING:
    from particles.assembly import Assembly


evaluate, kick = Direct(motion.evaluate), Direct(motion.kick)


class Contacts(NamedTuple):
    """Contacts with the elastic part of their forces (dashpots are left out); plates have no id: second = -1."""

    first: np.ndarray  # (k,) id of disc i
    second: np.ndarray  # (k,) id of disc j, -1 for a plate
    plate: np.ndarray  # (k,) index of the plate, -1 for pairs of discs
    normal: np.ndarray  # (k, 2) from i to j, unit
    overlap: np.ndarray  # (k,) m, negative for a gap
    first_arm: np.ndarray  # (k,) lever arm of i, m
    second_arm: np.ndarray  # (k,) lever arm of j, m (0 for a plate)
    force: np.ndarray  # (k, 2) on i, N
    moment: np.ndarray  # (k,) couple on i from rolling force and rolling moment, N m
    elastic: np.ndarray  # (k, 4) history: normal force, sliding force, rolling force (N), rolling moment (N m)
    constants: np.ndarray  # (k, 12) of the law, see LiChu.row


def rolling_radius(contacts: Contacts) -> np.ndarray:
    """Rolling radius of each contact (k,), m: l_i l_j / (l_i + l_j), for a plate l_i; times the law's factor."""
    a, b = contacts.first_arm, contacts.second_arm
    radius = np.where(contacts.plate >= 0, a, a * b / np.where(a + b > 0.0, a + b, 1.0))
    return radius * contacts.constants[:, 11]


def _columns(soil: Assembly, history: np.ndarray) -> np.ndarray:
    """Histories (k, 3) with zero columns for absent channels."""
    full = np.zeros((len(history), 3))
    law = soil._law
    present = [c for c, channel in enumerate((law.sliding, law.rolling, law.moment)) if channel is not None]
    full[:, present] = history
    return full


def pairs(soil: Assembly, contact_range: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows i, j and histories (k, 3) of all pairs with overlap > -contact_range (r_i + r_j)."""
    system = soil._system
    start, neighbour, history = system.start, system.neighbour, system.history
    if soil.count and 2.0 * contact_range * soil._radii.max() > 0.0:
        # also pairs that the list does not hold, or no longer holds
        skin = 2.0 * contact_range * soil._radii.max()
        width = 2.0 * soil._radii.max() + skin
        start, neighbour = neighbours.list_pairs(system.state, soil._ghost[soil._ids], width, skin, 4 * soil.count + 16)
        history = np.zeros((neighbour.size, system.history.shape[1]))
        rows = np.arange(soil.count, dtype=np.int32)
        neighbours.carry_history(
            start, neighbour, history, system.start, system.neighbour, system.history, rows, soil._columns_that_turn
        )
    first = np.repeat(np.arange(soil.count), np.diff(start))
    second = neighbour.astype(np.int64)
    reach = system.state[first, 5] + system.state[second, 5]
    branch = system.state[second, :2] - system.state[first, :2]
    near = reach * (1.0 + contact_range) > np.hypot(branch[:, 0], branch[:, 1])
    return first[near], second[near], _columns(soil, history[near])


def contacts(soil: Assembly, with_walls: bool = False, contact_range: float = 0.0) -> Contacts:
    """Contacts of discs, and with plates on request; forces are zero where there is a gap."""
    if not (np.isfinite(contact_range) and contact_range >= 0.0):
        raise ValueError(f"contact_range={contact_range} must be zero or positive (share of the radii)")
    state = soil._system.state
    i, j, history = pairs(soil, contact_range)
    branch = state[j, :2] - state[i, :2]
    distance = np.hypot(branch[:, 0], branch[:, 1])
    overlap = state[i, 5] + state[j, 5] - distance
    first_arm = state[i, 5] - 0.5 * overlap
    if soil._table is None:
        constants = np.broadcast_to(next(iter(soil.laws.values())).row(), (i.size, COLUMNS))
    else:
        constants = soil._table[soil._system.material[i], soil._system.material[j]]
    found = _assemble(
        soil, soil._ids[i], soil._ids[j], np.full(i.size, -1), branch / distance[:, None], overlap, first_arm,
        distance - first_arm, history, constants,
    )  # fmt: skip
    if with_walls and soil._system.walls is not None:
        touching = _wall_contacts(soil, contact_range)
        found = Contacts(*(np.concatenate(parts) for parts in zip(found, touching)))
    return found


def _wall_contacts(soil: Assembly, contact_range: float) -> Contacts:
    system = soil._system
    plates = system.walls
    normal = np.zeros((plates.row.size, 2))
    distance = np.zeros(plates.row.size)
    for c, (i, k) in enumerate(zip(plates.row, plates.plate)):
        x, y = system.state[i, :2] - plates.plates[k, :2]
        first, last = plates.corner_start[k : k + 2]
        normal[c, 0], normal[c, 1], distance[c], _ = walls.closest_point(plates.corners, first, last, x, y)
    radius = system.state[plates.row, 5]
    near = radius * (1.0 + contact_range) > distance
    material = 0 if system.material is None else system.material[plates.row]
    constants = plates.laws[plates.plate, material]
    history = _columns(soil, plates.history)
    row, plate, normal, distance, history = (a[near] for a in (plates.row, plates.plate, normal, distance, history))
    return _assemble(
        soil, soil._ids[row], np.full(row.size, -1), plate, normal, radius[near] - distance, distance,
        np.zeros(row.size), history, constants[near],
    )  # fmt: skip


def _assemble(soil, first, second, plate, normal, overlap, first_arm, second_arm, history, constants) -> Contacts:
    normal_force = np.maximum(0.0, constants[:, 0] * overlap)
    tangent = np.column_stack([-normal[:, 1], normal[:, 0]])
    along = history[:, 0]
    couple = -history[:, 2]
    empty = np.zeros(first.size)
    found = Contacts(
        first, second, plate, normal, overlap, first_arm, second_arm, np.zeros((first.size, 2)), empty,
        np.column_stack([normal_force, history]), constants,
    )  # fmt: skip
    if soil._law.literal is None:
        couple = couple - rolling_radius(found) * history[:, 1]
    else:
        along = along - history[:, 1]
    force = along[:, None] * tangent - normal_force[:, None] * normal
    return found._replace(force=force, moment=couple)


class Before(NamedTuple):
    """Histories before the last evaluation and the displacements of the step that led to it."""

    history: np.ndarray  # (pairs, channels)
    wall_history: Any  # None or (listed, channels)
    moved: np.ndarray  # (n, 3), row order, m and rad


def trial_forces(
    system: System, terms: Terms, increment: np.ndarray, velocity: np.ndarray, before: Before | None = None
) -> np.ndarray:
    """Forces (n, 3) in row order at a displaced state; see `Assembly.trial_forces`.

    With `before` the last step is made again with the displacement `moved + increment`: with a zero increment the forces
    are those of the last evaluation, slip and dashpots included.
    """
    state = system.state.copy()
    state[:, :2] += increment[:, :2]
    state[:, 7] += increment[:, 2]
    # one step of unit size: the row velocity is the displacement of the step, and the predictor is the velocity given
    moved = increment if before is None else before.moved + increment
    state[:, 2:5] = moved
    history = system.history if before is None else before.history
    trial = system._replace(
        state=state, acceleration=np.ascontiguousarray(2.0 * (velocity - moved)), force=np.zeros_like(system.force),
        history=history.copy(), sums=np.zeros_like(system.sums),
    )  # fmt: skip
    if system.walls is not None:
        plates, history = system.walls.plates.copy(), system.walls.history
        if before is None:
            plates[:, PLATE_DX] = plates[:, PLATE_DY] = 0.0
        else:
            history = before.wall_history
        trial = trial._replace(walls=system.walls._replace(plates=plates, history=history.copy()))
    evaluate(trial, terms, 1.0)
    return trial.force
