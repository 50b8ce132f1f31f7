"""A script that rank 0 leads does with all ranks what it does alone."""

import numpy as np
import pytest
from mpi4py import MPI

from particles import Unstable
from particles.crew import lead, ranks
from particles.driving import settle, unbalanced
from particles.spread import restore, spread
from particles.state import state_of
from tests.parallel.test_migration import collapse, spheres_that_go_round
from tests.particles.test_state import discs_among_walls

COMM = MPI.COMM_WORLD


def test_a_script_sees_the_numbers_of_one_rank():
    """Walls are given other loads and velocities on the way, particles new velocities, and more of them are held."""

    def script():
        assert ranks() == COMM.size
        (alone, step, loads), (soil, *_) = discs_among_walls(), discs_among_walls()
        together = spread(soil)
        for one in (alone, together):
            one.advance(100, step, **loads)
            one.plates[2].load = (0.0, -2e4, 0.0)
            one.plates[0].velocity = (0.0, 0.3)
            one.advance(100, step, **loads)
            one.velocities = 0.9 * one.velocities
            one.hold([7, 8])
            one.plates[3].velocity = lambda time: (0.1 * np.cos(30.0 * time), 0.0)
            one.advance(300, step, **loads)
        assert together.time == alone.time
        np.testing.assert_allclose(unbalanced(together), unbalanced(alone), rtol=1e-9)
        largest = max(map(abs, alone.energies().values()))
        assert together.energies() == pytest.approx(alone.energies(), abs=1e-9 * largest)
        for one, two in zip(alone.plates, together.plates):
            np.testing.assert_allclose(two.force, one.force, atol=1e-8 * np.abs(one.force).max())
            np.testing.assert_allclose(two.displacement, one.displacement, atol=1e-10)
        np.testing.assert_array_equal(together.plates[0].history.time, alone.plates[0].history.time)
        np.testing.assert_allclose(together.displacements, alone.displacements, rtol=0, atol=1e-9)
        assert together.energies() == pytest.approx(alone.energies(), abs=1e-9 * largest)
        check_goes_on(together, step, loads)
        return "done"

    assert lead(script, COMM) == "done" and ranks() == 1


def check_goes_on(soil, step, loads):
    """From a kept state the same particles come to the same places, to rounding: they are shared out anew."""
    kept = {
        name: {k: np.array(v) for k, v in value.items()} if isinstance(value, dict) else np.array(value)
        for name, value in state_of(soil).items()
    }
    assert not any(np.asarray(value).dtype == object for value in kept.values() if not isinstance(value, dict))
    soil.advance(50, step, **loads)
    places, time = soil.positions, soil.time
    restore(soil, kept)
    soil.advance(50, step, **loads)
    assert soil.time == time
    np.testing.assert_allclose(soil.positions, places, rtol=0, atol=1e-10)


def test_a_cell_is_deformed_by_what_it_answers():
    def script():
        soil, other = spheres_that_go_round(), spheres_that_go_round()
        alone, step, loads = soil
        together = spread(other[0])
        for one in (alone, together):
            for _ in range(5):
                one.advance(20, step, **loads)
                one.deform(np.diag([-1e-6, 1e-6, 1e-6] * one.cell_stress().diagonal() / 1e3))
        stress = alone.cell_stress()
        np.testing.assert_allclose(together.cell_stress(), stress, rtol=0, atol=1e-9 * np.abs(stress).max())
        np.testing.assert_allclose(together.cell.matrix, alone.cell.matrix, rtol=1e-12)
        np.testing.assert_allclose(together.displacements, alone.displacements, rtol=0, atol=1e-10)
        balances = together.energy_balance(), alone.energy_balance()
        assert balances[0] == pytest.approx(balances[1], abs=1e-9 * alone.energies()["kinetic"])

    lead(script, COMM)


def test_errors_of_the_script_reach_every_rank():
    def blows_up():
        soil, step, loads = collapse()
        together = spread(soil)
        together.advance(10, step, **loads)
        settle(together, 1e-1, gravity=(0.0, -9.81))

    with pytest.raises(Unstable, match="particle"):
        lead(blows_up, COMM)

    def refuses():
        spread(collapse()[0]).advance(10, 1e-4, gravity=(0.0, -9.81), mass_damping=0.1)
        raise ValueError("height=-1 must be positive (m)")

    with pytest.raises(ValueError, match="height=-1"):
        lead(refuses, COMM)
