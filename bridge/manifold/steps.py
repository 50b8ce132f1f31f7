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
    for q in range(len(elements.carried)):
        i, e, slot = elements.carried[q], elements.carrier[q], elements.slot[q]
        for a in range(len(elements.axes)):
            u = v = 0.0
            for c in range(len(elements.corners)):
                node, weight = elements.node[e, c], elements.shape[slot, c]
                u += weight * nodes.displacement[a, node]
                v += weight * nodes.velocity[a, node]
            state.displacement[a, i] = u
            state.velocity[a, i] = v


@njit(**KERNEL)
def element_forces(nodes, elements):
    """Nodal forces - K u of all elements, written into `force`, as sums of lines of K, which is symmetric."""
    f, u, moved = nodes.force, nodes.displacement, elements.room
    axes, corners = len(elements.axes), len(elements.corners)
    for a in range(3):
        for i in range(f.shape[1]):
            f[a, i] = 0.0
    for q in range(len(elements.active)):
        e = elements.active[q]
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
    """Forces on carried particles to the nodes: F_e = N F (eq 38); published forces are on those with bonds to free particles alone."""
    for q in range(len(elements.carried)):
        i, e, slot = elements.carried[q], elements.carrier[q], elements.slot[q]
        if moment is None and state.force_kind[i] == NONE:
            continue
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
def _hand_over_booked(state, terms, moment, nodes, elements, half, booked):
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
            i, e, slot = elements.carried[q], elements.carrier[q], elements.slot[q]
            if state.force_kind[i] == NONE:
                continue
            x, y, z = couple_of(state, terms, i)
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
    _hand_over_booked(state, terms, state.moment, nodes, elements, 0.5 * h, booked)
    motion.act(state, terms.damping, drive, s, h, booked)
    act(nodes, elements, elements.inertia, terms.damping, nodal_drive, s, h, booked)


@njit(**OUTER)
def advance(state, terms, nodes, elements, drive, nodal_drive, steps, h):
    """Whole steps of particles and nodes together, as `particles.lattice.motion.advance`."""
    booked = 1.0 if steps else 0.0
    motion.kick(state, booked * 0.5 * h, booked * h)
    motion.kick(nodes, booked * 0.5 * h, booked * h)
    for s in range(max(steps, 1)):
        evaluate(state, terms, nodes, elements, drive, nodal_drive, s, h, booked)
        if s < steps - 1:
            motion.kick(state, h, h)
            motion.kick(nodes, h, h)
    motion.kick(state, booked * 0.5 * h, 0.0)
    motion.kick(nodes, booked * 0.5 * h, 0.0)
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
def strains_at(nodes, elements, chosen, matrix, strain):
    """Strains (chosen, 6) of elements by a strain matrix (6, dofs)."""
    axes = len(elements.axes)
    for q in range(len(chosen)):
        for r in range(6):
            total = 0.0
            for c in range(len(elements.corners)):
                node = elements.node[chosen[q], c]
                for a in range(axes):
                    total += matrix[r, axes * c + a] * nodes.displacement[a, node]
            strain[q, r] = total


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
