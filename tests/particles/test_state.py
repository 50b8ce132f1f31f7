"""An assembly that is made anew and given a kept state goes on bit for bit as the one that it was taken from."""

import numpy as np
import pytest

from particles import Assembly, Bonded, Free, PeriodicCell, Plate, Servo, Wall, shapes
from particles.state import restore, state_of
from tests.particles.scenes import PAPER, cloud, hexagonal_lattice


def discs_among_walls():
    """Contacts that open and close, a controlled, a free, a driven and a recorded wall, list rebuilds, a held disc."""
    soil = cloud(60)
    soil.add_wall(
        Plate.rectangle((-1.0, -0.3), (2.0, -0.15), record=7),
        Plate.rectangle((-0.4, -0.1), (-0.2, 1.0), motion=Servo({"x": 5e3}, fastest=1.0)),
        Plate.rectangle((-0.2, 0.95), (1.0, 1.1), motion=Free(400.0, 60.0, damping=3.0)),
        Wall(shapes.plane((1.1, 0.0), (-1.0, 0.0)), velocity=lambda time: (-np.sin(40.0 * time), 0.0)),
    )
    soil.hold([5], "xr")
    return soil, 1e-5, {"gravity": (0.0, -9.81), "mass_damping": 1.0}


def spheres_in_a_cell():
    rng = np.random.default_rng(2)
    places = 0.2 * np.stack(np.meshgrid(*(np.arange(5),) * 3), axis=-1).reshape(-1, 3) + rng.uniform(-0.003, 0.003, (125, 3))
    soil = Assembly(places, rng.uniform(0.099, 0.102, 125), law=PAPER, cell=PeriodicCell((1.0,) * 3))
    soil.deform(np.diag([-1.0, 0.5, 0.5]))
    return soil, 0.3 * soil.critical_step(), {"local_damping": 0.2}


def bonds_that_break():
    law = Bonded(1e8, 2e7, 2e3, 2e3, friction=0.5)
    places = hexagonal_lattice(8, 8)
    soil = Assembly(places, 0.05, law=law)
    soil.bond()
    soil.velocities = np.random.default_rng(1).normal(size=(64, 3)) * [0.05, 0.05, 0.3]
    return soil, 0.2 * soil.critical_step(), {"vector_damping": (0.1, 0.1)}


@pytest.mark.parametrize("scene", [discs_among_walls, spheres_in_a_cell, bonds_that_break])
def test_a_restored_assembly_goes_on_bit_for_bit(scene):
    (whole, step, loads), (other, *_) = scene(), scene()
    before = 20 if scene is bonds_that_break else 730
    whole.advance(before, step, **loads)
    kept = {
        name: {k: np.array(v) for k, v in value.items()} if isinstance(value, dict) else np.array(value)
        for name, value in state_of(whole).items()
    }
    whole.advance(730, step, **loads)
    restore(other, kept)
    other.advance(730, step, **loads)
    for name in ("positions", "velocities", "forces", "displacements", "bonds", "breaks", "ids"):
        assert np.array_equal(getattr(whole, name), getattr(other, name)), name
    assert whole.energies() == other.energies() and whole.rebuilds == other.rebuilds > 1
    mine, theirs = whole.contacts(walls=True), other.contacts(walls=True)
    assert all(np.array_equal(mine.history[name], theirs.history[name]) for name in mine.history)
    for one, two in zip(whole.plates, other.plates):
        assert np.array_equal(one.force, two.force) and one.work == two.work
        assert all(np.array_equal(a, b) for a, b in zip(one.history, two.history))
    if scene is bonds_that_break:
        assert len(whole.breaks) > len(kept["breaks"]) > 0
    if scene is discs_among_walls:
        assert len(whole.plates[0].history.time) == 2 * 730 // 7


def test_the_state_of_other_particles_is_refused():
    kept = state_of(cloud(60))
    with pytest.raises(ValueError, match="60 particles that are not the 59"):
        restore(cloud(59), kept)
    with pytest.raises(ValueError, match="radii differ"):
        restore(cloud(60, seed=4), kept)
    soil = cloud(60)
    soil.add_wall(Plate.rectangle((-1.0, -0.3), (2.0, -0.15)))
    with pytest.raises(ValueError, match="other walls"):
        restore(soil, kept)
