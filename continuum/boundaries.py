"""Supports, prescribed motion and loads of a body."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from dolfinx import fem

from . import _compat, cuts, faces, shares

DIRECTIONS = {2: "xyr", 3: "xyzabc"}  # names of the components of a node, by axes; in space r is short for abc


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
        self._gravity = np.zeros(body.axes)
        self._sum_loads()

    # prescribed motion

    def prescribe(self, where, directions: str, velocity) -> None:
        """Drive the directions of the nodes `where` with a velocity (number or function of time); collective."""
        names, given = DIRECTIONS[self._body.axes][: self._body.components], directions
        if self._body.rotations == 3:
            directions = directions.replace("r", "abc")
        if not directions or any(d not in names for d in directions) or len(set(directions)) < len(directions):
            raise ValueError(f'directions="{given}" must be different letters of "{names}"')
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
        """Owned nodes of named facets, of a region or of a marker function of points (n, axes); collective."""
        body = self._body
        if isinstance(where, str):
            facets = body.domain.facets(where)
            body.mesh.topology.create_connectivity(body.axes - 1, body.axes)
            nodes = np.unique(fem.locate_dofs_topological(body.space, body.axes - 1, facets))
            return nodes[nodes < body.count]
        marker = getattr(where, "contains", where)
        if not callable(marker):
            raise ValueError(f"where={where} must be a name of facets, a region or a function of points")
        marked = np.asarray(marker(body.coordinates), dtype=bool)
        if marked.shape != (body.count,):
            raise ValueError(f"where={where} must give one bool a point, but gave the shape {marked.shape}")
        return np.flatnonzero(marked)

    @property
    def gravity_acceleration(self) -> tuple[float, ...]:
        """Body force per unit mass (g_x, g_y[, g_z]), m/s2."""
        return tuple(float(component) for component in self._gravity)

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
        """Force and moment (3,), in space (6,), of one group of prescribed components on the body; collective."""
        body = self._body
        if where not in self._groups:
            known = ", ".join(str(name) for name in self._groups) or "none"
            raise ValueError(f"where={where} has no prescribed motion; known: {known}")
        inertia = body.mass * (body.acceleration + mass_damping * body.velocity)
        force = np.where(self._groups[where], inertia + body.internal_force() - self.loads, 0.0)
        if body.axes == 3:
            moments = np.cross(body.coordinates, force[:, :3]).sum(axis=0)
            if body.turns:
                moments += force[:, 3:].sum(axis=0)
            return np.array(body._total(np.concatenate((force[:, :3].sum(axis=0), moments))))
        x, y = body.coordinates.T
        moment = float(np.sum(x * force[:, 1] - y * force[:, 0]))
        if body.turns:
            moment += float(force[:, 2].sum())
        return np.array(body._total(np.array([force[:, 0].sum(), force[:, 1].sum(), moment])))

    # loads

    def traction(self, name: str, traction, couple=None) -> None:
        """Add a dead load (t_x, t_y[, t_z]) in Pa, and couples in N/m, on the uncovered part of the facets `name`; collective."""
        body = self._body
        traction = _vector("traction", traction, body.axes, "Pa")
        if couple is not None:
            if not body.turns:
                raise ValueError(f"couple={couple} needs a Cosserat material: leave it out with a Cauchy body")
            traction = np.concatenate((traction, _vector("couple", np.atleast_1d(couple), body.rotations, "N/m")))
        facets = body.domain.facets(name)
        if body._total(len(facets)) == 0:
            raise ValueError(f'name="{name}" holds no facets of the mesh')
        topology, axes = body.mesh.topology, body.axes
        topology.create_connectivity(axes - 1, axes)
        topology.create_connectivity(axes, axes - 1)
        corners = _compat.facet_corners(topology.cell_name())
        function, values = body._nodal("traction")
        load = function.x.array.reshape(-1, body.components)
        for facet in facets:
            cell = topology.connectivity(axes - 1, axes).links(facet)[0]
            if cell >= len(body.cell_corners):
                continue  # the owner of the cell adds it
            position = int(np.flatnonzero(topology.connectivity(axes, axes - 1).links(cell) == facet)[0])
            ends = body.cell_nodes[cell][corners[position]]
            places = body.all_coordinates[ends]
            if axes == 3:
                parts = faces.loads(places, body.share if body.excluded is None else _outside(body.excluded))
            elif body.share is None:
                parts = cuts.segment_loads(places, body.excluded)
            else:
                parts = shares.segment_loads(places, body.share)
            load[np.ix_(ends, np.arange(len(traction)))] += np.outer(parts, traction)
        _compat.scatter_add(function)
        self._tractions = self._tractions + values
        self._sum_loads()

    def gravity(self, acceleration) -> None:
        """Set the body force (g_x, g_y[, g_z]) per unit mass in m/s2."""
        self._gravity = _vector("acceleration", acceleration, self._body.axes, "m/s2")
        self._sum_loads()

    def _sum_loads(self) -> None:
        loads, axes = self._tractions.copy(), self._body.axes
        loads[:, :axes] += self._body.mass[:, :axes] * self._gravity  # row sums of the mass: exactly the integral of rho N
        loads.flags.writeable = False
        self.loads = loads
        self.revision += 1


def _vector(name: str, value, axes: int, unit: str) -> np.ndarray:
    vector = np.asarray(value, dtype=float)
    if vector.shape != (axes,) or not np.all(np.isfinite(vector)):
        numbers = {1: "one finite number (z,)", 2: "two finite numbers (x, y)", 3: "three finite numbers (x, y, z)"}[axes]
        raise ValueError(f"{name}={value} must be {numbers} in {unit}")
    return vector


def _outside(region: Any) -> Any:
    """Share of the body at points (n, axes): all of it outside a region, none inside."""
    return lambda points: np.where(np.asarray(region.contains(points), dtype=bool), 0.0, 1.0)
