"""A body of particles and elements that several ranks move does what it does on one, releases and failing bonds included."""

import numpy as np
import pytest
from mpi4py import MPI

from bridge.manifold import PARTICLES, Manifold, Recoarsening, ultimate_strain
from meshes import Box, packings
from particles.crew import lead
from particles.lattice import Lattice, LatticeMaterial

COMM = MPI.COMM_WORLD
D = 1e-3
ROCK = LatticeMaterial(12.5e9, 0.2, 2650, normal_limit=5e-7)


def bar():
    """A bar pulled at both ends until its middle is released and torn."""
    sites = packings.simple_cubic(Box((0, 0, 0), (0.006, 0.006, 0.048)), D / 2)
    body = Manifold(Lattice(sites, D, ROCK), 3, free=Box((0, 0, 0.021), (0.006, 0.006, 0.027)), release=ultimate_strain(3e-4), check_every=4)
    body.hold(lambda x: x[:, 2] < 0.0007, "z", -2.0)
    body.hold(lambda x: x[:, 2] > 0.0473, "z", lambda t: 2.0 * min(1.0, t / 2e-6))
    return body


def column():
    """A tensile pulse along a column that repeats: what it releases comes back behind it."""
    sites = packings.simple_cubic(Box((0, 0, 0), (2 * D, 2 * D, 90 * D)), D / 2)
    body = Manifold(
        Lattice(sites, D, ROCK, periodic="xy"), 2, free=lambda x: x[:, 2] < 4 * D, release=ultimate_strain(1e-4),
        recoarsen=Recoarsening(2e-5, 3 * D / ROCK.wave_speed, check_every=10),
    )  # fmt: skip
    period = 30 * D / ROCK.wave_speed
    body.hold(lambda x: x[:, 2] > -1, "xy")
    body.hold(lambda x: x[:, 2] < 0.6 * D, "z", lambda t: -0.6 * np.sin(np.pi * t / period) ** 2 * (t < period))
    return body


def wave():
    """No particle is free: a pulse through elements alone, of the higher-order mass, absorbed at the end."""
    lattice = Lattice(packings.simple_cubic(Box((0, 0, 0), (0.004, 0.004, 0.02)), D / 2), D, ROCK)
    lattice.absorb(lambda x: x[:, 2] > 0.0193, "z")
    lattice.traction(lambda x: x[:, 2] < D, (1e4, 0.0, 1e5), lambda t: np.sin(1e6 * t) * (t < 3e-6))
    return Manifold(lattice, 2, continuum=False, mass="higher-order")


@pytest.mark.parametrize("make, steps", [(bar, 40), (column, 50), (wave, 60)])
def test_motion_energies_and_releases_are_those_of_one_rank(make, steps):
    alone = make()
    alone.advance(steps)
    alone.advance(steps)

    def script():
        body = make()
        body.advance(steps)
        body.advance(steps)
        return body.displacement, body.velocity, body.particle_motion(), body.energies(), body.release_log, body.parallel()

    displacement, velocity, motion, energies, log, parallel = lead(script, COMM)
    assert log == alone.release_log
    if make is column:
        assert alone.recoarsener.returned > 3
    if make is bar:
        assert alone.released > 4 and energies["broken_bonds"] > 50 and (alone.kind != PARTICLES).any()
        assert COMM.size == 1 or sum(one["particles"] for one in parallel["ranks"]) == alone.lattice.free.sum()
    for values, expected in zip((displacement, velocity, *motion), (alone.displacement, alone.velocity, *alone.particle_motion())):
        np.testing.assert_allclose(values, expected, rtol=0, atol=1e-10 * np.abs(expected).max())
    largest = max(abs(value) for name, value in energies.items() if name != "broken_bonds")
    assert energies == pytest.approx(alone.energies(), abs=1e-9 * largest)
