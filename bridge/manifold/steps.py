"""Compiled loops of a body of elements and particles: particles carried by elements, element forces, whole steps."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from numba import njit

from bridge.manifold.inertia import spread
from particles.lattice import motion
from particles.lattice.general import shear_of, stiffness_of
from particles.lattice.lanes import WIDTH, even, load, store
from particles.lattice.state import BROKEN, EXCESS, EXPLICIT, NONE
from particles.system import KERNEL, OUTER, STEPS


class Nodes(NamedTuple):
    """Motion of the nodes, as `particles.lattice.motion` wants points."""

    displacement: Any  # (3, nodes), m
    velocity: Any  # (3, nodes), m/s
    force: Any  # (3, nodes), N
    lightness: Any  # (nodes,) 1/kg; 0 where no element is left
    moving_runs: Any  # (runs, 2) int32
    counts: Any  # (5,) int64
    sums: Any  # energy sums, J
    couples: Any  # (2, 3, nodes) where excess work is booked, else (2, 3, 0): forces of `couples` before and now, N


class Elements(NamedTuple):
    """Elements that are there, by type of stiffness, and the particles that they carry."""

    axes: Any  # 0, 1, 2 in space; 0, 1 in the plane: loops over tuples are unrolled
    corners: Any  # 0 to 7, 0 to 3; those that are distinct (see `bridge.manifold.grid`)
    node: Any  # (elements, corners) int32
    kind: Any  # (elements,) int32
    stiffness: Any  # (kinds, dofs, dofs or more), N/m, dofs = corners x axes; whole vectors a line
    active: Any  # (active,) int32 elements
    carried: Any  # (carried,) int32 rows of the lattice
    carrier: Any  # (carried,) int32 element of each
    slot: Any  # (carried,) int32 place in it
    shape: Any  # (slots, corners) shape functions of the places
    gradient: Any  # (slots, corners, axes) their gradients, 1/m
    room: Any  # (3 vectors,)
    inertia: Any  # None (lumped mass) or Inertia


@njit(**KERNEL)
def carry(state, nodes, elements):
    """Displacements and velocities of carried particles by those of the nodes: u = N u_e (eq 39)."""
    u, v = nodes.displacement, nodes.velocity
    for q in range(len(elements.carried)):
        i, e, slot = elements.carried[q], elements.carrier[q], elements.slot[q]
        ux = uy = uz = vx = vy = vz = 0.0
        for c in range(len(elements.corners)):
            node, weight = elements.node[e, c], elements.shape[slot, c]
            ux, uy, vx, vy = ux + weight * u[0, node], uy + weight * u[1, node], vx + weight * v[0, node], vy + weight * v[1, node]
            if len(elements.axes) == 3:
                uz, vz = uz + weight * u[2, node], vz + weight * v[2, node]
        state.displacement[0, i], state.displacement[1, i], state.displacement[2, i] = ux, uy, uz
        state.velocity[0, i], state.velocity[1, i], state.velocity[2, i] = vx, vy, vz


@njit(**KERNEL)
def element_forces(nodes, elements):
    """Nodal forces of all elements, written into `force`."""
    f = nodes.force
    for a in range(3):
        for i in range(f.shape[1]):
            f[a, i] = 0.0
    for q in range(len(elements.active)):
        pull(nodes, elements, elements.active[q])


@njit(**KERNEL)
def pull(nodes, elements, e):
    """Add the nodal forces - K u of an element, as sums of lines of K, which is symmetric."""
    f, u, moved = nodes.force, nodes.displacement, elements.room
    axes, corners = len(elements.axes), len(elements.corners)
    matrix = elements.stiffness[elements.kind[e]]
    for c in range(corners):
        for a in range(axes):
            moved[axes * c + a] = u[a, elements.node[e, c]]
    first = second = third = even(0.0)
    for r in range(axes * corners):
        line, by = matrix[r], moved[r]
        first = first + load(line, 0) * by
        if axes * corners > WIDTH:
            second = second + load(line, WIDTH) * by
        if axes * corners > 2 * WIDTH:
            third = third + load(line, 2 * WIDTH) * by
    store(moved, 0, first)
    store(moved, WIDTH, second)
    store(moved, 2 * WIDTH, third)
    for c in range(corners):
        node = elements.node[e, c]
        for a in range(axes):
            f[a, node] -= moved[axes * c + a]


@njit(**KERNEL)
def hand_over(state, moment, nodes, elements):
    """Forces on carried particles to the nodes; published forces are on those with bonds to free particles alone."""
    for q in range(len(elements.carried)):
        if moment is not None or state.force_kind[elements.carried[q]] != NONE:
            force_to_nodes(state, nodes, elements, q)


@njit(**KERNEL)
def force_to_nodes(state, nodes, elements, q):
    """The force on a carried particle to the nodes of its element: F_e = N F (eq 38)."""
    i, e, slot = elements.carried[q], elements.carrier[q], elements.slot[q]
    for a in range(len(elements.axes)):
        force = state.force[a, i]
        for c in range(len(elements.corners)):
            nodes.force[a, elements.node[e, c]] += elements.shape[slot, c] * force


@njit(**KERNEL)
def act(nodes, elements, inertia, damping, drive, s, h, booked):
    """What acts on nodes, and what their mass is beside the lumped one."""
    if inertia is None:
        motion.act(nodes, damping, drive, s, h, booked)
    else:
        motion.push(nodes, drive, s, h)
        spread(nodes, elements, inertia, drive)
        motion.hold(nodes, drive, s, h, booked)
        motion.book(nodes, inertia.before, drive, s, h, booked)


@njit(**KERNEL)
def hand_over_without_couples(state, terms, moment, nodes, elements):
    """Hand forces over, less the couples that bonds with a shear force of their own leave on carried particles."""
    hand_over(state, moment, nodes, elements)
    couples(state, terms, moment, elements, nodes.force)


@njit(**KERNEL)
def hand_over_booked(state, terms, moment, nodes, elements, half, booked):
    """The same; the work of the couples since the last evaluation is excess work, where this is booked."""
    if nodes.couples.size == 0:
        hand_over_without_couples(state, terms, moment, nodes, elements)
        return
    hand_over(state, moment, nodes, elements)
    power, before, now = 0.0, nodes.couples[0], nodes.couples[1]
    for a in range(3):
        for i in range(now.shape[1]):
            now[a, i] = 0.0
    couples(state, terms, moment, elements, now)
    for a in range(3):
        for i in range(now.shape[1]):
            power += nodes.velocity[a, i] * (before[a, i] + now[a, i])
            nodes.force[a, i] += now[a, i]
            before[a, i] = now[a, i]
    state.sums[EXCESS] += booked * half * power


@njit(**KERNEL)
def couples(state, terms, moment, elements, force):
    """Take couples away from carried particles, as forces that are added to `force` (3, nodes).

    A published shear force is across its bond: half of the couple X x F acts on each end. In a lattice those of all bonds of a particle
    cancel in uniform strain. What an element holds of the bonds of a carried particle has no couple; so those of the others, C, have
    none to cancel and are taken away by nodal forces 1/2 C x grad N, which have no resultant. `moment`: of the variational form, None
    for the published one.
    """
    if moment is None:
        for q in range(len(elements.carried)):
            if state.force_kind[elements.carried[q]] != NONE:
                couple_to_nodes(state, terms, elements, q, force)


@njit(**KERNEL)
def couple_to_nodes(state, terms, elements, q, force):
    """The same of one carried particle."""
    e, slot = elements.carrier[q], elements.slot[q]
    x, y, z = couple_of(state, terms, elements.carried[q])
    for c in range(len(elements.corners)):
        node, by = elements.node[e, c], elements.gradient[slot, c]
        force[0, node] -= 0.5 * z * by[1]
        force[1, node] += 0.5 * z * by[0]
        if len(elements.axes) == 3:
            force[0, node] += 0.5 * y * by[2]
            force[1, node] -= 0.5 * x * by[2]
            force[2, node] += 0.5 * (x * by[1] - y * by[0])


@njit(**KERNEL)
def couple_of(state, terms, i):
    """Half of the couple X x F (N m) of the shear forces of the explicit bonds of a row."""
    x = y = z = 0.0
    for k in range(state.near.shape[1]):
        if state.bonds[i, k] & (EXPLICIT | BROKEN) == EXPLICIT:
            j = state.near[i, k]
            half, arm = 0.5 * stiffness_of(terms.shear, state, i, j), terms.vectors[k]
            sx, sy, sz = shear_of(state, terms, i, j, k)
            x += half * (arm[1] * sz - arm[2] * sy)
            y += half * (arm[2] * sx - arm[0] * sz)
            z += half * (arm[0] * sy - arm[1] * sx)
    return x, y, z


@njit(**OUTER)
def evaluate(state, terms, nodes, elements, drive, nodal_drive, s, h, booked):
    """All forces at the displacements of now."""
    carry(state, nodes, elements)
    motion.forces(state, terms, h, booked)
    element_forces(nodes, elements)
    hand_over_booked(state, terms, state.moment, nodes, elements, 0.5 * h, booked)
    motion.act(state, terms.damping, drive, s, h, booked)
    act(nodes, elements, elements.inertia, terms.damping, nodal_drive, s, h, booked)


@njit(**OUTER)
def advance(state, terms, nodes, elements, drive, nodal_drive, steps, h, ends):
    """Whole steps of particles and nodes together, from the middle of a step (see `begin`) to that of another one, or to the end of the last.

    Args:
        ends: whether displacements and velocities become those of one time.
    """
    for s in range(steps):
        evaluate(state, terms, nodes, elements, drive, nodal_drive, s, h, 1.0)
        if s < steps - 1 or not ends:
            motion.kick(state, h, h)
            motion.kick(nodes, h, h)
    if ends:
        motion.kick(state, 0.5 * h, 0.0)
        motion.kick(nodes, 0.5 * h, 0.0)
        carry(state, nodes, elements)


@njit(**STEPS)
def begin(state, nodes, h):
    """From displacements and velocities of one time to the middle of a step: displacements of its end, velocities half a step before."""
    motion.kick(state, 0.5 * h, h)
    motion.kick(nodes, 0.5 * h, h)


@njit(**OUTER)
def settle(state, terms, nodes, elements, drive, nodal_drive, h):
    """All forces of now, nothing booked."""
    evaluate(state, terms, nodes, elements, drive, nodal_drive, 0, h, 0.0)
    carry(state, nodes, elements)


@njit(**STEPS)
def carry_rows(state, nodes, elements):
    """`carry`, from Python."""
    carry(state, nodes, elements)


@njit(**STEPS)
def pull_nodes(state, terms, nodes, elements):
    """Forces of elements, and of the bonds of the particles that they carry, on the nodes."""
    element_forces(nodes, elements)
    hand_over_without_couples(state, terms, state.moment, nodes, elements)


@njit(**STEPS)
def act_on_nodes(nodes, elements, terms, drive, s, h):
    """`act`, booked, from Python."""
    act(nodes, elements, elements.inertia, terms.damping, drive, s, h, 1.0)


@njit(**STEPS)
def kick_both(state, nodes, by, drift):
    """`motion.kick` of particles and nodes."""
    motion.kick(state, by, drift)
    motion.kick(nodes, by, drift)


@njit(**OUTER)
def elastic(state, terms, nodes, elements):
    """Energies (J) of the explicit bonds and of the elements; forces become those of bonds and elements alone."""
    carry(state, nodes, elements)
    of_bonds = motion.elastic(state, terms)
    element_forces(nodes, elements)
    of_elements = 0.0
    for a in range(3):
        for i in range(nodes.force.shape[1]):
            of_elements -= 0.5 * nodes.force[a, i] * nodes.displacement[a, i]
    hand_over_without_couples(state, terms, state.moment, nodes, elements)
    return of_bonds, of_elements


@njit(**STEPS)
def strains_at(nodes, elements, chosen, table, strain):
    """Strains (chosen, numbers) of elements by a table (dofs, numbers) of strain matrices, whole vectors a line."""
    axes, corners, moved = len(elements.axes), len(elements.corners), elements.room
    for q in range(len(chosen)):
        for c in range(corners):
            for a in range(axes):
                moved[axes * c + a] = nodes.displacement[a, elements.node[chosen[q], c]]
        for first in range(0, table.shape[1], WIDTH):
            total = even(0.0)
            for r in range(axes * corners):
                total = total + load(table[r], first) * moved[r]
            store(strain[q], first, total)


@njit(**STEPS)
def largest_principal(strain, result):
    """Largest principal value (k,) of strains (k, 6) xx, yy, zz, yz, xz, xy, by the trigonometric solution."""
    for q in range(len(strain)):
        xx, yy, zz, yz, xz, xy = strain[q, 0], strain[q, 1], strain[q, 2], strain[q, 3], strain[q, 4], strain[q, 5]
        mean = (xx + yy + zz) / 3.0
        xx, yy, zz = xx - mean, yy - mean, zz - mean
        half = (xx * xx + yy * yy + zz * zz) / 6.0 + (yz * yz + xz * xz + xy * xy) / 3.0
        radius = math.sqrt(half)
        if not half * radius > 0.0:  # no deviator, or one that is too small for its cube
            result[q] = mean
            continue
        det = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
        cosine = min(1.0, max(-1.0, 0.5 * det / (half * radius)))
        result[q] = mean + 2.0 * radius * math.cos(math.acos(cosine) / 3.0)
