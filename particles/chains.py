"""Force chains: the contacts that carry more than the mean, as line segments for pictures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from particles.network import contacts

if TYPE_CHECKING:
    from particles.assembly import Assembly


class Chains(NamedTuple):
    """Segments of the force chains, strongest last."""

    ends: np.ndarray  # (k, 2, d) centres of the particles (of a plate: the contact), m
    force: np.ndarray  # (k,) normal force, N (in the plane N per metre of thickness), compression positive
    width: np.ndarray  # (k,) m, proportional to the force; the mean radius for the largest


def force_chains(soil: Assembly, above: float = 1.0, walls: bool = False) -> Chains:
    """Contacts whose normal force is larger than `above` times the mean of all that push (Radjai et al. 1996).

    Args:
        above: 1 for the mean, 0 for all contacts that push.
        walls: contacts with plates, too.
    """
    found = contacts(soil, walls)
    pushing = found.push[found.push > 0.0]
    strong = np.flatnonzero(found.push > above * (pushing.mean() if pushing.size else 0.0))
    strong = strong[np.argsort(found.push[strong], kind="stable")]
    start = soil.positions[found.first[strong]]
    length = (found.first_arm + found.second_arm)[strong]  # to the nearest image in a periodic cell
    ends = np.stack([start, start + length[:, None] * found.normal[strong]], axis=1)
    force = found.push[strong]
    return Chains(ends, force, soil.radii.mean() * force / force.max(initial=0.0) if force.size else force)


def write_chains(path: str | Path, chains: Chains) -> None:
    """Write segments as a VTK file (.vtu) of lines with `normal_force` (N) and `width` (m), for ParaView's tube filter."""
    import meshio

    count, _, axes = chains.ends.shape
    points = np.zeros((2 * count, 3))
    points[:, :axes] = chains.ends.reshape(-1, axes)
    mesh = meshio.Mesh(
        points, [("line", np.arange(2 * count).reshape(-1, 2))],
        cell_data={"normal_force": [chains.force], "width": [chains.width]},
    )  # fmt: skip
    meshio.write(path, mesh, file_format="vtu", binary=True)
