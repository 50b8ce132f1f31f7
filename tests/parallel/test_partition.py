"""One partition for cells and particles."""

import numpy as np
import pytest
from mpi4py import MPI

from bridge.run import Stopwatch
from continuum import Body, Cauchy
from meshes import domains
from studies.foundation import Parameters
from studies.foundation_coupled import MODELS
from tests.meshes.test_partition import under_a_plate

COMM = MPI.COMM_WORLD
MAKERS = {
    "rectangle": lambda **options: domains.rectangle((0.0, 0.0), (18.0, 9.0), **options),
    "graded": lambda **options: domains.foundation(**options),
    "box": lambda **options: domains.box((0.0, 0.0, 0.0), (18.0, 9.0, 1.0), (6, 3, 1), "tetrahedron", **options),
}


@pytest.mark.parametrize("maker", MAKERS)
def test_cells_of_even_cost_make_the_same_body(maker):
    """Mass and stiffness of one rank; each of the two cuts at most is off by half of the heaviest cell's cost."""

    def costs(corners):
        return under_a_plate(corners[..., :2])

    def energy(domain):
        body = Body(domain, Cauchy(1e9, 0.3, 2000.0))
        body.displacement = np.sin(body.coordinates) * 1e-3
        return body, np.array([body._total(body.mass.sum()), body.strain_energy()])

    shared, found = energy(MAKERS[maker](costs=costs, comm=COMM))
    alone, expected = energy(MAKERS[maker](comm=MPI.COMM_SELF))
    assert COMM.allreduce(shared.count) == alone.count
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    cost = np.array(COMM.allgather(costs(shared.cell_corners).sum()))
    assert cost.max() <= cost.mean() + costs(alone.cell_corners).max()


def test_particles_live_with_their_cells():
    """N is local: the nodes of each particle are those of a cell of its rank, and no particle is left out."""
    model = MODELS["bridging"](Parameters(radius=0.2, region="6x3"), Stopwatch())
    counts = COMM.allgather(model.shared.part.count if COMM.size > 1 else model.soil.count)
    assert sum(counts) == model.counts["particles"] + model.counts["ghosts"]
    if COMM.size > 1:
        body, used = model.body, model.coupled.fine._shape.indices
        known = body.space.dofmap.index_map.local_to_global(np.unique(body.cell_nodes).astype(np.int32))
        assert np.isin(model.coupled.exchange.nodes[used], known).all()
