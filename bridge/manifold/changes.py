"""Changes of elements while a run goes on, with the energies that they lose in the account."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from bridge.manifold import account
from bridge.manifold.kinds import PARTICLES
from particles.dispatch import Direct
from particles.lattice.driving import Driving

if TYPE_CHECKING:
    from bridge.manifold.body import Manifold

_account, _audit_before, _audit_after = Direct(account.account), Direct(account.audit_before), Direct(account.audit_after)


@contextmanager
def booked(body: Manifold, name: str) -> Iterator[None]:
    """Between two steps: what a change inside takes from the kinetic and the elastic energy is booked as `name`_kinetic and `name`_strain."""
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


class Change:
    """What changes where elements are left to particles, or taken from them: `changed` are all whose kind becomes another one.

    Args:
        body: the body, before it.
        elements: (k,) their numbers.
    """

    def __init__(self, body: Manifold, elements: np.ndarray) -> None:
        self._body, self.elements, self.changed = body, elements, elements
        self.sites = body.grid.sites_of(elements)
        self.rows = self._with_neighbours(self.sites)  # whose bonds change
        self.around = self._with_neighbours(self.rows)

    def _with_neighbours(self, rows: np.ndarray) -> np.ndarray:
        near = self._body.lattice._state.near
        found = np.zeros(len(near), dtype=bool)
        found[rows] = True
        beside = near[rows]
        found[beside[beside >= 0]] = True
        return np.flatnonzero(found)

    def carry_out(self) -> None:
        """Arrange everything by the kinds of elements as they are now."""
        body, lattice = self._body, self._body.lattice
        lattice.free[self.sites] = (body.kind == PARTICLES)[body.grid.element[self.sites]]
        lattice.refresh(lattice.free, ~lattice.free, self.rows)
        body._arrange(np.union1d(self.changed, body.grid.around(self.elements)), self.around)


def _kick(points: Any, driving: Driving, rows: np.ndarray, by: float) -> tuple[float, float]:
    """Velocities of components that are not held on by their forces for a time; the energy and the power v.F that it adds."""
    force = np.where(driving.is_held(rows), 0.0, points.force[:, rows])
    before, change = points.velocity[:, rows], by * points.lightness[rows] * force
    points.velocity[:, rows] = before + change
    return by * float((force * (before + 0.5 * change)).sum()), float((points.force[:, rows] * change).sum())


class Release(Change):
    """Elements that become particles, and those near that become manifold elements.

    Args:
        body: the body, before it.
        elements: (k,) their numbers; none of them is left to particles so far.
    """

    def __init__(self, body: Manifold, elements: np.ndarray) -> None:
        super().__init__(body, elements)
        kind, self._before = body.kind, body.kind.copy()
        kind[elements] = PARTICLES
        self.changed = np.concatenate((elements, body._surround(kind, elements)))

    def carry_out(self) -> None:
        """Hand the motion over, and arrange everything."""
        body, state = self._body, self._body.lattice._state
        nodes, shape = body.grid.nodes[body.grid.element[self.sites]], body._shape[body.grid.slot[self.sites]]
        for own, nodal in ((state.displacement, body._nodes.displacement), (state.velocity, body._nodes.velocity)):
            own[:, self.sites] = np.einsum("sc,asc->as", shape, nodal[:, nodes])
        body._add_mass(self.elements, -1.0)
        super().carry_out()

    @contextmanager
    def booked(self) -> Iterator[None]:
        """In the middle of a step: velocities go on to its end by the forces before the release, and back by those after it.

        So it is a release between two steps, to rounding. Without that particles would have a whole step of the kick by their own forces
        where half of it is due: the shortest waves would have up to 1.7 times the amplitude. Energies as in `bridge.manifold.account`.
        """
        body, lattice, half = self._body, self._body.lattice, 0.5 * self._body.step
        audited, nodes, state = lattice._state.acting.size > 0, self._body._nodes, self._body.lattice._state
        near = np.union1d(self.changed, body.grid.around(self.elements))  # whose stiffness changes
        own, near_nodes = np.unique(body.grid.nodes[self.elements]), np.unique(body.grid.nodes[near])
        near = body.grid.around(near)  # all that pull at their nodes
        beside = np.zeros(body.grid.count, dtype=bool)
        beside[near] = True
        carried = body._elements.carried
        acting = carried[beside[body._elements.carrier] & (state.force_kind[carried] > 0)]
        rows = np.union1d(self.rows, acting) if state.moment is None else np.arange(lattice.count)  # variational forces reach far
        around = np.union1d(self.around, self._with_neighbours(acting))
        if audited:
            _audit_before(state, lattice._terms, nodes, body._elements, half)
        beyond = body._influencing(self.elements)
        heavier = body._heavier(beyond)[0] if len(beyond) else 0.0
        elastic, power = self._account(near[self._before[near] != PARTICLES], rows, around)
        felt = self.sites if state.moment is None else rows  # whose forces change
        gained = _kick(nodes, body._nodal, near_nodes, half), _kick(state, lattice.driving, felt[lattice.free[felt]], half)
        kinetic = self._kinetic(own)
        yield
        kinetic -= self._kinetic(own)
        if audited:
            _audit_after(state, lattice._terms, nodes, body._elements)
        after, power_after = self._account(near[body.kind[near] != PARTICLES], rows, around)
        kicks = _kick(nodes, body._nodal, near_nodes, -half), _kick(state, lattice.driving, felt[lattice.free[felt]], -half)
        beyond = beyond[body.kind[beyond] != PARTICLES]
        heavier -= body._heavier(beyond)[0] if len(beyond) else 0.0
        body._lost["release_kinetic"] += kinetic + heavier
        body._lost["release_strain"] += elastic - after
        body._base += sum(one[0] for one in (*gained, *kicks)) + half * (power_after + sum(one[1] for one in kicks) - power)

    def _account(self, chosen: np.ndarray, rows: np.ndarray, around: np.ndarray) -> tuple[float, float]:
        lattice, elements = self._body.lattice, self._body._elements
        state, carried = lattice._state, np.flatnonzero(np.isin(elements.carried, rows, assume_unique=True))
        found: tuple[float, float] = _account(
            state, lattice._terms, state.moment, self._body._nodes, elements, chosen, rows, around, carried
        )
        return found

    def _kinetic(self, own: np.ndarray) -> float:
        """Of the nodes of what is released, and of its particles as far as they are free (J)."""
        body, rows = self._body, self.sites[self._body.lattice.free[self.sites]]
        return 0.5 * sum(
            float((velocity[:, where] ** 2).sum(axis=0) @ mass[where])
            for velocity, mass, where in (
                (body._nodes.velocity, body.node_mass, own), (body.lattice._state.velocity, body.lattice.mass, rows),
            )
        )  # fmt: skip


def release(body: Manifold, elements: np.ndarray, inside: bool) -> None:
    """See `Manifold.release`; `inside`: in the middle of a step, between two steps else."""
    elements = np.unique(np.asarray(elements, dtype=np.int64))
    elements = elements[body.kind[elements] != PARTICLES]
    if len(elements) == 0:
        return
    if not inside:
        body.prepare()
    change = Release(body, elements)
    with change.booked() if inside else booked(body, "release"):
        change.carry_out()
        if inside:
            body._arrange_driving()
    body.first_released = body.first_released if body.released else elements
    body.released += len(elements)
    body.release_log.append((body.time + inside * body.step, body.released))
