"""What a packing shows: stress, couple stress, nominal strain, fabric, coordination, porosity, moduli.

Index order of tensors: first the normal or derivative, second the force or displacement direction; tension positive.
In the plane d = 2 and all is per metre of thickness, in space d = 3.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from particles import neighbours
from particles.cell import image_of
from particles.images import images_near, parts_in, volume_of, wrapped
from particles.network import Contacts, contacts, stiffnesses
from particles.volumes import area_in_box as area_in_box
from particles.volumes import common_area, common_volume, share_inside, volumes

if TYPE_CHECKING:
    from particles.assembly import Assembly


class NominalStrain(NamedTuple):
    """Nominal strain of each particle (Li & Wan 2010, figs 6 and 7); NaN with too few neighbours."""

    volumetric: np.ndarray  # (n,) det F - 1
    effective: np.ndarray  # (n,) sqrt(2/3 e:e), e the deviator of the Green strain (in the plane with E_zz = 0)
    gradient: np.ndarray  # (n, d, d) F, row = direction of displacement


def _ends(soil: Assembly) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Both ends of all contacts: particle, vector from its centre to the contact, force and couple (1 or 3) on it."""
    found = contacts(soil, with_walls=True)
    pair = found.plate < 0
    n, moment = found.normal, found.moment.reshape(len(found.first), 2 * soil.axes - 3)
    particle = np.concatenate([found.first, found.second[pair]])
    arm = np.concatenate([found.first_arm[:, None] * n, -found.second_arm[pair, None] * n[pair]])
    force = np.concatenate([found.force, -found.force[pair]])
    couple = np.concatenate([moment, -moment[pair]])
    return particle, arm, force, couple


def _moments(soil: Assembly, particle: np.ndarray, arm: np.ndarray, action: np.ndarray) -> np.ndarray:
    """Sum of arm (x) action over the contacts of each particle, over its volume (n, d, components)."""
    terms = (arm[:, :, None] * action[:, None, :]).reshape(len(particle), -1)
    total = np.column_stack([np.bincount(particle, term, soil.count) for term in terms.T])
    total = total.reshape(soil.count, soil.axes, action.shape[1])
    return total / volumes(soil.radii, soil.axes)[:, None, None]


def particle_stress(soil: Assembly) -> np.ndarray:
    """Stress of each particle (n, d, d), Pa: (1/V_p) sum of arm (x) contact force (Rojek & Onate 2007, eq. 46)."""
    particle, arm, force, _ = _ends(soil)
    return _moments(soil, particle, arm, force)


def particle_couple_stress(soil: Assembly) -> np.ndarray:
    """Couple stress of each particle, N/m: (1/V_p) sum of arm (x) contact couple on it; (n, 2) in the plane, (n, 3, 3)."""
    particle, arm, _, couple = _ends(soil)
    stress = _moments(soil, particle, arm, couple)
    return stress[:, :, 0] if soil.axes == 2 else stress


def averaged_stress(
    soil: Assembly,
    points: Any,
    radius: float | None = None,
    values: np.ndarray | None = None,
    body: Any = None,
    solid_fraction: float | None = None,
) -> np.ndarray:
    """Average over circles (balls) around points of the particles' stresses (Rojek & Onate 2007, eqs 46-51), Pa.

    In a periodic cell all images in a circle count, wherever it lies.

    Args:
        points: (k, d), m: nodes of a grid, quadrature points, ...
        radius: of the circles or balls (default 2.5 times the largest particle), m.
        values: (n, ...) of each particle to be averaged; default `particle_stress`. For `particle_couple_stress` the same.
        body: box (lower, upper) or region with `contains(points)`: the volume is the circle's part inside it.
        solid_fraction: if given, divide by the solid volume in the circle and multiply by this (no counting noise).

    Returns:
        (k, d, d), or (k, ...) as `values`; zero where a circle holds no particle.
    """
    from scipy.spatial import cKDTree

    axes = soil.axes
    points = np.asarray(points, dtype=float).reshape(-1, axes)
    radii, positions = soil.radii, soil.positions
    size = 2.5 * radii.max() if radius is None else float(radius)
    if not (np.isfinite(size) and size > 0.0):
        raise ValueError(f"radius={radius} must be positive (m)")
    values = particle_stress(soil) if values is None else np.asarray(values)
    middle = wrapped(soil.cell, points)
    reach = size + radii.max()
    particle, places, _ = images_near(soil.cell, positions, middle.min(axis=0), middle.max(axis=0), reach)
    found = cKDTree(places).query_ball_point(middle, reach)
    average = np.zeros((len(points), *values.shape[1:]))
    solid = np.zeros(len(points))
    common = common_area if axes == 2 else common_volume
    for k, near in enumerate(found):
        own = particle[near]
        part = common(np.linalg.norm(places[near] - middle[k], axis=1), radii[own], size)
        average[k] = np.tensordot(part, values[own], axes=1)
        solid[k] = part.sum()
    if solid_fraction is not None:
        volume = np.where(solid > 0.0, solid, 1.0) / solid_fraction
    else:
        volume = volumes(np.array(size), axes) * np.maximum(share_inside(points, size, body), 1e-300)
    return average / volume.reshape((-1,) + (1,) * (values.ndim - 1))


def region_average(
    soil: Assembly, region: Any, volume: float | None = None, values: np.ndarray | None = None
) -> np.ndarray:
    """Average over one representative volume of any shape: sum of V_p inside times the particles' stresses, over V, Pa.

    Args:
        region: box (lower, upper), or anything with `contains(points)`; in a periodic cell all images in it count, and a
            region must have finite `bounds`. `soil.cell` is the whole cell, leaning or not.
        volume: of the region with its voids, m3 (in the plane m2); boxes and regions with `measure` know theirs.
        values: (n, ...) of each particle; default `particle_stress`.
    """
    values = particle_stress(soil) if values is None else np.asarray(values)
    part = parts_in(soil.cell, soil.positions, soil.radii, region)
    return np.tensordot(part, values, axes=1) / (volume_of(region) if volume is None else volume)


def volumetric_stress(stress: np.ndarray, poisson_ratio: float) -> np.ndarray:
    """One third of the trace (...,), Pa, with sigma_zz = nu (sigma_xx + sigma_yy)."""
    return (1.0 + poisson_ratio) * (stress[..., 0, 0] + stress[..., 1, 1]) / 3.0


def effective_stress(stress: np.ndarray, poisson_ratio: float) -> np.ndarray:
    """sqrt(3/2 s:s) of the symmetric part (...,), Pa, with sigma_zz = nu (sigma_xx + sigma_yy)."""
    mean = volumetric_stress(stress, poisson_ratio)
    xx, yy = stress[..., 0, 0] - mean, stress[..., 1, 1] - mean
    zz = poisson_ratio * (stress[..., 0, 0] + stress[..., 1, 1]) - mean
    xy = 0.5 * (stress[..., 0, 1] + stress[..., 1, 0])
    return np.sqrt(1.5 * (xx**2 + yy**2 + zz**2 + 2.0 * xy**2))


def reference_pairs(soil: Assembly, contact_range: float = 1e-3) -> np.ndarray:
    """Ids (k, 2) of particles (in a periodic cell: images) closer than (1 + contact_range) (r_i + r_j) in the reference state."""
    places, radii, cell = soil.reference, soil.radii, soil.cell
    largest = radii.max(initial=0.0)
    skin = (2.0 * contact_range + 1e-12) * largest
    none = np.zeros(soil.count, dtype=bool)
    box = None if cell is None else cell.at_start
    grid = neighbours.grid_of(places, 2.0 * largest + skin, soil.axes, box)
    start, first, second = neighbours.list_pairs(grid, places, radii, none, skin, soil.axes, 4 * soil.count, box)
    first, second = first[: start[-1]], second[: start[-1]]
    branch = places[second] - places[first]
    if cell is not None:
        branch += image_of(cell.start, cell.periodic, branch) @ cell.start.T
    gap = np.linalg.norm(branch, axis=1) - (1.0 + contact_range) * (radii[first] + radii[second])
    return np.column_stack([first, second])[gap < 0.0]


def _fitted(soil: Assembly, pairs: np.ndarray, vectors: np.ndarray, edges: Any) -> np.ndarray:
    """Gradient (n, d, d) of vectors (n, d) by least squares over neighbours of the reference state; NaN with too few.

    Args:
        edges: (d, d) difference of the vectors from one periodic image to the next (columns), None without a cell.
    """
    particle, other = np.concatenate([pairs, pairs[:, ::-1]]).T
    branch, apart = soil.reference[other] - soil.reference[particle], vectors[other] - vectors[particle]
    if soil.cell is not None:
        image = image_of(soil.cell.start, soil.cell.periodic, branch)
        branch, apart = branch + image @ soil.cell.start.T, apart + image @ edges.T
    before, change = branch[:, None, :], apart[:, :, None]
    moved = np.zeros((soil.count, soil.axes, soil.axes))
    shape = np.zeros_like(moved)
    np.add.at(moved, particle, change * before)
    np.add.at(shape, particle, before.transpose(0, 2, 1) * before)
    trace = np.trace(shape, axis1=1, axis2=2)
    usable = np.linalg.det(shape) > 1e-6 * trace**soil.axes
    gradient = np.full_like(moved, np.nan)
    gradient[usable] = moved[usable] @ np.linalg.inv(shape[usable])
    return gradient


def nominal_strain(soil: Assembly, contact_range: float = 1e-3, pairs: np.ndarray | None = None) -> NominalStrain:
    """Strain of each particle from its neighbours of the reference state: least-squares deformation gradient.

    In a periodic cell neighbours through the faces count, with the cell's own deformation since the start.

    Args:
        contact_range: neighbours are closer than (1 + contact_range) (r_i + r_j) in the reference state.
        pairs: (k, 2) ids, if other neighbours are wanted.
    """
    pairs = reference_pairs(soil, contact_range) if pairs is None else np.asarray(pairs)
    gradient = _fitted(soil, pairs, soil.positions, None if soil.cell is None else soil.cell.carried)
    green = 0.5 * (np.swapaxes(gradient, 1, 2) @ gradient - np.eye(soil.axes))
    square = np.sum(green**2, axis=(1, 2)) - np.trace(green, axis1=1, axis2=2) ** 2 / 3.0
    return NominalStrain(np.linalg.det(gradient) - 1.0, np.sqrt(2.0 / 3.0 * np.maximum(square, 0.0)), gradient)


def gradient_rate(soil: Assembly, contact_range: float = 1e-3, pairs: np.ndarray | None = None) -> np.ndarray:
    """Rate (n, d, d) of the same deformation gradient from the velocities, 1/s; L = rate F^-1. NaN with too few neighbours."""
    pairs = reference_pairs(soil, contact_range) if pairs is None else np.asarray(pairs)
    edges = None if soil.cell is None else soil.cell.velocity_gradient @ soil.cell.carried
    return _fitted(soil, pairs, soil.velocities[:, : soil.axes], edges)


def coordination(
    soil: Assembly, contact_range: float = 0.0, rattlers: bool = True, fewest: int | None = None
) -> float:
    """Mean number of particle contacts of a particle.

    Args:
        contact_range: counts pairs with overlap > -contact_range (r_i + r_j).
        rattlers: False leaves out particles with fewer than `fewest` contacts (plates count), and again until none is left.
        fewest: contacts that hold a particle; default 2 in the plane and 3 in space (with friction).
    """
    fewest = soil.axes if fewest is None else fewest
    found = contacts(soil, True, contact_range)
    kept = np.ones(soil.count, dtype=bool)
    while True:
        pair = found.plate < 0
        both = kept[found.first] & (kept[np.where(pair, found.second, found.first)])
        degree = np.bincount(found.first[both], minlength=soil.count)
        degree = degree + np.bincount(found.second[both & pair], minlength=soil.count)
        loose = kept & (degree < fewest)
        if rattlers or not loose.any():
            return 2.0 * float(np.sum(both & pair)) / max(int(kept.sum()), 1)
        kept &= ~loose


def fabric(soil: Assembly, contact_range: float = 0.0) -> np.ndarray:
    """Fabric tensor (d, d): mean of n (x) n over the contacts of particles; its trace is one."""
    n = contacts(soil, False, contact_range).normal
    return n.T @ n / max(len(n), 1)


def porosity(soil: Assembly, lower: Any, upper: Any) -> float:
    """Share of voids in a box (overlaps of particles are counted twice)."""
    return porosity_in(soil, (lower, upper))


def porosity_in(soil: Assembly, region: Any, volume: float | None = None) -> float:
    """Share of voids in a region; `region` and `volume` as in `region_average`."""
    solid = parts_in(soil.cell, soil.positions, soil.radii, region).sum()
    return float(1.0 - solid / (volume_of(region) if volume is None else volume))


def moduli(
    soil: Assembly, area: float, ids: Any = None, contact_range: float = 1e-6
) -> tuple[np.ndarray, np.ndarray]:
    """Elastic and couple moduli of the sticking network under affine motion, each contact counted once.

    D_ijkl = 1/V sum l^2 n_i n_k (k_N n_j n_l + k_s (d_jl - n_j n_l)); in the plane B_ik = 1/V sum l^2 k_rot n_i n_k, in
    space B_ijkl = 1/V sum l^2 n_i n_k (k_rot (d_jl - n_j n_l) + k_tor n_j n_l) (Chang & Ma 1992; Li & Wan 2010, eqs
    21-24, before their directional averages).

    Args:
        area: of the body that the discs fill, m2; in space its volume, m3.
        ids: particles of the body (default all); a contact with one outside counts half.
        contact_range: counts pairs with overlap > -contact_range (r_i + r_j).

    Returns:
        (d, d, d, d) Pa for sigma_ij = D_ijkl eps_kl with eps_kl = u_l,k - e_klm phi_m; (2, 2) N for m_i = B_ik phi_,k in
        the plane, (3, 3, 3, 3) N for m_ij = B_ijkl phi_l,k in space.
    """
    if not (np.isfinite(area) and area > 0.0):
        raise ValueError(f"area={area} must be positive (m2; in space the volume, m3)")
    found: Contacts = contacts(soil, False, contact_range)
    member = np.ones(soil.count) if ids is None else np.zeros(soil.count)
    if ids is not None:
        member[soil._checked_ids(ids)] = 1.0
    weight = 0.5 * (member[found.first] + member[found.second]) * (found.first_arm + found.second_arm) ** 2 / area
    n, k = found.normal, stiffnesses(soil, found)
    along = n[:, :, None] * n[:, None, :]
    across = np.eye(soil.axes) - along

    def summed(stiffness: np.ndarray) -> np.ndarray:
        return np.einsum("c,ci,ck,cjl->ijkl", weight, n, n, stiffness)

    elastic = summed(k[:, 0, None, None] * along + k[:, 1, None, None] * across)
    if soil.axes == 2:
        return elastic, np.einsum("c,c,ci,ck->ik", weight, k[:, 2], n, n)
    return elastic, summed(k[:, 2, None, None] * across + k[:, 3, None, None] * along)
