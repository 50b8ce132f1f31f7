"""Bodies of tetrahedra and hexahedra on any number of ranks give the serial numbers; one cell leaves ranks without facets.

Run by `mpirun -n 2|3 python3 -m pytest tests/parallel`; on one rank it compares the problem with itself.
"""

import numpy as np
import pytest
from mpi4py import MPI

from continuum import Body
from meshes import domains
from tests.continuum.space import GRAINS, ROCK

WORLD, ALONE = MPI.COMM_WORLD, MPI.COMM_SELF
SCENES = {
    "one cell": ("hexahedron", (1, 1, 1), ROCK), "hexahedra": ("hexahedron", (3, 2, 2), ROCK), "tetrahedra": ("tetrahedron", (2, 2, 2), ROCK),
    "hexahedra, Cosserat": ("hexahedron", (3, 2, 2), GRAINS), "tetrahedra, Cosserat": ("tetrahedron", (2, 2, 2), GRAINS),
}  # fmt: skip


def make_body(cell, counts, material, comm):
    body = Body(domains.box((0, 0, 0), (2.0, 1.5, 1.0), counts, cell, comm=comm), material)
    body.fix("bottom", "xyzr" if material.turns else "xyz")
    body.fix("left", "x")
    body.traction("top", (1e4, 0.0, -2e5), couple=(1e4, -2e4, 3e4) if material.turns else None)
    body.gravity((0.0, 0.0, -9.81))
    return body


@pytest.fixture(params=SCENES, scope="module")
def pair(request):
    body, serial = (make_body(*SCENES[request.param], comm) for comm in (WORLD, ALONE))
    gap = np.abs(body.coordinates[:, None] - serial.coordinates).max(axis=2)
    at = gap.argmin(axis=1) if body.count else np.empty(0, dtype=int)
    assert gap[np.arange(body.count), at].max(initial=0) < 1e-12
    return body, serial, at


def test_mass_loads_supports_and_forces_agree(pair):
    body, serial, at = pair
    assert WORLD.allreduce(body.count) == serial.count
    assert np.array_equal(body.fixed, serial.fixed[at])
    load = serial.external_force()

    def trial(b):
        return np.column_stack([np.sin(k + b.coordinates @ [0.7, 1.1, -0.4]) for k in range(b.components)])

    for found, expected in (
        (body.mass, serial.mass), (body.external_force(), load), (body.internal_force(trial(body)), serial.internal_force(trial(serial))),
    ):  # fmt: skip
        assert np.abs(found - expected[at]).max(initial=0) < 1e-12 * np.abs(expected).max()


def test_motion_energy_and_reactions_agree(pair):
    body, serial, at = pair
    step = 0.5 * serial.critical_step()
    assert body.critical_step() == pytest.approx(serial.critical_step(), rel=1e-12)
    for b in (body, serial):
        b.advance(40, step)
    scale = np.abs(serial.displacement).max()
    assert scale > 0 and np.abs(body.displacement - serial.displacement[at]).max(initial=0) < 1e-11 * scale
    expected = serial.energies()
    assert body.energies() == pytest.approx(expected, abs=1e-11 * expected["external_work"])
    reaction = serial.reaction("bottom")
    assert body.reaction("bottom") == pytest.approx(reaction, abs=1e-10 * np.abs(reaction).max())
