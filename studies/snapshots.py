"""What figures and field files show, taken from particles and continuum at one time; arrays live on rank 0."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np


class ParticleFields(NamedTuple):
    """Fields of discs, arrays (n,) or (n, 2); NaN where a field has no meaning. Stresses in Pa, tension positive."""

    positions: np.ndarray
    radii: np.ndarray
    displacement: np.ndarray
    rotation: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray
    volumetric_stress: np.ndarray
    effective_stress: np.ndarray
    volumetric_strain: np.ndarray
    effective_strain: np.ndarray
    coordination: np.ndarray  # number of touching discs and plates
    contact_force: np.ndarray  # mean size of the contact forces, N


class ContactFields(NamedTuple):
    """Contacts of discs as lines: ends (k, 2, 2) in m, normal force and tangential force (k,) in N."""

    ends: np.ndarray
    normal_force: np.ndarray
    tangential_force: np.ndarray


class ContinuumFields(NamedTuple):
    """Mesh of the continuum (cells without those wholly left to particles) and its fields."""

    nodes: np.ndarray  # (n, 2), m
    cells: np.ndarray  # (cells, 3 or 4), counter-clockwise
    displacement: np.ndarray  # (n, 3): x, y, micro-rotation
    velocity: np.ndarray  # (n, 3)
    cell_fields: dict[str, np.ndarray]  # (cells,) stresses in Pa, couple stresses in N/m, strains


class Snapshot(NamedTuple):
    """All fields at one time; parts that a method does not have are None."""

    time: float  # s
    displacement: float  # of the plate, m, downwards positive
    particles: ParticleFields | None = None
    contacts: ContactFields | None = None
    continuum: ContinuumFields | None = None


def neighbourhood_average(positions: np.ndarray, radii: np.ndarray, values: np.ndarray, radius: float) -> np.ndarray:
    """Averages over circles around all discs: sum of common areas times values over the sum of common areas.

    Methods as Rojek & Onate (2007), eqs 46-51, normalised by the solid in the circle.

    Args:
        positions: (n, 2), m.
        radii: (n,), m.
        values: (n, columns); discs with NaN are left out.
        radius: of the circles, m.

    Returns:
        (n, columns); NaN where a circle holds nothing.
    """
    from scipy import sparse
    from scipy.spatial import cKDTree

    from particles.measures import common_area

    usable = np.isfinite(values).all(axis=1)
    weights = np.where(usable, common_area(0.0, radii, radius), 0.0)
    pairs = cKDTree(positions).query_pairs(radius + radii.max(initial=0.0), output_type="ndarray")
    first, second = np.concatenate([pairs, pairs[:, ::-1]]).T
    distance = np.hypot(*(positions[second] - positions[first]).T)
    common = np.where(distance < radius + radii[second], common_area(distance, radii[second], radius), 0.0)
    share = sparse.csr_matrix((common * usable[second], (first, second)), shape=(len(radii),) * 2)
    share = share + sparse.diags(weights)
    total = np.asarray(share.sum(axis=1)).ravel()
    with np.errstate(invalid="ignore", divide="ignore"):
        return (share @ np.where(usable[:, None], values, 0.0)) / total[:, None]


def particle_fields(
    soil: Any, ghosts: np.ndarray | None, solid_fraction: float, poisson_ratio: float, averaging: float
) -> tuple[ParticleFields, ContactFields]:
    """Fields of all discs but ghosts, whose contacts are not all there, and their contacts.

    Args:
        soil: Assembly.
        ghosts: Mask (n,) or None.
        solid_fraction: Turns averages over solid into averages over the volume.
        poisson_ratio: For the stress out of plane.
        averaging: Radius of the circles of averaged stresses, in largest radii.
    """
    from particles import measures

    shown = np.ones(soil.count, dtype=bool) if ghosts is None else ~np.asarray(ghosts, dtype=bool)
    positions, radii = soil.positions, soil.radii
    values = measures.particle_stress(soil).reshape(-1, 4)
    values[~shown] = np.nan
    stress = neighbourhood_average(positions, radii, values, averaging * radii.max()).reshape(-1, 2, 2) * solid_fraction
    with np.errstate(invalid="ignore"):  # discs with too few neighbours have NaN
        strain = measures.nominal_strain(soil)
    found = soil.contacts(walls=True)
    size = np.hypot(*found.force.T)
    discs = found.plate < 0
    touching = np.concatenate([found.first, found.second[discs]])
    count = np.bincount(touching, minlength=soil.count)
    force = np.bincount(touching, np.concatenate([size, size[discs]]), minlength=soil.count) / np.maximum(count, 1)
    moved, rates = soil.displacements, soil.velocities
    fields = ParticleFields(
        positions, radii, moved[:, :2], moved[:, 2], rates[:, :2], rates[:, 2],
        measures.volumetric_stress(stress, poisson_ratio), measures.effective_stress(stress, poisson_ratio),
        strain.volumetric, strain.effective, count, force,
    )  # fmt: skip
    ends = np.stack([positions[found.first[discs]], positions[found.second[discs]]], axis=1)
    normal = found.push[discs]
    along = np.sqrt(np.maximum(size[discs] ** 2 - normal**2, 0.0))
    touched = normal > 0.0
    return (
        ParticleFields(*(np.asarray(field)[shown] for field in fields)),
        ContactFields(ends[touched], normal[touched], along[touched]),
    )


def continuum_fields(body: Any) -> ContinuumFields | None:
    """Fields of the whole body on rank 0, None elsewhere (collective)."""
    from continuum.fields import strain_fields, stress_fields

    index_map = body.space.dofmap.index_map
    owned = len(body.cell_nodes)
    kept = body.cell_fractions > 0.0
    cells = index_map.local_to_global(body.cell_nodes.ravel().astype(np.int32)).reshape(body.cell_nodes.shape)[kept]
    named = {**stress_fields(body), **strain_fields(body)}
    values = {name: function.x.array[:owned][kept].copy() for name, function in named.items()}
    own = (body.coordinates, cells, _three_components(body.displacement), _three_components(body.velocity), values)
    parts = body.comm.gather(own, root=0)
    if parts is None:
        return None
    nodes, cells, displacement, velocity = (np.concatenate([part[k] for part in parts]) for k in range(4))
    if cells.shape[1] == 4:
        cells = cells[:, [0, 1, 3, 2]]  # dolfinx numbers a quadrilateral's nodes row by row
    first, second = nodes[cells[:, 1]] - nodes[cells[:, 0]], nodes[cells[:, 2]] - nodes[cells[:, 0]]
    clockwise = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0] < 0.0
    cells[clockwise] = cells[clockwise][:, ::-1]
    return ContinuumFields(
        nodes,
        cells,
        displacement,
        velocity,
        {name: np.concatenate([part[4][name] for part in parts]) for name in values},
    )


def _three_components(nodal: np.ndarray) -> np.ndarray:
    return nodal.copy() if nodal.shape[1] == 3 else np.column_stack([nodal, np.zeros(len(nodal))])
