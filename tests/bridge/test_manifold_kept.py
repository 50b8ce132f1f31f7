"""A body of particles and elements goes on from a checkpoint to the same bits, in the middle of releases, failures and returns."""

import math

import numpy as np
import pytest

from bridge import checkpoint
from bridge.manifold import PARTICLES, Manifold, Recoarsening, kept, ultimate_strain
from meshes import Box, packings
from particles.lattice import Lattice, LatticeMaterial
from particles.lattice import kept as lattice_kept

D = 1e-3
LIMIT = 4e-7  # m


def bar(alone=False, mass="lumped", length=0.048):
    """A bar pulled at its lower end until it is released and torn there; at the upper one particles come back before the wave is there."""
    sites = packings.simple_cubic(Box((0, 0, 0), (0.006, 0.006, length)), D / 2)
    limit = LIMIT if mass == "lumped" else math.inf
    body = lattice = Lattice(sites, D, LatticeMaterial(12.5e9, 0.2, 2650, normal_limit=limit))
    lattice.absorb(lambda x: x[:, 0] < D, "x")
    if not alone:
        body = Manifold(
            lattice, 3, free=Box((0, 0, 0.003), (0.006, 0.006, 0.009)), release=ultimate_strain(5e-4), check_every=4, mass=mass,
            recoarsen=Recoarsening(1e-6, 9e-6, check_every=10),
        )  # fmt: skip
        body.release(np.flatnonzero(body.centres[:, 2] > length - 0.009))
    body.hold(lambda x: x[:, 2] < 0.0007, "z", -2.0)
    return body


@pytest.mark.parametrize("options", [{"alone": True}, {}, {"mass": "higher-order"}])
def test_the_same_bits_after_a_checkpoint(tmp_path, options):
    state_of, restore = (kept.state_of, kept.restore) if "alone" not in options else (lattice_kept.state_of, lattice_kept.restore)
    whole, path = bar(**options), tmp_path / checkpoint.NAME
    for _ in range(3):
        whole.advance(22)
        checkpoint.write(path, {}, state_of(whole))
        again = bar(**options)
        again.advance(0)
        restore(again, checkpoint.read(path)[1])
        whole.advance(33)
        again.advance(33)
        assert np.array_equal(whole.displacement, again.displacement) and np.array_equal(whole.velocity, again.velocity)
        assert whole.energies() == again.energies() and whole.time == again.time
        if "alone" not in options:
            assert whole.release_log == again.release_log and np.array_equal(whole.kind, again.kind) and whole.returned == again.returned
            assert all(map(np.array_equal, whole.particle_motion(), again.particle_motion()))
    assert whole.energies()["broken_bonds"] > 50 or options == {"mass": "higher-order"}
    if "alone" not in options:
        assert whole.released > 8 and whole.returned > 2 and np.any(whole.kind != PARTICLES)


def test_the_state_of_another_scene_is_refused():
    for options in ({"alone": True}, {}):
        module = lattice_kept if options else kept
        with pytest.raises(ValueError, match="make the same scene"):
            module.restore(bar(length=0.051, **options), module.state_of(bar(**options)))
