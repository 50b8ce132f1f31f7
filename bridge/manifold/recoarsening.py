"""Particles that have become quiet and intact again are taken back by elements.

No paper has it; the error is that of the fit, and it is booked. The nodes of the elements that come back get the motion q that
differs least from that of the particles they take over and from their own where they have been there before:

    (sum_j m_j N_j N_j^T + diag(M)) q = sum_j m_j N_j q_j + M q_old

for displacements and velocities alike. The N_j sum to one, so that linear momentum, with masses lumped at the nodes, and the
centre of mass are kept exactly; they carry linear fields exactly, so that these come back as they were, which shares lumped at the
nodes would not do. Angular momentum is kept with the consistent mass; masses at the nodes of an element turn with more of it than
its particles did, as they have more kinetic energy: what a release loses by it, the return gives back.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse import coo_array, diags
from scipy.sparse.linalg import splu

from bridge.manifold.changes import Change, booked
from bridge.manifold.kinds import CONTINUUM, MANIFOLD, PARTICLES
from continuum import bricks
from particles.lattice.driving import Where, rows_of
from particles.lattice.state import BROKEN

if TYPE_CHECKING:
    from bridge.manifold.body import Manifold


@dataclass(frozen=True)
class Recoarsening:
    """When particles become an element again.

    Args:
        strain: largest root mean square of what an element would not carry of its particles' motion: of strains, and of
            velocities over the wave speed. An element then loses about E strain^2 of energy per volume at most.
        quiet: time for which that must have held, s.
        share: of the criterion of release; it must not be met by strains of the particles divided by `share`.
        distance: elements between one that comes back and the nearest broken bond.
        where: elements that may come back, a region or a function of their centres; those that were elements at the start by
            default.
        check_every: steps between two looks.
    """

    strain: float
    quiet: float
    share: float = 0.5
    distance: int = 2
    where: Where | None = None
    check_every: int = 50

    def __post_init__(self) -> None:
        if not (math.isfinite(self.strain) and self.strain > 0):
            raise ValueError(f"strain={self.strain} must be positive")
        if not (math.isfinite(self.quiet) and self.quiet >= 0):
            raise ValueError(f"quiet={self.quiet} must be 0 or more (s)")
        if not 0 < self.share < 1:
            raise ValueError(f"share={self.share} must lie between 0 and 1: below the limit of release, or elements flicker")
        if self.distance < 1 or self.check_every < 1:
            raise ValueError(f"distance={self.distance} and check_every={self.check_every} must be at least 1")


class Recoarsener:
    """Looks for elements that come back, and takes them back.

    Args:
        body: the manifold body, with its first kinds of elements.
        rule: when they do.
        per_element: sites along the edge of an element, as the body was told.
    """

    def __init__(self, body: Manifold, rule: Recoarsening, per_element: Any) -> None:
        self._body, self.rule = body, rule
        grid = body.grid
        full = grid.full()
        self._may = full & (body.kind != PARTICLES)
        if rule.where is not None:
            self._may = np.zeros(grid.count, dtype=bool)
            self._may[rows_of(rule.where, body.centres)] = True
            self._may &= full
        slots = np.unique(grid.slot)
        self._shape = body._shape[slots]
        corners = self._shape.shape[1]
        nodes = grid.nodes[np.flatnonzero(self._may)[0]] if self._may.any() else np.arange(corners)
        folded = np.zeros((len(slots), corners))
        np.add.at(folded.T, np.unique(nodes, return_inverse=True)[1].reshape(-1), self._shape.T)
        if np.linalg.matrix_rank(folded) < len(np.unique(nodes)):
            raise ValueError(
                f"per_element={per_element} must be at least 2 along axes that do not repeat, for elements to come back from the "
                "motion of their particles"
            )
        self._fit = np.linalg.pinv(self._shape)  # (corners, slots): motion of nodes nearest to that of the particles of one element
        self._strain = bricks.strain_matrix(body.slots[slots], body.size)  # (slots, 6, dofs)
        self.since = np.full(grid.count, np.inf)  # time since when an element's particles have been quiet
        self.steps = 0  # since the last look
        self.returned = 0
        self._speed = min(one.wave_speed for one in body.lattice.materials)

    @property
    def left(self) -> int:
        """Steps until the next look."""
        return self.rule.check_every - self.steps

    def went_on(self, step_count: int) -> None:
        """Look, if it is time to, after so many steps."""
        if step_count < self.left:
            self.steps += step_count
            return
        self.steps = 0
        body, rule = self._body, self.rule
        found = self._intact()
        sites = self._sites(found)
        quiet = found[self._error(found, sites, self._nearest(sites)) & self._below(sites)]
        still = np.zeros(body.grid.count, dtype=bool)
        still[quiet] = True
        self.since[~still] = np.inf
        self.since[quiet] = np.minimum(self.since[quiet], body.time)
        self.take_back(quiet[body.time - self.since[quiet] >= rule.quiet * (1.0 - 1e-12)])

    def _intact(self) -> np.ndarray:
        """Elements left to particles that may come back and lie far enough from broken bonds."""
        body = self._body
        found = self._may & (body.kind == PARTICLES)
        if not found.any():
            return np.flatnonzero(found)
        broken = np.unique(body.grid.element[np.any(body.lattice._state.bonds & BROKEN, axis=1)])
        for _ in range(self.rule.distance if len(broken) else 0):
            broken = body.grid.around(broken)
        found[broken] = False
        return np.flatnonzero(found)

    def _sites(self, elements: np.ndarray) -> np.ndarray:
        """Rows (elements, slots) of the particles of full elements."""
        grid = self._body.grid
        sites = grid.sites_of(elements)
        order = np.lexsort((grid.slot[sites], grid.element[sites]))
        return sites[order].reshape(len(elements), len(self._strain))

    def _nearest(self, sites: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Displacements and velocities (elements, corners, axes) of the nodes of each element alone that carry its particles best."""
        state, axes = self._body.lattice._state, self._body.lattice.axes
        found = [np.einsum("cs,aes->eca", self._fit, own[:axes, sites]) for own in (state.displacement, state.velocity)]
        return found[0], found[1]

    def _error(self, elements: np.ndarray, sites: np.ndarray, motion: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        """Which elements (elements,) carry their particles well enough by a motion of their nodes."""
        state, axes = self._body.lattice._state, self._body.lattice.axes
        displacement, velocity = motion
        nodal = displacement.reshape(len(elements), self._strain.shape[2])
        strain = np.einsum("src,ec->res", self._strain, nodal) - state.strain[:, sites]
        square = (strain[:3] ** 2).sum(axis=0) + 2.0 * (strain[3:] ** 2).sum(axis=0)
        left = np.einsum("sc,eca->aes", self._shape, velocity) - state.velocity[:axes, sites]
        speed = (left**2).sum(axis=0)
        most = self.rule.strain**2
        return (square.mean(axis=1) <= most) & (speed.mean(axis=1) <= most * self._speed**2)

    def _below(self, sites: np.ndarray) -> np.ndarray:
        """Elements (elements,) in which no particle comes near the criterion of release."""
        criterion, strain = self._body.criterion, self._body.lattice._state.strain
        if criterion is None or not sites.size:
            return np.ones(len(sites), dtype=bool)
        met = np.asarray(criterion(strain[:, sites.ravel()].T / self.rule.share), dtype=bool)
        return ~np.any(met.reshape(sites.shape), axis=1)

    def take_back(self, elements: np.ndarray) -> np.ndarray:
        """Make manifold elements of those left to particles that carry their particles well enough, their neighbours considered.

        What the kinetic and strain energy lose is booked as `recoarsen_kinetic` and `recoarsen_strain`. Manifold elements that
        are left without particles near go back to what they were at the start.

        Returns:
            Those that have come back.
        """
        body, grid = self._body, self._body.grid
        body.prepare()  # strains of now
        elements = np.unique(np.asarray(elements, dtype=np.int64))
        elements = elements[self._may[elements] & (body.kind[elements] == PARTICLES)]
        while len(elements):
            sites = self._sites(elements)
            nodes, motion = self._common(elements, sites)
            where = np.searchsorted(nodes, grid.nodes[elements])
            fits = self._error(elements, sites, (motion[0][where], motion[1][where]))
            if fits.all():
                break
            self.since[elements[~fits]] = np.inf
            elements = elements[fits]
        if not len(elements):
            return elements
        change = Change(body, elements)
        with booked(body, "recoarsen"):
            for nodal, found in zip((body._nodes.displacement, body._nodes.velocity), motion):
                nodal[: body.lattice.axes, nodes] = found.T
            body._add_mass(elements, 1.0)
            body.kind[elements] = MANIFOLD
            for own in (body.lattice._state.velocity, body.lattice._state.force):
                own[:, sites] = 0.0  # they are the nodes' from now on
            change.changed = np.concatenate((elements, self._coarsen()))
            change.carry_out()
            self.since[elements] = np.inf
            self.returned += len(elements)
        return elements

    def _common(self, elements: np.ndarray, sites: np.ndarray) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
        """Nodes (k,) of elements, sorted, and the displacements and velocities (k, axes) that carry all their particles best."""
        body, state, axes = self._body, self._body.lattice._state, self._body.lattice.axes
        nodes, where = np.unique(body.grid.nodes[elements], return_inverse=True)
        where = where.reshape(len(elements), -1)
        mass = body.lattice.mass[sites]
        shape, own = self._shape, body.node_mass[nodes]
        blocks = np.einsum("es,sc,sd->ecd", mass, shape, shape)
        rows, columns = np.broadcast_arrays(where[:, :, None], where[:, None, :])
        matrix = coo_array((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=(len(nodes),) * 2).tocsc()
        solver = splu((matrix + diags(own)).tocsc())
        found = []
        for fine, coarse in ((state.displacement, body._nodes.displacement), (state.velocity, body._nodes.velocity)):
            wanted = own[:, None] * coarse[:axes, nodes].T
            shares = np.einsum("es,sc,aes->eca", mass, shape, fine[:axes, sites])
            np.add.at(wanted, where.ravel(), shares.reshape(-1, axes))
            found.append(solver.solve(wanted))
        return nodes, (found[0], found[1])

    def _coarsen(self) -> np.ndarray:
        """Let manifold elements far from particles be continuum again, where they were at the start; returns those."""
        body = self._body
        kept = np.flatnonzero(body.kind == PARTICLES)
        for _ in range(max(body.layers, 1)):
            kept = body.grid.around(kept)
        inner = (body.kind == MANIFOLD) & (body.coarsest == CONTINUUM)
        inner[kept] = False
        body.kind[inner] = CONTINUUM
        return np.flatnonzero(inner)
