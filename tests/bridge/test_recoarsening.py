"""Released particles that become elements again: what is kept exactly, what is lost and booked, and when it happens."""

import math

import numpy as np
import pytest

from bridge.manifold import CONTINUUM, MANIFOLD, PARTICLES, Manifold, Recoarsening, ultimate_strain
from meshes import Box, packings
from particles.lattice import Lattice, LatticeMaterial
from particles.lattice.part import cut_all, touched

ROCK = LatticeMaterial(12.5e9, 0.2, 2650.0)


def body(size, per_element, free, material=ROCK, force="variational", periodic="", **options):
    sites = packings.simple_cubic(Box((0, 0, 0), size), 0.5)
    return Manifold(Lattice(sites, 1.0, material, force=force, periodic=periodic), per_element, free=below(free), **options)


def below(level):
    return lambda x: x[:, 2] < level


def mass_and_moment(it):
    """Mass, and sums of mass times displacement and of momentum (3,) each."""
    free, state = it.lattice.free, it.lattice._state
    mass = it.lattice.mass * free
    return mass.sum() + it.node_mass.sum(), state.displacement @ mass + it._nodes.displacement @ it.node_mass, it.momentum()


def test_linear_motion_comes_back_as_it_was():
    """Strains and rates of strain that are the same everywhere: elements carry them, so that release and return leave no trace."""
    it = body((12, 12, 24), 3, 6, recoarsen=Recoarsening(1e-9, 0.0))
    strain, rate = np.random.default_rng(1).standard_normal((2, 3, 3)) * 1e-4
    it.set_motion(lambda x: x @ strain, lambda x: 1.0 + x @ rate)
    before = it.displacement.copy(), it.velocity.copy(), it.kind.copy()
    chosen = np.flatnonzero(np.all(np.abs(it.centres - it.centres.mean(axis=0)) < (2, 2, 5), axis=1))
    it.release(chosen)
    assert set(it.recoarsener.take_back(chosen)) == set(chosen)
    assert np.array_equal(it.kind, before[2])
    for now, then in zip((it.displacement, it.velocity), before):
        assert now[it.alive] == pytest.approx(then[it.alive], rel=1e-9, abs=1e-12 * np.abs(then).max())
    energy = it.energies()
    for name in ("kinetic", "strain"):  # the lumped masses lose at the release what the return gives back
        assert energy[f"recoarsen_{name}"] == pytest.approx(-energy[f"release_{name}"], rel=1e-9, abs=1e-12 * energy["elastic"])


def test_momentum_and_the_centre_of_mass_are_kept_by_any_return():
    """Motion that elements carry badly, taken back by a loose rule, beside nodes that move already: 1e-12; the account closes."""
    it = body((10, 10, 30), 5, 10, recoarsen=Recoarsening(1.0, 0.0, where=below(99)))
    it.set_motion(velocity=lambda x: 1e-3 * np.sin(0.9 * x[:, [1, 2, 0]]))
    for _ in range(2):
        it.release(np.flatnonzero(it.kind == MANIFOLD))
        it.advance(20)
        before = mass_and_moment(it)
        assert len(it.recoarsener.take_back(np.flatnonzero(it.kind == PARTICLES)[4:7])) == 3
        for now, then in zip(mass_and_moment(it), before):
            assert np.abs(now - then).max() < 1e-12 * np.abs(then).max()
    energy = it.energies()
    it.advance(50)
    size = energy["kinetic"] + energy["elastic"]
    assert abs(it.energies()["balance"]) < 1e-12 * size and abs(energy["recoarsen_kinetic"]) > 0.01 * size


def column(alone=False, **options):
    """A tensile pulse of twenty elements' length along a column that repeats; it is past the lower half in the end."""
    size, n = (4, 4, 280), 4
    if alone:
        it = Lattice(packings.simple_cubic(Box((0, 0, 0), size), 0.5), 1.0, ROCK, periodic="xy", force="variational")
    else:
        it = body(size, n, 8, periodic="xy", release=ultimate_strain(1e-4), **options)
    period = 80 / ROCK.wave_speed
    it.hold(lambda x: x[:, 2] > -1, "xy")
    it.hold(below(0.6), "z", lambda t: -math.sin(math.pi * t / period) ** 2 if t < period else 0.0)
    it.advance(int(240 / ROCK.wave_speed / it.step))
    return it


def test_particles_behind_a_pulse_come_back_at_little_cost():
    """Of the particles that the pulse has released, those that it has left come back; what they lose stays below E strain^2 a
    volume, the account closes to rounding, and the distance from the lattice alone is that without a return."""
    tolerance = 1e-5
    lattice, kept = column(alone=True), column()
    back = column(recoarsen=Recoarsening(tolerance, 10 / ROCK.wave_speed))
    assert back.recoarsener.returned > 10 and np.sum(back.kind == PARTICLES) < 0.8 * np.sum(kept.kind == PARTICLES)
    near = back.grid.around(np.flatnonzero(back.kind == PARTICLES))
    assert np.any(back.kind[: near.max()] == CONTINUUM) and not np.any(back.kind[near] == CONTINUUM)
    energy = back.energies()
    lost = energy["recoarsen_kinetic"] + energy["recoarsen_strain"]
    assert 0 < lost < back.recoarsener.returned * np.prod(back.size) * ROCK.young_modulus * tolerance**2
    assert abs(energy["balance"]) < 1e-12 * energy["held_work"]
    wanted = lattice.velocity[:, 2]
    errors = [np.linalg.norm(one.particle_motion()[1][:, 2] - wanted) / np.linalg.norm(wanted) for one in (kept, back)]
    assert errors[0] < 0.06 and errors[1] < 1.1 * errors[0], errors


def test_only_quiet_particles_far_from_cracks_come_back():
    """At rest, after the time: not those within two elements of a broken bond, nor where the strain is more than half the limit."""
    it = body((2, 2, 40), 2, 4, release=ultimate_strain(1e-4, 1.0), recoarsen=Recoarsening(1e-3, 2e-2, check_every=5))
    it.release(np.flatnonzero(it.centres[:, 2] < 30))
    row = int(it.lattice.rows(below(1))[0])
    up = int(np.flatnonzero(it.lattice._terms.vectors @ (0, 0, 1) == 1.0)[0])
    bond = np.array([(row, up)])
    cut_all(it.lattice._state, it.lattice._terms, bond, touched(it.lattice._state, bond)[0])
    it.advance(int(1.9e-2 / it.step))
    assert it.returned == 0  # not yet for long enough
    it.advance(int(0.2e-2 / it.step) + 5)
    assert it.returned == 15 - 3 and np.array_equal(np.sort(it.centres[it.kind == PARTICLES, 2]), (1, 3, 5))
    stretched = body((2, 2, 40), 2, 4, release=ultimate_strain(1e-4, 1.0), recoarsen=Recoarsening(1e-3, 0.0, check_every=5))
    stretched.release(np.flatnonzero(stretched.centres[:, 2] < 30))
    for strain, count in ((0.6e-4, 0), (0.4e-4, 8)):
        stretched.set_motion(lambda x: x * (0, 0, strain), lambda x: 0.0 * x)
        stretched.advance(5)
        assert (stretched.returned > count) == (count > 0)


def test_elements_that_were_particles_at_the_start_come_back_where_asked_for():
    for where, count in ((None, 0), (below(5), 2)):
        it = body((4, 4, 16), 4, 8, recoarsen=Recoarsening(1e-9, 0.0, where=where, check_every=10))
        it.advance(10)
        assert it.recoarsener.returned == (0 if where is None else 1) and np.sum(it.kind == PARTICLES) == 2 - (count > 0)


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: Recoarsening(0.0, 1.0), "strain=0.0"),
        (lambda: Recoarsening(1e-5, -1.0), "quiet=-1.0"),
        (lambda: Recoarsening(1e-5, 1.0, share=1.0), "share=1.0"),
        (lambda: Recoarsening(1e-5, 1.0, distance=0), "distance=0"),
        (lambda: body((4, 4, 4), (2, 2, 1), 2, recoarsen=Recoarsening(1e-5, 1.0)), r"per_element=\(2, 2, 1\) must be at least 2"),
    ],
)
def test_bad_rules_are_refused_in_one_sentence(make, words):
    with pytest.raises(ValueError, match=words):
        make()
