"""The overlap on several ranks gives what one rank gives: bonded discs that are eliminated, spheres on springs (as many loops to compile)."""

import numpy as np
import pytest
from mpi4py import MPI

from bridge import Overlap, OverlapZone
from continuum import Body, Cauchy, Cosserat
from meshes import Box, HalfPlane, HalfSpace, domains, packings
from particles import Assembly, Bonded

COMM = MPI.COMM_WORLD
STEPS = 1000
DISCS = Bonded(2.5e8, 5e7, np.inf, np.inf, normal_damping=40.0, shear_damping=20.0, bending_stiffness=1e5)
SPHERES = Bonded(5e7, 2e7, np.inf, np.inf)


def plane(comm, cosserat=False, few=False):
    """Discs of which some lie on the edges of cells and some right on nodes; or two discs in a single cell."""
    wide, radius = (0.5, 0.25) if few else (2.0, 0.125)
    zone = OverlapZone(HalfPlane((1.0, 0.0), (1.0, 0.0)), HalfPlane((1.0 + wide, 0.0), (1.0, 0.0)))
    material = Cosserat(2e8, 0.1, 3e7, 0.1, 2042.0) if cosserat else Cauchy(2e8, 0.1, 2042.0)
    counts = (1, 1) if few else (8, 4)
    body = Body(domains.rectangle((1.0, 0.0), (1.0 + wide if few else 5.0, 2.0), counts, comm=comm), material, share=zone)
    body.fix("right", "xy")
    body.fix("bottom", "y")
    body.traction("top", (0.0, -1e4))
    body.gravity((0.0, -9.81))
    sites = np.array([[1.25, 0.75], [1.25, 1.25]]) if few else packings.hexagonal(Box((0.0, 0.0), (3.0, 2.0)), radius, (0.0, 0.0))
    return zone, body, sites, radius, DISCS


def space(comm, cell, cosserat=False):
    """Spheres on faces, edges and corners of cells."""
    zone = OverlapZone(HalfSpace((0.5, 0.0, 0.0), (1.0, 0.0, 0.0)), HalfSpace((1.5, 0.0, 0.0), (1.0, 0.0, 0.0)))
    material = Cosserat(2e8, 0.0, 1e8, 0.1, 1361.0, couple_alpha=1e5, couple_beta=-2e5) if cosserat else Cauchy(2e8, 0.0, 1361.0)
    body = Body(domains.box((0.5, 0.0, 0.0), (2.5, 1.0, 1.0), (4, 2, 2), cell, comm=comm), material, share=zone)
    body.fix("right", "xyz")
    body.gravity((0.0, 0.0, -9.81))
    return zone, body, packings.simple_cubic(Box((0, 0, 0), (1.5, 1.0, 1.0)), 0.125, (0.0, 0.0, 0.0)), 0.125, SPHERES


SCENES = {
    "discs": (plane,), "discs, Cosserat": (plane, True), "two discs in one cell": (plane, False, True),
    "hexahedra": (space, "hexahedron"), "tetrahedra, Cosserat": (space, "tetrahedron", True),
}  # fmt: skip


def run(comm, scene, constraint, substeps, spread=True, steps=STEPS):
    make, *kind = SCENES[scene]
    zone, body, sites, radius, law = make(comm, *kind)
    mine = sites if comm.rank == 0 else sites[:0]
    soil = Assembly(mine, radius, 2600.0, law)
    soil.bond(0.01)
    rate = np.zeros((soil.count, soil.freedoms))
    rate[:, : soil.axes] = 2.0 * np.sin(3.0 * mine + np.arange(soil.axes)) * (mine[:, :1] < (0.9 if soil.axes == 2 else 0.4))
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
        ("discs", "lagrange", 3), ("discs, Cosserat", "lagrange", 1), ("two discs in one cell", "lagrange", 1),
        ("hexahedra", "penalty", 1), ("tetrahedra, Cosserat", "penalty", 3),
    ],
)
def test_ranks_agree_with_one_rank_after_1000_steps(scene, constraint, substeps):
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
