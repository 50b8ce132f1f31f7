"""Which particle sites become particles of the nested region and which become its ghosts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree


class Layout(NamedTuple):
    """Sites kept (indices into the given sites) and which of those are ghosts; `share` is the inside part of a ghost's mass."""

    kept: NDArray[np.int64]
    ghost: NDArray[np.bool_]
    share: NDArray[np.float64]  # one per ghost, 0 (outside) to 1


def nested_layout(sites, radii, region, *, contact_range: float = 0.02, layers: int = 1) -> Layout:
    """Split particle sites into the particles of a nested region and its ghosts (Li & Wan 2010, eq 17).

    Particles are the sites inside the region; a site on its outline is a ghost. Ghosts are the sites elsewhere within contact
    range of a particle, `layers` deep.

    Args:
        sites: Centres (n, 2), m, over the region and at least one particle diameter around it.
        radii: Radii (n,), m.
        region: A region with `.contains` and `.distance` (negative inside).
        contact_range: Gap up to which two sites count as neighbours, in sums of radii.
        layers: Layers of ghosts.

    Raises:
        ValueError: no site lies inside the region, or an argument is out of range.
    """
    sites = np.asarray(sites, dtype=np.float64).reshape(-1, 2)
    radii = np.asarray(radii, dtype=np.float64)
    if radii.shape not in ((), (len(sites),)) or not np.all(radii > 0.0) or not np.all(np.isfinite(radii)):
        raise ValueError(
            f"radii of shape {radii.shape} must be positive numbers (m), one or one for each of {len(sites)} sites"
        )
    if not (np.isfinite(contact_range) and contact_range >= 0.0):
        raise ValueError(f"contact_range={contact_range} must be zero or positive (sums of radii)")
    if int(layers) != layers or layers < 1:
        raise ValueError(f"layers={layers} must be a whole number of at least 1")
    radii = np.broadcast_to(radii, (len(sites),))
    distance = np.asarray(region.distance(sites))
    tolerance = 1e-6 * radii
    inside = distance < -tolerance
    if not inside.any():
        raise ValueError(f"no particle site lies inside the region {region}: enlarge the region or refine the packing")
    reach = cKDTree(sites).query_pairs(2.0 * radii.max() * (1.0 + contact_range), output_type="ndarray")
    gap = np.linalg.norm(sites[reach[:, 0]] - sites[reach[:, 1]], axis=1) - radii[reach].sum(axis=1)
    pairs = reach[gap <= contact_range * radii[reach].sum(axis=1)]
    ghost = np.zeros(len(sites), dtype=bool)
    reached = inside.copy()
    for _ in range(layers):
        touched = np.zeros(len(sites), dtype=bool)
        touched[pairs[reached[pairs[:, 0]], 1]] = True
        touched[pairs[reached[pairs[:, 1]], 0]] = True
        ghost |= touched & ~inside
        reached |= ghost
    kept = np.flatnonzero(inside | ghost)
    return Layout(kept, ghost[kept], _inside_share(sites[kept][ghost[kept]], radii[kept][ghost[kept]], region))


def _inside_share(centres, radii, region, points: int = 2000):
    """Part of each disc that lies inside the region, on a sunflower of sample points (symmetric halves count exactly)."""
    k = np.arange(points) + 0.5
    radius, angle = np.sqrt(k / points), np.pi * (1.0 + np.sqrt(5.0)) * k
    disc = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    turned = disc[:, ::-1] * (-1.0, 1.0)
    disc = np.concatenate(
        [disc, turned, -disc, -turned]
    )  # a disc cut through its centre counts one half exactly, a corner 1/4
    samples = centres[:, None, :] + radii[:, None, None] * disc
    return np.array([np.mean(np.asarray(region.distance(block)) < 0.0) for block in samples])
