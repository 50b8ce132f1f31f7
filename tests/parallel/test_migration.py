"""Particles that travel are handed from rank to rank with all that belongs to them, and the work is shared out anew."""

import numpy as np
import pytest
from mpi4py import MPI

from particles import Assembly, Bonded, Plate, Wall, shapes
from particles.exchange import SharedAssembly
from tests.parallel.test_particles import check_same
from tests.particles.scenes import ALL, hexagonal_lattice
from tests.particles.test_state import spheres_in_a_cell

COMM = MPI.COMM_WORLD


def block_that_breaks(strength=4e3):
    """A bonded block of two materials, spinning inside, flies past all ranks' boxes and breaks at a rough wall behind them."""
    places = hexagonal_lattice(8, 8)
    laws = {pair: Bonded(stiffness, 0.2 * stiffness, strength, strength, friction=0.5) for pair, stiffness in
            (((0, 0), 1e8), ((0, 1), 8e7), ((1, 1), 6e7))}  # fmt: skip
    soil = Assembly(places, 0.05, law=laws, materials=(places[:, 1] > 0.3).astype(int))
    soil.bond()
    soil.add_wall(Wall(shapes.plane((2.5, 0.0), (-1.0, 0.0))), Plate.rectangle((-1.0, -0.2), (4.0, -0.0499), frictionless=True))
    soil.velocities = [30.0, 0.0, 0.0] + np.random.default_rng(1).normal(size=(64, 3)) * [0.02, 0.02, 0.1]
    soil.external_forces = np.outer(np.arange(64) % 3 == 0, [5.0, -20.0, 0.0])
    soil.hold([3, 60], "r")
    return soil, 0.2 * soil.critical_step(), {"gravity": (0.0, -9.81)}


def both(scene, **options):
    """The scene on all ranks together, and on each rank by itself."""
    alone, step, loads = scene()
    return SharedAssembly(lambda: scene()[0], COMM, **options), alone, step, loads


@pytest.mark.parametrize("limit", [0.2, 1e6])
def test_what_travels_takes_everything_along(limit):
    """In flight equal to 1e-10; then the same bonds break, at the same time. Without new boxes the first rank becomes empty."""
    shared, alone, step, loads = both(block_that_breaks, limit=limit)
    flight = int(0.05 / step)
    for soil in (shared, alone):
        soil.advance(flight, step, **loads)
    found = shared.gather(shared.part.displacements)
    if COMM.rank == 0:
        np.testing.assert_allclose(found, alone.displacements, rtol=0, atol=1e-10 * np.abs(alone.displacements).max())
    counts = COMM.allgather(shared.part.count)
    if COMM.size > 1:
        assert shared.owners.handed > 0 and sum(counts) == 64 and not len(alone.breaks)
        assert counts[0] == 0 if limit > 1.0 else max(counts) < 64 * 1.5 / COMM.size
    for soil in (shared, alone):
        soil.advance(int(0.03 / step), step, **loads)
    whole = shared.collect()
    energies = shared.energies()
    if COMM.rank == 0:
        largest = max(map(abs, alone.energies().values()))
        check_same(whole, alone, largest)
        assert len(alone.breaks) > 10
        order = np.lexsort((*np.sort(alone.breaks[:, 1:3], axis=1).T, alone.breaks[:, 0]))
        mine, theirs = whole.breaks, alone.breaks[order]
        np.testing.assert_array_equal(np.sort(mine[:, 1:3], axis=1), np.sort(theirs[:, 1:3], axis=1))
        np.testing.assert_allclose(mine[:, [0, 3, 4, 6]], theirs[:, [0, 3, 4, 6]], rtol=1e-8, atol=1e-9)
        assert energies == pytest.approx(alone.energies(), abs=1e-9 * largest)


def spheres_that_go_round():
    """Spheres that touch, in a periodic cell that deforms, fly through the boxes of all ranks and on."""
    soil, step, _ = spheres_in_a_cell()
    soil.velocities = soil.velocities + [150.0, 100.0, 70.0, 0.0, 0.0, 0.0]
    return soil, step, {"local_damping": 1e-12}


def test_spheres_go_round_a_periodic_cell():
    """Momentum is kept to rounding, places and energies are those of one rank."""
    shared, alone, step, loads = both(spheres_that_go_round)
    before = alone.masses @ alone.velocities
    for soil in (shared, alone):
        soil.advance(300, step, **loads)
    assert COMM.size == 1 or shared.owners.handed > 1
    energies, largest = shared.energies(), max(map(abs, alone.energies().values()))
    assert energies == pytest.approx(alone.energies(), abs=1e-9 * largest)
    whole = shared.collect()
    if COMM.rank == 0:
        assert alone.displacements[:, 0].min() > 1.0
        np.testing.assert_allclose((whole.masses @ whole.velocities)[:3], before[:3], rtol=1e-11)
        check_same(whole, alone, largest)


def collapse():
    """A column of discs that roll and slide falls over and spreads, from a corner of what it covers in the end."""
    rng = np.random.default_rng(5)
    places = 0.1 * np.stack(np.meshgrid(np.arange(5), np.arange(24)), axis=-1).reshape(-1, 2) + rng.uniform(-0.004, 0.004, (120, 2))
    soil = Assembly(places, rng.uniform(0.042, 0.049, 120), law=ALL)
    soil.add_wall(
        Plate.rectangle((-1.0, -0.3), (20.0, -0.05), record=1000),
        Plate.rectangle((-0.3, -0.05), (-0.05, 4.0), velocity=lambda time: (0.0, 0.0), frictionless=True),
    )
    soil.velocities = np.outer(places[:, 1], [2.0, 0.0, 0.0])
    soil.hold([119], "r")
    return soil, 1e-4, {"gravity": (0.0, -9.81), "mass_damping": 0.1}


def test_a_column_falls_over_all_ranks():
    """Which disc slides where is chaos; energy balances as on one rank, no disc is lost, the work stays shared."""
    shared, alone, step, loads = both(collapse)
    for soil in (shared, alone):
        soil.advance(5000, step, **loads)
    numbers = np.concatenate(COMM.allgather(shared.ids))
    np.testing.assert_array_equal(np.sort(numbers), np.arange(120))
    assert abs(shared.energy_balance()) < 2.0 * abs(alone.energy_balance()) + 1e-6 * alone.energies()["gravity_work"]
    assert shared.energies()["gravity_work"] == pytest.approx(alone.energies()["gravity_work"], rel=0.05)
    if COMM.size > 1:
        assert shared.owners.cuts > 1 and shared.part.count > 0
    whole = shared.collect()
    if COMM.rank == 0:
        assert np.ptp(whole.positions[:, 0]) > 1.5


@pytest.mark.parametrize("scene, before, after", [(block_that_breaks, 900, 1500), (spheres_that_go_round, 150, 150), (collapse, 2000, 3000)])
def test_a_restored_scene_goes_on_to_the_same_bits(scene, before, after):
    """Through new lists, particles that change hands and boxes that are cut anew; what is written goes on, and so does what reads it."""
    undisturbed, _, step, loads = both(scene)
    written, again = (both(scene)[0] for _ in range(2))
    for soil in (undisturbed, written):
        soil.advance(before, step, **loads)
    state = copied(written.state())
    again.restore(state if COMM.rank == 0 else None)
    lists, handed = again.rebuilds, again.owners.handed
    shared = (undisturbed, written, again)
    for soil in shared:
        soil.advance(after, step, **loads)
    assert again.rebuilds > lists + 2 and (COMM.size == 1 or again.owners.handed > handed)
    one = everything(undisturbed)
    for soil in shared[1:]:
        for name, values in everything(soil).items():
            np.testing.assert_array_equal(values, one[name], err_msg=name)


def everything(shared):
    """What a rank has, row by row, and what all have together on rank 0."""
    part, whole = shared.part, shared.collect()
    system, names = part._system, ("position", "velocity", "acceleration", "spin", "first", "second", "history", "sums", "clock")
    found = {name: getattr(system, name) for name in names if getattr(system, name) is not None}
    found |= {"ids": shared.ids, "rows": part._rows, "border": shared._border_sums, "energies": list(shared.energies().values())}
    if system.walls is not None:
        found["walls"] = system.walls.body
    if whole is not None:
        found |= {"positions": whole.positions, "breaks": whole.breaks} | {
            f"{name} of {k}": getattr(wall.history, name) for k, wall in enumerate(whole.plates) for name in ("time", "force") if wall.record
        }
    return found


def copied(state):
    """As a file gives it back."""
    return {name: copied(one) if isinstance(one, dict) else np.array(one) for name, one in state.items()}
