"""Walls that move: rolling on slopes and turntables, objectivity, reactions, servo, free bodies, energy."""

import numpy as np
import pytest

from particles import Assembly, Free, LiChu, Plate, Servo, Wall, room, shapes
from tests.particles.scenes import hexagonal_lattice

GRIP = LiChu(1e7, 5e6, 1e5, 1e2, 800.0, 800.0, 1e2, 0.0, 0.4, 0.1, 1e-3)


@pytest.mark.parametrize("slope, friction, sticks", [(0.3, 0.5, True), (0.8, 0.2, False)])
def test_sphere_on_a_slope_rolls_or_slides(slope, friction, sticks):
    """Rolling: a = 5/7 g sin(slope) while tan(slope) < 7/2 mu; else g (sin - mu cos) and spin 5/2 mu g cos / r."""
    law = LiChu(1e7, 5e6, normal_damping=800.0, sliding_damping=800.0, sliding_friction=friction)
    soil = Assembly([[0.0, 0.0, 0.05]], 0.05, law=law)
    soil.add_wall(Wall(shapes.plane((0, 0, 0), (-np.sin(slope), 0, np.cos(slope)))))
    along = np.array([np.cos(slope), 0.0, np.sin(slope)])
    soil.displacements = [[*(np.array([-np.sin(slope), 0, np.cos(slope)]) * 0.05 - [0, 0, 0.05]), 0, 0, 0]]
    soil.advance(1000, 1e-4, gravity=(0, 0, -9.81))
    before = soil.velocities[0]
    soil.advance(2000, 1e-4, gravity=(0, 0, -9.81))
    rate = (soil.velocities[0] - before) / 0.2
    down = -9.81 * np.sin(slope), 9.81 * np.cos(slope)
    expected = (5 / 7 * down[0], -5 / 7 * down[0] / 0.05) if sticks else (down[0] + friction * down[1], 2.5 * friction * down[1] / 0.05)
    # the lever arm is shorter than the radius by the overlap m g / k = 1e-6 m; springs ring a little
    assert (rate[:3] @ along, -rate[4]) == pytest.approx(expected, rel=2e-3)


def test_sphere_on_a_turntable_runs_in_circles_at_two_sevenths_of_its_spin():
    """Rolling without slip on a turning plane: the centre turns with 2/7 of the plane's spin, anywhere, at any speed."""
    law = LiChu(1e7, 5e6, sliding_friction=5.0, normal_damping=800.0, sliding_damping=800.0)
    soil = Assembly([[0.3, 0.0, 0.05]], 0.05, law=law)
    table = Wall(shapes.plane((0, 0, 0), (0, 0, 1)), spin=(0, 0, 7.0))
    soil.add_wall(table)
    # rolling: v = W x p + r w x e_z at the contact p; here w about x only so that the centre rests at the start
    soil.velocities = [[0.0, 0.1, 0.0, (7.0 * 0.3 - 0.1) / 0.05, 0.0, 0.0]]
    soil.advance(500, 1e-4, gravity=(0, 0, -9.81))
    start = soil.velocities[0, :2]
    soil.advance(4000, 1e-4, gravity=(0, 0, -9.81))
    turned = np.arctan2(*soil.velocities[0, 1::-1]) - np.arctan2(*start[::-1])
    assert turned == pytest.approx(2 / 7 * 7.0 * 0.4, rel=2e-3)
    assert np.linalg.norm(soil.velocities[0, :2]) == pytest.approx(np.linalg.norm(start), rel=2e-3)
    # the rotation matrix is exact for a constant axis
    np.testing.assert_allclose(table.rotation[:2, 0], [np.cos(7 * 0.45), np.sin(7 * 0.45)], rtol=1e-10)


def test_disc_in_a_turning_drum_spins_with_the_drum():
    """No slip inside a drum: spin of the disc r = spin of the drum times its radius; friction brings it there."""
    angle = 2 * np.pi * np.arange(720) / 720
    drum = Wall(shapes.polyline(np.column_stack([np.cos(angle), np.sin(angle)]), closed=True), spin=0.5, centre=(0, 0))
    law = LiChu(1e7, 5e6, sliding_friction=0.5, normal_damping=5e3, sliding_damping=5e3)
    soil = Assembly([[0.0, -0.9]], 0.1, law=law)
    soil.add_wall(drum)
    soil.advance(40000, 1e-4, gravity=(0, -9.81), mass_damping=0.5)
    # damping (0.5/s) lets it lag; corners of 0.5 degrees shake it: some per cent
    assert soil.velocities[0, 2] == pytest.approx(0.5 / 0.1, rel=0.05)
    assert np.hypot(*soil.positions[0]) == pytest.approx(0.9, abs=1e-4)


@pytest.mark.parametrize("axes, place", [(2, (0.3, 0.0495)), (2, (1.03, 0.038)), (3, (0.3, 0.2, 0.0495)), (3, (0.5, 1.03, 0.038))])
@pytest.mark.parametrize("turn", [1e-5, 0.05, 0.8])
def test_rigid_rotation_of_wall_and_particle_causes_no_tangential_force(axes, place, turn):
    """Faces, edges and corners, any angle in one step (the series of tan is good to 1e-13 up to 1 rad)."""
    law = LiChu(1e8, 5e7, 1e6, 1e3, sliding_friction=1e9, rolling_friction=1e9, moment_friction=1e9)
    soil = Assembly([place], 0.05, law=law)
    axis = np.array([0, 0, 1.0]) if axes == 2 else np.array([0.48, -0.6, 0.64])
    bounds = (0,) * (axes - 1) + (-1,), (1,) * (axes - 1) + (0,)
    centre = np.array(place) + 0.017  # so near that the particle moves by less than its radius
    box = Wall(shapes.box(*bounds), spin=turn if axes == 2 else turn * axis, centre=centre)
    soil.add_wall(box)
    soil.advance(1, 1e-12)
    push = soil.contacts(walls=True).push[0]
    about = np.cross(axis, np.eye(3)).T  # the matrix of axis x
    rotation = (np.eye(3) + np.sin(turn) * about + (1 - np.cos(turn)) * about @ about)[:axes, :axes]
    arm = soil.positions[0] - box.centre
    soil.hold([0])
    soil.velocities = [[*(rotation @ arm - arm), *np.atleast_1d(box.spin)]]
    soil.advance(1, 1.0)
    found = soil.contacts(walls=True)
    np.testing.assert_allclose(np.linalg.norm(found.force[0]), push, rtol=1e-9)
    assert max(np.abs(values).max() for values in found.history.values()) < 1e-8 * push
    np.testing.assert_allclose(box.force[:axes], -found.force[0], rtol=1e-9, atol=1e-9 * push)


def test_action_and_reaction_in_space_including_moments():
    """Particle and turning wall: total force and total moment about the origin vanish, on faces, edges, corners."""
    for place in ([0.3, 0.2, 0.0495], [0.5, 1.03, 0.038], [1.028, 1.028, 0.028]):
        soil = Assembly([place], 0.05, law=GRIP)
        box = Wall(shapes.box((0, 0, -1), (1, 1, 0)), velocity=(0.5, 0.1, 0.2), spin=(1, -2, 3))
        soil.add_wall(box)
        soil.velocities = [[1.0, -0.5, -0.3, 30.0, 10.0, -5.0]]
        soil.advance(20, 1e-6)
        force, reaction = soil.forces[0], box.force
        assert np.abs(force).min() > 0
        np.testing.assert_allclose(force[:3], -reaction[:3], rtol=1e-12)
        total = force[3:] + np.cross(soil.positions[0], force[:3]) + reaction[3:] + np.cross(box.centre, reaction[:3])
        np.testing.assert_allclose(total, 0.0, atol=1e-11 * np.abs(force).max())


def test_walls_of_one_body_move_together_and_share_the_reaction():
    whole = Wall(shapes.polygon([(0, 0), (1, 0), (1, 0.5), (0.5, 0.5), (0.5, 1), (0, 1)]), spin=2.0, centre=(2, 1))
    low = Wall(shapes.box((0, 0), (1, 0.5)), spin=2.0, centre=(2, 1), name="base")
    high = Wall(shapes.box((0, 0), (0.5, 1)), fixed_to=low)
    results = []
    for walls in ([whole], [low, high]):
        soil = Assembly([[0.549, 0.548]], 0.05, law=GRIP)
        soil.add_wall(*walls)
        soil.advance(50, 1e-5)
        results.append((soil.displacements, sum(wall.force for wall in walls), sum(wall.work for wall in walls)))
    for one, other in zip(*results):
        np.testing.assert_allclose(other, one, rtol=1e-10)
    assert high.displacement == pytest.approx(low.displacement) and high.rotation == pytest.approx(low.rotation)
    with pytest.raises(ValueError, match="spin of wall is that of base, to which it is fixed"):
        Wall(shapes.box((0, 0), (1, 1)), spin=1.0, fixed_to=low)


@pytest.mark.parametrize("axes", [2, 3])
def test_servo_reaches_its_stress(axes):
    """Four particles on a floor under a lid of 0.04 m2 (0.2 m in the plane): 50 kPa; all of it goes through to the floor."""
    places = np.array([[x, y, 0.05] for x in (0.05, 0.15) for y in (0.05, 0.15)]) if axes == 3 else np.array(
        [[0.05, 0.05], [0.15, 0.05], [0.05, 0.15], [0.15, 0.15]]
    )  # fmt: skip
    soil = Assembly(places, 0.05, law=GRIP)
    up, top = np.eye(axes)[-1], (0.1 if axes == 3 else 0.2)
    area = 0.04 if axes == 3 else 0.2
    floor = Wall(shapes.plane(np.zeros(axes), up))
    lid = Wall(shapes.plane((top + 1e-3) * up, -up), motion=Servo.confining("-z" if axes == 3 else "-y", 5e4, area, fastest=0.05))
    soil.add_wall(floor, lid)
    soil.advance(8000, 2e-5, mass_damping=200.0)
    np.testing.assert_allclose(lid.force[axes - 1], 5e4 * area, rtol=1e-3)
    np.testing.assert_allclose(floor.force[axes - 1], -5e4 * area, rtol=1e-3)
    assert lid.displacement[-1] < -1e-3
    terms = soil.energies()
    assert lid.work == pytest.approx(terms["wall_work"])
    # servo velocities change from step to step while the gap closes; the rest is of second order
    assert abs(soil.energy_balance()) < 2e-3 * terms["wall_work"]


@pytest.mark.parametrize("axes", [2, 3])
def test_free_plate_falls_on_particles_and_comes_to_rest(axes):
    """Free fall to rounding at first; at rest the particles carry its weight, and the energy is all accounted for."""
    places = np.array([[x, y, 0.05] for x in (0.0, 0.6) for y in (0.0, 0.5)]) if axes == 3 else np.array([[0, 0.05], [0.6, 0.05]])
    soil = Assembly(places, 0.05, law=GRIP)
    g = -9.81 * np.eye(axes)[-1]
    corners = ((-0.2,) * (axes - 1) + (0.11,), (0.8,) * (axes - 1) + (0.15,))
    plate = Wall(shapes.box(*corners), motion=Free(mass=50.0, inertia=5.0, load={"x": 0.5}))
    floor = Wall(shapes.plane(np.zeros(axes), np.eye(axes)[-1]))
    soil.add_wall(floor, plate)
    soil.advance(400, 5e-5, gravity=g)
    assert plate.displacement[-1] == pytest.approx(-0.5 * 9.81 * 0.02**2, rel=1e-9)
    soil.advance(400, 5e-5, gravity=g)
    terms = soil.energies()
    assert terms["kinetic_walls"] > 1.0
    for _ in range(3):
        soil.advance(10000, 5e-5, gravity=g, mass_damping=2.0)
    assert np.abs(plate.velocity[-1]) < 1e-3 and plate.centre[-1] == pytest.approx(0.12, abs=1e-3)
    # what is left of the bouncing, 1e-4 m/s times sqrt(k m), is some per cent of the weight
    assert plate.force[axes - 1] == pytest.approx(50.0 * 9.81, rel=5e-2)
    assert floor.force[axes - 1] == pytest.approx(-(50.0 + soil.masses.sum()) * 9.81, rel=5e-2)
    terms = soil.energies()
    assert terms["wall_work"] == pytest.approx(50.0 * g @ plate.displacement + 0.5 * plate.displacement[0], rel=1e-6)
    # of second order: 2.3e-2 J with this step, 6e-3 J with half of it, 1.4e-3 J with a quarter
    assert abs(soil.energy_balance()) < 1e-2 * terms["wall_work"]


def test_free_wall_and_particles_conserve_momentum():
    """A tool flies into a heap: linear and angular momentum to rounding, with friction and spin."""

    def change(steps):
        soil = Assembly(hexagonal_lattice(4, 4), 0.05, law=GRIP)
        tool = Wall(shapes.polygon([(-0.6, 0.0), (-0.06, 0.1), (-0.6, 0.3)]), (2.0, 0.3), 1.0, motion=Free(20.0, 0.8))
        soil.add_wall(tool)

        def momentum():
            velocities, positions, masses = soil.velocities, soil.positions, soil.masses
            arm = masses * (positions[:, 0] * velocities[:, 1] - positions[:, 1] * velocities[:, 0])
            own = 20.0 * (tool.centre[0] * tool.velocity[1] - tool.centre[1] * tool.velocity[0]) + 0.8 * tool.spin
            linear = (masses[:, None] * velocities[:, :2]).sum(axis=0) + 20.0 * tool.velocity
            return np.array([*linear, (arm + soil.inertias * velocities[:, 2]).sum() + own])

        before = momentum()
        soil.advance(steps, 0.06 / steps)
        assert abs(tool.spin - 1.0) > 0.1
        return np.abs(momentum() - before) / 40.0, abs(soil.energy_balance()), soil.energies()

    moved, balance, terms = change(6000)
    assert moved.max() < 1e-12 and terms["kinetic_walls"] < 0.95 * terms["imposed"]
    assert balance < 1e-3 * terms["imposed"]


def test_free_body_spins_by_eulers_equations():
    """No torque: energy and angular momentum stay, with errors that fall with the square of the step."""
    inertia = np.array([[2.0, 0.1, 0.0], [0.1, 1.0, 0.2], [0.0, 0.2, 1.5]])

    def errors(steps):
        soil = Assembly([[9.0, 9.0, 9.0]], 0.05, law=GRIP)
        body = Wall(shapes.box((0, 0, 0), (1, 1, 1)), spin=(3.0, 0.1, 1.0), motion=Free(1.0, inertia))
        soil.add_wall(body)
        start = soil.energies()["kinetic_walls"], inertia @ body.spin
        soil.advance(steps, 2.0 / steps)
        now = body.rotation @ inertia @ body.rotation.T @ body.spin
        assert np.abs(body.rotation - np.eye(3)).max() > 0.2
        return np.array([abs(soil.energies()["kinetic_walls"] - start[0]), np.linalg.norm(now - start[1])])

    rates = np.log2(errors(200) / errors(400))
    assert (rates > 1.8).all(), f"rates {rates}"


@pytest.mark.parametrize("axes", [2, 3])
def test_energy_audit_with_turning_and_free_walls_falls_with_the_square_of_the_step(axes):
    """Particles in a box with an oscillating, turning paddle and a free block; friction and dashpots."""
    rng = np.random.default_rng(4)
    grid = np.stack(np.meshgrid(*[np.arange(3 if axes == 3 else 5)] * axes), axis=-1).reshape(-1, axes)
    places = 0.1 * grid + rng.uniform(-1e-3, 1e-3, grid.shape)
    side = 0.1 * grid.max() + 0.05

    def imbalance(steps):
        soil = Assembly(places, 0.0499, law=GRIP)
        soil.velocities = np.random.default_rng(5).normal(size=(len(places), soil.freedoms)) * 0.3
        paddle = (shapes.box((0.5 * side - 0.02, side + 0.01), (0.5 * side, side + 0.3)) if axes == 2 else
                  shapes.box((0.5 * side - 0.02, 0, side + 0.01), (0.5 * side, 0.2, side + 0.3)))  # fmt: skip
        down = np.eye(axes)[-1]
        turn = (lambda t: 5.0 * np.cos(200 * t)) if axes == 2 else (lambda t: (0, 5.0 * np.cos(200 * t), 1.0))
        moving = Wall(paddle, velocity=lambda t: -(2.0 + np.sin(300 * t)) * down, spin=turn)
        block = Wall(shapes.box((-0.3,) + (-0.05,) * (axes - 1), (-0.052,) + (side,) * (axes - 1)),
                     velocity=(1.0,) + (0.0,) * (axes - 1), motion=Free(20.0, 1.0, damping=5.0))  # fmt: skip
        soil.add_wall(moving, block, *room((-0.5,) + (-0.05,) * (axes - 1), (side + 0.05, *(side * 9,) * (axes - 1))))
        soil.advance(steps, 0.02 / steps, gravity=-9.81 * down)
        return abs(soil.energy_balance()), soil.energies(), moving.work, block

    steps = np.array([200, 400, 800, 1600])
    errors = []
    for count in steps:
        error, terms, work, block = imbalance(count)
        errors.append(error)
    total = terms["imposed"] + abs(terms["wall_work"])
    assert abs(work) > 1e-2 * total and abs(np.asarray(block.spin)).max() > 1e-3
    for name in ("friction_sliding", "viscous"):
        assert terms[name] > 1e-4 * total, f"{name} does not happen in this scene"
    assert errors[-1] < 1e-3 * total
    # contacts open and close at random within a step, so that single errors scatter
    rate = -np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert rate > 1.6, f"observed rate {rate:.2f} from {errors}"


def test_wall_force_and_motion_survive_new_lists():
    """A plane that turns far: the list follows it and the disc is pushed along, never lost."""
    soil = Assembly([[0.5, 0.051]], 0.05, law=GRIP)
    soil.add_wall(Plate.rectangle((-1, -0.1), (1, 0), spin=3.0, centre=(0, 0)))
    soil.advance(2000, 1e-4)
    place = soil.positions[0]
    normal = np.array([-np.sin(0.6), np.cos(0.6)])
    assert place @ normal > 0.0499 and soil.rebuilds > 3
