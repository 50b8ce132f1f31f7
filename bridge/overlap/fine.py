"""The particle side of the overlap coupling."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray

from bridge.overlap.mass import factored, rows_of, solve
from bridge.overlap.nodes import ZoneNodes
from bridge.overlap.steps import Tied, run_penalised, run_tied
from bridge.overlap.tie import Tie, by_component
from bridge.particle_side import ParticleSide
from particles.dispatch import Direct

Array = NDArray[np.float64]

PLACES, SPEEDS = ("position", "rotation"), ("velocity", "spin")  # arrays of the particle rows
_run_tied, _run_penalised, _solve = map(Direct, (run_tied, run_penalised, solve))


class ZoneParticles(ParticleSide):
    """Particles of which those in the zone are tied to the mesh, and the nodes that tie them.

    Args:
        soil: Assembly, weighed already.
        tie: Tied particles.
        stiffness: (g, f) of springs, or None where the tied components are eliminated.
        step: Particle time step, s.
        mass_damping: c_m, 1/s.
        gravity: m/s2.
        vector_damping: (alpha, alpha_r) of the particles that are not eliminated, or None.
    """

    ENERGY_NAMES = (
        "kinetic", "elastic", "friction", "viscous", "contact_loss", "mass_damping", "local_damping", "external", "penalty",
        "stepping",
    )  # fmt: skip
    leads = True  # whether what the nodes lose counts here; where all ranks step them alike it does on one

    def __init__(
        self, soil, tie: Tie, stiffness: Array | None, step: float, mass_damping: float, gravity, vector_damping=None
    ):
        super().__init__(soil, step, mass_damping, gravity, vector_damping)
        self.tie, self.eliminated, self._axes = tie, stiffness is None, len(gravity)
        shape, size = tie.tied.shape, tie.width * len(tie.exchange.nodes)
        self.all_masses = by_component(soil.masses, soil.inertias, self._axes)  # (n, f)
        self.masses = self.all_masses[tie.ids]
        self.stiffness = np.zeros(shape) if stiffness is None else np.where(tie.tied, stiffness, 0.0)
        self.force, self._origin = np.zeros(shape), np.zeros(shape)
        values = [np.zeros(size) for _ in ZoneNodes._fields[:-3]]
        links = values[ZoneNodes._fields.index("link")].reshape(-1, 3)
        self.nodes = ZoneNodes._make([*values, links, np.zeros(1), np.zeros(1)])
        self.external = soil.external_forces[tie.ids].reshape(shape)
        loads = self.masses * [*gravity, *np.zeros(shape[1] - self._axes)] + tie.share[tie.ids, None] * self.external
        self.load = np.where(tie.tied & self.eliminated, loads, 0.0)  # of the mesh, where components are eliminated

    def set_nodes(
        self, mass: Array, movable: NDArray[np.bool_], stiffness: sparse.csr_matrix, edge: sparse.csr_matrix, displacement: Array
    ) -> None:  # fmt: skip
        """Factor the masses; what is now the state becomes the one without stretch.

        Args:
            mass: Lumped mass of the continuum at the nodes (w, c), c components each.
            movable: Components (w, c) that are neither prescribed nor without any mass.
            stiffness: Of the continuum among the nodes (c w, c w).
            edge: The part of it that is of cells with other nodes, too.
            displacement: Of the nodes (w, c).
        """
        self.lumped, tie = mass.ravel(), self.tie.matrix
        matrix = sparse.diags(self.lumped)
        if self.eliminated:
            matrix = matrix + tie.T @ sparse.diags(self.masses.ravel()) @ tie
        self.mass = factored(matrix, np.flatnonzero(movable.ravel() & (matrix.diagonal() > 0.0)))
        self.continuum_stiffness, self._edge = stiffness, edge
        self._inner = rows_of(stiffness)
        if self.soil.count:
            self._prepare(1)
            self._origin[:] = self._present(*PLACES)
            self._origin -= self._led_by(displacement)
            turning = self._origin[:, self._axes :]
            turning[:] = np.where(self.tie.tied[:, self._axes :], turning, 0.0)

    def _rows(self, names: tuple[str, ...]) -> list[Array]:
        """Arrays of the particle rows: of translations (in the plane of all components) and, in space, of rotations."""
        found = [getattr(self.soil.system, name) for name in names]
        return [rows for rows in found if rows is not None]

    def _present(self, *names: str) -> Array:
        """Components (g, f) of the tied particles."""
        return np.hstack([rows[self._led.rows, :3] for rows in self._rows(names)])

    def _assign(self, names: tuple[str, ...], values: Array) -> None:
        """Write tied components of values (g, f)."""
        for part, rows in enumerate(self._rows(names)):
            which = slice(3 * part, 3 * part + 3)
            own = rows[self._led.rows, :3]
            rows[self._led.rows, :3] = np.where(self.tie.tied[:, which], values[:, which], own)

    def _led_by(self, nodal: Array) -> Array:
        """What the mesh gives to the tied particles (g, f), from nodes (w, c)."""
        return (self.tie.matrix @ nodal.ravel()).reshape(self.tie.tied.shape)

    def _order(self, rows, order) -> None:
        matrix = self.tie.matrix
        self._led = Tied(
            rows[self.tie.ids].astype(np.int64), matrix.indptr.astype(np.int64), matrix.indices.astype(np.int64), matrix.data,
            self.load, self._origin, self.stiffness, self.force,
        )  # fmt: skip

    def prepare(self, steps: int) -> None:
        """Make ready for that many fine steps (collective where the particles are spread)."""
        if self.soil.count:
            self._prepare(steps)

    def run(self, displacement: Array, velocity: Array, force: Array, slope: Array, steps: int) -> Array:
        """Fine steps of particles and nodes of the zone within a coarse step; `prepare` was called for them.

        Args:
            displacement, velocity: Of the nodes (w, c) at the start.
            force: Of the continuum on them, N.
            slope: Change of that force by the motion of the other nodes, N/s.
            steps: Number of fine steps.

        Returns:
            (w, 3 c): displacement, change of velocity and acceleration at the end.
        """
        nodes = self.nodes
        if not self.soil.count:
            return np.zeros((len(velocity), 3 * velocity.shape[1]))
        nodes.base[:], nodes.velocity[:] = displacement.ravel(), velocity.ravel()
        nodes.start[:], nodes.slope[:] = force.ravel(), slope.ravel()
        kernel = _run_tied if self.eliminated else _run_penalised
        self.run_loop(kernel, steps, lambda: (nodes, self._inner, self.mass, self.mass_damping, *self.across()), ())
        moved, reached, acceleration = (part.reshape(velocity.shape) for part in (nodes.moved, nodes.velocity, nodes.acceleration))
        return np.hstack([moved, reached - velocity, acceleration])

    def across(self) -> tuple[Any, Any]:
        """Contacts with particles of other ranks and the way to them, for the loop; None on one rank."""
        return None, None

    def missing(self, step: float) -> Array:
        """Impulse (w, c) that cells at the edge of the zone lack in a coarse step to that of the trapezoidal rule, N s.

        Within the step the nodes of the zone feel them at every fine time, those outside at both ends.
        """
        nodes = self.nodes
        return (self._edge @ (nodes.swept - 0.5 * step * nodes.moved)).reshape(-1, self.tie.width)

    @property
    def worked(self) -> float:
        """Work of the continuum on the nodes of the zone in the last `run`, J."""
        return float(self.nodes.work[0])

    def solve(self, values: Array) -> Array:
        """M^-1 values (w, c) of the nodes."""
        flat = np.ascontiguousarray(values).ravel().copy()
        if flat.size:
            _solve(self.mass, flat)
        return flat.reshape(values.shape)

    def kick(self, velocity: Array) -> None:
        """Add a change of the nodes' velocity (w, c) to the components that follow them."""
        if self.eliminated and self.soil.count:
            self._assign(SPEEDS, self._present(*SPEEDS) + self._led_by(velocity))

    def follow_mesh(self, displacement: Array, velocity: Array) -> None:
        """Put eliminated components where the nodal motion (w, c) says; with linear contacts, compute the forces anew."""
        if not self.soil.count:
            return
        if self.eliminated:
            self._assign(PLACES, self._led_by(displacement) + self._origin)
            self._assign(SPEEDS, self._led_by(velocity))
        if self.linear is not None:
            system = self.soil.system
            shape = (3 * self.soil.count, 3 * self.soil.count)
            matrix = sparse.csr_matrix((self.linear.value, self.linear.column, self.linear.start), shape=shape)
            moved = system.position[:, :3] - self._reference
            system.force[:, :3] = -(matrix @ moved.ravel()).reshape(-1, 3)

    def linearise(self, stiffness: sparse.spmatrix | None) -> None:
        """As for all couplings; loads are left out, and the state without stretch is that of the reference positions."""
        super().linearise(stiffness)
        if self.linear is not None:
            self.load[:] = 0.0
            self._origin[:] = np.where(self.tie.tied, self._reference[self._led.rows], 0.0)

    def own_arrays(self) -> list[Array]:
        """Arrays of this class that a linear analysis writes (kept and restored around it)."""
        return [self.force, self.nodes.lost, self.nodes.work, self.load, self._origin]

    def stretch(self, displacement: Array) -> Array:
        """Motion of the tied particles beyond that of the mesh (g, f), m and rad; zero for components that are free."""
        if not self.soil.count:
            return np.zeros(self.tie.tied.shape)
        self._arrange()
        return np.where(self.tie.tied, self._present(*PLACES) - self._origin - self._led_by(displacement), 0.0)

    def energies(self, displacement: Array) -> list[float]:
        """Energies (J) in the order of `ENERGY_NAMES`."""
        if not self.soil.count:
            return [0.0] * len(self.ENERGY_NAMES)
        sums = self._sums()
        sums["mass_damping"] += float(self.nodes.lost[0]) if self.leads else 0.0
        sums["penalty"] = 0.5 * float(np.vdot(self.stiffness, self.stretch(displacement) ** 2))
        sums["stepping"] = self.step**2 / 8.0 * float(np.sum(self.all_masses * self.soil.accelerations**2))
        return [sums[name] for name in self.ENERGY_NAMES]

    def start(self, force: Array) -> Array:
        """Accelerations of the nodes (w, c) under the continuum's force (w, c) and the particles'; tied components take them."""
        if not self.soil.count:
            return np.zeros_like(force)
        if self.eliminated:
            felt = np.where(self.tie.tied, self._present("force", "torque") - self.load, 0.0)
            force = force + (self.tie.matrix.T @ felt.ravel()).reshape(force.shape)
        found = self.solve(force)
        if self.eliminated:
            self._assign(("acceleration", "angular"), self._led_by(found))
        return found
