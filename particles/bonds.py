"""Bonds of an assembly: which pairs are joined, which of them still hold."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from particles import listing
from particles.cell import nearest_image
from particles.system import RADIUS, Breaks

if TYPE_CHECKING:
    from particles.assembly import Assembly


def make(soil: Assembly, reach: float, pairs: Any) -> int:
    """Bond pairs as they are now; see `Assembly.bond`."""
    columns = [name for name, _ in soil._laws.columns]
    if "bond" not in columns:
        raise ValueError(f"law={type(soil._laws.all[0]).__name__} has no bonds; take the law Bonded")
    if not (np.isfinite(reach) and reach >= 0.0):
        raise ValueError(f"reach={reach} must be zero or positive (share of the sum of the radii)")
    before = soil._mechanical()
    soil._widen(2.0 * reach * soil._radii.max(initial=0.0))
    listing.rebuild(soil)
    system = soil._system
    count = int(system.start[-1])
    first, second = system.first[:count].astype(np.int64), system.second[:count].astype(np.int64)
    branch = system.position[second, : soil.axes] - system.position[first, : soil.axes]
    distance = np.linalg.norm(nearest_image(soil.cell, branch), axis=1)
    sums = system.position[first, RADIUS] + system.position[second, RADIUS]
    wanted = distance <= (1.0 + reach) * sums
    if pairs is not None:
        pairs = np.sort(np.asarray(pairs, dtype=np.int64).reshape(-1, 2), axis=1)
        own = np.sort(np.column_stack([soil._ids[first], soil._ids[second]]), axis=1).astype(np.int64)
        wanted &= np.isin(own @ [soil.count, 1], pairs @ [soil.count, 1])
    places = np.flatnonzero(wanted)
    system.history[:, places] = 0.0
    system.history[columns.index("bond"), places] = 1.0
    system.history[columns.index("offset"), places] = (distance - sums)[places]
    holding = int((system.history[columns.index("bond"), :count] > 0.5).sum())
    soil._file_breaks()
    soil._system = system._replace(breaks=Breaks(np.zeros((holding, 7)), np.zeros(1, dtype=np.int64)))
    soil._primed = None
    soil._imposed += soil._mechanical() - before
    return places.size


def held(soil: Assembly) -> np.ndarray:
    """Ids (k, 2) of the pairs whose bonds hold."""
    columns = [name for name, _ in soil._laws.columns]
    if "bond" not in columns:
        return np.zeros((0, 2), dtype=np.int64)
    system = soil._system
    count = int(system.start[-1])
    places = np.flatnonzero(system.history[columns.index("bond"), :count] > 0.5)
    return np.column_stack([soil._ids[system.first[places]], soil._ids[system.second[places]]]).astype(np.int64)
