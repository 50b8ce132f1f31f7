"""Which particles are tied to the mesh, how their motion follows from that of the nodes, and what they carry."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray

from bridge.interpolation import ExchangeOfOneRank, NodeExchange, on_every_rank
from particles.driving import free_components

Array = NDArray[np.float64]

ON_FACE = 1e-6  # distance from a face, in radii, that counts as on it
LEAST_LEAD = 1e-9  # shape function of a node that moves, above which it leads a held particle
LEAST = 1e-3  # share that a particle keeps, though it had no contact
NEAR = 0.02  # gap, in sums of radii, up to which two particles count as neighbours
ROTATIONS = ("micro", "curl", "free")


class Tie:
    """Tied particles of this rank and the nodes that they need (construction is collective).

    Attributes:
        ids: (g,) tied particles.
        exchange: NodeExchange of the w needed nodes.
        matrix: G (f g, c w), motion of the tied particles from that of the nodes; an empty row is a free component. Particles
            have f = 3 components (x, y, rotation) in the plane, 6 in space; nodes c = 3, (x, y, rotation) or (x, y, z), or 6.
        share: (n,) share of contacts and loads that particles carry, 1 - alpha.
        mass_share: (n,) share of their mass, 1 - alpha with a floor.

    Args:
        body: Continuum.
        soil: Assembly.
        zone: OverlapZone.
        rotation: One of `ROTATIONS`: rotations of the tied particles are the micro-rotation, half the curl of the
            displacement, or free.
        width: Number c of components of a node.
        everywhere: Every rank has all particles; what is scattered to nodes is rank 0's.

    Raises:
        ValueError: a tied particle outside the mesh, particles where the continuum is alone, or no tied particle at all.
    """

    def __init__(self, body: Any, soil: Any, zone: Any, rotation: str, width: int, everywhere: bool = False):
        alpha = zone(soil.reference) if soil.count else np.zeros(0)
        on_every_rank(body.comm, lambda: _check_place(soil, zone))
        self.share = 1.0 - alpha
        self.mass_share, self._mesh_share = (_with_floor(soil, share) for share in (self.share, alpha))
        self.ids = np.flatnonzero(_in_zone(soil, zone))
        if body.comm.allreduce(len(self.ids)) == 0:
            raise ValueError("no particle lies in the overlap zone: move its faces, or fill it with particles")
        self._axes, self._freedoms = body.axes, 3 * (body.axes - 1)
        points = soil.reference[self.ids].reshape(-1, body.axes)
        nodes, shape, found = body.shape_functions(points, gradients=True)
        on_every_rank(body.comm, lambda: _check_found(self.ids, points, np.asarray(found)))
        self.exchange = (ExchangeOfOneRank if everywhere else NodeExchange)(body.comm, body.owned_range, nodes)
        self.width = width
        columns = np.searchsorted(self.exchange.nodes, nodes)
        self.matrix = _tie_matrix(columns, shape, (len(self.exchange.nodes), width), rotation)

    def spring_shares(self, stiffness: Array, radii: Array) -> Array:
        """alpha (1 - alpha) of stiffnesses (n,) for the tied particles (g, f), turning times the radius squared.

        Particle and mesh carry 1 - alpha and alpha of a mass, so that every spring swings as fast as a contact does.
        """
        both = (self._mesh_share * self.mass_share * stiffness)[self.ids, None]
        return both * by_component(np.ones(len(self.ids)), radii[self.ids] ** 2, self._axes)

    def leave_held(self, soil: Any, fixed: NDArray[np.bool_]) -> None:
        """Untie the held components of particles, which stand still beside a mesh that does.

        Springs there would bear what pushes the particle, and give way.

        Args:
            soil: Assembly.
            fixed: (w, 3), nodal components that are prescribed.

        Raises:
            ValueError: a held component follows nodes that move.
        """
        if not soil.count:
            return
        held = free_components(soil)[self.ids].ravel() < 0.5
        torn = held & (abs(self.matrix) @ (~fixed).ravel().astype(float) > LEAST_LEAD)
        if torn.any():
            first = self.ids[np.flatnonzero(torn)[0] // self._freedoms]
            raise ValueError(
                f"particle {first} at {soil.reference[first]} m is held and lies in the zone, where the mesh leads: fix the body "
                "there as well"
            )
        self.matrix = sparse.csr_matrix(sparse.diags((~held).astype(float)) @ self.matrix)
        self.matrix.eliminate_zeros()

    def part(self, these: NDArray[np.int64], numbers: NDArray[np.int64]) -> Tie:
        """The same of some of the tied particles, `these` (k,), where `numbers` (m,), ascending, are all that an assembly has."""
        found = copy.copy(self)
        found.ids = np.searchsorted(numbers, self.ids[these])
        found.matrix = self.matrix[(self._freedoms * these[:, None] + np.arange(self._freedoms)).ravel()]
        found.share, found.mass_share, found._mesh_share = (
            values[numbers] for values in (self.share, self.mass_share, self._mesh_share)
        )
        return found

    @property
    def tied(self) -> NDArray[np.bool_]:
        """Which components (g, f) of the tied particles are tied."""
        return np.diff(self.matrix.indptr).reshape(-1, self._freedoms) > 0


def by_component(moving: Array, turning: Array, axes: int) -> Array:
    """One number of each particle (n,) for translations and one for rotations, as (n, f)."""
    return np.hstack([np.repeat(moving[:, None], axes, axis=1), np.repeat(turning[:, None], 2 * axes - 3, axis=1)])


def _tie_matrix(columns, shape: Array, nodal: tuple[int, int], rotation: str) -> sparse.csr_matrix:
    """G from the nodes' places (g, nodes a cell) and values and derivatives (g, nodes a cell, 1 + axes) of shape functions.

    `nodal`: numbers w of the nodes and c of their components.
    """
    (count, per_cell), axes = columns.shape, shape.shape[2] - 1
    freedoms = 3 * (axes - 1)
    particle = np.repeat(np.arange(count), per_cell)
    node, values = columns.ravel(), shape.reshape(-1, 1 + axes).copy()
    values[np.abs(values[:, 0]) < 1e-14, 0] = 0.0  # a point on an edge has no share in the nodes across
    n, *slopes = values.T
    entries = [(axis, axis, n) for axis in range(axes)]
    if rotation == "micro":
        entries += [(to, to, n) for to in range(axes, freedoms)]
    elif rotation == "curl":
        for to, first, second in [(2, 0, 1)] if axes == 2 else [(3, 1, 2), (4, 2, 0), (5, 0, 1)]:
            entries += [(to, second, 0.5 * slopes[first]), (to, first, -0.5 * slopes[second])]
    rows = np.concatenate([freedoms * particle + to for to, _, _ in entries])
    places = np.concatenate([nodal[1] * node + component for _, component, _ in entries])
    data = np.concatenate([value for _, _, value in entries])
    matrix = sparse.csr_matrix((data, (rows, places)), shape=(freedoms * count, nodal[0] * nodal[1]))
    matrix.eliminate_zeros()
    return matrix


def _in_zone(soil: Any, zone: Any) -> NDArray[np.bool_]:
    """Mask (n,) of the particles with their centre in the zone, both faces included."""
    if not soil.count:
        return np.zeros(0, dtype=bool)
    return zone.distances(soil.reference)[0] > -ON_FACE * soil.radii


def _check_place(soil: Any, zone: Any) -> None:
    if not soil.count:
        return
    beyond = zone.distances(soil.reference)[1] < -ON_FACE * soil.radii
    if beyond.any():
        first = int(np.flatnonzero(beyond)[0])
        raise ValueError(
            f"particle {first} at {soil.reference[first]} m lies beyond the zone, where the continuum is alone: leave such "
            "particles out, or move the zone's outer face"
        )


def _check_found(ids, points: Array, found: NDArray[np.bool_]) -> None:
    lost = np.flatnonzero(~found.astype(bool))
    if len(lost):
        raise ValueError(
            f"{len(lost)} particles of the zone lie outside the mesh, the first ({ids[lost[0]]}) at {points[lost[0]]} m: the "
            "mesh must reach over the whole zone"
        )


def _with_floor(soil: Any, share: Array) -> Array:
    """Share of each particle (n,) that is at least half the largest share of its contacts: none goes without mass."""
    least = np.full(len(share), LEAST)
    if soil.count:
        found, radii = soil.contacts(contact_range=NEAR), soil.radii
        i, j = found.first, found.second
        of_contact = (share[i] * radii[j] + share[j] * radii[i]) / (radii[i] + radii[j])
        for side in (i, j):
            np.maximum.at(least, side, 0.5 * of_contact)
    return np.minimum(np.maximum(share, least), 1.0)
