"""The continuum on any number of ranks gives the serial numbers: every rank also runs the whole problem alone.

Run by `mpirun -n 2|3 python3 -m pytest tests/parallel`; on one rank it compares the problem with itself.
"""

import numpy as np
import pytest
from mpi4py import MPI

from continuum import Body, Cosserat, Unstable, cells
from meshes import Box, domains

WORLD, ALONE = MPI.COMM_WORLD, MPI.COMM_SELF
MATERIAL = Cosserat(500e6, 0.2, 70e6, 0.05, 2042.0)
REGION = Box((5.5, 5.5), (12.5, 9))


def make_domain(kind, comm):
    if kind == "graded":
        return domains.foundation(size=2.0, size_near=0.5, region=REGION, comm=comm)
    if kind == "single":  # fewer cells than ranks: some rank owns none
        return domains.rectangle((0, 0), (18, 9), (1, 1), plate=18.0, comm=comm)
    return domains.rectangle((0, 0), (18, 9), (18, 9), kind, plate=2.0, comm=comm)


def make_body(kind, comm, excluded=True):
    domain = make_domain(kind, comm)
    if kind in ("quadrilateral", "triangle"):  # the same function of place on all ranks
        x = domain.mesh.geometry.x
        inner = (x[:, 0] > 1e-9) & (x[:, 0] < 18 - 1e-9) & (x[:, 1] > 1e-9) & (x[:, 1] < 9 - 1e-9)
        moved = 0.1 * np.column_stack((np.sin(3 * x[:, 0] + x[:, 1]), np.cos(2 * x[:, 0] - x[:, 1])))
        x[inner, :2] += moved[inner]
    body = Body(domain, MATERIAL, excluded=REGION if excluded else None)
    body.fix("bottom", "xyr")
    body.fix("left", "xr")
    body.fix("right", "xr")
    if kind != "single":
        body.prescribe("plate", "y", lambda t: -np.sin(50.0 * t))
    body.traction("top", (1e4, -2e5))
    body.gravity((0.0, -9.81))
    return body


def matching(body, serial):
    """Nodes of the serial body at the places of the distributed one's owned nodes."""
    if body.count == 0:
        return np.empty(0, dtype=int)
    gap = np.abs(body.coordinates[:, None] - serial.coordinates).max(axis=2)
    assert gap.min(axis=1).max() < 1e-9
    return gap.argmin(axis=1)


@pytest.fixture(params=["quadrilateral", "triangle", "graded", "single"], scope="module")
def pair(request):
    body, serial = make_body(request.param, WORLD), make_body(request.param, ALONE)
    return body, serial, matching(body, serial)


def test_every_node_has_one_owner(pair):
    body, serial, _ = pair
    assert WORLD.allreduce(body.count) == serial.count
    assert body.owned_range[1] - body.owned_range[0] == body.count
    assert WORLD.allreduce(len(body.cell_fractions)) == len(serial.cell_fractions)


def test_mass_loads_supports_and_forces_agree(pair):
    body, serial, at = pair
    assert np.abs(body.mass - serial.mass[at]).max(initial=0) < 1e-12 * serial.mass.max()
    load = serial.external_force()
    assert np.abs(body.external_force() - load[at]).max(initial=0) < 1e-12 * np.abs(load).max()
    assert np.array_equal(body.fixed, serial.fixed[at])

    def trial(b):
        return np.column_stack([np.sin(k + b.coordinates @ [0.7, 1.1]) for k in range(3)])

    for method in ("matrix", "form"):
        expected = serial.internal_force(trial(serial), method)
        difference = body.internal_force(trial(body), method) - expected[at]
        assert np.abs(difference).max(initial=0) < 1e-12 * np.abs(expected).max()


def test_critical_steps_agree(pair):
    """The iteration starts from other numbers on other ranks; it stops at 1e-8 of the eigenvalue."""
    body, serial, _ = pair
    assert body.critical_step() == pytest.approx(serial.critical_step(), rel=1e-12)
    assert body.critical_step("power") == pytest.approx(serial.critical_step("power"), rel=1e-6)


def test_shape_functions_agree_whoever_asks(pair):
    """Every rank asks for points of its own, the last one for none; rows refer to the same places and values."""
    body, serial, _ = pair
    count = 0 if WORLD.size > 1 and WORLD.rank == WORLD.size - 1 else 40 + WORLD.rank
    points = np.random.default_rng(WORLD.rank).random((count, 2)) * [18, 9]
    points = np.concatenate(
        (points, serial.coordinates[: 10 if count else 0], [[18.5, 3.0]] if count else np.empty((0, 2)))
    )
    nodes, values, found = body.shape_functions(points)
    assert len(found) == len(points)
    assert np.array_equal(found, serial.shape_functions(points)[2])
    places = np.zeros((serial.count, 2))
    for start, part in zip(WORLD.allgather(body.owned_range[0]), WORLD.allgather(body.coordinates)):
        places[start : start + len(part)] = part
    assert np.abs(values[found].sum(axis=1) - 1).max(initial=0) < 1e-12
    again = np.einsum("kn,knj->kj", values[found], places[nodes[found]])
    assert np.abs(again - points[found]).max(initial=0) < 1e-11
    assert np.all(nodes[~found] == -1)


def test_motion_energy_and_reactions_agree(pair):
    body, serial, at = pair
    step = 0.5 * serial.critical_step()
    for b in (body, serial):
        b.advance(60, step, mass_damping=20.0)
    scale = np.abs(serial.displacement).max()
    assert scale > 0
    assert np.abs(body.displacement - serial.displacement[at]).max(initial=0) < 1e-11 * scale
    energies, expected = body.energies(), serial.energies()
    work = abs(expected["external_work"])
    assert energies == pytest.approx(expected, abs=1e-11 * work)
    assert abs(energies["balance"]) < 1e-12 * work
    reaction = serial.reaction("bottom")
    assert body.reaction("bottom") == pytest.approx(reaction, abs=1e-10 * np.abs(reaction).max())
    # ghosts hold their owners' values: cell-wise fields need them
    fields, references = body.stress_fields(), serial.stress_fields()
    number = len(body.cell_fractions)
    peak = WORLD.allreduce(float(np.nanmax(fields["effective_stress"].x.array[:number], initial=0.0)), op=MPI.MAX)
    assert peak == pytest.approx(float(np.nanmax(references["effective_stress"].x.array)), rel=1e-9)


def test_names_agree():
    domain, serial = make_domain("graded", WORLD), make_domain("graded", ALONE)
    for name in serial.cell_names:
        assert WORLD.allreduce(len(domain.cells(name))) >= len(serial.cells(name))  # ghosts count twice
    assert np.array_equal(domain.bounds, serial.bounds)


def test_errors_reach_every_rank(tmp_path):
    """No rank is left waiting: the same sentence everywhere."""
    with pytest.raises(ValueError, match="does not exist"):
        domains.read(tmp_path / "missing.msh", WORLD)
    body = Body(domains.rectangle((0, 0), (18, 9), comm=WORLD), MATERIAL)
    with pytest.raises(ValueError, match="holds no nodes"):
        body.fix(Box((-5, -5), (-4, -4)), "x")
    body.displacement[:, 0] = np.sin(9.0 * body.coordinates[:, 0])
    with pytest.raises(Unstable, match="became unstable"):
        body.advance(200, 3 * body.critical_step())


TWO_SQUARES = """$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
3
1 7 "footing"
2 1 "clay"
2 2 "sand"
$EndPhysicalNames
$Nodes
6
1 0 0 0
2 1 0 0
3 2 0 0
4 0 1 0
5 1 1 0
6 2 1 0
$EndNodes
$Elements
5
1 1 2 7 1 4 5
2 2 2 1 1 1 2 5
3 2 2 1 1 1 5 4
4 2 2 2 2 2 3 6
5 2 2 2 2 2 6 5
$EndElements
"""


def test_own_mesh_is_the_same_on_all_ranks(tmp_path):
    path = WORLD.bcast(tmp_path / "own.msh")
    if WORLD.rank == 0:
        path.write_text(TWO_SQUARES)
    domain = domains.read(path, WORLD)
    body = Body(domain, MATERIAL)
    assert WORLD.allreduce(body.mass.sum(axis=0))[0] == pytest.approx(2 * 2042.0, rel=1e-12)
    for name, expected in (("clay", 1.0), ("sand", 1.0), ("soil", 2.0)):
        owned = domain.cells(name)[domain.cells(name) < len(body.cell_corners)]
        assert WORLD.allreduce(cells.areas(body.cell_corners[owned]).sum()) == pytest.approx(expected, rel=1e-12)
    assert sorted(domain.facet_names) == ["bottom", "footing", "left", "right"]  # the top is named in part by the file
    for name, length in (("footing", 1.0), ("bottom", 2.0), ("left", 1.0)):
        before = body.external_force().copy()
        body.traction(name, (0.0, -1.0))
        assert WORLD.allreduce((body.external_force() - before).sum(axis=0))[1] == pytest.approx(-length, rel=1e-12)
