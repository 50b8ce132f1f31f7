"""P and Q of particles that are spread over the ranks are those of one rank."""

import numpy as np
import pytest
from mpi4py import MPI

from bridge.interpolation import Interpolation
from bridge.projection import Projection
from bridge.spread_projection import SpreadProjection
from continuum import Body, Cosserat
from meshes import domains

COMM = MPI.COMM_WORLD
NEAR = dict(rtol=0.0, atol=1e-10)


def cloud(comm, mine, spacing=0.2, cells=(4, 2)):
    """A body, N of some of the particles in its right half, their masses, inertias and motion."""
    body = Body(domains.rectangle((0, 0), (4, 2), cells, comm=comm), Cosserat(1e6, 0.2, 1e5, 0.1, density=1.0))
    along = np.arange(0.5 * spacing, 2.0, spacing)
    points = np.stack(np.meshgrid(2.0 + along, along), axis=-1).reshape(-1, 2)
    random = np.random.default_rng(2)
    points += random.uniform(-0.3, 0.3, points.shape) * spacing
    masses, values = random.uniform(1.0, 3.0, len(points)), random.standard_normal((len(points), 3))
    which = np.flatnonzero(mine(len(points)))
    return body, Interpolation(body, points[which]), masses[which], 0.1 * masses[which] ** 2, values[which], which


def spread(owner, free=None, **options):
    """The projection of all ranks, with the particles of `owner` (function of their numbers) on each, and that of one rank."""
    body, interpolation, masses, inertias, values, which = cloud(COMM, lambda n: owner(np.arange(n)) == COMM.rank, **options)
    mask = None if free is None else free(body.coordinates)
    found = SpreadProjection(
        COMM, body.owned_range, interpolation.matrix, interpolation.nodes, masses, inertias, mask
    )
    _, alone, masses, inertias, all_values, _ = cloud(MPI.COMM_SELF, lambda n: np.ones(n, dtype=bool), **options)
    return found, values, Projection(alone.matrix, masses, inertias), all_values, which, body


OWNERS = {
    "mixed": lambda k: k % COMM.size,  # a particle's rank need not own its cell
    "last rank": lambda k: np.full(len(k), COMM.size - 1),  # others have none
    "bands": lambda k: k * COMM.size // len(k),
}


@pytest.mark.parametrize("owner", OWNERS)
def test_projectors_are_those_of_one_rank(owner):
    """Consistent M, whichever rank has a particle; P P = P, Q N = 0, N^T Mp Q = 0 (Li & Wan 2010, eqs 4-8)."""
    p, values, alone, all_values, which, body = spread(OWNERS[owner])
    np.testing.assert_allclose(p.project(values), alone.project(all_values)[which], **NEAR)
    np.testing.assert_allclose(p.project(p.project(values)), p.project(values), **NEAR)
    np.testing.assert_allclose(p.restrict(p.weights * p.remainder(values)), 0.0, **NEAR)
    linear = body.coordinates @ [[2.0, -1.0, 0.5], [0.3, 4.0, -2.0]]
    np.testing.assert_allclose(p.remainder(p.extend(linear)), 0.0, **NEAR)
    assert p.solvers[0].condition == pytest.approx(COMM.bcast(p.solvers[0].condition), rel=1e-12)


@pytest.mark.parametrize("owner", OWNERS)
def test_few_particles_take_the_solution_of_least_norm(owner):
    """Fewer particles than nodes: M is singular, P is still the projector on the range of N, and the same on all ranks."""
    p, values, alone, all_values, which, _ = spread(OWNERS[owner], spacing=0.5, cells=(16, 8))
    assert not p.solvers[0].condition < 1e10
    np.testing.assert_allclose(p.project(values), alone.project(all_values)[which], **NEAR)


def test_held_nodes_keep_their_values_and_the_rest_is_fitted():
    """A linear motion of the particles is met by the free nodes beside held ones that have it."""
    p, *_, body = spread(OWNERS["mixed"], free=lambda x: x[:, 0] > 2.5)
    field = body.coordinates @ [[2.0, -1.0, 0.5], [0.3, 4.0, -2.0]]
    held = np.where(body.coordinates[:, :1] > 2.5, -7.0, field)
    np.testing.assert_allclose(p.coarse(p.extend(field), held), field, **NEAR)
