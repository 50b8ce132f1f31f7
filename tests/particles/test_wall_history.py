"""Histories of walls: impulse, moments and work by rows, however the run is divided; CSV; bad input."""

import numpy as np
import pytest

from particles import Assembly, LiChu, Plate, Unstable, Wall, shapes
from particles.files import write_history
from particles.walls import WallHistory

GRIP = LiChu(1e7, 5e6, normal_damping=100.0, sliding_damping=100.0, sliding_friction=0.4)


def bouncing(record, **options):
    """Discs that fall onto a plate at an angle and spin, far enough to renew the list."""
    soil = Assembly([[0.0, 0.06], [0.3, 0.08], [0.31, 0.2]], 0.05, law=GRIP)
    plate = Wall(shapes.box((-1, -0.2), (1, 0)), centre=(0.1, -0.1), record=record, **options)
    soil.add_wall(plate)
    soil.velocities = [[0.5, -1.0, 20.0], [-0.3, -0.5, 0.0], [0.0, -2.0, 3.0]]
    return soil, plate


def test_impulse_of_the_rows_is_the_change_of_momentum():
    """Every step: central differences give the impulse by the trapezoidal rule to rounding; that of gravity is taken off."""
    soil, plate = bouncing(1, velocity=(0.2, 0.05))
    step, steps, g = 1e-5, 6000, np.array([0.0, -9.81])
    before = soil.masses @ soil.velocities[:, :2]
    first = plate.force[:2]
    soil.advance(steps, step, gravity=g)
    change = soil.masses @ soil.velocities[:, :2] - before - soil.masses.sum() * g * steps * step
    history = plate.history
    forces = np.vstack([first, history.force])
    impulse = -step * (0.5 * (forces[1:] + forces[:-1])).sum(axis=0)
    np.testing.assert_allclose(impulse, change, atol=1e-11 * np.abs(history.force).sum() * step)
    assert np.abs(change).min() > 1.0
    np.testing.assert_allclose(history.time, step * np.arange(1, steps + 1), rtol=1e-11)
    np.testing.assert_allclose(history.position, [0.1, -0.1] + history.time[:, None] * [0.2, 0.05], rtol=1e-10)
    # work on the particles: minus reaction times velocity, by the same rule
    power = -forces @ [0.2, 0.05]
    np.testing.assert_allclose(history.work, step * np.cumsum(0.5 * (power[1:] + power[:-1])), atol=1e-10 * np.abs(power).max())
    assert history.work[-1] == plate.work != 0.0 and soil.rebuilds > 3


@pytest.mark.parametrize("parts", [[1800], [1, 149, 900, 750], [369] * 4 + [324]])
def test_rows_are_those_that_the_wall_shows_however_the_run_is_divided(parts):
    """A turning body: forces and moments about its moving centre every 150 steps; runs that are divided differ by rounding."""
    soil, plate = bouncing(150, velocity=(0.0, 0.5), spin=2.0)
    plain, same = bouncing(0, velocity=(0.0, 0.5), spin=2.0)
    for part in parts:
        soil.advance(part, 1e-5)
    shown = []
    for _ in range(12):
        plain.advance(150, 1e-5)
        shown.append([plain.time, *same.force, *same.centre, 2.0 * plain.time, same.work])
    history = plate.history
    rows = np.column_stack([history.time, history.force, history.moment, history.position, history.rotation, history.work])
    np.testing.assert_allclose(rows, shown, rtol=1e-7, atol=1e-7)
    assert history.time.shape == (12,) and np.abs(history.moment).max() > 1.0


def test_moment_is_about_the_moving_centre():
    """One frictionless contact: moment = lever x force with the lever from the present centre."""
    soil = Assembly([[0.35, 0.0499]], 0.05, law=LiChu(1e6))
    floor = Plate.rectangle((-1, -1), (1, 0), velocity=(0.7, 0.0), record=10)
    soil.add_wall(floor)
    soil.hold([0])
    soil.advance(100, 1e-4)
    history = floor.history
    assert history.time.size == 10
    np.testing.assert_allclose(history.force, np.tile([0.0, -100.0], (10, 1)), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(history.moment, (0.35 - 0.7 * history.time) * -100.0, rtol=1e-9)


def test_walls_are_recorded_each_at_its_own_pace_and_from_when_it_is_wanted():
    soil, plate = bouncing(0)
    other = Wall(shapes.plane((0, -0.3), (0, 1)), record=7)
    soil.add_wall(other)
    assert plate.history.time.shape == (0,) and plate.history.force.shape == (0, 2)
    soil.advance(100, 1e-5)
    plate.record = 30
    soil.advance(100, 1e-5)
    assert other.history.time.size == 28 and plate.history.time.size == 3
    assert plate.history.time[0] == pytest.approx(130e-5)
    plate.record = 0
    soil.advance(100, 1e-5)
    assert plate.history.time.size == 3 and other.history.time.size == 42
    assert soil.system.records is None  # loops of other callers do not see it


def test_rows_are_kept_when_the_particles_blow_up():
    soil, plate = bouncing(10)
    with pytest.raises(Unstable):  # more than 5 cm a step after 50 steps
        soil.advance(1000, 1e-5, gravity=(0.0, 1e7))
    assert 3 <= plate.history.time.size < 10


@pytest.mark.parametrize("axes", [2, 3])
def test_csv_has_a_column_a_component(axes, tmp_path):
    rng = np.random.default_rng(0)
    turning = (4,) if axes == 2 else (4, 3)
    history = WallHistory(*(rng.normal(size=size) for size in ((4,), (4, axes), turning, (4, axes), turning, (4,))))
    write_history(tmp_path / "wall.csv", history)
    head, *lines = (tmp_path / "wall.csv").read_text().splitlines()
    assert head == (
        "time,force_x,force_y,moment,x,y,rotation,work" if axes == 2 else
        "time,force_x,force_y,force_z,moment_x,moment_y,moment_z,x,y,z,rotation_x,rotation_y,rotation_z,work"
    )  # fmt: skip
    values = np.array([[float(word) for word in line.split(",")] for line in lines])
    np.testing.assert_array_equal(values, np.column_stack(list(history.columns().values())))


@pytest.mark.parametrize("record", [-1, 2.5])
def test_bad_paces_are_named(record):
    with pytest.raises(ValueError, match="record=.* of floor must be a whole number of steps"):
        Plate.rectangle((0, 0), (1, 1), name="floor", record=record)
