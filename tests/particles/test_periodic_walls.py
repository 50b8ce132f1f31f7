"""Walls in periodic cells: they are one with their images, wherever the cell is cut; shear cells; what is refused."""

import numpy as np
import pytest

from particles import Assembly, Free, LiChu, PeriodicCell, Plate, Servo, Wall, shapes
from tests.particles.scenes import ALL, hexagonal_lattice

L = 1.0
GRIP = LiChu(1e7, 5e6, 1e5, 1e2, 200.0, 200.0, 1e2, 0.0, 0.4, 0.1, 1e-3)


def line(*points):
    """Polyline through points (x, y)."""
    return shapes.polyline(points)


FLOORS = {
    "plane": lambda: shapes.plane((0.2, 0.0), (0.0, 1.0)),
    "line from face to face": lambda: line((0.0, 0.0), (L, 0.0)),
    "line in pieces": lambda: line((-0.35, 0.0), (0.1, 0.0), (0.3, 0.0), (0.65, 0.0)),
    "line over its images": lambda: line((-0.3, 0.0), (0.4, 0.0), (L + 0.25, 0.0)),
    "line from right to left": lambda: line((L, 0.0), (0.0, 0.0)),
    "block from face to face": lambda: shapes.box((0.0, -0.3), (L, 0.0)),
    "block over its images": lambda: shapes.box((-0.2, -0.3), (L + 0.1, 0.0)),
}


def square(low, high, cuts):
    """Flat triangles at z = 0 over a square with a grid of `cuts` x `cuts` cells."""
    s = np.linspace(low, high, cuts + 1)
    x, y = np.meshgrid(s, s, indexing="ij")
    vertices = np.column_stack([x.ravel(), y.ravel(), 0.0 * x.ravel()])
    a = (np.arange(cuts)[:, None] * (cuts + 1) + np.arange(cuts)).ravel()
    b, c, d = a + cuts + 1, a + cuts + 2, a + 1
    return shapes.mesh(vertices, np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])]))


SPACE_FLOORS = {
    "plane": lambda: shapes.plane((0.2, 0.0, 0.0), (0.0, 0.0, 1.0)),
    "square": lambda: square(0.0, L, 1),
    "squares": lambda: square(-0.37, L - 0.37, 3),
    "squares over their images": lambda: square(-0.2, L + 0.15, 2),
    "block": lambda: shapes.box((0.0, 0.0, -0.3), (L, L, 0.0)),
}
CASES = [(2, name) for name in FLOORS] + [(3, name) for name in SPACE_FLOORS]
every_floor = pytest.mark.parametrize("axes, name", CASES, ids=[f"{axes}D {name}" for axes, name in CASES])


def cell_of(axes):
    return PeriodicCell([L] * axes, [True] * (axes - 1) + [False])


@every_floor
def test_a_flat_floor_gives_one_contact_everywhere(axes, name):
    """On faces of the cell, seams, overlaps, beyond the cell: normal force k delta straight up, and no other contact."""
    floor = (FLOORS if axes == 2 else SPACE_FLOORS)[name]()
    for x in (-1.7, -0.04, -1e-9, 0.0, 0.003, 0.1, 0.32, 0.65, 0.99, 1.0, 1.02, 1.2501, 5.3):
        place = [x, 0.049] if axes == 2 else [x, 0.6 * x + 0.01, 0.049]
        soil = Assembly([place], 0.05, law=LiChu(1e7), cell=cell_of(axes))
        soil.add_wall(Wall(floor))
        found = soil.contacts(walls=True)
        assert found.first.size == 1, (x, found)
        np.testing.assert_allclose(found.force[0], [0.0] * (axes - 1) + [1e4], rtol=1e-9, atol=1e-3)


def thrown(axes, floor, cell):
    """A spinning particle thrown onto a floor."""
    place = [0.3, 0.06] if axes == 2 else [0.3, 0.85, 0.06]
    soil = Assembly([place], 0.05, law=GRIP, cell=cell)
    soil.add_wall(wall := Wall(floor))
    soil.velocities = [[6.0, -1.0, 30.0]] if axes == 2 else [[6.0, 1.7, -1.0, 10.0, 30.0, -20.0]]
    return soil, wall


@every_floor
def test_a_particle_bounces_along_through_the_faces_as_on_an_endless_floor(axes, name):
    """Friction, rolling, spin, gravity: motion, momentum and energy as over a plane without a cell, whatever the floor is made of."""
    down = [0.0] * (axes - 1) + [-30.0]
    plain, _ = thrown(axes, (FLOORS if axes == 2 else SPACE_FLOORS)["plane"](), None)
    soil, wall = thrown(axes, (FLOORS if axes == 2 else SPACE_FLOORS)[name](), cell_of(axes))
    before = soil.masses[0] * soil.velocities[0, :axes]
    for each in (plain, soil):
        each.advance(20000, 2e-5, gravity=down)
    assert soil.displacements[0, 0] > 0.8 and soil.energies()["friction_sliding"] > 0.0
    np.testing.assert_allclose(soil.displacements, plain.displacements, rtol=1e-7, atol=1e-9)
    for term, value in plain.energies().items():
        assert soil.energies()[term] == pytest.approx(value, rel=1e-5, abs=1e-6), term
    assert abs(soil.energy_balance()) < 2e-3 * soil.energies()["imposed"]
    change = soil.masses[0] * (soil.velocities[0, :axes] - np.array(down) * 0.4) - before
    wall.record = 1  # impulse by rows: central differences keep it to rounding
    first = wall.force[:axes]
    start = soil.masses[0] * soil.velocities[0, :axes]
    soil.advance(5000, 2e-5, gravity=down)
    forces = np.vstack([first, wall.history.force])
    impulse = -2e-5 * (0.5 * (forces[1:] + forces[:-1])).sum(axis=0)
    gained = soil.masses[0] * (soil.velocities[0, :axes] - np.array(down) * 0.1) - start
    np.testing.assert_allclose(impulse, gained, atol=1e-9 * np.abs(forces).sum() * 2e-5 + 1e-11)
    assert np.abs(change[:-1]).max() > 0.1


@pytest.mark.parametrize("move", [0.0, 0.37, -0.5, 2.9])
def test_a_bumpy_floor_and_an_obstacle_do_not_depend_on_where_the_cell_is_cut(move):
    """Valleys (two contacts) and ridges (one) on the face of the cell and inside, a block that reaches across it."""
    found = []
    for shift in (0.0, move):
        ridge = line((0.0 + shift, 0.0), (0.3 + shift, 0.12), (0.55 + shift, 0.02), (1.0 + shift, 0.0))
        places = np.array([[0.02, 0.06], [0.3, 0.165], [0.55, 0.075], [0.8, 0.4], [0.45, 0.3], [0.98, 0.2]]) + [shift, 0.0]
        soil = Assembly(places, 0.05, law=GRIP, cell=cell_of(2))
        block = Wall(shapes.box((0.6 + shift, 0.2), (0.75 + shift, 0.3)), spin=1.0, velocity=(0.3, 0.0))
        soil.add_wall(Wall(ridge), block)
        soil.velocities = np.random.default_rng(2).normal(size=(6, 3)) * [1.0, 0.5, 10.0]
        touching = soil.contacts(walls=True).first
        soil.advance(4000, 2e-5, gravity=(0.0, -9.81))
        found.append((touching, soil.displacements, block.force, soil.critical_step(), soil.energy_balance()))
    (one, moved, force, step, balance), (two, moved_two, force_two, step_two, balance_two) = found
    np.testing.assert_array_equal(np.sort(one), np.sort(two))
    np.testing.assert_allclose(moved_two, moved, atol=1e-7)
    np.testing.assert_allclose(force_two, force, atol=1e-2 + 1e-4 * np.abs(force).max())
    assert abs(balance) < 0.05 and balance_two == pytest.approx(balance, abs=1e-3)


def test_couette_flow_of_rolling_discs():
    """One layer between plates that go opposite ways: centres at rest, spin -U / d, no friction any more once they roll."""
    u, k = 2.0, 1e7
    places = [[0.1 + 0.2 * i, 0.0] for i in range(5)]
    soil = Assembly(places, 0.05, law=LiChu(k, 5e6, normal_damping=500.0, sliding_damping=500.0, sliding_friction=0.4), cell=cell_of(2))
    height = 0.0499
    floor = Wall(line((-0.1, -height), (L + 0.1, -height)), velocity=(-u, 0.0), name="floor")
    lid = Plate.rectangle((0.0, height), (L, 0.2), velocity=(u, 0.0), name="lid")
    soil.add_wall(floor, lid)
    soil.advance(12000, 2e-5)
    np.testing.assert_allclose(soil.velocities, np.tile([0.0, 0.0, -u / height], (5, 1)), rtol=1e-4, atol=1e-7)
    np.testing.assert_allclose(soil.displacements[:, :2], 0.0, atol=1e-9)
    np.testing.assert_allclose(lid.force[:2], [0.0, 5 * k * 1e-4], rtol=1e-6, atol=1.0)
    terms = soil.energies()
    # of what the plates give half goes into the spins, half into sliding: I w^2 / 2 each
    kinetic = 5 * 0.5 * soil.inertias[0] * (u / height) ** 2
    assert terms["kinetic"] == pytest.approx(kinetic, rel=1e-3)
    assert terms["wall_work"] == pytest.approx(2 * kinetic, rel=2e-2)
    assert terms["friction_sliding"] + terms["viscous"] == pytest.approx(kinetic, rel=4e-2)
    assert abs(soil.energy_balance()) < 1e-2 * kinetic
    soil.advance(18000, 2e-5)  # until the plates have gone once round the cell: nothing changes
    assert lid.displacement[0] > L
    np.testing.assert_allclose(soil.velocities[:, 2], -u / height, rtol=1e-4)


@pytest.mark.parametrize("axes", [2, 3])
def test_shear_cell(axes):
    """A layer between a floor and a servo-driven lid that moves: forces balance, energy closes, any cut gives the same motion."""
    rng = np.random.default_rng(1)
    if axes == 2:
        lattice = hexagonal_lattice(10, 5, 0.05)
        radii = rng.uniform(0.0490, 0.0502, len(lattice))
    else:
        lattice = 0.1 * np.stack(np.meshgrid(np.arange(5), np.arange(5), np.arange(3), indexing="ij"), axis=-1).reshape(-1, 3)
        radii = rng.uniform(0.0490, 0.0502, len(lattice))
    size = [L, L] if axes == 2 else [0.5, 0.5, 1.0]
    up, along = np.eye(axes)[-1], np.eye(axes)[0]
    top = lattice[:, -1].max()
    found = []
    for shift in (0.0, 0.23):
        places = lattice + shift * (1.0 - up)
        soil = Assembly(places, radii, law=GRIP, cell=PeriodicCell(size, [True] * (axes - 1) + [False]))
        floor = Wall(shapes.plane(-0.0498 * up, up))
        lid = Wall(
            shapes.plane((top + 0.0498) * up, -up), velocity=0.3 * along,
            motion=Servo({"y" if axes == 2 else "z": -2e3}, fastest=0.05),
        )  # fmt: skip
        soil.add_wall(floor, lid)
        soil.advance(1000, 1e-5)
        start, before = soil.displacements, soil.masses @ soil.velocities[:, :axes]
        floor.record = lid.record = 1
        first = floor.force[:axes] + lid.force[:axes]
        soil.advance(200, 1e-5)
        both = np.vstack([first, floor.history.force + lid.history.force])
        impulse = -1e-5 * (0.5 * (both[1:] + both[:-1])).sum(axis=0)
        gained = soil.masses @ soil.velocities[:, :axes] - before
        np.testing.assert_allclose(impulse, gained, atol=1e-10 * np.abs(both).sum() * 1e-5 + 1e-12)
        found.append((start, soil.displacements, soil.cell_stress(), lid.force[:axes], soil.energies()))
        terms = soil.energies()
        turned_over = abs(terms["wall_work"]) + terms["imposed"] + terms["viscous"] + terms["kinetic"]
        assert abs(soil.energy_balance()) < 0.02 * turned_over, terms
    for one, two in zip(found[0][:4], found[1][:4]):
        np.testing.assert_allclose(two, one, atol=1e-6 * np.abs(one).max())
    force = found[0][3]
    assert force[0] < -10.0 < 10.0 < force[-1], force  # dragged back and pressed up


def test_cell_stretches_between_smooth_planes():
    """Uniaxial strain of a square lattice: sigma_xx = -k delta / (2 r), floor and lid carry their own share; energy closes."""
    soil = Assembly([[0.05 + 0.1 * i, 0.05 + 0.1 * j] for i in range(10) for j in range(3)], 0.05, law=LiChu(1e7), cell=cell_of(2))
    floor, lid = Wall(shapes.plane((0, 0), (0, 1)), frictionless=True), Wall(shapes.plane((0, 0.3), (0, -1)), frictionless=True)
    soil.add_wall(floor, lid)
    soil.deform([[-0.5, 0.0], [0.0, 0.0]])
    soil.advance(1000, 2e-6)
    assert np.abs(soil.positions[:, 1] - soil.reference[:, 1]).max() < 1e-12
    strain = 1.0 - soil.cell.matrix[0, 0]
    assert strain == pytest.approx(1e-3, rel=1e-2)
    # rows of ten between 0.3 m of walls: three contacts of overlap 0.1 strain across any section of the cell's 1 m
    assert soil.cell_stress()[0, 0] == pytest.approx(-1e7 * 0.1 * strain * 3 / 1.0, rel=2e-2)
    assert abs(soil.energy_balance()) < 1e-3 * soil.energies()["cell_work"]
    assert lid.force[1] == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize(
    "call, message",
    [
        (lambda soil: soil.add_wall(Wall(shapes.plane((0, 0), (1, 1)))), "must be parallel to the edges that repeat"),
        (lambda soil: soil.add_wall(Wall(shapes.plane((0, 0), (0, 1)), spin=1.0)), "must not turn"),
        (lambda soil: soil.add_wall(Wall(shapes.plane((0, 0), (0, 1)), motion=Free(1.0, 1.0))), "must not turn"),
    ],
)
def test_walls_that_do_not_repeat_are_named(call, message):
    soil = Assembly([[0.5, 0.5]], 0.05, law=ALL, cell=cell_of(2))
    with pytest.raises(ValueError, match=message):
        call(soil)
    assert soil.plates == []
    soil.advance(1, 1e-6)


def test_rigid_walls_in_a_deforming_cell_are_named():
    for wall in (Wall(shapes.plane((0, 0), (0, 1)), name="floor"), Wall(line((0, 0), (L, 0)), frictionless=True, name="floor")):
        soil = Assembly([[0.5, 0.5]], 0.05, law=ALL, cell=cell_of(2))
        soil.add_wall(wall)
        with pytest.raises(ValueError, match="velocity_gradient does not go with floor: a rigid wall in a deforming cell"):
            soil.deform([[0.1, 0.0], [0.0, 0.0]])
        soil.deform(np.zeros((2, 2)))
    soil = Assembly([[0.5, 0.5]], 0.05, law=ALL, cell=cell_of(2))
    soil.deform([[0.1, 0.0], [0.0, 0.0]])
    with pytest.raises(ValueError, match="velocity_gradient does not go with wall"):
        soil.add_wall(Wall(shapes.plane((0, 0), (0, 1))))
