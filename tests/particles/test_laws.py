"""One battery of properties for every contact law, on discs and on spheres; then closed forms of single laws.

Laws of one structure (the same channels, dashpots present or absent) share compiled code: laws that lack a dashpot in a
test have one that is too weak to matter. No scene has plates or loads, which would be compiled anew.
"""

from dataclasses import dataclass, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from particles import Assembly, LiChu
from particles.laws import Bonded, HertzMindlin, Response, UserLaw, kernel, linear_sliding
from particles.laws.touch import Channel, carried, limited
from particles.network import contacts, evaluate, stored
from particles.vectors import scaled
from tests.particles import naive
from tests.particles.scenes import BEAM, BONDED, WEAK, hexagonal_lattice, trial

ENDLESS = 1e6  # a friction coefficient that no contact reaches

LI_CHU = LiChu(
    1e7, 5e6, 2e6, 1e3, 500.0, 300.0, 200.0, 0.1, 0.5, 0.1, 1e-3,
    torsion_stiffness=2e3, torsion_damping=0.1, torsion_friction=1e-3,
)  # fmt: skip
LINEAR = linear_sliding(1e7, 5e6, 0.5, 500.0, 300.0)
HERTZ = HertzMindlin(5e9, 0.25, friction=0.4, restitution=0.7, rolling_friction=0.1, rolling_stiffness=0.5)


class Stiffening(NamedTuple):
    """Constants of a law of our own: k d + c d^3 in compression, a sliding spring with a limit."""

    linear: float
    cubic: float
    sliding: float
    friction: float


@kernel
def stiffening(constants, touch, history):
    overlap = max(touch.overlap, 0.0)
    push = constants.linear * overlap + constants.cubic * overlap**3
    spring = Channel(constants.sliding, constants.friction, None)
    kept, shear, work, _, lost = limited(
        spring, carried(touch.turn, history), touch.slide, touch.slide_rate, push, touch.overlap > 0.0
    )
    return Response(push, shear, scaled(0.0, touch.roll), kept, (work, 0.0, 0.0, 0.0, lost, 0.0))


@cache
def own_law(axes, friction=0.5):
    """The law of our own; the shear is a vector that changes sign with the labels in space, a number that does not in 2D."""
    linear, cubic, sliding = 1e7, 1e14, 5e6

    def energy(overlap, history):
        d = np.maximum(overlap, 0.0)
        return 0.5 * linear * d**2 + 0.25 * cubic * d**4 + 0.5 * (history["shear"] ** 2).sum(axis=1) / sliding

    return UserLaw(
        stiffening, Stiffening(linear, cubic, sliding, friction), [("shear", -1.0)] * 3 if axes == 3 else [("shear", 1.0)],
        stiffness=lambda d: (linear + 3 * cubic * np.maximum(d, 0.0) ** 2, sliding, 0.0), stored=energy,
    )  # fmt: skip


@dataclass(frozen=True)
class Case:
    """A law with discs (axes 2) or spheres (3), and whether its contacts are bonded at the start."""

    name: str
    axes: int
    law: Any
    endless: Any  # the same law below all its limits
    bonded: bool = False


CASES = [
    case
    for axes in (2, 3)
    for case in [
        Case("Li-Chu", axes, LI_CHU, replace(
            LI_CHU, sliding_friction=ENDLESS, rolling_friction=ENDLESS, moment_friction=ENDLESS, torsion_friction=ENDLESS)),
        Case("linear sliding", axes, LINEAR, replace(LINEAR, sliding_friction=ENDLESS)),
        Case("contact of bonded", axes, BONDED, replace(BONDED, friction=ENDLESS)),
        Case("bonded", axes, BONDED, BONDED, True),
        Case("breaking", axes, replace(BONDED, tensile_strength=300.0, shear_strength=200.0), BONDED, True),
        Case("beam", axes, BEAM, BEAM, True),
        Case("breaking beam", axes, replace(
            BEAM, tensile_strength=300.0, shear_strength=200.0, bending_strength=3.0, torsion_strength=2.0), BEAM, True),
        Case("own law", axes, own_law(axes), own_law(axes, ENDLESS)),
    ]
] + [Case("Hertz-Mindlin", 3, HERTZ, replace(HERTZ, friction=ENDLESS, rolling_friction=ENDLESS))]  # fmt: skip
every_law = pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.name}, {'discs' if case.axes == 2 else 'spheres'}")


def assembly(case, positions, radii, law=None):
    """Particles with the law of a case; those of a bond law always with a log of breaks, bonded where the case says so."""
    soil = Assembly(positions, radii, 2600.0, law or case.law)
    if isinstance(soil.laws[0, 0], Bonded):
        soil.bond(0.02, None if case.bonded else np.zeros((0, 2)))
    return soil


def cloud(case, law=None, frame=None, count=14):
    """Unequal particles, nearly touching, that rush together and spin; `frame` (d, d) turns or mirrors the scene."""
    rng, axes = np.random.default_rng(5), case.axes
    lattice = hexagonal_lattice(4, 4, 0.046)
    if axes == 3:
        layers = np.array([[0.0, 0.0, 0.0], [0.046, 0.046 / np.sqrt(3), 0.046 * np.sqrt(8 / 3)]])
        lattice = (np.column_stack([hexagonal_lattice(3, 3, 0.046), np.zeros(9)]) + layers[:, None]).reshape(-1, 3)
    places = lattice[:count] + rng.uniform(-4e-4, 4e-4, (count, axes))
    radii = rng.uniform(0.0445, 0.0465, count)
    inwards = -6.0 * (places - places.mean(axis=0)) + 0.2 * rng.normal(size=places.shape)
    spins = 8.0 * rng.normal(size=(count, 1 if axes == 2 else 3))
    if frame is not None:
        places, inwards = places @ frame.T, inwards @ frame.T
        spins = np.linalg.det(frame) * (spins if axes == 2 else spins @ frame.T)
    soil = assembly(case, places, radii, law)
    soil.velocities = np.hstack([inwards, spins])
    return soil


def loaded(case, law=None):
    """The cloud after a while, with all springs loaded and contacts at work."""
    soil = cloud(case, law)
    soil.advance(20, 2e-5)
    return soil


def moments(soil, vectors):
    """Sum of vectors (n, freedoms) = (forces, moments), and of moments about the origin."""
    axes, places = soil.axes, soil.positions
    across = np.cross(places, vectors[:, :axes]).reshape(soil.count, -1)
    return np.concatenate([vectors[:, :axes].sum(axis=0), (across + vectors[:, axes:]).sum(axis=0)])


def inertia(soil):
    """Masses and moments of inertia (n, freedoms)."""
    axes = soil.axes
    return np.column_stack([soil.masses] * axes + [soil.inertias] * (2 * axes - 3))


DISSIPATED = ("friction_sliding", "friction_rolling", "friction_moment", "viscous", "contact_loss", "breaking")


# ------------------------------------------------------------------------------------------------------ the battery


@every_law
def test_linear_and_angular_momentum_are_kept_to_rounding(case):
    """Action and reaction without net moment in every step: sums of m v and of m x v + J w stay."""
    soil = loaded(case)
    forces = soil.forces
    assert np.abs(forces).max() > 10.0
    np.testing.assert_allclose(moments(soil, forces), 0.0, atol=1e-13 * np.abs(forces).sum())
    before, scale = moments(soil, inertia(soil) * soil.velocities), np.abs(inertia(soil) * soil.velocities).sum()
    soil.advance(300, 2e-5)
    np.testing.assert_allclose(moments(soil, inertia(soil) * soil.velocities), before, atol=1e-13 * scale)


@every_law
@pytest.mark.parametrize("angle", [1e-3, 0.3, 1.0])
def test_a_rigid_rotation_in_one_step_turns_the_forces_and_adds_none(case, angle):
    """In space by the rational tangent, whose error (2e-13 of the angle at 1 rad) the sliding spring amplifies."""
    soil = loaded(case)
    still = np.zeros((soil.count, soil.freedoms))
    before = trial(soil, still)
    if case.axes == 2:
        turn = np.array([angle])
        matrix = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        turned = np.hstack([before[:, :2] @ matrix.T, before[:, 2:]])
    else:
        turn = angle * np.array([2.0, -1.0, 2.0]) / 3.0
        matrix = Rotation.from_rotvec(turn).as_matrix()
        turned = np.hstack([before[:, :3] @ matrix.T, before[:, 3:] @ matrix.T])
    places = soil.positions
    after = trial(soil, np.hstack([places @ matrix.T - places, np.broadcast_to(turn, (soil.count, turn.size))]))
    # of slide: rounding of places of 0.2 m, and 2e-14 times the arm of 0.05 m; stiffness 1e7 N/m, a dozen contacts
    np.testing.assert_allclose(after, turned, atol=12 * 1e7 * (0.2 * 4e-16 + 0.05 * 2e-14))
    assert np.abs(before).max() > 10.0


@every_law
def test_exchange_of_labels_exchanges_forces_and_signs_of_what_is_remembered(case):
    """Two particles alone share a cell of the grid, where rows keep the order of ids: i and j are truly exchanged."""
    axes = case.axes
    places = np.array([[0.0, 0.0, 0.0], [0.049, 0.03, 0.055]])[:, :axes]
    radii = np.array([0.05, 0.03]) * np.linalg.norm(places[1]) / 0.08 * (1 + 1e-3)
    motion = np.array([[0.3, -0.2, 0.1, 5.0, -4.0, 2.0], [-0.1, 0.2, -0.3, -6.0, 3.0, 7.0]])[:, [0, 1, 3] if axes == 2 else slice(6)]
    found = []
    for order in ([0, 1], [1, 0]):
        soil = assembly(case, places[order], radii[order])
        soil.velocities = motion[order]
        soil.advance(12, 2e-5)
        system = soil.system
        assert system.start[-1] == 1 and (soil.ids == [0, 1]).all()
        found.append((soil.forces[order], soil.displacements[order], system.history[:, 0]))
    (forces, moved, history), (other_forces, other_moved, other_history) = found
    np.testing.assert_allclose(other_forces, forces, rtol=1e-9, atol=1e-9 * np.abs(forces).max())
    np.testing.assert_allclose(other_moved, moved, rtol=1e-9, atol=1e-15)
    signs = [sign for _, sign in case.law.columns([case.law], axes == 3)]
    np.testing.assert_allclose(other_history, signs * history, rtol=1e-9, atol=1e-9 * np.abs(history).max())
    assert np.abs(forces[:, axes:]).max() > 0.0


@every_law
@pytest.mark.parametrize("kind", ["turned", "mirrored"])
def test_frame_indifference(case, kind):
    """A turned or mirrored scene does the same, turned or mirrored; axial vectors change sign in the mirror."""
    axes = case.axes
    frame = np.array([[0.6, -0.8], [0.8, 0.6]]) if axes == 2 else Rotation.from_rotvec([1.0, -2.0, 0.5]).as_matrix()
    frame = frame if kind == "turned" else frame @ np.diag([-1.0, 1.0, 1.0][:axes])
    plain, other = cloud(case), cloud(case, frame=frame)
    for soil in (plain, other):
        soil.advance(100, 2e-5)
    forces = plain.forces
    across = np.linalg.det(frame) * (forces[:, 2:] if axes == 2 else forces[:, 3:] @ frame.T)
    expected = np.hstack([forces[:, :axes] @ frame.T, across])
    # rounding of the places, 1e-16 m, grows along the way by no more than some powers of ten; k = 1e7 N/m
    np.testing.assert_allclose(other.forces, expected, atol=1e-8 * np.abs(forces).max())


def spent(soil):
    """What contacts have dissipated so far, J."""
    terms = soil.energies()
    return np.array([terms[name] for name in DISSIPATED])


@every_law
def test_below_its_limits_the_force_is_minus_the_gradient_of_the_stored_energy(case):
    """Central differences in random directions, all particles at once.

    Hertz-Mindlin books a loss when the tangential force is rescaled: there stored and booked energy together.
    """
    rng = np.random.default_rng(2)
    forces = trial(still := loaded(case, case.endless), np.zeros((still.count, still.freedoms)))
    for _ in range(3):
        direction = rng.normal(size=forces.shape) * ([1.0] * case.axes + [20.0] * (2 * case.axes - 3))
        energies = []
        for size in (-1e-9, 1e-9):
            soil = loaded(case, case.endless)
            before = spent(soil).sum()
            system, terms = soil.system, soil.terms()
            kinds = [("position", "velocity", "acceleration"), ("rotation", "spin", "angular")][: case.axes - 1]
            for k, (place, motion, change) in enumerate(kinds):
                step = size * direction[soil.ids, 3 * k : 3 * k + 3]
                getattr(system, place)[:, :3] += step
                getattr(system, motion)[:, :3] = step
                getattr(system, change)[:, :3] = -2.0 * step  # no rates at the end of the step
            evaluate(system, terms, 1.0, None, None)
            energies.append(sum(stored(soil, contacts(soil)).values()) + spent(soil).sum() - before)
        slope = (energies[1] - energies[0]) / 2e-9
        # energy of some J known to 1e-15; third derivatives of contacts of 1e-4 m: (1e-9 / 1e-4)^2
        scale = np.linalg.norm(forces) * np.linalg.norm(direction)
        assert slope == pytest.approx(-np.sum(forces * direction), abs=1e-6 * scale)


@every_law
def test_every_booked_dissipation_grows(case):
    """By every piece of the way, to the rounding of the sums."""
    soil = cloud(case)
    terms = [spent(soil)]
    for _ in range(60):
        soil.advance(20, 5e-6)
        terms.append(spent(soil))
    growth = np.diff(terms, axis=0)
    total = terms[-1].sum()
    assert growth.min() >= -1e-14 * total
    at_work = dict(zip(DISSIPATED, terms[-1] > 1e-4))
    assert at_work["breaking"] == ("breaking" in case.name)
    assert at_work["friction_sliding"] or case.bonded
    assert at_work["viscous"] or case.name == "own law"
    assert at_work["friction_rolling"] == (case.name in ("Li-Chu", "Hertz-Mindlin"))


@pytest.mark.parametrize("components", [1, 2])
def test_friction_work_is_that_of_the_trapezoidal_rule_and_never_negative(components):
    """Any springs, increments and limits: mean force times slip, or nothing where that is above -k |du|^2 / 8 and below 0."""
    rng = np.random.default_rng(4)
    cut, k = 0, 5e6
    for _ in range(2000):
        old, increment = rng.normal(size=components), rng.normal(size=components) / k
        old *= min(1.0, 2.0 * rng.random() / np.linalg.norm(old))
        push = rng.random()
        new, _, work, _, _ = limited(Channel(k, 1.0, None), tuple(old), tuple(increment), tuple(old), push, True)
        mean = 0.5 * (old + new) @ (old + k * increment - new) / k
        assert work == pytest.approx(max(mean, 0.0), rel=1e-12, abs=1e-22)
        assert mean >= -k * increment @ increment / 8.0 * (1.0 + 1e-12)
        cut += mean < 0.0
    assert cut > 20


@every_law
def test_energy_audit_closes_with_the_square_of_the_step(case):
    """First order where something jumps within a step: Hertz-Mindlin rescales its tangential force, bonds break."""
    law = replace(HERTZ, restitution=1.0 - 1e-12) if case.law is HERTZ else case.law
    jumps = case.law is HERTZ or "breaking" in case.name
    steps = np.array([200, 400, 800, 1600])
    errors = []
    for count in steps:
        soil = cloud(case, law)
        soil.advance(count, 4e-3 / count)
        errors.append(abs(soil.energy_balance()))
    # contacts open and close at random within a step, so that single errors scatter
    rate = -np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert rate > (0.9 if jumps else 1.7), f"observed rate {rate:.2f} from {errors}"
    assert errors[-1] < (3e-4 if jumps else 1e-4) * soil.energies()["imposed"]


def test_spheres_move_as_in_a_plain_double_loop():
    """All channels with torsion; the reference turns vectors by Rodrigues' formula and finds shares of dashpots by bisection."""
    case = next(case for case in CASES if case.name == "Li-Chu" and case.axes == 3)
    soil = cloud(case)
    start = soil.positions, soil.radii, soil.masses, soil.velocities
    soil.advance(60, 2e-5)
    places, velocities = naive.advance_spheres(*start, LI_CHU, 2e-5, 60)
    np.testing.assert_allclose(soil.positions, places, atol=1e-15)
    np.testing.assert_allclose(soil.velocities, velocities, atol=1e-10)
    assert np.abs(velocities - start[3]).max() > 1.0


@pytest.mark.parametrize("axes", [2, 3])
def test_a_contact_that_opens_loses_what_its_springs_held(axes):
    """Sheared while it sticks, then torn apart in one step: the loss is the work of the mean force of the springs."""
    along, across = np.eye(axes)[:2]
    soil = Assembly(np.outer([0.0, 0.0999], along), 0.05, 2600.0, linear_sliding(1e7, 5e6, ENDLESS, WEAK, WEAK))
    step = 1e-6
    velocities = np.zeros((2, soil.freedoms))
    velocities[:, :axes] = np.outer([-0.5, 0.5], across)
    soil.velocities = velocities
    soil.advance(20, step)
    held = soil.energies()["elastic_sliding"]
    assert held == pytest.approx(0.5 * 5e6 * (20 * step) ** 2, rel=0.02)  # springs slow the discs down a little
    velocities[:, :axes] = np.outer([-0.5, 0.5], along) * 4e-4 / step
    soil.velocities = velocities
    soil.advance(1, step)
    assert soil.energies()["elastic_sliding"] == 0.0
    # the line of centres leans by u / d: parting by 4e-4 m at a mean distance of 0.1001 m takes back as much of the sliding u
    assert soil.energies()["contact_loss"] == pytest.approx(held * (1.0 - 4e-4 / 0.1001), rel=1e-4)


# ---------------------------------------------------------------------------------------- closed forms: Hertz and Mindlin


def _impact(restitution, speed=1.0):
    """Two equal spheres head-on, in pieces of five steps: times (k,), overlaps (k,), speed after over speed before."""
    law = replace(HERTZ, restitution=restitution)
    soil = Assembly([[0, 0, 0], [0.1, 0, 0]], 0.05, 2600.0, law)
    soil.velocities = [[0.5 * speed, 0, 0, 0, 0, 0], [-0.5 * speed, 0, 0, 0, 0, 0]]
    times, overlaps = [], []
    for _ in range(400):
        soil.advance(5, 5e-7)
        times.append(soil.time)
        overlaps.append(0.1 - (soil.positions[1, 0] - soil.positions[0, 0]))
    return np.array(times), np.array(overlaps), (soil.velocities[1, 0] - soil.velocities[0, 0]) / speed


def test_overlap_and_duration_of_an_elastic_impact_of_spheres():
    """Hertz: overlap (15 m* v^2 / (16 E* sqrt R*))^(2/5), duration 2.9433 overlap / v (Johnson 1985, eqs 11.23 and 11.24)."""
    times, overlaps, ratio = _impact(1.0 - 1e-12)
    mass, radius = 2600 * 4 / 3 * np.pi * 0.05**3 / 2, 0.025
    largest = (15 * mass / (16 * HERTZ.moduli[0] * np.sqrt(radius))) ** 0.4
    # a thousand steps in the contact: second order in the overlap; the end is known to a piece of five steps
    assert overlaps.max() == pytest.approx(largest, rel=1e-4)
    assert times[np.flatnonzero(overlaps > 0)[-1]] == pytest.approx(2.9433 * largest, abs=2 * 2.5e-6)
    assert ratio == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize("parameter", [0.2, 0.5, 0.8, 0.95])
def test_restitution_of_spheres_by_its_parameter(parameter):
    """The contact lets go where its force would turn to tension, as in the equation of motion with the same cut.

    The parameter is that of a contact that holds on until the overlap is gone: it lies below, the more so the lower it is.
    """
    law = replace(HERTZ, restitution=parameter)
    mass, modulus = 2600 * 4 / 3 * np.pi * 0.05**3 / 2, law.moduli[0]

    def rate(_, state):
        overlap = max(state[0], 0.0)
        patch = np.sqrt(overlap * 0.025)
        damping = law.damping_factor * np.sqrt(2 * modulus * patch * mass)
        return [state[1], -max(0.0, 4 / 3 * modulus * patch * overlap + damping * state[1]) / mass]

    found = solve_ivp(rate, (0.0, 2e-3), [0.0, 1.0], rtol=1e-9, atol=1e-13, max_step=2e-6)
    expected = -found.y[1, -1]
    ratio = _impact(parameter)[2]
    # the force sets in with the square root of the overlap: between first and second order of 1 / 1000
    assert ratio == pytest.approx(expected, abs=2e-4)
    assert parameter < expected < parameter + 0.21 * (1 - parameter) ** 2
