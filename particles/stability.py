"""Linearised stiffness of the contact network and the critical time step."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from particles.network import Contacts, contacts, dashpots, stiffnesses
from particles.walls.rows import CENTRE, FRAME, LIGHTNESS, NIMBLENESS, OWNER, PLACE

if TYPE_CHECKING:
    from particles.assembly import Assembly


def tangents(normal: np.ndarray) -> list[np.ndarray]:
    """Unit vectors (k, d) that make an orthonormal frame with the normals (k, d): one in the plane, two in space."""
    if normal.shape[1] == 2:
        return [np.column_stack([-normal[:, 1], normal[:, 0]])]
    axis = np.eye(3)[np.abs(normal).argmin(axis=1)]
    first = np.cross(normal, axis)
    first /= np.linalg.norm(first, axis=1)[:, None]
    return [first, np.cross(normal, first)]


def relative_motions(found: Contacts, lever: np.ndarray) -> list[tuple[int, np.ndarray]]:
    """Relative displacements of contacts as products with (q_i, q_j): column of `stiffnesses`, matrix (k, 2 freedoms).

    Args:
        lever: (k, d) from the centre of the second body to the contact, m.
    """
    n, arm = found.normal, found.first_arm[:, None] * found.normal
    plane = n.shape[1] == 2
    none = np.zeros((len(n), 1 if plane else 3))

    def moment(at: np.ndarray, e: np.ndarray) -> np.ndarray:
        return (at[:, 0] * e[:, 1] - at[:, 1] * e[:, 0])[:, None] if plane else np.cross(at, e)

    def along(e: np.ndarray) -> np.ndarray:
        return np.hstack([-e, -moment(arm, e), e, moment(lever, e)])

    motions = [(0, along(n))]
    for t in tangents(n):
        about = np.ones_like(none) if plane else t
        motions += [(1, along(t)), (2, np.hstack([0.0 * t, about, 0.0 * t, -about]))]
    if not plane:
        motions.append((3, np.hstack([none, n, none, -n])))
    return motions


class _Bodies(NamedTuple):
    """Rigid bodies of the walls as further masses of the network (b of them; none without walls)."""

    lever: np.ndarray  # (k, d) from the centre of the second body of each contact to the contact, m
    second: np.ndarray  # (k,) second body of each contact: id of a particle, or number of particles + row of the body
    lightness: np.ndarray  # (b, freedoms, freedoms) inverse of the mass matrix; zero where the motion is prescribed


def _bodies(soil: Assembly, found: Contacts) -> _Bodies:
    lever, second, walls = -found.second_arm[:, None] * found.normal, found.second.copy(), soil.system.walls
    if walls is None:
        return _Bodies(lever, second, np.zeros((0, soil.freedoms, soil.freedoms)))
    axes, these = soil.axes, np.flatnonzero(found.plate >= 0)
    owner = walls.wall[found.plate[these], OWNER].astype(np.int64)
    second[these] = soil.count + owner
    centre = (walls.body[:, CENTRE : CENTRE + 3] + walls.body[:, PLACE : PLACE + 3])[owner, :axes]
    lever[these] = soil.positions[found.first[these]] + found.image[these] + found.first_arm[these, None] * found.normal[these] - centre
    frame = walls.body[:, FRAME : FRAME + 9].reshape(-1, 3, 3)
    turning = frame @ walls.body[:, NIMBLENESS : NIMBLENESS + 9].reshape(-1, 3, 3) @ frame.transpose(0, 2, 1)
    lightness = np.zeros((len(frame), soil.freedoms, soil.freedoms))
    for k in range(axes):
        lightness[:, k, k] = walls.body[:, LIGHTNESS + k]
    lightness[:, axes:, axes:] = turning[:, 2:, 2:] if axes == 2 else turning
    return _Bodies(lever, second, lightness)


def _network_matrix(soil: Assembly, found: Contacts, bodies: _Bodies) -> Any:
    """Stiffness matrix of contacts, scipy CSR; rows and columns of the walls' bodies follow those of the particles."""
    from scipy import sparse

    freedoms = soil.freedoms
    size = freedoms * (soil.count + len(bodies.lightness))
    stiffness = stiffnesses(soil, found)
    blocks = np.zeros((len(found.first), 2 * freedoms, 2 * freedoms))
    for kind, b in relative_motions(found, bodies.lever):
        blocks += stiffness[:, kind, None, None] * b[:, :, None] * b[:, None, :]
    own = np.arange(freedoms)
    dofs = np.concatenate([freedoms * found.first[:, None] + own, freedoms * bodies.second[:, None] + own], axis=1)
    rows = np.repeat(dofs, 2 * freedoms, axis=1).ravel()
    columns = np.tile(dofs, (1, 2 * freedoms)).ravel()
    return sparse.coo_matrix((np.ravel(blocks), (rows, columns)), shape=(size, size)).tocsr()


def stiffness_matrix(soil: Assembly, contact_range: float = 0.0, walls: bool = False) -> Any:
    """Stiffness of sticking contacts, scipy CSR (f n, f n), f = 3 or 6 freedoms, id order, symmetric: energy 1/2 q K q.

    All pairs with overlap > -contact_range (r_i + r_j), without tension cut, limits and geometric stiffness; with `walls`
    also contacts with plates at rest.

    Returns:
        Rows and columns f id + k for the k-th generalised component; N/m, N, N m.
    """
    found = contacts(soil, walls, contact_range)
    size = soil.freedoms * soil.count
    return _network_matrix(soil, found, _bodies(soil, found))[:size, :size]


def normal_stiffness(soil: Assembly, overlap: float = 1e-3) -> np.ndarray:
    """Normal stiffness (n,) of the contact of each particle with one of its kind, N/m, at an overlap (share of the radius)."""
    radii, ids = soil.radii, soil._laws.materials
    found = np.zeros(soil.count)
    for (a, b), law in soil.laws.items():
        these = np.arange(soil.count) if ids is None else np.flatnonzero((ids == a) & (ids == b))
        r = radii[these]
        history = soil._laws.by_channel(np.zeros((len(soil._laws.columns), len(these))))
        found[these] = law.stiffness(overlap * r, np.column_stack([r, r]), 0.5 * r, history)[:, 0]
    return found


def critical_step(soil: Assembly, sharp: bool = False, contact_range: float = 1e-6) -> float:
    """Largest stable step of the present contacts (pairs and plates), s; infinity without contacts. Use 0.8 of it.

    By default a rigorous bound from splitting the mass of each particle and free wall over its contacts (each contact then
    is a small system of its own). `sharp` solves for the largest frequency of the sticking network (Lanczos), a step up to
    about 1.5 times larger. Dashpots, which act on the predictor (M9), shorten the step by sqrt(1 + 4 xi^2) - 2 xi, xi the
    largest damping ratio (one oscillator: the root -1 appears at (w h)^2 / 4 + 2 xi w h = 1).

    Args:
        sharp: solve the eigenvalue problem.
        contact_range: counts pairs with overlap > -contact_range (r_i + r_j), so that discs of a lattice that just touch
            are in contact.
    """
    found = contacts(soil, True, contact_range)
    if found.first.size == 0:
        return float("inf")
    bodies = _bodies(soil, found)
    masses, inertias = soil.masses, soil.inertias
    discs = found.plate < 0
    degree = np.bincount(found.first, minlength=soil.count) + np.bincount(found.second[discs], minlength=soil.count)
    second = np.where(discs, found.second, 0)
    light_i, light_j = (degree / masses)[found.first], np.where(discs, (degree / masses)[second], 0.0)
    spin_i, spin_j = (degree / inertias)[found.first], np.where(discs, (degree / inertias)[second], 0.0)
    stiffness, damping = stiffnesses(soil, found), dashpots(soil, found)
    opening = light_i + light_j
    slide = opening + found.first_arm**2 * spin_i + found.second_arm**2 * spin_j
    roll = spin_i + spin_j
    mobility = _mobility_of_walls(soil, found, bodies, degree)

    def bound(k: np.ndarray) -> float:
        of_pairs = np.max([k[:, 0] * opening, k[:, 1] * slide + k[:, 2] * roll, k[:, 3] * roll])
        return max(float(of_pairs), _largest_of_walls(k[~discs], mobility))

    square, rate = bound(stiffness), bound(damping)
    if sharp:
        matrix = _network_matrix(soil, found, bodies)
        square = largest_eigenvalue(matrix, masses, inertias, bodies.lightness)
    frequency = np.sqrt(square)
    ratio = rate / frequency  # 2 xi
    return float(2.0 / frequency * (np.sqrt(1.0 + ratio**2) - ratio))


def _mobility_of_walls(soil: Assembly, found: Contacts, bodies: _Bodies, degree: np.ndarray) -> list[Any]:
    """Kinds of relative motion of the contacts with walls, and how these answer to forces of each kind (k, kinds, kinds).

    That is B M^-1 B' with the masses split over the contacts of each particle and wall.
    """
    these = np.flatnonzero(found.plate >= 0)
    own = found._replace(normal=found.normal[these], first_arm=found.first_arm[these])
    motions = relative_motions(own, bodies.lever[these])
    b = np.stack([rows for _, rows in motions], axis=1)
    f, body = soil.freedoms, bodies.second[these] - soil.count
    masses, inertias, i = soil.masses[:, None], soil.inertias[:, None], found.first[these]
    light = degree[:, None] / np.hstack([np.repeat(masses, soil.axes, 1), np.repeat(inertias, f - soil.axes, 1)])
    of_particle = (b[:, :, :f] * light[i, None]) @ b[:, :, :f].transpose(0, 2, 1)
    number = np.bincount(body, minlength=len(bodies.lightness))
    of_body = b[:, :, f:] @ (number[:, None, None] * bodies.lightness)[body] @ b[:, :, f:].transpose(0, 2, 1)
    return [[kind for kind, _ in motions], of_particle + of_body]


def _largest_of_walls(k: np.ndarray, mobility: list[Any]) -> float:
    """Largest eigenvalue of mobility times stiffness (or dashpots) (k, 4) among the contacts with walls."""
    kinds, answer = mobility
    root = np.sqrt(k[:, kinds])
    return float(np.linalg.eigvalsh(root[:, :, None] * answer * root[:, None, :]).max(initial=0.0))


def largest_eigenvalue(
    stiffness: Any, masses: np.ndarray, inertias: np.ndarray, lightness: np.ndarray | None = None
) -> float:
    """Largest eigenvalue of M^-1 K (1/s2) by Lanczos on the symmetric form M^-1/2 K M^-1/2.

    Args:
        stiffness: sparse, freedoms of the particles (id order) and, with `lightness`, of further bodies after them.
        masses, inertias: (n,) of the particles, kg and kg m2.
        lightness: (b, freedoms, freedoms) inverse mass matrices of the further bodies.
    """
    from scipy import sparse
    from scipy.sparse.linalg import eigsh

    further = 0 if lightness is None else len(lightness)
    freedoms = stiffness.shape[0] // (len(masses) + further)
    axes = 2 if freedoms == 3 else 3
    weights = np.hstack([np.repeat(masses[:, None], axes, 1), np.repeat(inertias[:, None], 2 * axes - 3, 1)])
    roots = [sparse.diags(1.0 / np.sqrt(weights.ravel()))]
    for matrix in () if lightness is None else lightness:
        values, vectors = np.linalg.eigh(matrix)
        roots.append(sparse.csr_matrix((vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T))
    scale = sparse.block_diag(roots, format="csr")
    scaled = scale @ stiffness @ scale
    if scaled.shape[0] < 32:
        return float(np.linalg.eigvalsh(scaled.toarray())[-1])
    start = np.random.default_rng(1).standard_normal(scaled.shape[0])
    return float(eigsh(scaled, k=1, which="LA", v0=start, tol=1e-8, return_eigenvectors=False)[0])
