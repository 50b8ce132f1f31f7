"""Forces and energies round elements that are about to change, in the middle of a step, without a look at the whole body.

With u of the end of a step and v of its middle the account is K(v) + E(u) + h/2 v.F(u), with F the forces of bonds and elements at u: it
is what it was in the middle of the step before, less what was put in (see `particles.lattice.motion`). A release changes all three terms, each where
bonds or elements change alone.
"""

from __future__ import annotations

from numba import njit

from bridge.manifold.steps import carry, couple_to_nodes, couples, force_to_nodes, hand_over_booked, pull
from particles.lattice import motion
from particles.lattice.some import energy_of, forces_of, strains_of
from particles.lattice.state import AWAKE, NONE
from particles.system import KERNEL, OUTER, STEPS


@njit(**KERNEL)
def _of_elements(nodes, elements, chosen):
    """Elastic energy (J) of some elements, whose forces become those of the nodes."""
    u, f, energy = nodes.displacement, nodes.force, 0.0
    for a in range(3):
        for i in range(f.shape[1]):
            f[a, i] = 0.0
    for e in chosen:
        pull(nodes, elements, e)
    for a in range(3):
        for i in range(f.shape[1]):
            energy -= 0.5 * f[a, i] * u[a, i]
    return energy


@njit(**OUTER)
def account(state, terms, moment, nodes, elements, chosen, rows, around, carried):
    """Elastic energy (J) and power v.F (W) of elements and bonds at displacements of now, with F written into the forces.

    Args:
        moment: of the variational form, which takes all rows; None for the published one.
        chosen: (k,) elements.
        rows: (r,) in order: whose forces, and whose bonds in even directions, count.
        around: those rows and their neighbours, in order.
        carried: (c,) which of the carried rows (`elements.carried`) are among `rows`.
    """
    carry(state, nodes, elements)
    energy, power = _of_elements(nodes, elements, chosen), 0.0
    if moment is None:
        strains_of(state, terms, around)
        energy += energy_of(state, terms, rows, None)
        forces_of(state, terms, terms.smallest, rows)
    else:
        energy += motion.elastic(state, terms)
    for q in carried:
        if moment is not None or state.force_kind[elements.carried[q]] != NONE:
            force_to_nodes(state, nodes, elements, q)
            if moment is None:
                couple_to_nodes(state, terms, elements, q, nodes.force)
    for a in range(3):
        for i in range(nodes.force.shape[1]):
            power += nodes.velocity[a, i] * nodes.force[a, i]
        for i in rows:
            if state.moving[i]:
                power += state.velocity[a, i] * state.force[a, i]
    return energy, power


@njit(**STEPS)
def audit_before(state, terms, nodes, elements, half):
    """Book the excess work since the last evaluation, at displacements of now, with bonds and elements as they still are."""
    carry(state, nodes, elements)
    motion.strains(state, terms, terms.plane)
    motion.bond_forces(state, terms, state.moment, terms.plane, terms.smallest)
    motion.audit(state, terms, half, 1.0)
    hand_over_booked(state, terms, state.moment, nodes, elements, half, 1.0)


@njit(**STEPS)
def audit_after(state, terms, nodes, elements):
    """Let the next evaluation, at the same displacements, book no excess work: what is kept of the last forces is less those of now."""
    carry(state, nodes, elements)
    state.stored[0] = motion.elastic(state, terms)
    last = nodes.couples[0]
    for a in range(3):
        for i in range(last.shape[1]):
            last[a, i] = 0.0
    couples(state, terms, state.moment, elements, last)
    for a in range(3):
        for i in range(last.shape[1]):
            last[a, i] = -last[a, i]
    for q in range(state.counts[AWAKE]):
        for i in range(state.awake[q, 0], state.awake[q, 1]):
            for a in range(3):
                state.acting[a, i] = -state.force[a, i]
