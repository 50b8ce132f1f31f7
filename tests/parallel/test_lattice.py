"""A lattice that several ranks move does what it does on one."""

import numpy as np
import pytest
from mpi4py import MPI

from meshes import Box, packings
from particles.crew import lead
from particles.lattice import Lattice, LatticeMaterial
from particles.lattice.kept import restore, state_of
from particles.lattice.part import cut_axis, owners

COMM = MPI.COMM_WORLD
D = 1e-3
ROCK, WEAK = LatticeMaterial(12.5e9, 0.2, 2650, normal_limit=5e-7), LatticeMaterial(5e9, 0.15, 2400, normal_limit=4e-7)


def bar(**options):
    """A bar of two rocks, eight sites thick, fixed at one end and pulled at the other, with a dashpot face."""
    body = Lattice(
        packings.simple_cubic(Box((0, 0, 0), (0.005, 0.006, 0.02)), D / 2), D, [ROCK, WEAK], layer=lambda x: x[:, 2] > 0.012,
        local_damping=0.01, **options,
    )  # fmt: skip
    body.hold(lambda x: x[:, 2] < D, "z")
    body.absorb(lambda x: x[:, 1] < D, "y")
    body.pressure(lambda x: x[:, 0] < D, 1e5, lambda t: np.sin(2e5 * t))
    body.velocity = 40.0 * body.reference[:, [2, 0, 2]] * [0.1, 0.2, 1.0]
    return body


def layer(**options):
    """One layer that repeats, in plane strain, under a moving side."""
    sites = packings.simple_cubic(Box((0, 0, 0), (0.03, 0.02, D)), D / 2)
    body = Lattice(sites, D, ROCK, periodic="z", local_damping=0.3, **options)
    body.hold(lambda x: x[:, 0] >= 0, "z")
    body.hold(lambda x: x[:, 0] > 0.029, "x", lambda t: 0.5 * (1 - np.exp(-t / 1e-5)))
    body.hold(lambda x: x[:, 0] < D, "xy")
    return body


def plane(share=1.0, **options):
    """The hexagonal lattice under a traction, or a share of it."""
    body = Lattice(packings.hexagonal(Box((0, 0), (0.03, 0.02)), D / 2), D, ROCK, **options)
    body.hold(lambda x: x[:, 0] < D, "xy")
    body.traction(lambda x: x[:, 0] > 0.0285, (3e6 * share, 1e6 * share))
    return body


def compared(make, steps, **options):
    """Two bodies after the same steps in two parts, moved by one rank and by all."""
    alone = make(**options)
    alone.advance(steps)
    alone.velocity = 0.9 * alone.velocity
    alone.advance(steps)

    def script():
        together = make(**options)
        together.advance(steps)
        together.velocity = 0.9 * together.velocity
        together.advance(steps)
        return together.displacement, together.velocity, together.energies(), together.broken_bonds(), together.parallel()

    return alone, lead(script, COMM)


@pytest.mark.parametrize("make", [bar, layer, plane])
def test_motion_energies_and_broken_bonds_are_those_of_one_rank(make):
    alone, (displacement, velocity, energies, broken, parallel) = compared(make, 120)
    assert energies["broken_bonds"] > 20
    np.testing.assert_array_equal(broken, alone.broken_bonds())
    np.testing.assert_allclose(displacement, alone.displacement, rtol=0, atol=1e-10 * np.abs(alone.displacement).max())
    np.testing.assert_allclose(velocity, alone.velocity, rtol=0, atol=1e-9 * np.abs(alone.velocity).max())
    largest = max(abs(value) for name, value in energies.items() if name != "broken_bonds")
    assert energies == pytest.approx(alone.energies(), abs=1e-9 * largest)
    assert COMM.size == 1 or sum(one["particles"] for one in parallel["ranks"]) == alone.count


def test_elastic_motion_is_the_same_to_1e_10_after_1000_steps():
    alone, (displacement, velocity, energies, *_) = compared(lambda: plane(0.05), 500)
    assert energies["broken_bonds"] == 0
    np.testing.assert_allclose(displacement, alone.displacement, rtol=0, atol=1e-10 * np.abs(alone.displacement).max())


def test_a_restored_lattice_goes_on_to_the_same_bits():
    """Bonds break before: shared out anew, by the work that is left, three ranks would have other rows and sum energies in another order."""

    def script():
        body, again = plane(), plane()
        body.velocity = 20.0 * body.reference * (1.0, 0.5)
        body.advance(40)
        restore(again, {name: np.array(values) for name, values in state_of(body).items()})
        broken = body.energies()["broken_bonds"]
        for one in (body, again):
            one.advance(20)
        anew = owners(body._state, body.free, body.reference[:, cut_axis(body.places, body.free, COMM.size)], COMM.size)
        return body.displacement, again.displacement, body.energies(), again.energies(), broken, body._owner, anew

    one, two, mine, theirs, broken, owner, anew = lead(script, COMM)
    assert mine["broken_bonds"] > broken > 20
    np.testing.assert_array_equal(one, two)
    assert mine == theirs
    assert COMM.size != 3 or not np.array_equal(owner[0], anew)


def test_a_rank_may_have_no_rows():
    """Three sites in a row, on up to three ranks."""
    alone, (displacement, *_) = compared(lambda: Lattice(np.arange(3.0)[:, None] * [0, 0, D], D, ROCK, local_damping=0.1), 5)
    np.testing.assert_array_equal(displacement, alone.displacement)


def test_the_variational_force_stays_on_one_rank():
    def script():
        return Lattice(np.eye(3), D, ROCK, force="variational").following()

    assert lead(script, COMM) is None


def test_a_blow_up_is_told_on_every_rank():
    def script():
        body = plane(step=1e-5)
        body.advance(2000)

    from particles import Unstable

    with pytest.raises(Unstable, match="more than half a spacing"):
        lead(script, COMM)
