"""The coarse step of each bridging-scale variant (see `bridge.bridging_scale`)."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sparse

from bridge.blocks import blocks
from bridge.interpolation import NodeExchange
from bridge.projection import SymmetricSolver
from bridge.rule import Rule
from bridge.subcycling import Mesh, Others, finish, move_others
from particles.halos import halo_of

NODES = 8  # tag of messages between nodes


class PaperVariant(Rule):
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
            force = fine.force_of_total_motion(exchange.gather(body.displacement), exchange.gather(predictor), self)
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


class RespaVariant(Rule):
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


class MultiplierVariant(Rule):
    """Ghosts are particles; multipliers tie their velocities to the mesh in every substep (Gravouil & Combescure 2001)."""

    KEPT = 0.3  # least part of a node's continuum mass that is left when the ghosts' outside mass is taken out of it

    def __init__(self, coupled):
        super().__init__(coupled)
        if self.step > np.sqrt(self.KEPT) * self.body.critical_step() and self.step > (most := self.critical_step()):
            raise ValueError(
                f"step={self.step:g} s must be at most {most:.4g} s with variant='multiplier', which takes the ghosts' outside "
                "mass out of the continuum's at the interface; take fewer substeps or variant='subcycling'"
            )
        weight = self.fine.ghost_mass_at_nodes(
            1.0 - self.fine.share
        )  # of the ghosts' outside parts: they carry it themselves
        weight *= [*self.body.gravity_acceleration, 0.0]
        self.exchange.scatter(-weight, self.external)
        self.update_continuum_force()
        self._mobility = 0.5 * self.step / self.damper * self.inverse_mass  # link force to velocity, s/kg
        self.fine.set_tie(self.exchange.gather(self._mobility))
        self.body.acceleration[:] = self.continuum_force * self.inverse_mass

    def _coarse_mass(self, mass):
        before = mass.copy()
        self.exchange.scatter(-self.fine.ghost_mass_at_nodes(1.0 - self.fine.share), mass)
        return np.maximum(mass, self.KEPT * before)

    def critical_step(self) -> float:
        return self.body.critical_step("power", self.mass)

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


class SubcyclingVariant(Rule):
    """Interface nodes take the particles' steps, their neighbours move evenly meanwhile (see `bridge.subcycling`)."""

    ATTRIBUTES = (*Rule.ATTRIBUTES, "_lost", "_work")

    def __init__(self, coupled):
        super().__init__(coupled)
        body, fine, exchange = self.body, self.fine, self.exchange
        exchange.scatter(fine.ghost_mass_at_nodes(fine.share) * [*body.gravity_acceleration, 0.0], self.external)
        self.update_continuum_force()
        mass = np.where(self.inverse_mass > 0.0, self.mass, 0.0)
        stiffness = body.stiffness_matrix(exchange.nodes[fine.interface])
        fine.set_nodes(exchange.gather(mass), exchange.gather(self.inverse_mass), stiffness)
        marked, on = np.zeros((len(exchange.nodes), 1)), np.zeros((len(mass), 1))
        marked[fine.interface] = 1.0
        exchange.scatter(marked, on)
        self._on = np.flatnonzero(on)
        self._lost, self._work = np.zeros(1), np.zeros(1)
        self._mesh = Mesh(
            mass, self.inverse_mass, self.external, self.continuum_force, *(np.zeros_like(mass) for _ in range(3)),
            body.displacement, body.velocity, body.acceleration, np.flatnonzero(on == 0.0), self._lost, self._work,
        )  # fmt: skip
        self._side: tuple[Any, ...] | None = None  # for steps that are compiled as a whole
        if body.comm.size == 1 and coupled.soil.count > 0:
            self._side = self._mesh, blocks(self._stiffness_rows()), self._on, None

    def _stiffness_rows(self) -> sparse.csr_matrix:
        """Stiffness (rows of this rank's nodes, all columns), contacts of ghosts on the outline with it."""
        rows, edge = self.body.stiffness_rows(), self.fine.edge_stiffness
        if edge is None:
            return rows
        places, edge = (3 * self.exchange.nodes[:, None] + np.arange(3)).ravel(), edge.tocoo()
        row, column = places[edge.row] - 3 * self.body.owned_range[0], places[edge.col]
        own = (row >= 0) & (row < rows.shape[0])
        return rows + sparse.csr_matrix((edge.data[own], (row[own], column[own])), shape=rows.shape)

    def spread(self, seconds: np.ndarray) -> None:
        body, (first, last) = self.body, self.body.owned_range
        rows, width = self._stiffness_rows().tocoo(), len(self.fine.interface)
        node, part = np.divmod(rows.col, 3)
        foreign = (node < first) | (node >= last)
        beside = NodeExchange(body.comm, body.owned_range, node[foreign])
        local = np.where(foreign, last - first + np.searchsorted(beside.nodes, node), node - first)
        count = last - first + len(beside.nodes)
        stiffness = sparse.csr_matrix((rows.data, (rows.row, 3 * local + part)), shape=(rows.shape[0], 3 * count))
        way, self._requests = halo_of(
            body.comm, beside.wanted_by_others, beside.wanted_of_others, last - first, 3, sums=9 * width,
            seconds=seconds, tag=NODES,
        )  # fmt: skip
        which = np.searchsorted(self.exchange.nodes[self.fine.interface], first + self._on)
        others = Others(which, np.zeros((count, 3)), np.zeros((3 * width, 3)), way)
        self._side = self._mesh, blocks(stiffness), self._on, others

    def carried(self) -> list[np.ndarray]:
        return [self.fine.nodes.link]

    def run(self, steps: int) -> None:
        if self._side is not None and not self.moves_prescribed:
            self.fine.run_coarse(self._side, steps, self.coupled.substeps)
            self.coupled.count(steps)
        else:
            super().run(steps)

    def advance(self) -> None:
        velocity, fixed, time = self.body.velocity, self.body.fixed, self.coupled.time
        if self.moves_prescribed:
            end = self.body.prescribed_velocity(time + self.step)[fixed]
            velocity[fixed] = 0.5 * (self.body.prescribed_velocity(time)[fixed] + end)
        if self._side is not None:
            self.fine.run_coarse(self._side, 1, self.coupled.substeps)
        else:
            self._advance_together()
        if self.moves_prescribed:
            velocity[fixed] = end

    def _advance_together(self) -> None:
        """The step of `bridge.subcycling.run_coarse` with a mesh that is spread over the ranks and particles that are not."""
        body, gather, mesh, on = self.body, self.exchange.gather, self._mesh, self._on
        move_others(mesh, self.damping, self.step)
        slope = body.internal_force(mesh.increment) / -self.step
        found = self.fine.run_subcycled(gather(body.velocity), gather(mesh.force), gather(slope), self.coupled.substeps)
        nodal = np.zeros((len(self.mass), 12))
        self.exchange.scatter(found, nodal)
        moved, faster, impulse, link = np.hsplit(nodal, 4)
        body.displacement[:] += moved
        body.velocity[:] += faster
        mesh.impulse[on], mesh.link[on] = impulse[on], link[on]
        mesh.work[0] += np.vdot(mesh.external, moved)
        finish(mesh, self.internal_force(), self.damping, self.step)

    def energies(self) -> np.ndarray:
        result = super().energies()
        result[2:4] = self._lost[0] + self.fine.lost_by_nodes, self._work[0]
        return result


VARIANTS = {
    "paper": PaperVariant, "resync": ResyncVariant, "respa": RespaVariant, "multiplier": MultiplierVariant,
    "subcycling": SubcyclingVariant,
}  # fmt: skip
