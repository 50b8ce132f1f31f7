"""The overlap on several ranks gives what one rank gives: discs that are eliminated, spheres on springs (as many loops to compile)."""

import numpy as np
import pytest
from mpi4py import MPI

from bridge import Overlap, OverlapZone
from continuum import Body, Cauchy, Cosserat
from meshes import Box, HalfPlane, HalfSpace, domains, packings
from particles import Assembly, Bonded, LiChu

COMM = MPI.COMM_WORLD
GRANULAR = LiChu(2.5e8, 5e7, 1e6, 7e2, 4e3, 2e3, 1e3, 1.0, 0.5, 0.05, 0.5e-3)
CLOSER = 0.98  # spacing over the diameter: contacts that carry a force, and open


def plane(comm, cosserat):
    zone = OverlapZone(HalfPlane((1.0, 0.0), (1.0, 0.0)), HalfPlane((3.0, 0.0), (1.0, 0.0)))
    material = Cosserat(2e8, 0.1, 3e7, 0.1, 2042.0) if cosserat else Cauchy(2e8, 0.1, 2042.0)
    body = Body(domains.rectangle((1.0, 0.0), (5.0, 2.0), (8, 4), comm=comm), material, share=zone)
    body.fix("right", "xy")
    body.fix("bottom", "y")
    body.traction("top", (0.0, -1e4))
    body.gravity((0.0, -9.81))
    sites = CLOSER * packings.hexagonal(Box((0.0, 0.0), (3.0 / CLOSER, 2.0 / CLOSER)), 0.1)
    return zone, body, sites, 0.1, GRANULAR


def space(comm, cell, cosserat=False):
    zone = OverlapZone(HalfSpace((0.5, 0.0, 0.0), (1.0, 0.0, 0.0)), HalfSpace((1.5, 0.0, 0.0), (1.0, 0.0, 0.0)))
    material = Cosserat(2e8, 0.0, 1e8, 0.1, 1361.0, couple_alpha=1e5, couple_beta=-2e5) if cosserat else Cauchy(2e8, 0.0, 1361.0)
    body = Body(domains.box((0.5, 0.0, 0.0), (2.5, 1.0, 1.0), (4, 2, 2), cell, comm=comm), material, share=zone)
    body.fix("right", "xyz")
    body.gravity((0.0, 0.0, -9.81))
    return zone, body, packings.simple_cubic(Box((0, 0, 0), (1.5, 1.0, 1.0)), 0.125), 0.125, Bonded(5e7, 2e7, np.inf, np.inf)


SCENES = {
    "discs": (plane, False), "discs, Cosserat": (plane, True), "hexahedra": (space, "hexahedron"), "tetrahedra": (space, "tetrahedron"),
    "hexahedra, Cosserat": (space, "hexahedron", True), "tetrahedra, Cosserat": (space, "tetrahedron", True),
}  # fmt: skip


def run(comm, scene, constraint, substeps, spread=True, steps=30):
    make, *kind = SCENES[scene]
    zone, body, sites, radius, law = make(comm, *kind)
    mine = sites if comm.rank == 0 else sites[:0]
    soil = Assembly(mine, radius, 2600.0, law)
    if isinstance(law, Bonded):
        soil.bond(0.01)
    rate = np.zeros((soil.count, soil.freedoms))
    rate[:, : soil.axes] = 0.05 * np.sin(3.0 * mine + np.arange(soil.axes)) * (mine[:, :1] < (0.9 if soil.axes == 2 else 0.4))
    soil.velocities = rate
    limit = Overlap(body, soil, zone, constraint=constraint, step=1e-9).critical_step()
    step = min(0.5 * substeps * limit, 0.8 * body.critical_step())
    coupled = Overlap(body, soil, zone, constraint=constraint, step=step, substeps=substeps, spread=spread)
    coupled.advance(steps)
    nodes = np.concatenate(comm.allgather(np.hstack([body.coordinates, body.displacement])))
    nodes = nodes[np.lexsort(np.round(nodes[:, : body.axes], 6).T)]
    energies, mismatch, sharp = coupled.energies(), coupled.mismatch(), coupled.critical_step(sharp=True)
    coupled.collect()
    with coupled._together():
        ties = comm.bcast(coupled.multipliers())
    coupled.release()
    return nodes, comm.bcast(soil.displacements), ties, energies, mismatch, [step, sharp]


@pytest.mark.parametrize(
    "scene, constraint, substeps",
    [
        ("discs", "lagrange", 3), ("discs, Cosserat", "lagrange", 1), ("hexahedra", "penalty", 1), ("tetrahedra", "penalty", 3),
        ("hexahedra, Cosserat", "penalty", 1), ("tetrahedra, Cosserat", "penalty", 3),
    ],
)
def test_ranks_agree_with_one_rank(scene, constraint, substeps):
    """Ranks change the order of additions only: 1e-10 of the largest displacement, of the forces of the ties and of the energy."""
    nodes, particles, ties, energies, mismatch, step = run(COMM, scene, constraint, substeps)
    alone = run(MPI.COMM_SELF, scene, constraint, substeps)
    assert step == pytest.approx(alone[5], rel=1e-12)
    scale = np.abs(alone[1]).max()
    np.testing.assert_allclose(nodes, alone[0], rtol=0.0, atol=1e-10 * scale)
    np.testing.assert_allclose(particles, alone[1], rtol=0.0, atol=1e-10 * scale)
    np.testing.assert_allclose(ties, alone[2], rtol=0.0, atol=1e-10 * np.abs(alone[2]).max())
    for name, value in alone[3].items():
        assert energies[name] == pytest.approx(value, abs=1e-10 * max(map(abs, alone[3].values())))
    assert mismatch == pytest.approx(alone[4], rel=1e-6, abs=1e-12 * scale)
