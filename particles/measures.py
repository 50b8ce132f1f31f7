"""What a packing shows: stress, couple stress, nominal strain, fabric, coordination, porosity, moduli.

Index order of tensors: first the normal or derivative, second the force or displacement direction; tension positive.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from particles import neighbours
from particles.network import Contacts, contacts, stiffnesses

if TYPE_CHECKING:
    from particles.assembly import Assembly


class NominalStrain(NamedTuple):
    """Nominal strain of each disc (Methods of Li & Wan 2010, figs 6 and 7); NaN with too few neighbours."""

    volumetric: np.ndarray  # (n,) det F - 1
    effective: np.ndarray  # (n,) sqrt(2/3 e:e), e the deviator of the Green strain with E_zz = 0
    gradient: np.ndarray  # (n, 2, 2) F, row = direction of displacement


def _ends(soil: Assembly) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Both ends of all contacts: disc, vector from its centre to the contact, force and couple on it."""
    found = contacts(soil, with_walls=True)
    discs = found.plate < 0
    n = found.normal
    disc = np.concatenate([found.first, found.second[discs]])
    arm = np.concatenate([found.first_arm[:, None] * n, -found.second_arm[discs, None] * n[discs]])
    force = np.concatenate([found.force, -found.force[discs]])
    couple = np.concatenate([found.moment, -found.moment[discs]])
    return disc, arm, force, couple


def particle_stress(soil: Assembly) -> np.ndarray:
    """Stress of each disc (n, 2, 2), Pa: (1/V_p) sum of arm (x) contact force (Rojek & Onate 2007, eq. 46)."""
    disc, arm, force, _ = _ends(soil)
    stress = np.zeros((soil.count, 2, 2))
    np.add.at(stress, disc, arm[:, :, None] * force[:, None, :])
    return stress / (np.pi * soil.radii**2)[:, None, None]


def particle_couple_stress(soil: Assembly) -> np.ndarray:
    """Couple stress of each disc (n, 2), N/m: (1/V_p) sum of arm times contact couple on it."""
    disc, arm, _, couple = _ends(soil)
    stress = np.zeros((soil.count, 2))
    np.add.at(stress, disc, arm * couple[:, None])
    return stress / (np.pi * soil.radii**2)[:, None]


def common_area(distance: Any, first: Any, second: Any) -> np.ndarray:
    """Area (m2) of the intersection of two discs with radii `first`, `second` at a distance of centres."""
    d, a, b = np.broadcast_arrays(np.asarray(distance, float), np.asarray(first, float), np.asarray(second, float))
    d = np.clip(d, np.abs(a - b) + 1e-300, a + b)
    cos_a = np.clip((d * d + a * a - b * b) / (2 * d * a), -1.0, 1.0)
    cos_b = np.clip((d * d + b * b - a * a) / (2 * d * b), -1.0, 1.0)
    half_a, half_b = np.arccos(cos_a), np.arccos(cos_b)
    return a * a * (half_a - np.sin(half_a) * cos_a) + b * b * (half_b - np.sin(half_b) * cos_b)


def _share_inside(points: np.ndarray, radius: float, body: Any) -> np.ndarray:
    """Share of the circle around each point that lies in the body (box of bounds or region), by 2000 samples."""
    if body is None:
        return np.ones(len(points))
    k = np.arange(2000)
    place = radius * np.sqrt((k + 0.5) / k.size)
    angle = k * np.pi * (3.0 - np.sqrt(5.0))
    samples = np.column_stack([place * np.cos(angle), place * np.sin(angle)])
    return np.array([_contains(body, point + samples).mean() for point in points])


def _contains(body: Any, points: np.ndarray) -> np.ndarray:
    if hasattr(body, "contains"):
        return np.asarray(body.contains(points), dtype=bool)
    (x0, y0), (x1, y1) = body
    return (points[:, 0] >= x0) & (points[:, 0] <= x1) & (points[:, 1] >= y0) & (points[:, 1] <= y1)


def averaged_stress(
    soil: Assembly,
    points: Any,
    radius: float | None = None,
    values: np.ndarray | None = None,
    body: Any = None,
    solid_fraction: float | None = None,
) -> np.ndarray:
    """Average over circles around points of the discs' stresses (Rojek & Onate 2007, eqs 46-51), Pa.

    Args:
        points: (k, 2), m.
        radius: of the circles (default 2.5 times the largest disc), m.
        values: (n, ...) of each disc to be averaged; default `particle_stress`. For `particle_couple_stress` the same.
        body: box ((x0, y0), (x1, y1)) or region with `contains(points)`: the volume is the circle's part inside it.
        solid_fraction: if given, divide by the solid area in the circle and multiply by this (no counting noise).

    Returns:
        (k, 2, 2), or (k, ...) as `values`; zero where a circle holds no disc.
    """
    from scipy.spatial import cKDTree

    points = np.atleast_2d(np.asarray(points, dtype=float))
    radii, positions = soil.radii, soil.positions
    size = 2.5 * radii.max() if radius is None else float(radius)
    if not (np.isfinite(size) and size > 0.0):
        raise ValueError(f"radius={radius} must be positive (m)")
    values = particle_stress(soil) if values is None else np.asarray(values)
    found = cKDTree(positions).query_ball_point(points, size + radii.max())
    average = np.zeros((len(points), *values.shape[1:]))
    solid = np.zeros(len(points))
    for k, near in enumerate(found):
        distance = np.hypot(*(positions[near] - points[k]).T)
        share = common_area(distance, radii[near], size)
        average[k] = np.tensordot(share, values[near], axes=1)
        solid[k] = share.sum()
    if solid_fraction is not None:
        volume = np.where(solid > 0.0, solid, 1.0) / solid_fraction
    else:
        volume = np.pi * size**2 * np.maximum(_share_inside(points, size, body), 1e-300)
    return average / volume.reshape((-1,) + (1,) * (values.ndim - 1))


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
    """Ids (k, 2) of discs closer than (1 + contact_range) (r_i + r_j) in the reference state."""
    places, radii = soil.reference, soil.radii
    largest = radii.max(initial=0.0)
    skin = (2.0 * contact_range + 1e-12) * largest
    none = np.zeros(soil.count, dtype=bool)
    width, capacity = 2.0 * largest + skin, 4 * soil.count + 16
    start, first, second = neighbours.list_pairs(places, radii, none, width, skin, soil.axes, capacity, None)
    first, second = first[: start[-1]], second[: start[-1]]
    gap = np.linalg.norm(places[second] - places[first], axis=1) - (1.0 + contact_range) * (radii[first] + radii[second])
    return np.column_stack([first, second])[gap < 0.0]


def nominal_strain(soil: Assembly, contact_range: float = 1e-3, pairs: np.ndarray | None = None) -> NominalStrain:
    """Strain of each disc from its neighbours of the reference state: least-squares deformation gradient.

    Args:
        contact_range: neighbours are closer than (1 + contact_range) (r_i + r_j) in the reference state.
        pairs: (k, 2) ids, if other neighbours are wanted.
    """
    pairs = reference_pairs(soil, contact_range) if pairs is None else np.asarray(pairs)
    disc = np.concatenate([pairs[:, 0], pairs[:, 1]])
    other = np.concatenate([pairs[:, 1], pairs[:, 0]])
    before = (soil.reference[other] - soil.reference[disc])[:, None, :]
    now = (soil.positions[other] - soil.positions[disc])[:, :, None]
    moved = np.zeros((soil.count, 2, 2))
    shape = np.zeros((soil.count, 2, 2))
    np.add.at(moved, disc, now * before)
    np.add.at(shape, disc, before.transpose(0, 2, 1) * before)
    trace = np.trace(shape, axis1=1, axis2=2)
    usable = np.linalg.det(shape) > 1e-6 * trace**2
    gradient = np.full((soil.count, 2, 2), np.nan)
    gradient[usable] = moved[usable] @ np.linalg.inv(shape[usable])
    green = 0.5 * (np.swapaxes(gradient, 1, 2) @ gradient - np.eye(2))
    square = np.sum(green**2, axis=(1, 2)) - np.trace(green, axis1=1, axis2=2) ** 2 / 3.0
    return NominalStrain(np.linalg.det(gradient) - 1.0, np.sqrt(2.0 / 3.0 * square), gradient)


def coordination(soil: Assembly, contact_range: float = 0.0, rattlers: bool = True) -> float:
    """Mean number of disc contacts of a disc.

    Args:
        contact_range: counts pairs with overlap > -contact_range (r_i + r_j).
        rattlers: False leaves out discs with fewer than two contacts (plates count), and again until none is left.
    """
    found = contacts(soil, True, contact_range)
    kept = np.ones(soil.count, dtype=bool)
    while True:
        discs = found.plate < 0
        both = kept[found.first] & (kept[np.where(discs, found.second, found.first)])
        degree = np.bincount(found.first[both], minlength=soil.count)
        degree = degree + np.bincount(found.second[both & discs], minlength=soil.count)
        loose = kept & (degree < 2)
        if rattlers or not loose.any():
            return 2.0 * float(np.sum(both & discs)) / max(int(kept.sum()), 1)
        kept &= ~loose


def fabric(soil: Assembly, contact_range: float = 0.0) -> np.ndarray:
    """Fabric tensor (2, 2): mean of n (x) n over the contacts of discs."""
    n = contacts(soil, False, contact_range).normal
    return n.T @ n / max(len(n), 1)


def area_in_box(positions: np.ndarray, radii: np.ndarray, lower: Any, upper: Any) -> np.ndarray:
    """Area (n,) of each disc inside a box, m2 (discs across a side by quadrature, error about 1e-4 of the disc)."""
    inside = np.all((positions - radii[:, None] >= lower) & (positions + radii[:, None] <= upper), axis=1)
    area = np.where(inside, np.pi * radii**2, 0.0)
    cut = np.flatnonzero(
        ~inside & np.all((positions + radii[:, None] > lower) & (positions - radii[:, None] < upper), axis=1)
    )
    x, y, r = positions[cut, 0], positions[cut, 1], radii[cut]
    from_angle = np.arcsin(np.clip((lower[0] - x) / r, -1.0, 1.0))
    to_angle = np.arcsin(np.clip((upper[0] - x) / r, -1.0, 1.0))
    nodes, weights = np.polynomial.legendre.leggauss(48)
    angle = 0.5 * (from_angle + to_angle) + 0.5 * np.outer(nodes, to_angle - from_angle)
    half = r * np.cos(angle)
    chord = np.maximum(np.minimum(y + half, upper[1]) - np.maximum(y - half, lower[1]), 0.0)
    area[cut] = 0.5 * (to_angle - from_angle) * (weights @ (chord * half))
    return area


def porosity(soil: Assembly, lower: Any, upper: Any) -> float:
    """Share of voids in a box (overlaps of discs are counted twice)."""
    solid = area_in_box(soil.positions, soil.radii, lower, upper).sum()
    return float(1.0 - solid / ((upper[0] - lower[0]) * (upper[1] - lower[1])))


def moduli(
    soil: Assembly, area: float, ids: Any = None, contact_range: float = 1e-6
) -> tuple[np.ndarray, np.ndarray]:
    """Elastic and couple moduli of the sticking network under affine motion, each contact counted once.

    D_ijkl = 1/V sum l^2 n_i n_k (k_N n_j n_l + k_s t_j t_l), B_ik = 1/V sum l^2 k_rot n_i n_k (Chang & Ma 1992; Li & Wan
    2010, eqs 21-24, before their directional averages).

    Args:
        area: of the body that the discs fill, m2.
        ids: discs of the body (default all); a contact with a disc outside counts half.
        contact_range: counts pairs with overlap > -contact_range (r_i + r_j).

    Returns:
        (2, 2, 2, 2) Pa for sigma_ij = D_ijkl eps_kl with eps_kl = u_l,k - e_klm phi_m, and (2, 2) N for m_i = B_ik phi_,k.
    """
    if not (np.isfinite(area) and area > 0.0):
        raise ValueError(f"area={area} must be positive (m2)")
    found: Contacts = contacts(soil, False, contact_range)
    member = np.ones(soil.count) if ids is None else np.zeros(soil.count)
    if ids is not None:
        member[soil._checked_ids(ids)] = 1.0
    weight = 0.5 * (member[found.first] + member[found.second]) * (found.first_arm + found.second_arm) ** 2 / area
    n = found.normal
    t = np.column_stack([-n[:, 1], n[:, 0]])
    k = stiffnesses(soil, found)
    stiffness = k[:, 0, None, None] * n[:, :, None] * n[:, None, :] + k[:, 1, None, None] * t[:, :, None] * t[:, None, :]
    rotational = k[:, 2]
    elastic = np.einsum("c,ci,ck,cjl->ijkl", weight, n, n, stiffness)
    return elastic, np.einsum("c,c,ci,ck->ik", weight, rotational, n, n)
