"""The coarse step of each bridging-scale variant (see `bridge.bridging_scale`)."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sparse

from bridge.projection import SymmetricSolver


class _Variant:
    """What the variants share: coarse masses, prescribed nodes, energy sums of the continuum side."""

    ATTRIBUTES = ("external", "continuum_force", "link", "lost", "external_work", "link_work", "moves_prescribed")

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
        self.external = body.external_force()
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

    def update_continuum_force(self) -> None:
        """Loads minus internal force (owned nodes, 3) at the present displacements, N (collective)."""
        self.continuum_force = self.external - self.body.internal_force()
        if self._stiff_edge:
            nodal = self.exchange.gather(self.body.displacement)
            edge = self.fine.edge_stiffness
            force = np.zeros_like(nodal) if edge is None else (edge @ nodal.ravel()).reshape(-1, 3)
            self.exchange.scatter(-force, self.continuum_force)

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
            self.assign(owned, fine.fit_covered(values, self.exchange.gather(owned)), self.covered)

    def advance(self) -> None:
        """Take one coarse step (collective)."""
        raise NotImplementedError

    def carried(self) -> list[np.ndarray]:
        """Arrays beyond the motion of nodes and particles that one coarse step hands to the next."""
        return []

    def start_from_state(self) -> None:
        """Bring everything else in line with displacements, velocities and `carried` arrays that were set from outside."""
        body, gather = self.body, self.exchange.gather
        self.update_continuum_force()
        self.fine.follow_mesh(gather(body.displacement), gather(body.velocity), gather(body.acceleration))

    def energies(self) -> np.ndarray:
        """Kinetic, strain, damping loss, external work and work received from the particles (J); this rank's part."""
        body = self.body
        kinetic = 0.5 * np.vdot(self.mass * body.velocity, body.velocity)
        strain = 0.5 * np.vdot(body.displacement, self.external - self.continuum_force)
        return np.array([kinetic, strain, self.lost, self.external_work, self.link_work])


class PaperVariant(_Variant):
    """Li & Wan (2010), eqs 25-34: all nodes are coarse unknowns, F(N d + Q q) in the covered block."""

    total_motion = True  # forces at u = N d + Q q, otherwise at q
    resynchronise = False

    def __init__(self, coupled):
        super().__init__(coupled)
        exchange = self.exchange
        free = ~(exchange.gather(self.body.fixed.astype(float)) > 0.5)
        lumped = exchange.gather(self.body.mass)
        gram = self.fine.consistent_mass()
        self._blocks = []
        for component in range(3):
            unknown = np.flatnonzero(free[:, component])
            matrix = gram[min(component, 2) // 2] + sparse.diags(lumped[:, component])
            if len(unknown):
                self._blocks.append((component, unknown, SymmetricSolver(matrix[unknown][:, unknown])))
        self._everywhere = np.ones(len(free), dtype=bool)
        self._forces_on_nodes(self.fine.force())  # accelerations at the start
        self.body.acceleration[:] = self._solve(self._total)

    def _forces_on_nodes(self, particle_force):
        total = self.continuum_force.copy()
        self.exchange.scatter(self.fine.to_nodes(particle_force), total)
        self._total = total

    def _solve(self, force):
        """Accelerations of all nodes (owned, 3) by the coarse mass: lumped outside, consistent where particles are."""
        result = force * self.inverse_mass
        right = self.exchange.gather(force)
        nodal = np.zeros_like(right)
        for component, unknown, solver in self._blocks:
            nodal[unknown, component] = solver.solve(right[unknown, component : component + 1])[:, 0]
        self.assign(result, nodal, self._everywhere)
        return result

    def advance(self) -> None:
        body, fine, exchange = self.body, self.fine, self.exchange
        velocity, acceleration = body.velocity, body.acceleration
        before = velocity.copy()
        nodal = exchange.gather(velocity), exchange.gather(acceleration)
        fine.run_prescribed(*nodal, self.coupled.substeps, remember=self.total_motion)
        half = velocity + 0.5 * self.step * acceleration
        increment = self.step * half
        self._displace(increment)
        if self.total_motion:
            predictor = velocity + self.step * acceleration
            force = fine.force_of_total_motion(exchange.gather(body.displacement), exchange.gather(predictor))
        else:
            force = fine.force()
        self._forces_on_nodes(force)
        undamped = self._solve(self._total)
        new = (undamped - self.damping * half) / self.damper if self.damping else undamped
        velocity[:] = half + 0.5 * self.step * new
        acceleration[:] = new
        self._finish(increment, before, self.mass * undamped - self.continuum_force)
        if self.resynchronise:
            self.place_covered(velocities=True)


class ResyncVariant(PaperVariant):
    """As published but with F(q); covered nodes follow the projection of the particles after each coarse step."""

    total_motion = False
    resynchronise = True


class RespaVariant(_Variant):
    """Impulse multi-stepping: continuum kicks at coarse times, interface nodes move with the particles in between."""

    def __init__(self, coupled):
        super().__init__(coupled)
        self._nodal_inverse_mass = self.exchange.gather(self.inverse_mass)

    def carried(self) -> list[np.ndarray]:
        return [self.fine.nodal_acceleration]

    def advance(self) -> None:
        body, fine, exchange, step = self.body, self.fine, self.exchange, self.step
        velocity = body.velocity
        before = velocity.copy()
        velocity *= 1.0 - 0.5 * self.damping * step
        velocity += 0.5 * step * self.inverse_mass * self.continuum_force
        nodal = exchange.gather(velocity)
        worked = fine.interface_work
        moved, reached = fine.run_slaved(nodal, self._nodal_inverse_mass, self.coupled.substeps)
        self.link_work -= fine.interface_work - worked  # ghosts and nodes move together in every substep
        increment = step * velocity
        exchange.scatter(moved - step * nodal, increment)
        exchange.scatter(reached - nodal, velocity)
        self._displace(increment)
        body.acceleration[:] = self.inverse_mass * self.continuum_force
        velocity += 0.5 * step * body.acceleration
        velocity /= self.damper
        self._finish(increment, before, self.link)


class MultiplierVariant(_Variant):
    """Ghosts are particles; multipliers tie their velocities to the mesh in every substep (Gravouil & Combescure 2001)."""

    KEPT = 0.3  # least part of a node's continuum mass that is left when the ghosts' outside mass is taken out of it

    def __init__(self, coupled):
        super().__init__(coupled)
        weight = self.fine.ghost_mass_at_nodes(
            1.0 - self.fine.share
        )  # of the ghosts' outside parts: they carry it themselves
        weight *= [*self.body.gravity_acceleration, 0.0]
        self.external = self.external.copy()
        self.exchange.scatter(-weight, self.external)
        self.update_continuum_force()
        self._mobility = 0.5 * self.step / self.damper * self.inverse_mass  # link force to velocity, s/kg
        self.fine.set_tie(self.exchange.gather(self._mobility))
        self.body.acceleration[:] = self.continuum_force * self.inverse_mass

    def _coarse_mass(self, mass):
        before = mass.copy()
        self.exchange.scatter(-self.fine.ghost_mass_at_nodes(1.0 - self.fine.share), mass)
        return np.maximum(mass, self.KEPT * before)

    def carried(self) -> list[np.ndarray]:
        return [self.link]

    def start_from_state(self) -> None:
        self.update_continuum_force()  # ghosts have a motion of their own

    def advance(self) -> None:
        body, fine, exchange, step = self.body, self.fine, self.exchange, self.step
        velocity, acceleration = body.velocity, body.acceleration
        before = velocity.copy()
        start = velocity - self._mobility * self.link
        half = velocity + 0.5 * step * acceleration
        increment = step * half
        shift_to = exchange.gather(body.displacement)
        self._displace(increment)
        free = (self.inverse_mass * self.continuum_force - self.damping * half) / self.damper
        end = half + 0.5 * step * free
        tie = fine.run_tied(exchange.gather(start), exchange.gather(end), shift_to, self.coupled.substeps)
        link = np.zeros_like(end)
        exchange.scatter(tie, link)
        correction = self._mobility * link
        velocity[:] = end + correction
        acceleration[:] = free + (2.0 / step) * correction
        self._finish(increment, before, link)


VARIANTS = {"paper": PaperVariant, "resync": ResyncVariant, "respa": RespaVariant, "multiplier": MultiplierVariant}
