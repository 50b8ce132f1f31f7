"""The particle side of a coupling: row-ordered operators, the substeps, energies; on ranks without particles all is empty."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray

from bridge import subcycling, substeps
from bridge.blocks import Blocks, blocks
from bridge.particle_side import ParticleSide
from bridge.projection import Projection, SymmetricSolver
from bridge.subcycling import Mesh, Nodes, Others
from bridge.substeps import Ghosts, Tie
from particles.dispatch import Direct
from particles.network import Before, before_evaluation, trial_forces

Array = NDArray[np.float64]

run_prescribed, run_slaved, run_tied = map(Direct, (substeps.run_prescribed, substeps.run_slaved, substeps.run_tied))
run_coarse = Direct(subcycling.run_coarse)

TOUCHING = 1e-6  # gap, in sums of radii, up to which two discs count as touching
RETIE = 0.1  # part of the tied ghosts' drift from the mesh that is taken back each coarse step; 1 makes the scheme grow


class FineScale(ParticleSide):
    """Particles of the nested region and the ghosts around them.

    Args:
        soil: Assembly of particles and ghosts.
        ghosts: Mask (n,) in the assembly's id order.
        share: Inside part of each ghost's mass (g,).
        shape: N (n, needed nodes), id order, sparse.
        step: Particle time step, s.
        mass_damping: c_m, 1/s.
        gravity: m/s2.
    """

    ENERGY_NAMES = (
        "kinetic", "elastic", "friction", "viscous", "contact_loss", "mass_damping", "external", "interface",
    )  # fmt: skip

    _saved: Array
    reaction: Array
    _multiplier: Array
    _ghost_acceleration: Array
    _shift: Array

    def __init__(self, soil, ghosts, share: Array, shape: sparse.csr_matrix, step: float, mass_damping: float, gravity):
        super().__init__(soil, step, mass_damping, gravity)
        self.share = np.asarray(share)
        self.ids, self._shape = np.flatnonzero(ghosts), sparse.csr_matrix(shape)
        self._weights = np.column_stack([soil.masses, soil.masses, soil.inertias])
        self.ghost_mass = self._weights[self.ids]
        self.ghost_shape = self._shape[self.ids]
        self._work, self._left = np.zeros(1), np.zeros(1, dtype=np.int64)
        self.ghosts_move_by_themselves = False  # otherwise their inside share is mass of the mesh
        self.carried_weight = 1.0 - self.share  # part of each ghost's weight that is a load of the continuum
        self._before: Before | None = None
        self._previous = np.zeros((0, 3))

    def set_interface(self, covered, outline) -> int:
        """Number the nodes that move ghosts and make the kernels' arrays.

        Args:
            covered: Mask (needed nodes,) of nodes without continuum mass; ghosts may not depend on them.
            outline: Mask (n,) of particles whose centre lies on the outline of the covered region.

        Returns:
            Number of ghosts that depend on a covered node; there must be none.
        """
        self.covered = np.asarray(covered)
        self.interface = np.unique(self.ghost_shape.indices)
        self._local_shape = sparse.csr_matrix(self.ghost_shape[:, self.interface])
        count, width = len(self.ids), len(self.interface)
        self.nodes = Nodes._make([*(np.zeros((width, 3)) for _ in Nodes._fields[1:]), np.zeros(1)])
        self._saved, self.reaction, self._multiplier = np.zeros((count, 6)), np.zeros((count, 3)), np.zeros((count, 3))
        self._ghost_acceleration, self._shift = np.zeros((count, 3)), np.zeros((count, 3))
        self.nodal_acceleration = np.zeros((width, 3))  # of interface nodes by the ghosts' reactions
        self.edge_stiffness = None
        if self.soil.count:
            self._set_edge_stiffness(np.flatnonzero(np.asarray(outline)[self.ids]))
            self.soil.set_ghosts(self.ids)
            self._prepare(1)
            self.reaction[:] = self.soil.system.force[self._led.rows, :3] - self._led.load
        return int(np.count_nonzero(self.ghost_shape @ self.covered.astype(float)))

    def _set_edge_stiffness(self, edge) -> None:
        """Contacts between two ghosts on the outline: half of each belongs to the particle region, as the ghosts' mass does.

        They stick and stay elastic, as the continuum across the outline does: a constant matrix (3 needed nodes squared).
        """
        if len(edge) < 2:
            return
        self.soil.set_ghosts(self.ids[:0])
        everything = self.soil.stiffness_matrix(contact_range=TOUCHING)
        self.soil.set_ghosts(self.ids[edge])  # pairs of two of them drop out of the network
        pairs = everything - self.soil.stiffness_matrix(contact_range=TOUCHING)
        rows = (3 * self.ids[edge][:, None] + np.arange(3)).ravel()
        pairs = sparse.csr_matrix(pairs)[rows][:, rows]
        if abs(pairs).max() == 0.0:
            return
        shape = sparse.kron(self.ghost_shape[edge], sparse.identity(3), format="csr")
        self.edge_stiffness = sparse.csr_matrix(0.5 * shape.T @ pairs @ shape)

    def _order(self, rows, order) -> None:
        free = np.ones(len(rows), dtype=bool)
        free[rows[self.ids]] = False
        self._free = np.flatnonzero(free)
        self._to_nodes = sparse.csr_matrix(self._shape[order].T)
        self._projection: Projection | None = None
        load = self.ghost_mass * self.carried_weight[:, None] * np.array([*self._gravity, 0.0])
        local = self._local_shape
        self._led = Ghosts(
            rows[self.ids].astype(np.int64), self.ghost_mass, load,
            local.indptr.astype(np.int64), local.indices.astype(np.int64), local.data,
            self._reference[rows[self.ids]],
        )  # fmt: skip
        if len(self._previous) != len(rows):  # loops under way go on with the array that they have
            self._previous = np.zeros((len(rows), 3))
        self._fitters: list[SymmetricSolver] = []

    @property
    def projection(self) -> Projection:
        """Projection of the free particles' motion on the mesh, in the present row order."""
        if self._projection is None:
            shape, weights = self._shape[self._row_ids][self._free], self._weights[self._row_ids][self._free]
            self._projection = Projection(shape, weights[:, 0], weights[:, 2])
        return self._projection

    # ------------------------------------------------------------------------------------------------ motion (free, 3)

    def displacement(self) -> Array:
        """Displacements q of the free particles, row order (free, 3); with no particles (0, 3)."""
        if not self.soil.count:
            return np.zeros((0, 3))
        return (self.soil.system.position[:, :3] - self._reference)[self._free]

    def velocity(self) -> Array:
        """Velocities of the free particles, row order (free, 3)."""
        return self.soil.system.velocity[self._free, :3] if self.soil.count else np.zeros((0, 3))

    def ghost_displacement(self) -> Array:
        """Displacements of the ghosts (g, 3)."""
        if not self.soil.count:
            return np.zeros((0, 3))
        rows = self._led.rows
        return self.soil.system.position[rows, :3] - self._reference[rows]

    def force(self) -> Array:
        """Forces on particles and, as reactions, on ghosts (n, 3), row order, N and N m."""
        return self.soil.system.force[:, :3] if self.soil.count else np.zeros((0, 3))

    def to_nodes(self, values: Array) -> Array:
        """N^T values: (n, 3) in row order to (needed nodes, 3)."""
        return self._to_nodes @ values if self.soil.count else np.zeros((self._shape.shape[1], 3))

    def force_of_total_motion(self, nodal: Array, nodal_velocity: Array, rule: Any) -> Array:
        """Forces (n, 3) at u = N d + Q q and its velocity, on a copy of the histories (Li & Wan 2010, eq 33; collective).

        The predictor of the last substep stands for the particles' velocities, so that full coverage is exact with dashpots.
        """
        if not self.soil.count:
            return np.zeros((0, 3))
        system, free = self.soil.system, self._free
        predictor = system.velocity[:, :3] + 0.5 * self.step * (self._previous - system.acceleration[:, :3])
        increment = np.zeros_like(predictor)
        increment[free] = self._mesh_minus_coarse(rule, nodal, self.displacement())
        predictor[free] += self._mesh_minus_coarse(rule, nodal_velocity, predictor[free])
        if self.linear is None:
            force = trial_forces(system, self._terms, increment, predictor, self._before, *self.across())
        else:
            linear = self.linear
            moved = system.position[:, :3] - self._reference + increment
            shape = (3 * len(moved), 3 * len(moved))
            stiffness = sparse.csr_matrix((linear.value, linear.column, linear.start), shape=shape)
            force = -(stiffness @ moved.ravel()).reshape(-1, 3)
        force[self._led.rows] -= self._led.load
        return force

    def _mesh_minus_coarse(self, rule: Any, nodal: Array, values: Array) -> Array:
        """What the mesh's motion (needed nodes, 3) is beyond the coarse part of the free particles', at these (free, 3)."""
        return self.projection.extend(nodal - self.projection.coarse(values))

    def fit_covered(self, owned: Array, values: Array, rule: Any) -> None:
        """Fit the covered nodes among nodal values (owned nodes, 3) to the free particles' (free, 3), others held (collective)."""
        rule.assign(owned, self._fitted(values, rule.exchange.gather(owned)), self.covered)

    def _fitted(self, values: Array, nodal: Array) -> Array:
        """Nodal values (needed nodes, 3) with those of covered nodes fitted to the free particles' (free, 3), others held."""
        nodal = np.array(nodal)
        if not self.soil.count or not self.covered.any():
            return nodal
        projection = self.projection
        fitted = np.flatnonzero(self.covered & projection.supported)
        if not self._fitters:
            self._fitters = [SymmetricSolver(self._gram(k)[fitted][:, fitted]) for k in (0, 2)]
        nodal[self.covered] = 0.0
        right = projection.restrict(projection.weights * (values - projection.extend(nodal)))[fitted]
        nodal[fitted, :2] = self._fitters[0].solve(right[:, :2])
        nodal[fitted, 2:] = self._fitters[1].solve(right[:, 2:])
        return nodal

    # ---------------------------------------------------------------------------------------------------------- masses

    def _gram(self, component: int) -> sparse.csr_matrix:
        shape, weights = self.projection.matrix, self.projection.weights[:, component]
        return sparse.csr_matrix(shape.T @ sparse.diags(weights) @ shape)

    def consistent_mass(self) -> list[sparse.csr_matrix]:
        """N^T Mp N with the ghosts' inside shares, for translations and for the rotation (needed nodes squared)."""
        if not self.soil.count:
            return [sparse.csr_matrix((self._shape.shape[1],) * 2)] * 2
        ghosts = self.ghost_shape
        return [
            sparse.csr_matrix(self._gram(k) + ghosts.T @ sparse.diags(self.share * self.ghost_mass[:, k]) @ ghosts)
            for k in (0, 2)
        ]

    def ghost_mass_at_nodes(self, part: Array) -> Array:
        """N_g^T of a part (g,) of the ghosts' masses: (needed nodes, 3)."""
        return self.ghost_shape.T @ (self.ghost_mass * part[:, None])

    def set_tie(self, mobility: Array) -> None:
        """Factor the interface problem; `mobility` (needed nodes, 3) turns a link force into a coarse velocity, s/kg."""
        self.ghosts_move_by_themselves = True
        damper = 1.0 + 0.5 * self.mass_damping * self.step
        stiffness = 2.0 * damper / self.step * self.ghost_mass
        local = self._local_shape
        inverse = np.zeros((3, len(self.interface), len(self.interface)))
        for component in range(3):
            part = mobility[self.interface, component]
            loose = np.flatnonzero(part > 0.0)  # prescribed nodes do not give way
            if len(loose):
                columns = local[:, loose]
                gram = (columns.T @ sparse.diags(stiffness[:, component]) @ columns).toarray()
                inverse[component][np.ix_(loose, loose)] = np.linalg.inv(gram + np.diag(1.0 / part[loose]))
        self._tie = Tie(stiffness, inverse, self.mass_damping, damper, RETIE)

    def set_nodes(self, mass: Array, inverse_mass: Array, stiffness: sparse.csr_matrix) -> None:
        """Let the interface nodes step with the particles; the mesh then carries the ghosts' weight.

        Args:
            mass, inverse_mass: Of the nodes (needed nodes, 3), zero where prescribed.
            stiffness: Of the continuum among the interface nodes (3 w, 3 w).
        """
        own = self.interface
        self.carried_weight = np.ones(len(self.ids))
        self._generation = -1
        self.nodes.mass[:], self.nodes.inverse_mass[:] = mass[own], inverse_mass[own]
        if self.edge_stiffness is not None:
            places = (3 * own[:, None] + np.arange(3)).ravel()
            stiffness = stiffness + self.edge_stiffness[places][:, places]
        self._inner = blocks(stiffness)
        if self.soil.count:
            self._arrange()

    # ---------------------------------------------------------------------------------------------------------- substeps

    def run_prescribed(self, velocity: Array, acceleration: Array, steps: int, remember: bool) -> None:
        """Fine steps with ghosts of constant acceleration.

        Args:
            velocity, acceleration: Of the nodes (needed nodes, 3) at the start.
            steps: Number of fine steps.
            remember: Keep what `force_of_total_motion` needs of the time before the last evaluation.
        """
        if not self.soil.count:
            return
        self._prepare(steps)
        self._set_ghost_velocity(velocity)
        self._ghost_acceleration[:] = self.ghost_shape @ acceleration

        def before() -> tuple[Any, ...]:
            return self._ghost_acceleration, *self.across()

        after = (self._saved, self.reaction, self._previous, self._work)
        first = -1
        if remember and self.linear is None:
            first = self.run_loop(run_prescribed, steps, before, (steps - 1, *after), until=steps - 1)
            self._before = before_evaluation(self.soil.system, self.step, self.across()[0])
        self.run_loop(run_prescribed, steps, before, (-1, *after), first)

    def run_slaved(self, velocity: Array, inverse_mass: Array, steps: int) -> tuple[Array, Array]:
        """Fine steps with interface nodes moved by the ghosts' reactions.

        Returns:
            Displacement over the steps and final velocity (needed nodes, 3); nodes off the interface drift.
        """
        moved, reached = steps * self.step * velocity, velocity.copy()
        if not self.soil.count:
            return moved, reached
        self._prepare(steps)
        own, inverse_mass = self.interface, inverse_mass[self.interface]
        nodal = np.stack([np.zeros((len(own), 3)), velocity[own], self.nodal_acceleration])
        after = (self._saved, self.reaction, self._ghost_acceleration, self._previous, self._work)
        self.run_loop(run_slaved, steps, lambda: (nodal, inverse_mass, *self.across()), after)
        self.nodal_acceleration[:] = nodal[2]
        moved[own], reached[own] = nodal[0], nodal[1]
        return moved, reached

    def run_tied(self, start: Array, end: Array, nodal: Array, steps: int) -> Array:
        """Fine steps with ghosts tied to the free coarse velocities (needed nodes, 3) and, at their start, to the mesh `nodal`.

        Returns:
            N_g^T lambda (needed nodes, 3): the force of the tie on the nodes at the end, N.
        """
        force = np.zeros_like(start)
        if not self.soil.count:
            return force
        self._prepare(steps)
        own = self.interface
        sums = np.empty((len(own), 3))
        before = self._tie, start[own], end[own], nodal[own]
        self.run_loop(run_tied, steps, lambda: (*before, *self.across()), (self._shift, self._multiplier, sums, self._work))
        force[own] = sums
        return force

    def run_subcycled(self, velocity: Array, force: Array, slope: Array, steps: int) -> Array:
        """Fine steps of particles and interface nodes within a coarse step.

        Args:
            velocity: Of the nodes (needed nodes, 3) at the start.
            force: Of the continuum on them, N.
            slope: Change of that force by the motion of the nodes off the interface, N/s.
            steps: Number of fine steps.

        Returns:
            (needed nodes, 12): displacement, change of velocity, impulse of the continuum and force of the particles at the
            end; zero off the interface.
        """
        result = np.zeros((len(velocity), 12))
        if not self.soil.count:
            return result
        self._prepare(steps)
        own, nodes = self.interface, self.nodes
        nodes.velocity[:], nodes.start[:], nodes.slope[:] = velocity[own], force[own], slope[own]
        self._left[0] = 1
        before = (nodes, self._inner, *(None,) * 4, self.mass_damping, self._left, None, None)
        self.run_loop(run_coarse, steps, before, ())
        result[own] = np.hstack([nodes.moved, nodes.velocity - velocity[own], nodes.impulse, nodes.link])
        return result

    def run_coarse(self, side: tuple[Mesh, Blocks, NDArray[np.int64], Others | None], steps: int, substeps: int) -> None:
        """Coarse steps of `substeps` fine ones; `side` are the nodes of this rank as `bridge.subcycling.run_coarse` takes them."""
        self._prepare(steps * substeps)
        self._left[0] = steps
        self.run_loop(
            run_coarse, substeps, lambda: (self.nodes, self._inner, *side, self.mass_damping, self._left, *self.across()), ()
        )

    def across(self) -> tuple[Any, Any]:
        """Contacts with particles of other ranks and the way to them; None where one rank has all particles."""
        return None, None

    def follow_mesh(self, displacement: Array, velocity: Array, acceleration: Array) -> None:
        """Put massless ghosts where the nodal motion (needed nodes, 3) says."""
        if not self.soil.count:
            return
        system, rows, shape = self.soil.system, self._led.rows, self.ghost_shape
        moved = shape @ displacement
        system.position[rows, :3] = self._reference[rows] + moved
        system.velocity[rows, :3] = shape @ velocity
        system.acceleration[rows, :3] = shape @ acceleration

    def own_arrays(self) -> list[Array]:
        """Arrays of this class that the substeps write (kept and restored around a linear analysis)."""
        if not self.soil.count:
            return []
        return [self.reaction, self._multiplier, self._work, self._previous, self.nodes.lost]

    def _set_ghost_velocity(self, velocity: Array) -> None:
        self.soil.system.velocity[self._led.rows, :3] = self.ghost_shape @ velocity

    # ---------------------------------------------------------------------------------------------------------- energies

    @property
    def interface_work(self) -> float:
        """Work of the mesh on the particles through the ghosts, J."""
        return float(self._work[0])

    @property
    def lost_by_nodes(self) -> float:
        """What mass damping has taken from the interface nodes in the particles' steps, J."""
        return float(self.nodes.lost[0])

    def energies(self) -> list[float]:
        """Energies (J) in the order of `ENERGY_NAMES`; `external` is the work of plates, gravity and held particles."""
        if not self.soil.count:
            return [0.0] * len(self.ENERGY_NAMES)
        sums = self._sums()
        velocity = self.soil.system.velocity[self._led.rows, :3]
        kinetic = sums["kinetic"]
        if not self.ghosts_move_by_themselves:
            kinetic -= 0.5 * float(np.vdot(self.ghost_mass * velocity, velocity))
        return [kinetic, *(sums[name] for name in self.ENERGY_NAMES[1:-1]), self.interface_work]
