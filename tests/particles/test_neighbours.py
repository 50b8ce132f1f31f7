"""Neighbour list: nothing is missed, histories survive rebuilds and sorting, the fast loops equal a plain one."""

import numpy as np
import pytest

from particles import Assembly, LiChu, listing
from particles.system import SKIN_SCALE
from tests.particles import naive
from tests.particles.scenes import ALL, PAPER, cloud, hexagonal_lattice, packed, stacked


def test_fast_loop_equals_a_plain_double_loop():
    soil = cloud(25)
    start = soil.positions, soil.radii, soil.masses, soil.velocities
    step, steps = 1e-5, 150
    places, angle, velocities = naive.advance(*start, ALL, step, steps)
    soil.advance(steps, step)
    assert soil.contacts().first.size > 10
    # the mean arms of the fast loop are exact to the square of the strain increment (1e-8), in a force of relative size 1
    np.testing.assert_allclose(soil.positions, places, atol=1e-10)
    np.testing.assert_allclose(soil.velocities, velocities, atol=1e-6 * np.abs(velocities).max())


@pytest.mark.parametrize("width", [0.3, 1.5, 4.0])
def test_list_holds_exactly_the_pairs_in_reach(width):
    rng = np.random.default_rng(2)
    positions, radii = rng.uniform(0, width, (120, 2)), rng.uniform(0.01, 0.08, 120)
    soil = Assembly(positions, radii, law=PAPER, skin=0.02)
    system, ids = soil.system, soil.ids
    found = set()
    for i in range(120):
        for j in system.second[system.start[i] : system.start[i + 1]]:
            assert j > i
            found.add(frozenset((int(ids[i]), int(ids[j]))))
    distance = np.hypot(*(positions[:, None] - positions[None]).transpose(2, 0, 1))
    near = distance < radii[:, None] + radii[None] + 0.02
    assert found == {frozenset((i, j)) for i in range(120) for j in range(i) if near[i, j]}


def test_histories_survive_rebuilds_and_sorting():
    """A thin skin (rebuilt every few steps, rows sorted as the heap shears) and a thick one give the same motion."""

    def run(skin, count=64):
        soil = cloud(count, skin=skin)
        places = soil.positions
        soil.velocities = soil.velocities * 0.2 + np.column_stack([10 * places[:, 1], 0 * places[:, 0], 0 * places[:, 0]])
        soil.advance(4000, 1e-5)
        return soil

    thin, thick = run(0.0005), run(10.0)
    assert thin.rebuilds > 20 and thin.generation > 1, (thin.rebuilds, thin.generation)
    assert thick.generation == 1
    # the order of sums differs (rounding), and collisions amplify it
    np.testing.assert_allclose(thin.displacements, thick.displacements, rtol=1e-6, atol=1e-8)
    assert sorted(thin.rows) == list(range(64))
    np.testing.assert_array_equal(thin.ids[thin.rows], np.arange(64))


def test_sorting_turns_rolling_histories_with_the_order_of_a_pair():
    soil = cloud(16)
    soil.advance(60, 1e-5)
    before = soil.contacts()
    soil._system.position[:, :2] *= -1.0  # a half turn about the origin: the same contacts, rows in opposite order
    listing.rebuild(soil)
    assert soil.generation == 2
    after = soil.contacts()
    where = {frozenset((i, j)): k for k, (i, j) in enumerate(zip(after.first, after.second))}
    match = [where[frozenset((i, j))] for i, j in zip(before.first, before.second)]
    turned = np.where(before.first == after.first[match], 1.0, -1.0)
    assert (turned < 0).any() and np.abs(before.history["rolling"]).max() > 0
    # the half turn carries the pair rigidly, so the couple on a given disc and the sliding force along t stay
    np.testing.assert_allclose(after.history["sliding"][match], before.history["sliding"])
    np.testing.assert_allclose(after.history["rolling"][match, 0], turned * before.history["rolling"][:, 0])
    np.testing.assert_allclose(after.moment[match], turned * before.moment)


def test_materials_pick_their_law():
    soft, hard = LiChu(1e6), LiChu(4e6)
    laws = {(0, 0): soft, (0, 1): hard, (1, 1): hard}
    soil = Assembly([[0, 0], [0.099, 0], [0.3, 0], [0.399, 0]], 0.05, law=laws, materials=[0, 0, 0, 1])
    soil.advance(1, 1e-9)
    forces = soil.forces[:, 0]
    assert forces[2] / forces[0] == pytest.approx(4.0, rel=1e-6)
    one = Assembly([[0, 0], [0.099, 0]], 0.05, law=soft)
    one.advance(1, 1e-9)
    assert forces[0] == pytest.approx(one.forces[0, 0])


def test_ghosts_have_no_contacts_among_themselves():
    soil = Assembly(hexagonal_lattice(4, 4, 0.0499), 0.05, law=PAPER)
    soil.set_ghosts([0, 1])
    found = soil.contacts()
    assert not ((found.first + found.second == 1) & (found.first * found.second == 0)).any()
    assert found.first.size == Assembly(hexagonal_lattice(4, 4, 0.0499), 0.05, law=PAPER).contacts().first.size - 1


def test_empty_assembly_runs():
    soil = Assembly(np.zeros((0, 2)), np.zeros(0), law=PAPER)
    soil.advance(5, 1e-3)
    assert soil.displacements.shape == (0, 3) and soil.critical_step() == np.inf
    assert soil.energy_balance() == 0.0


def test_every_law_runs_the_loops_that_were_compiled_for_it():
    """Laws that differ only in what they have, one after the other and twice, in one process."""
    channels = {"sliding_stiffness": 5e7, "rolling_stiffness": 1e6, "moment_stiffness": 7e2}
    for change, viscous in [({}, False), ({"normal_damping": 4e3}, True)] * 2:
        for _ in range(2):
            soil = Assembly([[0, 0], [0.0999, 0]], 0.05, law=LiChu(2.5e8, **channels, **change))
            soil.velocities = [[1, 0, 0], [0, 0, 0]]
            soil.advance(3, 1e-7)
            assert (soil.energies()["viscous"] > 0) == viscous


def _drifting(speed, skin=None):
    """Touching discs of 0.05 m that move to and fro against each other, by `speed` radii a step of 1e-6 s at most."""
    soil = Assembly(hexagonal_lattice(6, 6, 0.05), 0.05, law=PAPER, skin=skin)
    velocities = np.zeros((soil.count, 3))
    velocities[:, 0] = 0.05 * speed / 1e-6 * np.linspace(-1.0, 1.0, soil.count)
    soil.velocities = velocities
    return soil


def test_skin_that_is_not_given_follows_the_speed():
    """s^2 = 2 c v / g: thin where a list lasts long anyway, thicker where it is soon used up; one given by the caller stays."""
    usual = listing.skin_scale(36, 36 / 0.05)  # no pair more within the outer list: the least, one a particle and radius
    slow = _drifting(1e-6)
    before, skin = slow.rebuilds, slow.skin
    slow.advance(7, 1e-6)
    assert slow.rebuilds == before and slow.skin == skin
    slow.advance(124, 1e-6)
    assert slow.rebuilds == before + 1
    assert slow.skin == pytest.approx(np.sqrt(usual * 0.05 * 1e-6), rel=0.2)  # contacts slow the discs down meanwhile
    fast = _drifting(1e-4)
    fast.advance(700, 1e-6)
    assert fast.skin == pytest.approx(np.sqrt(usual * 0.05 * 1e-4), rel=0.2)
    given = _drifting(1e-6, skin=0.005)
    given.advance(131, 1e-6)
    assert given.skin == 0.005 and given.rebuilds == before


def test_skin_is_thinner_where_a_wider_one_would_bring_more_pairs():
    """The scale goes down with the pairs that a metre more of skin would bring, but not for fewer than one a particle and radius."""

    def scale(gap):
        places = np.array([[0.1 * k + gap * (k // 2), 0.0] for k in range(200)])  # pairs that touch, with a gap to the next
        soil = Assembly(places, 0.05, law=LiChu(1e6))
        soil._set_skin(1e-4)
        listing.rebuild(soil)
        return soil.system.clock[SKIN_SCALE]

    beyond, within = scale(0.03), scale(0.02)  # the first outer list, which still holds, reaches as far as 0.0225 m
    more = 99 / (0.0225 - 1e-4)
    assert beyond == pytest.approx(listing.skin_scale(200, 200 / 0.05))
    assert within == pytest.approx(listing.skin_scale(200, more))


def _moved(soil, steps, step):
    """Lists and histories on the way, and how many of the lists were pruned from an older one."""
    found, old, searches = [], listing._search, []
    listing._search = lambda *scene: searches.append(1) or old(*scene)
    try:
        for _ in range(steps):
            soil.advance(25, step)
            system = soil.system
            pairs = system.start[-1]
            found.append((system.first[:pairs].copy(), system.second[:pairs].copy(), system.history[:, :pairs].copy()))
    finally:
        listing._search = old
    return found, soil.rebuilds - len(searches)


@pytest.mark.parametrize("share", [0.3, 0.46])
def test_outer_list_is_done_with_before_it_misses_a_pair(share):
    """Two discs just beyond the outer skin come closer, by `share` of it each: within the skin of the list in the end."""
    outer = 1e-3
    soil = Assembly([[0.0, 0.0], [0.1 + 1.001 * outer, 0.0]], 0.05, law=LiChu(1e6), skin=outer / listing.OUTER)
    assert soil._outer.skin == pytest.approx(outer) and soil._outer.start[-1] == 0
    soil.system.position[:, 0] += outer * share * np.array([1.0, -1.0])
    listing.rebuild(soil)
    gap = soil.positions[1, 0] - soil.positions[0, 0] - 0.1
    assert soil.system.start[-1] == (gap < soil.skin)


@pytest.mark.parametrize("make", [packed, stacked])
def test_pruned_lists_are_those_of_a_search(make, monkeypatch):
    """The same pairs in the same order, the same histories and so the same motion to the bit, also in a shearing cell."""
    runs = []
    for searching in (False, True):
        if searching:
            monkeypatch.setattr(listing, "holds", lambda soil: False)
        soil = make()
        soil.system.clock[SKIN_SCALE] = 0.0  # as if the caller had given the skin
        soil._set_skin(1e-4)
        soil.deform(np.triu(np.full((soil.axes, soil.axes), 0.3), 1))
        runs.append((*_moved(soil, 12, 0.1 * soil.critical_step()), soil.positions))
    (lists, pruned, places), (others, none, same) = runs
    assert pruned >= 5 and none <= 1
    for one, other in zip(lists, others):
        for a, b in zip(one, other):
            np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(places, same)


def test_motion_does_not_depend_on_the_skin_that_is_chosen():
    own, given = _drifting(1e-5), _drifting(1e-5, skin=0.02)
    for soil in (own, given):
        soil.advance(700, 1e-6)
    assert own.skin < 0.5 * given.skin
    np.testing.assert_allclose(own.displacements, given.displacements, rtol=1e-9, atol=1e-15)
