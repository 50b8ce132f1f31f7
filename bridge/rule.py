"""The coarse step of a bridging-scale coupling: what its variants share."""

from __future__ import annotations

import numpy as np


class Rule:
    """What the variants share: coarse masses, prescribed nodes, energy sums of the continuum side."""

    ATTRIBUTES: tuple[str, ...] = (
        "external", "continuum_force", "link", "lost", "external_work", "link_work", "moves_prescribed",
    )  # fmt: skip

    def __init__(self, coupled):
        body, fine, exchange = coupled.body, coupled.fine, coupled.exchange
        self.coupled, self.body, self.fine, self.exchange = coupled, body, fine, exchange
        self.step, self.damping = coupled.step, coupled.mass_damping
        self.damper = 1.0 + 0.5 * self.damping * self.step
        self.covered = exchange.gather(body.mass)[:, 0] <= 0.0  # needed nodes without continuum mass
        lost = body.comm.allreduce(fine.set_interface(self.covered, coupled.on_outline()))
        if lost:
            raise ValueError(
                f"{lost} ghosts lie in covered elements: leave the same region out of the body as was given to the layout"
            )
        self.mass = self._coarse_mass(body.mass.copy())
        movable = (self.mass > 0.0) & ~body.fixed
        self.inverse_mass = np.divide(1.0, self.mass, out=np.zeros_like(self.mass), where=movable)
        self.external = body.external_force().copy()
        self.continuum_force = np.zeros_like(self.mass)
        self._stiff_edge = bool(body.comm.allreduce(int(fine.edge_stiffness is not None)))
        self.update_continuum_force()
        self.link = np.zeros_like(self.mass)  # force of the particles on the continuum's own mass, N
        self.lost = self.external_work = self.link_work = 0.0
        self.moves_prescribed = body.moves_prescribed

    def _coarse_mass(self, mass):
        """Lumped mass (owned nodes, 3) of the nodes that carry continuum, here with the ghosts' inside share."""
        self.exchange.scatter(self.fine.ghost_mass_at_nodes(self.fine.share), mass)
        return mass

    def _displace(self, increment):
        """Add an increment (owned nodes, 3) to the displacements, prescribed motion imposed; the continuum force follows."""
        if self.moves_prescribed:
            fixed, time = self.body.fixed, self.coupled.time
            mean = 0.5 * (self.body.prescribed_velocity(time) + self.body.prescribed_velocity(time + self.step))
            increment[fixed] = self.step * mean[fixed]
        self.body.displacement[:] += increment
        self.update_continuum_force()

    def internal_force(self):
        """Internal force (owned nodes, 3) at the present displacements, N (collective)."""
        force = self.body.internal_force()
        if self._stiff_edge:
            nodal = self.exchange.gather(self.body.displacement)
            edge = self.fine.edge_stiffness
            values = np.zeros_like(nodal) if edge is None else (edge @ nodal.ravel()).reshape(-1, 3)
            self.exchange.scatter(values, force)
        return force

    def update_continuum_force(self) -> None:
        """Loads minus internal force (owned nodes, 3) at the present displacements, N (collective)."""
        self.continuum_force[:] = self.external - self.internal_force()

    def _finish(self, increment, velocity_before, link):
        """Impose prescribed velocities and book the work of the coarse step (trapezoidal sums)."""
        velocity = self.body.velocity
        if self.moves_prescribed:
            fixed = self.body.fixed
            velocity[fixed] = self.body.prescribed_velocity(self.coupled.time + self.step)[fixed]
        if self.damping:
            self.lost += 0.5 * self.damping * np.vdot(self.mass * (velocity_before + velocity), increment)
        self.external_work += np.vdot(self.external, increment)
        self.link_work += 0.5 * np.vdot(self.link + link, increment)
        self.link = link

    def assign(self, owned, nodal, which):
        """Write the rows `which` of values at the needed nodes into the owners' rows (collective)."""
        change = np.where(which[:, None], nodal - self.exchange.gather(owned), 0.0)
        self.exchange.scatter(change, owned)

    def place_covered(self, velocities: bool = False):
        """Give covered nodes the projection of the particles, nodes with continuum mass held (collective)."""
        fine, body = self.fine, self.body
        pairs = [(body.displacement, fine.displacement())]
        if velocities:
            pairs.append((body.velocity, fine.velocity()))
        for owned, values in pairs:
            fine.fit_covered(owned, values, self)

    def run(self, steps: int) -> None:
        """Take coarse steps (collective)."""
        for _ in range(steps):
            self.advance()
            self.coupled.count(1)

    def spread(self, seconds: np.ndarray) -> None:
        """Go on with particles that are spread over the ranks as the mesh is (collective).

        Args:
            seconds: (2,) where the time of exchanges and agreements is added up.
        """

    def advance(self) -> None:
        """Take one coarse step without counting it (collective)."""
        raise NotImplementedError

    def critical_step(self) -> float:
        """Largest stable step of the continuum by itself, s (collective)."""
        return self.body.critical_step("power")

    def carried(self) -> list[np.ndarray]:
        """Arrays beyond the motion of nodes and particles that one coarse step hands to the next."""
        return []

    def start_from_state(self) -> None:
        """Bring everything else in line with displacements, velocities and `carried` arrays that were set from outside."""
        body, gather = self.body, self.exchange.gather
        self.update_continuum_force()
        self.fine.follow_mesh(gather(body.displacement), gather(body.velocity), gather(body.acceleration))

    def motion_was_restored(self) -> None:
        """Take note of a state that was restored as a whole: nothing has to follow it."""

    def energies(self) -> np.ndarray:
        """Kinetic, strain, damping loss, external work and work received from the particles (J); this rank's part."""
        body = self.body
        kinetic = 0.5 * np.vdot(self.mass * body.velocity, body.velocity)
        strain = 0.5 * np.vdot(body.displacement, self.external - self.continuum_force)
        return np.array([kinetic, strain, self.lost, self.external_work, self.link_work])
