"""A deformable body on a dolfinx mesh: state, lumped mass, internal and external forces.

Arrays of nodes have the shape (n_owned, components), components (x, y[, rotation]), per metre of thickness, or (x, y, z[, three
rotations]) where the mesh is one of volume elements; SI units. They hold the nodes that this rank owns. Calls marked collective must be made by every rank.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sparse
import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh
from mpi4py import MPI
from petsc4py import PETSc

from . import _compat, boundaries, cells, cuts, fields, forms, location, motion, shares, stability
from .materials import Material

DEGREE = {"triangle": 2, "quadrilateral": 3, "tetrahedron": 2, "hexahedron": 3}  # quadrature: 3, 2 x 2, 4, 2 x 2 x 2 points
MASSLESS = 1e-12  # of the largest nodal mass; below it a component does not move by itself


class Body:
    """Body of one linear material, with nodal displacements (and rotations of a Cosserat material).

    In plane strain on a plane mesh, in space on one of tetrahedra or hexahedra (`axes` 2 or 3).

    Args:
        domain: mesh with named facets (`mesh`, `facets(name)`), as made by `meshes.domains`.
        material: Cauchy, Cosserat or CosseratModuli.
        micro_inertia: rotational inertia per volume Theta: "scaled" (rho h_e^2 / 12, quasi-static runs; h_e is the edge of a
            square or cube as large as the cell, two triangles or six tetrahedra), "physical" (rho r^2 / 2 of discs, 2/5 rho
            r^2 of spheres) or a number (kg/m).
        particle_radius: radius r (m) of the particles; needed for "physical".
        excluded: region whose part of all integrals (stiffness, mass, loads) is left out (all of it allowed): exact where it has
            `corners` (a convex polygon, such as a Box in the plane), else by 16 sub-cells along the edges of a cell.
        share: function of points (n, axes) giving the part (n,) of all integrals that the body carries, 0 to 1, where particles
            carry the rest (such as `bridge.OverlapZone`); instead of `excluded`.

    Construction is collective.
    """

    def __init__(
        self,
        domain: Any,
        material: Material,
        micro_inertia: str | float = "scaled",
        particle_radius: float | None = None,
        excluded: Any = None,
        share: Callable[[np.ndarray], np.ndarray] | None = None,
    ):
        if excluded is not None and share is not None:
            raise ValueError(f"excluded={excluded} and share={share} must not be given both: leave one of them out")
        if not hasattr(domain, "mesh"):
            raise ValueError(f"domain={domain!r} must be a mesh with names, made by meshes.domains")
        if not hasattr(material, "stiffness"):
            raise ValueError(f"material={material!r} must be a material of the continuum, such as Cauchy or Cosserat")
        self.domain, self.material, self.excluded, self.share = domain, material, excluded, share
        self.mesh = domain.mesh
        self.comm = self.mesh.comm
        self.axes, self.turns = self.mesh.topology.dim, material.turns
        self.moduli, self.couple_moduli = material.stiffness_in(self.axes), material.couple_in(self.axes)
        self.rotations = 2 * self.axes - 3 if self.turns else 0
        self.components = self.axes + self.rotations
        self.time = 0.0

        self.space = _compat.nodal_space(self.mesh, self.components)
        index_map = self.space.dofmap.index_map
        self.count = index_map.size_local
        self.owned_range = tuple(int(i) for i in index_map.local_range)
        owned_cells = self.mesh.topology.index_map(self.axes).size_local
        self._all_nodes = _compat.cell_nodes(self.space)
        self.cell_nodes = self._all_nodes[:owned_cells]
        self.all_coordinates = self._node_places()
        self.coordinates = self.all_coordinates[: self.count]
        self.cell_corners = self.all_coordinates[self.cell_nodes]
        measure, number = cells.measures(self.cell_corners).sum(), len(self.cell_corners)
        self.cell_size = float(cells.length(self._total(float(measure)) / self._total(number), self.axes))  # mean, m

        self._displacement, self._displacement_values = self._nodal("displacement")
        self._velocity, self._velocity_values = self._nodal("velocity")
        self._acceleration, self._acceleration_values = self._nodal("acceleration")
        self._trial, self._trial_values = self._nodal("trial")

        inertia = self._micro_inertia(micro_inertia, particle_radius) if self.turns else np.zeros(owned_cells)
        self._cut_up()
        self._compile(inertia)
        self.boundaries = boundaries.Boundaries(self)
        self.motion = motion.Motion(self)

    # construction

    def _node_places(self) -> np.ndarray:
        index_map = self.space.dofmap.index_map
        places = np.zeros((index_map.size_local + index_map.num_ghosts, self.axes))
        places[self._all_nodes] = self.mesh.geometry.x[_compat.geometry_nodes(self.mesh), : self.axes]
        return places

    def _nodal(self, name: str):
        """A Function on the nodal space and the (n_owned, components) view of its owned values."""
        function = fem.Function(self.space)
        function.name = name
        return function, function.x.array[: self.count * self.components].reshape(self.count, self.components)

    def _micro_inertia(self, choice: str | float, radius: float | None) -> np.ndarray:
        """Theta (cells,) of the owned cells in kg/m."""
        density, axes = self.material.density, self.axes
        if choice == "scaled":
            parts = float(math.factorial(axes)) if cells.simplex(self._all_nodes.shape[1], axes) else 1.0
            return density * cells.length(parts * cells.measures(self.cell_corners), axes) ** 2 / 12.0
        if choice == "physical":
            if radius is None or not (np.isfinite(radius) and radius > 0):
                raise ValueError(f'particle_radius={radius} must be positive (m) for micro_inertia="physical"')
            return np.full(len(self.cell_corners), (0.5 if axes == 2 else 0.4) * density * radius**2)
        if isinstance(choice, str) or not (np.isfinite(choice) and choice > 0):
            raise ValueError(f'micro_inertia={choice!r} must be "scaled", "physical" or a positive number (kg/m)')
        return np.full(len(self.cell_corners), float(choice))

    def _cut_up(self) -> None:
        """Uncovered fractions, tags of whole and cut cells, weights at the points of cut cells."""
        self.cell_fractions = np.ones(len(self.cell_corners))
        weights: dict[int, np.ndarray] = {}
        if self.excluded is not None:
            if not hasattr(self.excluded, "contains"):
                raise ValueError(f"excluded={self.excluded} must be a region (an object with contains)")
            self.cell_fractions, weights = cuts.uncovered(self.cell_corners, self.excluded)
        elif self.share is not None:
            self.cell_fractions, weights = shares.weighted(self.cell_corners, self.share)
        tags = np.where(self.cell_fractions == 1.0, forms.WHOLE, forms.CUT).astype(np.int32)
        kept = np.flatnonzero(self.cell_fractions > 0.0).astype(np.int32)
        self._measure = ufl.Measure(
            "dx", domain=self.mesh, subdomain_data=dmesh.meshtags(self.mesh, self.axes, kept, tags[kept])
        )
        name = cells.name(self._all_nodes.shape[1], self.axes)
        self._degrees = DEGREE[name], cuts.CUT_DEGREE[name]
        self._weight = None
        if self.comm.allreduce(len(weights)) > 0:  # every rank compiles the same forms
            space = _compat.quadrature_space(self.mesh, self._degrees[1])
            self._weight = fem.Function(space)
            table = _compat.cell_nodes(space)
            for cell, values in weights.items():
                self._weight.x.array[table[cell]] = values

    def _compile(self, inertia: np.ndarray) -> None:
        """Stiffness matrix and lumped mass."""
        self._stiffness = fem.Constant(self.mesh, np.array(self.moduli, dtype=float))
        self._couple = fem.Constant(self.mesh, np.array(self.couple_moduli, dtype=float))
        self._density = fem.Constant(self.mesh, float(self.material.density))
        self._theta = fem.Function(_compat.cell_space(self.mesh))
        self._theta.x.array[: len(inertia)] = inertia
        w, v = ufl.TrialFunction(self.space), ufl.TestFunction(self.space)
        self._matrix = _compat.assemble_matrix(_compat.form(self._work(w, v)))
        result, mass = self._nodal("mass")
        _compat.assemble_into(result, _compat.form(self._mass(v)))
        self.mass = np.where(mass > MASSLESS * self._largest(mass), mass, 0.0)
        self._result = result
        self._result_values = result.x.array[: self.count * self.components].reshape(self.count, self.components)
        self._force = np.zeros((self.count, self.components))
        self._vectors = tuple(
            PETSc.Vec().createWithArray(array.reshape(-1), bsize=self.components, comm=self.comm)
            for array in (self.displacement, self._trial_values, self._force)
        )

    @cached_property
    def _internal(self) -> Any:
        """Form of the internal force at the trial displacement, compiled when it is first wanted (collective)."""
        return _compat.form(self._work(self._trial, ufl.TestFunction(self.space)))

    def _work(self, w, v):
        density = forms.internal_work(w, v, self._stiffness, self._couple)
        return forms.over_uncovered(density, self._measure, self._weight, *self._degrees)

    def _mass(self, v):
        density = forms.lumped_mass(v, self._density, self._theta)
        return forms.over_uncovered(density, self._measure, self._weight, *self._degrees)

    def _largest(self, array: np.ndarray) -> np.ndarray:
        """Largest value of each component over all ranks."""
        return self._reduce_max(array.max(axis=0) if len(array) else np.zeros(self.components))

    def _reduce_max(self, local: np.ndarray) -> np.ndarray:
        """Largest values over all ranks, entry by entry (collective)."""
        result = np.empty_like(local)
        self.comm.Allreduce(local, result, op=MPI.MAX)
        return result

    # state: views of the owned values; an assignment writes through them

    @property
    def displacement(self) -> np.ndarray:
        """Displacement (n_owned, components) in m and rad; a view, to be written in place."""
        return self._displacement_values

    @displacement.setter
    def displacement(self, values) -> None:
        self._displacement_values[:] = values

    @property
    def velocity(self) -> np.ndarray:
        """Velocity (n_owned, components) in m/s and rad/s; a view, to be written in place."""
        return self._velocity_values

    @velocity.setter
    def velocity(self, values) -> None:
        self._velocity_values[:] = values

    @property
    def acceleration(self) -> np.ndarray:
        """Acceleration (n_owned, components) in m/s2 and rad/s2; a view, to be written in place."""
        return self._acceleration_values

    @acceleration.setter
    def acceleration(self, values) -> None:
        self._acceleration_values[:] = values

    # forces

    def internal_force(self, displacement: np.ndarray | None = None, method: str = "matrix") -> np.ndarray:
        """Internal force + integral of B^T sigma (n_owned, components) in N and N m (collective).

        Args:
            displacement: (n_owned, components); the body's own when None.
            method: "matrix" (action of the assembled matrix) or "form" (assembly of the UFL form); equal to rounding.
        """
        if method == "matrix":
            source = self._vectors[0]
            if displacement is not None:
                self._trial_values[:] = displacement
                source = self._vectors[1]
            self._matrix.mult(source, self._vectors[2])
            return self._force.copy()
        if method != "form":
            raise ValueError(f'method="{method}" must be "matrix" or "form"')
        self._trial_values[:] = self.displacement if displacement is None else displacement
        self._trial.x.scatter_forward()
        _compat.assemble_into(self._result, self._internal)
        return self._result_values.copy()

    def marked_nodes(self, marked: np.ndarray) -> np.ndarray:
        """Number (owned cells,) of the nodes of each cell that are marked (n_owned,), whichever rank owns them (collective)."""
        self._trial_values[:] = np.asarray(marked, dtype=float)[:, None]
        self._trial.x.scatter_forward()
        found = self._trial.x.array.reshape(-1, self.components)[self.cell_nodes, 0]
        return np.rint(found.sum(axis=1)).astype(np.int64)

    def stiffness_matrix(self, nodes: np.ndarray, of_cells: np.ndarray | None = None) -> sparse.csr_matrix:
        """Stiffness among nodes of any rank, with all components (collective).

        Args:
            nodes: ascending global indices.
            of_cells: mask (owned cells,) of the cells that count, all by default.
        """
        matrix = self._matrix if of_cells is None else self._matrix_of(of_cells)
        places = (self.components * np.asarray(nodes)[:, None] + np.arange(self.components)).ravel()
        among = PETSc.IS().createGeneral(places.astype(PETSc.IntType), comm=MPI.COMM_SELF)
        (block,) = matrix.createSubMatrices([among], [among])
        start, column, value = block.getValuesCSR()
        return sparse.csr_matrix((value, column, start), shape=block.getSize())

    def stiffness_rows(self) -> sparse.csr_matrix:
        """Stiffness (components of the owned nodes, of all nodes by global index)."""
        start, column, value = self._matrix.getValuesCSR()
        return sparse.csr_matrix((value, column, start), shape=(self.mass.size, self._matrix.getSize()[1]))

    def _matrix_of(self, some_cells: np.ndarray) -> Any:
        """Stiffness matrix of some of the owned cells."""
        counts = fem.Function(_compat.cell_space(self.mesh))
        counts.x.array[: len(some_cells)] = some_cells
        w, v = ufl.TrialFunction(self.space), ufl.TestFunction(self.space)
        density = counts * forms.internal_work(w, v, self._stiffness, self._couple)
        form = forms.over_uncovered(density, self._measure, self._weight, *self._degrees)
        return _compat.assemble_matrix(_compat.form(form))

    def external_force(self) -> np.ndarray:
        """Constant loads (n_owned, components): tractions and body force on the uncovered part; not to be written."""
        return self.boundaries.loads

    def update_ghosts(self) -> None:
        """Send owned displacements, velocities and accelerations to the ranks that hold them as ghosts (collective)."""
        if self.comm.size > 1:
            for function in (self._displacement, self._velocity, self._acceleration):
                function.x.scatter_forward()

    def strain_energy(self) -> float:
        """Strain energy of the uncovered part in J (collective)."""
        return self._total(0.5 * float(np.vdot(self.displacement, self.internal_force())))

    def kinetic_energy(self) -> float:
        """Kinetic energy 1/2 v M v in J (collective)."""
        return self._total(0.5 * float(np.vdot(self.velocity, self.mass * self.velocity)))

    def _total(self, local):
        """Sum over the ranks of a number or an array."""
        return local if self.comm.size == 1 else self.comm.allreduce(local)

    # boundary conditions and loads

    def fix(self, where: str | Callable, directions: str) -> None:
        """Hold the directions of the nodes `where` at rest (collective).

        Args:
            where: name of facets of the domain, a region, or a function of points (n, axes) giving bools (n,).
            directions: held components, letters of "xyr" together (r: the rotation), in space of "xyzabc" (a, b, c: the
                rotations about x, y, z) or r for all three; a later call wins where two name the same component.
        """
        self.boundaries.prescribe(where, directions, 0.0)

    def prescribe(self, where: str | Callable, directions: str, velocity: float | Callable[[float], float]) -> None:
        """Move the directions of the nodes `where` with a velocity (m/s, rad/s), a number or a function of time."""
        self.boundaries.prescribe(where, directions, velocity)

    def traction(self, name: str, traction, couple=None) -> None:
        """Add a dead load (t_x, t_y[, t_z]) in Pa on the facets called `name`, on their uncovered part only (collective).

        `couple` is the moment per area of a Cosserat body in N/m, a number in the plane, else (m_x, m_y, m_z); none when None.
        """
        self.boundaries.traction(name, traction, couple)

    def gravity(self, acceleration) -> None:
        """Body force (g_x, g_y[, g_z]) per unit mass in m/s2; replaces an earlier one."""
        self.boundaries.gravity(acceleration)

    @property
    def gravity_acceleration(self) -> tuple[float, ...]:
        """Body force per unit mass (g_x, g_y[, g_z]), m/s2."""
        return self.boundaries.gravity_acceleration

    @property
    def fixed(self) -> np.ndarray:
        """True (n_owned, components) where a component is prescribed."""
        return self.boundaries.fixed

    @property
    def moves_prescribed(self) -> bool:
        """Whether any prescribed component (of any rank) moves, ever."""
        return self.boundaries.moving

    def prescribed_velocity(self, time: float) -> np.ndarray:
        """Prescribed velocities (n_owned, components) at a time; zero where nothing is prescribed."""
        return self.boundaries.velocity(time)

    def reaction(self, where: str | Callable, mass_damping: float | None = None) -> np.ndarray:
        """Force and moment (f_x, f_y, moment about the origin) that the support `where` exerts on the body (collective).

        In space the three forces and the three moments, those of the micro-rotation included. From M a + c M v + F_int - F_ext on its prescribed components; c is the mass damping (1/s), that of the last
        `advance` when None. A node in two groups counts in both.
        """
        return self.boundaries.reaction(where, self.motion.mass_damping if mass_damping is None else mass_damping)

    # motion, limits, look-ups

    def advance(self, steps: int, step: float, mass_damping: float = 0.0, local_damping: float = 0.0) -> None:
        """Take explicit steps; see `motion.Motion.advance` (collective)."""
        self.motion.advance(steps, step, mass_damping, local_damping)

    def energies(self) -> dict[str, float]:
        """Energy terms and balance error in J; see `motion.Motion.energies` (collective)."""
        return self.motion.energies()

    def critical_step(self, bound: str = "element", mass: np.ndarray | None = None) -> float:
        """Largest stable step in s; see `stability.critical_step` (collective)."""
        return stability.critical_step(self, bound, mass)

    def shape_functions(self, points, gradients: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Cells' shape functions at points; see `location.shape_functions` (collective)."""
        return location.shape_functions(self, points, gradients)

    def owners(self, points) -> np.ndarray:
        """Ranks that own the cells of points; see `location.owners` (collective)."""
        return location.owners(self, points)

    def strain_fields(self) -> dict[str, fem.Function]:
        """Cell-wise strain measures for output; see `fields.strain_fields` (collective)."""
        return fields.strain_fields(self)

    def stress_fields(self) -> dict[str, fem.Function]:
        """Cell-wise stress measures for output; see `fields.stress_fields` (collective)."""
        return fields.stress_fields(self)
