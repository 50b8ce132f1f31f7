"""The coarse step of the overlap coupling: explicit subcycling as in `bridge.subcycling`, the zone's nodes with the particles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bridge.subcycling import Mesh, finish, move_others

Array = NDArray[np.float64]

PREPARED = 256  # coarse steps that the particles are made ready for at a time


class OverlapRule:
    """Masses, forces and energy sums of the continuum's side, and its step."""

    ATTRIBUTES = ("external", "force", "moves_prescribed", "_lost", "_work", "_interface")

    def __init__(self, coupled):
        mesh, fine, exchange = coupled.mesh, coupled.fine, coupled.exchange
        self.coupled, self.mesh, self.fine, self.exchange = coupled, mesh, fine, exchange
        self.step, self.damping = coupled.step, coupled.mass_damping
        self.moves_prescribed = mesh.moves_prescribed
        self.external = mesh.external_force().copy()
        exchange.scatter((fine.tie.matrix.T @ fine.load.ravel()).reshape(-1, mesh.width), self.external)
        movable = (mesh.mass > 0.0) & ~mesh.fixed
        on = np.zeros((len(mesh.mass), 1))
        exchange.scatter(np.ones((len(exchange.nodes), 1)), on)
        stiffness, edge = mesh.stiffness_matrix(exchange.nodes), mesh.edge_stiffness(exchange.nodes, on[:, 0] > 0.0)
        free = exchange.gather((~mesh.fixed).astype(float)) > 0.5
        without = mesh.comm.allreduce(int(np.count_nonzero((on[:, 0] > 0.0) & (mesh.mass[:, 0] <= 0.0))))
        if without and not fine.eliminated:
            raise ValueError(
                f"constraint='penalty': {without} nodes that springs pull have no mass of the continuum; let the zone's inner face "
                "run along element edges, or take 'lagrange'"
            )
        fine.set_nodes(exchange.gather(mesh.mass), free, stiffness, edge, exchange.gather(mesh.displacement))
        self._on = np.flatnonzero(on)
        self._inverse = np.divide(1.0, mesh.mass, out=np.zeros_like(mesh.mass), where=movable & (on == 0.0))
        self._mass = np.where(movable, mesh.mass, 0.0)
        self.force, self._increment, impulse, link = (np.zeros_like(self._mass) for _ in range(4))
        self._lost, self._work, self._interface = np.zeros(1), np.zeros(1), np.zeros(1)
        arrays = (
            self._mass, self._inverse, self.external, self.force, impulse, link, self._increment, mesh.displacement,
            mesh.velocity, mesh.acceleration,
        )  # fmt: skip
        off = np.flatnonzero(np.repeat(on[:, 0] == 0.0, mesh.width // 3))
        self._arrays = Mesh(*(array.reshape(-1, 3) for array in arrays), off, self._lost, self._work)  # six components: two rows
        self.start_from_state()
        mesh.acceleration[:] = self._inverse * self.force
        exchange.scatter(fine.start(exchange.gather(self.force)), mesh.acceleration)
        mesh.send()

    def start_from_state(self) -> None:
        """Bring everything else in line with a motion that was set from outside."""
        mesh, gather = self.mesh, self.exchange.gather
        mesh.receive()
        self.force[:] = self.external - mesh.internal_force(mesh.displacement)
        self.fine.follow_mesh(gather(mesh.displacement), gather(mesh.velocity))
        self._known = mesh.displacement.copy(), mesh.velocity.copy()

    def receive(self) -> None:
        """Take up what was written into the body's motion since the last step (collective)."""
        mesh = self.mesh
        mesh.receive()
        same = all(np.array_equal(old, new) for old, new in zip(self._known, (mesh.displacement, mesh.velocity)))
        if mesh.comm.allreduce(int(not same)):
            self.start_from_state()

    def motion_was_restored(self) -> None:
        """Take note of a state that was restored as a whole: nothing has to follow it."""
        self.mesh.receive()
        self._known = self.mesh.displacement.copy(), self.mesh.velocity.copy()

    def _send(self) -> None:
        self.mesh.send()
        self._known = self.mesh.displacement.copy(), self.mesh.velocity.copy()

    def carried(self) -> list[Array]:
        """Arrays beyond the motion of nodes and particles that one coarse step hands to the next: none."""
        return []

    def run(self, steps: int) -> None:
        """Take coarse steps (collective)."""
        self.receive()
        for k in range(steps):
            if k % PREPARED == 0:
                self.fine.prepare(min(PREPARED, steps - k) * self.coupled.substeps)
            self._advance()
            self.coupled.count(1)
        self._send()

    def advance(self) -> None:
        """Take one coarse step without counting it (collective)."""
        self.receive()
        self.fine.prepare(self.coupled.substeps)
        self._advance()
        self._send()

    def _gather(self, *nodal: Array) -> list[Array]:
        """Copies of rows that this rank needs of arrays (owned nodes, c), in one message (collective)."""
        return np.hsplit(self.exchange.gather(np.hstack(nodal)), len(nodal))

    def _advance(self) -> None:
        mesh, arrays, on, step = self.mesh, self._arrays, self._on, self.step
        fixed, time = mesh.fixed, self.coupled.time
        if self.moves_prescribed:
            end = mesh.prescribed_velocity(time + step)[fixed]
            mesh.velocity[fixed] = 0.5 * (mesh.prescribed_velocity(time)[fixed] + end)
        before = self.force.copy() if self.damping else self.force
        move_others(arrays, self.damping, step)
        slope = mesh.internal_force(self._increment) / -step
        displacement, velocity, start, slope = self._gather(mesh.displacement, mesh.velocity, self.force, slope)
        found = self.fine.run(displacement, velocity, start, slope, self.coupled.substeps)
        nodal = np.zeros((len(self._mass), 3 * mesh.width))
        self.exchange.scatter(found, nodal)
        moved, faster, acceleration = np.hsplit(nodal[on], 3)
        mesh.displacement[on] += moved
        mesh.velocity[on] += faster
        self._work[0] += np.vdot(self.external[on], moved)
        finish(arrays, mesh.internal_force(mesh.displacement).reshape(-1, 3), self.damping, step)
        if self.damping:  # of the middle of the step, on the velocities at its ends
            change = np.where(self._inverse > 0.0, self.force - before, 0.0)
            self._lost[0] += 0.25 * step * self.damping * np.vdot(change, self._increment)
        missing = self.fine.missing(step)
        kick = self.fine.solve(missing)
        end_force, velocity = self._gather(self.force, mesh.velocity)
        uncounted = self._uncounted(found, missing, kick, start + end_force, velocity)
        self._interface += uncounted if self.fine.leads else 0.0
        self.fine.kick(kick)
        faster = np.zeros_like(self._mass)
        self.exchange.scatter(kick, faster)
        mesh.velocity += faster
        mesh.acceleration[on] = acceleration
        if self.moves_prescribed:
            mesh.velocity[fixed] = end

    def _uncounted(self, found: Array, missing: Array, kick: Array, forces: Array, velocity: Array) -> float:
        """Energy (J) that the even motion of the neighbours within the coarse step takes: zero for one substep."""
        due = 0.5 * np.vdot(forces, found[:, : self.mesh.width])
        return float(due - self.fine.worked - np.vdot(missing, velocity + 0.5 * kick))

    def energies(self) -> Array:
        """Kinetic, strain, damping loss, external work, loss at the edge of the zone, h^2/8 a M a (J) of the continuum; this rank's part."""
        mesh = self.mesh
        kinetic = 0.5 * np.vdot(mesh.mass * mesh.velocity, mesh.velocity)
        strain = 0.5 * np.vdot(mesh.displacement, self.external - self.force)
        undamped = mesh.acceleration + self.damping * mesh.velocity
        undamped[self._on] = mesh.acceleration[self._on]
        squares = self._mass * undamped**2
        zone = squares[self._on].sum() * (1.0 / self.coupled.substeps**2 - 1.0)
        stepping = self.step**2 / 8.0 * (squares.sum() + zone)
        return np.array([kinetic, strain, self._lost[0], self._work[0], self._interface[0], stepping])
