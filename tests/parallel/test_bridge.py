"""The coupling on several ranks gives what one rank gives: particles on rank 0, the mesh on all."""

import numpy as np
import pytest
from mpi4py import MPI

from bridge.ranks import spread
from bridge.variants import VARIANTS
from particles.exchange import SharedAssembly
from tests.bridge.scenes import GRANULAR, scene

comm = MPI.COMM_WORLD
OPTIONS = dict(
    size=(4.0, 3.0), radius=0.125 / np.sqrt(2.0), region=((1.0, 2.0), (3.0, 4.0)), anchor=(0.0, 2.0), law=GRANULAR,
    plate=((1.5, 3.0 + 0.125 / np.sqrt(2.0)), (2.5, 3.5), (0.0, -0.5)), step=4e-4, substeps=4, mass_damping=100.0,
)  # fmt: skip


SQUARE = dict(kind="square", radius=0.0625, gravity=(0.0, -9.81), velocity=(0.05, 0.02))


def run(communicator, variant, steps=40, **options):
    coupled, _ = scene(**{**OPTIONS, **options}, variant=variant, comm=communicator)
    coupled.advance(steps)
    return results(coupled, communicator, communicator.bcast(coupled.soil.displacements))


def results(coupled, communicator, particles):
    coupled.project_covered()
    body = coupled.body
    rows = np.column_stack([body.coordinates, body.displacement])
    nodes = np.concatenate(communicator.allgather(rows))
    nodes = nodes[np.lexsort(np.round(nodes[:, :2], 6).T)]
    return nodes, particles, coupled.energies(), coupled.mismatch()


@pytest.mark.parametrize("variant", VARIANTS)
def test_ranks_agree_with_one_rank(variant):
    """Sums over ranks change the order of additions only: 1e-9 of the largest displacement after 40 coarse steps."""
    compare(variant)


def test_contacts_on_the_outline_and_moving_sides_agree_too():
    """Square lattice: ghosts on the outline touch, half of their stiffness belongs to the mesh."""
    compare("subcycling", **SQUARE)


@pytest.mark.parametrize("variant, options", [*((name, {}) for name in VARIANTS), ("subcycling", SQUARE)])
def test_particles_on_the_ranks_of_their_cells_agree_too(variant, options):
    """1,000 particle steps once; 160 elsewhere: discs on the edges of cells slide, which amplifies rounding (by 500 in 1,000 steps)."""
    steps, limit = (250, 1e-10) if not options and variant == "subcycling" else (40, 1e-9)
    options = {**options, "variant": variant}
    coupled, layout = scene(**{**OPTIONS, **options}, comm=comm, everywhere=True)

    def particles():
        soil = scene(**{**OPTIONS, **options}, comm=MPI.COMM_SELF)[0].soil
        soil.set_ghosts(layout.ghost)
        return soil

    fine, body = coupled.fine, coupled.body
    shared = SharedAssembly(particles, comm, room=3 * len(fine.interface), owner=body.owners(coupled.soil.reference))
    spread(coupled, shared)
    shared.prepare(fine.step, mass_damping=coupled.mass_damping, gravity=body.gravity_acceleration)
    coupled.advance(steps)
    moved = comm.bcast(shared.gather(shared.part.displacements))
    check(results(coupled, comm, moved), run(MPI.COMM_SELF, steps=steps, **options), limit)


def compare(variant, **options):
    check(run(comm, variant, **options), run(MPI.COMM_SELF, variant, **options))


def check(shared, alone, limit=1e-9):
    nodes, particles, energies, mismatch = shared
    scale = np.abs(alone[1]).max()
    np.testing.assert_allclose(nodes, alone[0], rtol=0.0, atol=limit * scale)
    np.testing.assert_allclose(particles, alone[1], rtol=0.0, atol=limit * scale)
    for name, value in alone[2].items():
        assert energies[name] == pytest.approx(value, abs=1e-8 * abs(alone[2]["external"]))
    assert mismatch == pytest.approx(alone[3], rel=1e-3, abs=1e-13)
