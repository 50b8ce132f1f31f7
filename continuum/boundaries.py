"""Supports, prescribed motion and loads of a body."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from dolfinx import fem

from . import _compat, cuts, shares


class Boundaries:
    """Prescribed components and constant loads of one body; used through `Body`."""

    def __init__(self, body: Any):
        self._body = body
        shape = (body.count, body.components)
        self.fixed = np.zeros(shape, dtype=bool)
        self.revision = 0  # grows with every change, so that the motion knows
        self._source = np.full(shape, -1)  # which motion drives a component
        self._motions: list[float | Callable[[float], float]] = []
        self._groups: dict[Any, np.ndarray] = {}
        self._tractions = np.zeros(shape)
        self._gravity = np.zeros(2)
        self._sum_loads()

    # prescribed motion

    def prescribe(self, where, directions: str, velocity) -> None:
        """Drive the directions of the nodes `where` with a velocity (number or function of time); collective."""
        names = "xyr"[: self._body.components]
        if not directions or any(d not in names for d in directions) or len(set(directions)) < len(directions):
            raise ValueError(f'directions="{directions}" must be different letters of "{names}"')
        if not callable(velocity) and not np.isfinite(velocity):
            raise ValueError(f"velocity={velocity} must be finite (m/s, rad/s)")
        nodes = self.nodes(where)
        if self._body._total(len(nodes)) == 0:
            raise ValueError(f"where={where} holds no nodes of the mesh")
        components = np.array([names.index(d) for d in directions])
        self._source[np.ix_(nodes, components)] = len(self._motions)
        self._motions.append(velocity if callable(velocity) else float(velocity))
        self.fixed = self._source >= 0
        group = self._groups.setdefault(where, np.zeros(self.fixed.shape, dtype=bool))
        group[np.ix_(nodes, components)] = True
        self._fixed_flat = np.flatnonzero(self.fixed.ravel())
        self._fixed_source = self._source.ravel()[self._fixed_flat]
        self.revision += 1

    def nodes(self, where) -> np.ndarray:
        """Owned nodes of named facets, of a region or of a marker function of points (n, 2); collective."""
        body = self._body
        if isinstance(where, str):
            facets = body.domain.facets(where)
            body.mesh.topology.create_connectivity(1, 2)
            nodes = np.unique(fem.locate_dofs_topological(body.space, 1, facets))
            return nodes[nodes < body.count]
        marker = getattr(where, "contains", where)
        if not callable(marker):
            raise ValueError(f"where={where} must be a name of facets, a region or a function of points")
        marked = np.asarray(marker(body.coordinates), dtype=bool)
        if marked.shape != (body.count,):
            raise ValueError(f"where={where} must give one bool a point, but gave the shape {marked.shape}")
        return np.flatnonzero(marked)

    @property
    def gravity_acceleration(self) -> tuple[float, float]:
        """Body force per unit mass (g_x, g_y), m/s2."""
        return float(self._gravity[0]), float(self._gravity[1])

    @property
    def moving(self) -> bool:
        """Whether any motion is other than rest."""
        return any(callable(motion) or motion != 0.0 for motion in self._motions)

    @property
    def fixed_flat(self) -> np.ndarray:
        """Places of the prescribed components in the flattened (n_owned, components) arrays."""
        return self._fixed_flat if self._motions else np.empty(0, dtype=np.int64)

    def velocity_flat(self, time: float) -> np.ndarray:
        """Velocities of the prescribed components at a time, in the order of `fixed_flat`."""
        if not self._motions:
            return np.empty(0)
        values = [float(motion(time)) if callable(motion) else motion for motion in self._motions]
        return np.array(values)[self._fixed_source]

    def velocity(self, time: float) -> np.ndarray:
        """Prescribed velocities (n_owned, components) at a time; zero where nothing is prescribed."""
        velocity = np.zeros(self.fixed.shape)
        velocity.ravel()[self.fixed_flat] = self.velocity_flat(time)
        return velocity

    def reaction(self, where, mass_damping: float) -> np.ndarray:
        """Force and moment (3,) of one group of prescribed components on the body; collective."""
        body = self._body
        if where not in self._groups:
            known = ", ".join(str(name) for name in self._groups) or "none"
            raise ValueError(f"where={where} has no prescribed motion; known: {known}")
        inertia = body.mass * (body.acceleration + mass_damping * body.velocity)
        force = np.where(self._groups[where], inertia + body.internal_force() - self.loads, 0.0)
        x, y = body.coordinates.T
        moment = float(np.sum(x * force[:, 1] - y * force[:, 0]))
        if body.components == 3:
            moment += float(force[:, 2].sum())
        return np.array(body._total(np.array([force[:, 0].sum(), force[:, 1].sum(), moment])))

    # loads

    def traction(self, name: str, traction) -> None:
        """Add a dead load (t_x, t_y) in Pa on the uncovered part of the facets called `name`; collective."""
        traction = _vector("traction", traction, "Pa")
        body, facets = self._body, self._body.domain.facets(name)
        if body._total(len(facets)) == 0:
            raise ValueError(f'name="{name}" holds no facets of the mesh')
        topology = body.mesh.topology
        topology.create_connectivity(1, 2)
        topology.create_connectivity(2, 1)
        function, values = body._nodal("traction")
        load = function.x.array.reshape(-1, body.components)
        for facet in facets:
            cell = topology.connectivity(1, 2).links(facet)[0]
            if cell >= len(body.cell_corners):
                continue  # the owner of the cell adds it
            position = int(np.flatnonzero(topology.connectivity(2, 1).links(cell) == facet)[0])
            ends = body.cell_nodes[cell][_facet_nodes(body.cell_nodes.shape[1])[position]]
            places = body.all_coordinates[ends]
            if body.share is None:
                parts = cuts.segment_loads(places, body.excluded)
            else:
                parts = shares.segment_loads(places, body.share)
            load[np.ix_(ends, [0, 1])] += np.outer(parts, traction)
        _compat.scatter_add(function)
        self._tractions = self._tractions + values
        self._sum_loads()

    def gravity(self, acceleration) -> None:
        """Set the body force (g_x, g_y) per unit mass in m/s2."""
        self._gravity = _vector("acceleration", acceleration, "m/s2")
        self._sum_loads()

    def _sum_loads(self) -> None:
        loads = self._tractions.copy()
        loads[:, :2] += self._body.mass[:, :2] * self._gravity  # row sums of the mass: exactly the integral of rho N
        loads.flags.writeable = False
        self.loads = loads
        self.revision += 1


def _vector(name: str, value, unit: str) -> np.ndarray:
    vector = np.asarray(value, dtype=float)
    if vector.shape != (2,) or not np.all(np.isfinite(vector)):
        raise ValueError(f"{name}={value} must be two finite numbers (x, y) in {unit}")
    return vector


def _facet_nodes(nodes: int) -> list[list[int]]:
    """End nodes of the facets of a cell in the order of the reference cell (basix)."""
    return [[1, 2], [0, 2], [0, 1]] if nodes == 3 else [[0, 1], [0, 2], [1, 3], [2, 3]]
