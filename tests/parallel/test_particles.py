"""Particles on any number of ranks move as on one: contacts, walls, cells, bonds, energies, histories, outputs."""

import numpy as np
import pytest
from mpi4py import MPI
from scipy.spatial import cKDTree

from particles import Assembly, Plate, Unstable
from particles.bisection import bisect, part_of
from particles.exchange import SharedAssembly
from particles.system import TRAVEL_LIMIT
from tests.particles.scenes import ALL, square_lattice
from tests.particles.test_state import discs_among_walls

COMM = MPI.COMM_WORLD


def shared_and_whole(scene, steps):
    """The scene after some steps on all ranks together, and on each rank by itself."""
    alone, step, loads = scene()
    shared = SharedAssembly(lambda: scene()[0], COMM)
    alone.advance(steps, step, **loads)
    shared.advance(steps, step, **loads)
    return shared, alone


def test_every_number_is_that_of_one_rank():
    """Sums are in another order: equal to rounding, which collisions and sliding amplify (by 1e4 at most here)."""
    shared, alone = shared_and_whole(discs_among_walls, 1000)
    assert alone.rebuilds > 1 and (shared.halo > 0 or COMM.size == 1 or not shared.part.count)
    energies, balance = shared.energies(), shared.energy_balance()
    largest = max(map(abs, alone.energies().values()))
    for name, energy in alone.energies().items():
        assert energies[name] == pytest.approx(energy, abs=1e-9 * largest), name
    assert balance == pytest.approx(alone.energy_balance(), abs=1e-9 * largest)
    for mine, theirs in zip(shared.part.plates, alone.plates):  # every rank knows the whole wall
        np.testing.assert_allclose(mine.displacement, theirs.displacement, rtol=0, atol=1e-10)
        assert mine.work == pytest.approx(theirs.work, abs=1e-9 * largest)
        np.testing.assert_array_equal(mine.history.time, theirs.history.time)
    whole = shared.collect()
    if COMM.rank == 0:
        check_same(whole, alone, largest)


def check_same(whole, alone, largest):
    """What rank 0 collects is the assembly that one rank has: measures and pictures need nothing else."""
    for name in ("displacements", "velocities"):
        mine, theirs = getattr(whole, name), getattr(alone, name)
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-9 * np.abs(theirs).max(), err_msg=name)
    for name, energy in alone.energies().items():
        assert whole.energies()[name] == pytest.approx(energy, abs=1e-9 * largest), name
    mine, theirs = (sorted(map(tuple, np.sort(soil.bonds, axis=1).tolist())) for soil in (whole, alone))
    assert mine == theirs
    mine, theirs = (soil.contacts(walls=True) for soil in (whole, alone))
    assert len(mine.first) == len(theirs.first)
    assert np.abs(mine.force).sum() == pytest.approx(np.abs(theirs.force).sum(), rel=1e-7)


def lattice():
    """Columns of discs right on the cut between ranks: elastic waves in a lattice between smooth plates."""
    places = square_lattice(12, 4)
    soil = Assembly(places, 0.0501, law=ALL.without_friction())
    soil.add_wall(*Plate.box((-0.05, -0.05), (1.15, 0.35), 0.2, frictionless=True))
    soil.velocities = np.column_stack([0.1 * np.sin(7.0 * places[:, 0]), 0.1 * np.cos(5.0 * places[:, 0]), 0.0 * places[:, 0]])
    return soil, 2e-5, {}


def test_elastic_motion_is_the_same_to_1e_10_after_1000_steps():
    shared, alone = shared_and_whole(lattice, 1000)
    found = shared.gather(shared.part.displacements)
    if COMM.rank == 0:
        np.testing.assert_allclose(found, alone.displacements, rtol=0, atol=1e-10 * np.abs(alone.displacements).max())


def test_ranks_without_particles_take_part():
    def two():
        soil = Assembly([[0.0, 0.0], [0.0999, 0.0]], 0.05, law=ALL.without_friction())
        soil.add_wall(*Plate.box((-0.05, -0.05), (0.15, 0.05), 0.2, frictionless=True))
        return soil, 2e-5, {}

    shared, alone = shared_and_whole(two, 200)
    assert COMM.allreduce(shared.part.count) == 2
    found = shared.gather(shared.part.positions)
    if COMM.rank == 0:
        np.testing.assert_allclose(found, alone.positions, rtol=0, atol=1e-13)


def halves(speed):
    """A gas with gaps of up to 0.02 m, one half of it looser: a skin that fits one half is not that which fits the other."""
    dense, loose = 1.1 * square_lattice(80, 30), 2.5 * square_lattice(30, 12)
    random = np.random.default_rng(2)
    places = np.vstack([dense, loose + [8.9, 0.0]])
    soil = Assembly(places + random.uniform(-0.005, 0.005, places.shape), 0.05, law=ALL)
    soil.velocities = np.column_stack([random.normal(0.0, speed, places.shape), np.zeros(len(places))])
    return soil


def missing_pairs(shared):
    """Pairs with a particle of this rank that come nearer than the list must know and are in none of its lists."""
    part, reach = shared.part, 2.0 * shared.part._system.clock[TRAVEL_LIMIT]
    places = np.zeros((shared.count, 2))
    for ids, some in COMM.allgather((shared.ids, part.positions[:, :2])):
        places[ids] = some
    listed = set()
    for numbers, one in ((shared.ids[part._ids], part._system), (shared._numbers, shared._border)):
        count = int(one.start[-1])
        listed |= set(map(tuple, np.sort(numbers[np.array([one.first[:count], one.second[:count]])], axis=0).T.tolist()))
    near = set(map(tuple, cKDTree(places).query_pairs(0.1 + reach - 1e-12, output_type="ndarray").tolist()))
    return [pair for pair in near - listed if np.isin(pair, shared.ids).any()]


@pytest.mark.parametrize("speed, steps", [(0.1, 150), (30.0, 20)])
def test_lists_of_all_ranks_reach_as_far_as_they_say(speed, steps):
    """Whatever skin would fit a rank's own particles, whether a list is pruned from an outer one or searched, and within a run."""
    shared = SharedAssembly(lambda: halves(speed), COMM)
    rebuild, search, searched, missing, skins = shared.rebuild, shared._search, [], [], []

    def checked():
        rebuild()
        missing.extend(missing_pairs(shared))
        skins.append(len(set(COMM.allgather(shared.part.skin))))

    shared.rebuild, shared._search = checked, lambda: (searched.append(1), search())
    for _ in range(12):
        shared.advance(steps, 2e-5)
        shared.rebuild()
    assert not missing and max(skins) == 1
    assert 0 < len(searched) < shared.rebuilds - 2


def test_particles_that_blow_up_on_one_rank_stop_all():
    shared = SharedAssembly(lambda: lattice()[0], COMM)
    with pytest.raises(Unstable, match="particle"):
        shared.advance(2000, 1e-2)


@pytest.mark.parametrize("parts", [1, 2, 3, 5, 7])
def test_bisection_shares_weights_evenly(parts):
    """No part differs from the mean by more than one point's weight a cut; the same parts whatever the axes are called."""
    rng = np.random.default_rng(4)
    places, weights = rng.uniform(size=(4000, 3)) * [1.0, 2.0, 0.5], rng.uniform(0.5, 1.5, 4000)
    found = part_of(bisect(places, parts, weights), places, -1)
    loads = np.bincount(found, weights, minlength=parts)
    assert np.abs(loads - weights.sum() / parts).max() <= 1.5 * 3
    np.testing.assert_array_equal(part_of(bisect(places[:, ::-1], parts, weights), places[:, ::-1]), found)
    mine = slice(COMM.rank, None, COMM.size)
    np.testing.assert_allclose(bisect(places[mine], parts, weights[mine], COMM), bisect(places, parts, weights), rtol=1e-12)
