"""The linearised coupled system as one state vector that is stepped by the run's own code (for the growth test)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from particles.walls.listing import moving_arrays


class LinearSystem:
    """Context in which a `BridgingScale` steps the linear system: contact law -K q, no loads. Restores everything at the end.

    The state vector holds displacements, velocities times a time scale and accelerations times its square of nodes and
    particles, and what the variant carries along; it is the same whole vector on every rank.

    Args:
        coupled: A `BridgingScale`.
        stiffness: K (3n, 3n) of the particles in id order, sparse; None on ranks without particles.
        scale: Time scale, s: near 1 / (angular frequency) of the slowest motion, so that eigenvectors stay well apart.
    """

    def __init__(self, coupled, stiffness, scale: float):
        self._coupled, self._stiffness, self._scale = coupled, stiffness, scale
        self._rule, self._fine, self._body = coupled.rule, coupled.fine, coupled.body

    def __enter__(self) -> LinearSystem:
        coupled, rule, fine, system = self._coupled, self._rule, self._fine, self._fine.soil.system
        self._kept = [array.copy() for array, _ in self._arrays()]
        self._sums = [array.copy() for array in self._side_arrays(system)]
        self._attributes = {name: np.copy(getattr(rule, name)) for name in rule.ATTRIBUTES}
        self._clock = (coupled.time, coupled.coarse_steps)
        rule.external[:], rule.moves_prescribed = 0.0, False
        fine.linearise(self._stiffness)
        self._bounds = np.cumsum([0, *self._body.comm.allgather(len(self._local()))])
        return self

    def __exit__(self, *exception) -> None:
        coupled, rule, system = self._coupled, self._rule, self._fine.soil.system
        self._fine.linearise(None)
        for name, value in self._attributes.items():
            if value.ndim:
                getattr(rule, name)[:] = value
            else:
                setattr(rule, name, value.item())
        for (array, _), kept in zip(self._arrays(), self._kept, strict=True):
            array[:] = kept
        for array, kept in zip(self._side_arrays(system), self._sums, strict=True):
            array[:] = kept
        coupled.time, coupled.coarse_steps = self._clock

    def _arrays(self) -> list[tuple[NDArray, float]]:
        body, system, time = self._body, self._fine.soil.system, self._scale
        motion: list[tuple[NDArray, float]] = [
            (body.displacement, 1.0), (body.velocity, time), (body.acceleration, time * time),
            (system.position[:, :3], 1.0), (system.velocity[:, :3], time), (system.acceleration[:, :3], time * time),
        ]  # fmt: skip
        return motion + [(array, time * time) for array in self._rule.carried()]

    def _side_arrays(self, system):
        plates = [] if system.walls is None else moving_arrays(system.walls)
        return [system.sums, system.clock, system.force, *plates, *self._fine.own_arrays()]

    def _local(self) -> NDArray[np.float64]:
        parts = [np.ravel(array) * scale for array, scale in self._arrays()]
        parts[3] = parts[3] - self._fine.reference().ravel() if self._fine.soil.count else parts[3]
        return np.concatenate(parts)

    def read(self) -> NDArray[np.float64]:
        """The state vector (collective)."""
        return np.concatenate(self._body.comm.allgather(self._local()))

    def write(self, vector: NDArray[np.float64]) -> None:
        """Set the state; prescribed nodes rest, ghosts that have no motion of their own follow the mesh (collective)."""
        rank = self._body.comm.rank
        own = vector[self._bounds[rank] : self._bounds[rank + 1]]
        at = 0
        for array, scale in self._arrays():
            array[:] = own[at : at + array.size].reshape(array.shape) / scale
            at += array.size
        if self._fine.soil.count:
            self._fine.soil.system.position[:, :3] += self._fine.reference()
        for array in (self._body.displacement, self._body.velocity, self._body.acceleration):
            array[self._body.fixed] = 0.0
        self._rule.start_from_state()

    def step(self) -> None:
        """One coarse step."""
        self._rule.advance()
