"""The contact network: pairs, normals, forces; trial forces on copies."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numba import njit

from particles import motion, neighbours
from particles.cell import PeriodicCell, nearest_image
from particles.dispatch import Direct
from particles.kinematics import turning
from particles.laws.touch import FLAT, Touch, respond, with_numbers
from particles.system import INLINE, OUTER, RADIUS, System, Terms
from particles.vectors import load
from particles.walls.contact import see_all
from particles.walls.motion import hold_walls, lightness_of

if TYPE_CHECKING:
    from particles.assembly import Assembly


evaluate, hold = Direct(motion.evaluate), Direct(hold_walls)
_see_all = Direct(see_all)


class Contacts(NamedTuple):
    """Contacts with the elastic part of their forces (dashpots are left out); walls have no id: second = -1.

    `d` is 2 or 3; rotational quantities have one component in the plane and three in space.
    """

    first: np.ndarray  # (k,) id of particle i
    second: np.ndarray  # (k,) id of particle j, -1 for a wall
    plate: np.ndarray  # (k,) index of the wall, -1 for pairs of particles
    normal: np.ndarray  # (k, d) from i to j, unit
    overlap: np.ndarray  # (k,) m, negative for a gap
    first_arm: np.ndarray  # (k,) lever arm of i, m
    second_arm: np.ndarray  # (k,) lever arm of j, m (0 for a wall)
    push: np.ndarray  # (k,) normal force, N
    force: np.ndarray  # (k, d) on i, N
    moment: np.ndarray  # (k,) or (k, 3) couple on i from rolling and torsion, N m
    history: dict[str, np.ndarray]  # (k, components) what the law remembers, by channel
    law: np.ndarray  # (k,) place in `Assembly.all_laws`
    image: np.ndarray  # (k, d) from particle i to its periodic image that touches a wall, m; zero otherwise


def rolling_radius(contacts: Contacts) -> np.ndarray:
    """Rolling radius of each contact (k,), m: l_i l_j / (l_i + l_j), for a wall l_i."""
    a, b = contacts.first_arm, contacts.second_arm
    return np.where(contacts.plate >= 0, a, a * b / np.where(a + b > 0.0, a + b, 1.0))


def radii_of(soil: Assembly, contacts: Contacts) -> np.ndarray:
    """Radii of both sides (k, 2), m; FLAT for walls."""
    radii = soil.radii
    return np.column_stack([radii[contacts.first], np.where(contacts.plate >= 0, FLAT, radii[contacts.second])])


def _history(contacts: Contacts, these: np.ndarray) -> dict[str, np.ndarray]:
    return {name: values[these] for name, values in contacts.history.items()}


def shares(soil: Assembly, contacts: Contacts) -> np.ndarray:
    """Share of each contact (k,) that the particles carry, see `Assembly.weigh`; contacts with walls count in full."""
    if soil._system.share is None:
        return np.ones(len(contacts.first))
    of_particle = soil._system.share[soil._rows, 0]
    radii, pairs = radii_of(soil, contacts), contacts.plate < 0
    one, other = of_particle[contacts.first], of_particle[np.where(pairs, contacts.second, 0)]
    a, b = radii.T
    return np.where(pairs, np.minimum((one * b + other * a) / (a + b), 1.0), 1.0)


def stiffnesses(soil: Assembly, contacts: Contacts) -> np.ndarray:
    """Tangent stiffness of normal, sliding (N/m), rolling, torsion (N m/rad) of each contact (k, 4), all sticking; its share."""
    found = np.zeros((len(contacts.first), 4))
    radii, rolling = radii_of(soil, contacts), rolling_radius(contacts)
    for k in np.unique(contacts.law):
        these = contacts.law == k
        found[these] = soil.all_laws[k].stiffness(
            contacts.overlap[these], radii[these], rolling[these], _history(contacts, these)
        )
    return found * shares(soil, contacts)[:, None]


def dashpots(soil: Assembly, contacts: Contacts) -> np.ndarray:
    """Dashpots of the same (k, 4), N s/m and N m s/rad."""
    found = np.zeros((len(contacts.first), 4))
    radii, rolling, masses = radii_of(soil, contacts), rolling_radius(contacts), soil.masses
    if soil._system.share is not None:
        masses = masses / soil._system.share[soil._rows, 1]
    of_wall = np.zeros(0) if soil.system.walls is None else lightness_of(soil.system.walls)
    at_wall = contacts.plate >= 0
    lightness = 1.0 / masses[contacts.first] + np.where(at_wall, 0.0, 1.0 / masses[contacts.second])
    lightness[at_wall] += of_wall[contacts.plate[at_wall]]
    for k in np.unique(contacts.law):
        these = contacts.law == k
        found[these] = soil.all_laws[k].damping(
            contacts.overlap[these], radii[these], rolling[these], 1.0 / lightness[these], _history(contacts, these)
        )
    return found * shares(soil, contacts)[:, None]


def stored(soil: Assembly, contacts: Contacts) -> dict[str, float]:
    """Elastic energy by channel, J."""
    radii, share = radii_of(soil, contacts), shares(soil, contacts)
    total: dict[str, float] = {}
    for k in range(len(soil.all_laws)):
        these = contacts.law == k
        energies = soil.all_laws[k].stored(contacts.overlap[these], radii[these], _history(contacts, these))
        for name, energy in energies.items():
            total[name] = total.get(name, 0.0) + float(energy @ share[these])
    return total


@njit(**INLINE)
def _resting_disc(law, blank, overlap, rolling, nx, ny, distance, radius_i, radius_j, values, k, stride):
    touch = Touch(
        overlap, 0.0, (0.0,), (0.0,), (0.0,), (0.0,), 0.0, 0.0, rolling, rolling, (nx, ny), distance, (radius_i, radius_j),
        1.0, (),
    )  # fmt: skip
    return respond(law, touch, load(values, k, stride, blank))


@njit(**OUTER)
def _rest_in_plane(law, numbers, blank, normal, overlap, distance, radii, rolling, history, push, tangential, couple):
    """Actions of contacts that do not move: normal force (k,), tangential force and couple on i (k, components)."""
    values = history.ravel()
    for k in range(push.size):
        answer = _resting_disc(
            with_numbers(law, numbers[k], 0, 1), blank, overlap[k], rolling[k], normal[k, 0], normal[k, 1], distance[k],
            radii[k, 0], radii[k, 1], values, k, push.size,
        )  # fmt: skip
        push[k], tangential[k, 0], couple[k, 0] = answer.normal, answer.tangential[0], answer.couple[0]


@njit(**INLINE)
def _resting_sphere(law, blank, overlap, rolling, n, distance, radius_i, radius_j, values, k, stride):
    still = (0.0, 0.0, 0.0)
    touch = Touch(
        overlap, 0.0, still, still, still, still, 0.0, 0.0, rolling, rolling, n, distance, (radius_i, radius_j), 1.0,
        turning(still, 1.0, n, n),
    )  # fmt: skip
    return respond(law, touch, load(values, k, stride, blank))


@njit(**OUTER)
def _rest_in_space(law, numbers, blank, normal, overlap, distance, radii, rolling, history, push, tangential, couple):
    """The same for spheres."""
    values = history.ravel()
    for k in range(push.size):
        answer = _resting_sphere(
            with_numbers(law, numbers[k], 0, 1), blank, overlap[k], rolling[k], (normal[k, 0], normal[k, 1], normal[k, 2]),
            distance[k], radii[k, 0], radii[k, 1], values, k, push.size,
        )  # fmt: skip
        push[k] = answer.normal
        for c in range(3):
            tangential[k, c], couple[k, c] = answer.tangential[c], answer.couple[c]


_rests = {2: Direct(_rest_in_plane), 3: Direct(_rest_in_space)}


def pairs(soil: Assembly, contact_range: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows i, j and histories (columns, k) of all pairs with overlap > -contact_range (r_i + r_j), and of all bonds."""
    system, axes = soil._system, soil.axes
    start, first, second, history = system.start, system.first, system.second, system.history
    if soil.count and 2.0 * contact_range * soil._radii.max() > 0.0:
        # also pairs that the list does not hold, or no longer holds
        skin = 2.0 * contact_range * soil._radii.max()
        if soil._laws.has_bonds:  # listed within the skin, stretched since by as much at most
            skin = max(skin, 2.0 * soil.skin)
        width = 2.0 * soil._radii.max() + skin
        grid = neighbours.grid_of(system.position, width, axes, system.cell)
        start, first, second = neighbours.list_pairs(
            grid, system.position, system.position[:, RADIUS].copy(), soil._ghost[soil._ids], skin, axes, 4 * soil.count,
            system.cell,
        )
        history = np.zeros((len(soil._laws.columns), first.size))
        rows = np.arange(soil.count, dtype=np.int32)
        neighbours.carry_history(
            start, second, history, system.start, system.second, system.history, rows, soil._laws.signs
        )
    count = int(start[-1])
    first, second = first[:count].astype(np.int64), second[:count].astype(np.int64)
    reach = system.position[first, RADIUS] + system.position[second, RADIUS]
    branch = nearest_image(soil.cell, system.position[second, :axes] - system.position[first, :axes])
    distance = np.linalg.norm(branch, axis=1)
    near = reach * (1.0 + contact_range) > distance
    if soil._laws.has_bonds:
        near |= soil._laws.all[0].reaches(reach - distance, soil._laws.by_channel(history[:, :count]))
    return first[near], second[near], history[:, :count][:, near]


def contacts(
    soil: Assembly, with_walls: bool = False, contact_range: float = 0.0, with_forces: bool = True
) -> Contacts:
    """Contacts of particles, and with walls on request; forces are zero where there is a gap and no bond, or not asked for."""
    if not (np.isfinite(contact_range) and contact_range >= 0.0):
        raise ValueError(f"contact_range={contact_range} must be zero or positive (share of the radii)")
    system, axes = soil._system, soil.axes
    i, j, history = pairs(soil, contact_range)
    branch = nearest_image(soil.cell, system.position[j, :axes] - system.position[i, :axes])
    distance = np.linalg.norm(branch, axis=1)
    radii = system.position[:, RADIUS]
    overlap = radii[i] + radii[j] - distance
    first_arm = radii[i] - 0.5 * overlap
    kinds = (i * 0, j * 0) if system.material is None else (system.material[i], system.material[j])
    found = _assemble(
        soil, soil._ids[i], soil._ids[j], np.full(i.size, -1), branch / distance[:, None], overlap, first_arm,
        distance - first_arm, history, soil._laws.of_pair[kinds], np.zeros((i.size, axes)), with_forces,
    )  # fmt: skip
    if with_walls and system.walls is not None:
        touching = _wall_contacts(soil, contact_range, with_forces)
        history_of = {name: np.concatenate([found.history[name], touching.history[name]]) for name in found.history}
        both: Any = (
            history_of if isinstance(a, dict) else np.concatenate([a, b]) for a, b in zip(found, touching, strict=True)
        )
        found = Contacts(*both)
    return found


def _wall_contacts(soil: Assembly, contact_range: float, with_forces: bool) -> Contacts:
    system, axes = soil._system, soil.axes
    listed = system.walls
    size = listed.row.size
    normal, distance, live = np.zeros((size, 3)), np.zeros(size), np.zeros(size)
    _see_all(listed, system.cell, system.position, None if axes == 2 else 1, normal, distance, live)
    radius = system.position[listed.row, RADIUS]
    near = (radius * (1.0 + contact_range) > distance) & (live > 0.0)
    row, wall, normal, distance = listed.row[near], listed.corners[listed.facet[near], 3], normal[near, :axes], distance[near]
    material = np.zeros(row.size, dtype=np.int64) if system.material is None else system.material[row]
    return _assemble(
        soil, soil._ids[row], np.full(row.size, -1), wall.astype(np.int64), normal, radius[near] - distance, distance,
        np.zeros(row.size), listed.history[:-1, near], soil._plate_laws[wall, material],
        np.zeros((row.size, axes)) if soil.cell is None else listed.image[near, :axes] @ soil.cell.matrix.T, with_forces,
    )  # fmt: skip


def _assemble(
    soil, first, second, plate, normal, overlap, first_arm, second_arm, history, law, image, with_forces
) -> Contacts:
    axes, count = soil.axes, first.size
    push, tangential, couple = np.zeros(count), np.zeros((count, 2 * axes - 3)), np.zeros((count, 2 * axes - 3))
    found = Contacts(
        first, second, plate, normal, overlap, first_arm, second_arm, push, normal, push, soil._laws.by_channel(history), law,
        image,
    )
    if count and with_forces:
        _rests[axes](
            soil._laws.template, soil._numbers[law], soil._laws.blank, np.ascontiguousarray(normal), overlap,
            first_arm + second_arm, radii_of(soil, found), rolling_radius(found), np.ascontiguousarray(history), push,
            tangential, couple,
        )  # fmt: skip
    if axes == 2:
        tangential = tangential * np.column_stack([-normal[:, 1], normal[:, 0]])
        couple = couple[:, 0]
    return found._replace(force=tangential - push[:, None] * normal, moment=couple)


def cell_stress(soil: Assembly, cell: PeriodicCell) -> np.ndarray:
    """Mean stress (axes, axes) in a periodic cell, Pa: sum of branch (x) force on i over the volume; tension positive.

    Contacts with walls count as well, with the arm of the particle. Elastic parts of the forces; without the momentum flux of the particles' own motion.
    """
    return virial(soil) / cell.volume


def virial(soil: Assembly) -> np.ndarray:
    """Sum (axes, axes) of branch (x) force on i over all contacts, J; those with walls with the arm of the particle."""
    found = contacts(soil, with_walls=True)
    branch = (found.first_arm + found.second_arm)[:, None] * found.normal
    return branch.T @ found.force


class Before(NamedTuple):
    """Histories before the last evaluation and the displacements of the step that led to it."""

    history: np.ndarray  # (columns, pairs)
    border_history: Any  # the same of contacts with particles of other ranks, None on one rank
    wall_history: Any  # None or (columns, listed)
    moved: np.ndarray  # (n, freedoms), row order, m and rad


def before_evaluation(system: System, step: float, border: System | None = None) -> Before:
    """What `trial_forces` needs to make the step of size `step` (s) that is under way again."""
    walls = None if system.walls is None else system.walls.history.copy()
    across = None if border is None else border.history.copy()
    return Before(system.history.copy(), across, walls, step * rows_of(system.velocity, system.spin))


def trial_forces(
    system: System, terms: Terms, increment: np.ndarray, velocity: np.ndarray, before: Before | None = None,
    border: System | None = None, halo: Any = None,
) -> np.ndarray:  # fmt: skip
    """Forces (n, freedoms) in row order at a displaced state; see `Assembly.trial_forces`.

    With `before` the last step is made again with the displacement `moved + increment`: with a zero increment the forces
    are those of the last evaluation, slip and dashpots included. With `border` and `halo`, contacts with particles of other
    ranks and the way to them, it is collective.
    """
    # one step of unit size: the row velocity is the displacement of the step, half the acceleration later it is that given
    moved = increment if before is None else before.moved + increment
    count, room = len(increment), system if border is None else border  # the border's arrays begin with the own rows
    long: dict[str, np.ndarray] = {}
    kinds = [("position", "velocity", "acceleration", "force")]
    kinds += [] if system.spin is None else [("rotation", "spin", "angular", "torque")]
    for k, (place, motion_of, change, force) in enumerate(kinds):
        part = slice(3 * k, 3 * k + 3)
        for name, values in ((place, increment), (motion_of, moved), (change, 2.0 * (velocity - moved))):
            if getattr(room, name) is None:
                continue
            long[name] = getattr(room, name).copy()
            long[name][:count, :3] = values[:, part] + (long[name][:count, :3] if name == place else 0.0)
        long[force] = np.zeros_like(getattr(room, force))
    trial = system._replace(**{name: rows[:count] for name, rows in long.items()})
    trial = _without_trace(trial, system.history if before is None else before.history)
    if border is not None:
        border = _without_trace(border._replace(**long), border.history if before is None else before.border_history)
    if system.walls is not None:
        history = system.walls.history if before is None else before.wall_history
        walls = system.walls._replace(
            body=system.walls.body.copy(), wall=system.walls.wall.copy(), history=history.copy()
        )
        if before is None:
            hold(walls)
        trial = trial._replace(walls=walls)
    evaluate(trial, terms, 1.0, border, halo)
    return rows_of(trial.force, trial.torque)


def _without_trace(system: System, history: np.ndarray) -> System:
    """The same with histories, sums and log of its own, that an evaluation may write to."""
    breaks = system.breaks
    if breaks is not None:
        breaks = breaks._replace(log=breaks.log.copy(), count=breaks.count.copy())
    return system._replace(history=history.copy(), sums=np.zeros_like(system.sums), breaks=breaks)


def rows_of(translations: np.ndarray, rotations: np.ndarray | None) -> np.ndarray:
    """Generalised components (n, freedoms) from rows of four, in the rows' order."""
    return translations[:, :3].copy() if rotations is None else np.hstack([translations[:, :3], rotations[:, :3]])
