"""Explicit motion: exact waves, exact energy account, momentum, damping, restart."""

import numpy as np
import pytest

from continuum import Body, Cauchy, Unstable
from meshes import Box, domains

EVERYWHERE = Box((-1, -1), (100, 100))


def rod(cells=60):
    """Laterally held rod of unit squares: u_x only, uniform over the height."""
    material = Cauchy(1e9, 0.3, 2000.0)
    body = Body(domains.rectangle((0, 0), (cells, 1), (cells, 1)), material)
    body.fix(EVERYWHERE, "y")
    return body, np.sqrt(material.stiffness[0, 0, 0, 0] / material.density)


def test_pulse_travels_at_the_wave_speed_and_turns_at_the_fixed_end():
    """At h = c dt central differences solve the wave equation exactly: f(x - c t) to rounding, sign change at the end.

    The rod is u_x(x) only, so the lumped squares act as two-node bars with dispersion sin(w dt/2) = (c dt/h) sin(k h/2).
    """
    body, speed = rod()
    body.fix("right", "x")
    x = body.coordinates[:, 0]

    def pulse(s):
        return np.where(np.abs(s - 12) < 8, 1e-3 * np.cos(np.pi * (s - 12) / 16) ** 2, 0.0)

    step = 1.0 / speed
    # M9 needs v = (d(+1) - d(-1)) / 2 dt of the discrete solution
    body.displacement[:, 0] = pulse(x)
    body.velocity[:, 0] = (pulse(x - 1) - pulse(x + 1)) / (2 * step)
    body.advance(20, step)
    assert body.displacement[:, 0] == pytest.approx(pulse(x - 20), abs=1e-13)
    body.advance(60, step)  # 80 cells: centre at 92, mirrored at 60 to 28, sign turned
    assert body.displacement[:, 0] == pytest.approx(-pulse(120 - 80 - x), abs=1e-13)
    assert np.abs(body.displacement).max() == pytest.approx(1e-3, rel=1e-2)


def test_standing_wave_frequency():
    """Half a period after release the mode of wavelength 20 m stands reversed; dispersion as in the docstring above."""
    body, speed = rod(20)
    k = 2 * np.pi / 20
    shape = 1e-4 * np.cos(k * body.coordinates[:, 0])
    step = 0.5 / speed
    omega = 2 / step * np.arcsin(0.5 * np.sin(k / 2))
    body.displacement[:, 0] = shape
    body.advance(25, step)
    assert body.displacement[:, 0] == pytest.approx(shape * np.cos(omega * 25 * step), abs=1e-15)


def shaken(make_domain, make_material, kind="cosserat", cell="quadrilateral"):
    """A body with everything that does work: supports, moving plate, traction, weight."""
    body = Body(make_domain(cell), make_material(kind))
    body.fix("bottom", "xy")
    body.prescribe("top", "y", lambda t: -0.1 * np.sin(400 * t))
    body.traction("right", (-1e5, 2e4))
    body.gravity((0.0, -9.81))
    return body


@pytest.mark.parametrize("damping", [{}, {"mass_damping": 150.0}, {"local_damping": 0.4}])
def test_energy_account_closes(damping, cell, make_domain, make_material):
    """Balance to rounding, with the leap-frog's own kinetic energy, whatever moves the body or damps it."""
    body = shaken(make_domain, make_material, cell=cell)
    body.advance(300, 0.7 * body.critical_step(), **damping)
    energies = body.energies()
    for name in damping:
        assert energies[name] > 0.01 * abs(energies["external_work"])
    assert energies["strain"] > 0 and energies["kinetic"] > 0
    assert abs(energies["balance"]) < 1e-12 * abs(energies["external_work"])


def test_plain_sum_of_energies_closes_at_second_order(make_domain, make_material):
    """1/2 v M v differs from the leap-frog's kinetic energy by h^2/8 a M a: halving the step divides it by 4."""
    errors = []
    for halvings in (1, 2, 3):
        body = shaken(make_domain, make_material)
        body.traction("right", (1e5, -2e4))  # no load at the start: a smooth beginning
        body.gravity((0.0, 0.0))
        step = 1.0e-4 / 2**halvings
        body.advance(20 * 2**halvings, step, mass_damping=100.0)
        e = body.energies()
        errors.append(abs(e["strain"] + e["kinetic"] + e["mass_damping"] - e["external_work"]))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert rates == pytest.approx([2.0, 2.0], abs=0.25)


def test_impulse_is_momentum(distorted):
    """A free body under a constant traction: sum of M v = F t, and the moment about the centre stays zero."""
    distorted.traction("right", (2e4, 0.0))
    step = 0.5 * distorted.critical_step()
    distorted.advance(400, step)
    momentum = (distorted.mass * distorted.velocity).sum(axis=0)
    impulse = 2e4 * 1.5 * 400 * step
    assert momentum[0] == pytest.approx(impulse, rel=1e-12)
    assert abs(momentum[1]) < 1e-12 * impulse
    x, y = distorted.coordinates.T
    spin = np.sum(distorted.mass[:, 0] * (x * distorted.velocity[:, 1] - y * distorted.velocity[:, 0]))
    if distorted.components == 3:
        spin += momentum[2]
    assert spin == pytest.approx(-0.75 * impulse, rel=1e-11)  # the load acts at y = 0.75 on average


def test_mass_damping_slows_a_free_body_by_the_exact_factor(distorted):
    """v(n+1) = v(n) (1 - c h/2) / (1 + c h/2) when nothing else acts (M9)."""
    distorted.velocity[:, 0] = 2.0
    step = 0.5 * distorted.critical_step()
    distorted.advance(50, step, mass_damping=300.0)
    factor = (1 - 150 * step) / (1 + 150 * step)
    assert distorted.velocity[:, 0] == pytest.approx(np.full(distorted.count, 2.0 * factor**50), rel=1e-12)


def test_local_damping_slows_a_fall(distorted):
    """Free fall with the damping force -alpha |F| sgn v: (1 - alpha) g."""
    distorted.gravity((0.0, -10.0))
    step = 0.5 * distorted.critical_step()
    distorted.advance(1, step, local_damping=0.3)  # at rest nothing is damped yet
    start = distorted.velocity[:, 1].copy()
    distorted.advance(100, step, local_damping=0.3)
    assert distorted.velocity[:, 1] - start == pytest.approx(np.full(distorted.count, -7.0 * 100 * step), rel=1e-11)


def test_reactions_carry_the_loads_at_rest(make_domain, make_material):
    """After heavy damping the support's reaction is minus the load; the moment likewise."""
    body = Body(make_domain("quadrilateral"), make_material("cosserat"))
    body.fix("bottom", "xyr")
    body.traction("top", (1e4, -3e4))
    for damping in (600.0, 200.0):
        body.advance(3000, 0.8 * body.critical_step(), mass_damping=damping)
    load = body.external_force()
    x, y = body.coordinates.T
    moment = np.sum(x * load[:, 1] - y * load[:, 0])
    assert body.reaction("bottom") == pytest.approx([-2e4, 6e4, -moment], rel=1e-6)
    assert body.velocity[:, :2].max() < 1e-9


def test_damping_of_a_body_carried_along_loads_its_support(make_domain, make_material):
    """All nodes at 2 m/s: the supports push against c M v, a force through the middle of the mass."""
    body = Body(make_domain("quadrilateral"), make_material("cosserat"))
    body.prescribe(EVERYWHERE, "x", 2.0)
    body.fix(EVERYWHERE, "yr")
    body.advance(10, 1e-4, mass_damping=30.0)
    push = 30.0 * 2.0 * 2042.0 * 3.0
    assert body.reaction(EVERYWHERE)[:2] == pytest.approx([push, 0.0], rel=1e-9, abs=1e-6 * push)
    assert body.energies()["mass_damping"] == pytest.approx(push * 2.0 * 10e-4, rel=1e-12)


def test_prescribed_motion_is_followed(make_domain, make_material):
    """The displacement is the midpoint sum of the velocity: exact for a velocity linear in time."""
    body = Body(make_domain("triangle"), make_material("cauchy"))
    body.fix("bottom", "xy")
    body.prescribe("top", "y", lambda t: -3.0 * t)
    step = 0.5 * body.critical_step()
    body.advance(100, step)
    top = body.prescribed_velocity(1.0)[:, 1] != 0
    assert body.time == pytest.approx(100 * step, rel=1e-12)
    assert body.displacement[top, 1] == pytest.approx(np.full(top.sum(), -1.5 * body.time**2), rel=1e-12)
    assert body.velocity[top, 1] == pytest.approx(np.full(top.sum(), -3.0 * body.time), rel=1e-12)


@pytest.mark.parametrize("damping", [{"mass_damping": 50.0}, {"local_damping": 0.2}])
def test_divided_and_restarted_runs_are_the_same_run(damping, make_domain, make_material):
    """Bit for bit: 40 steps; 15 + 25 steps; 15 steps, then d, v, a and the time handed to a new body for 25."""
    runs = [shaken(make_domain, make_material) for _ in range(4)]
    step = 0.6 * runs[0].critical_step()
    runs[0].advance(40, step, **damping)
    runs[1].advance(15, step, **damping)
    runs[1].advance(25, step, **damping)
    runs[2].advance(15, step, **damping)
    for name in ("displacement", "velocity", "acceleration"):
        getattr(runs[3], name)[:] = getattr(runs[2], name)
    runs[3].time = runs[2].time
    runs[3].advance(25, step, **damping)
    for run in (runs[1], runs[3]):
        assert np.array_equal(run.displacement, runs[0].displacement)
        assert np.array_equal(run.velocity, runs[0].velocity)
    whole, first, second = (runs[i].energies() for i in (0, 2, 3))
    for name in ("mass_damping", "local_damping", "external_work"):  # the two parts add up, to rounding
        assert first[name] + second[name] == pytest.approx(whole[name], rel=1e-12)


def test_blow_up_is_noticed_and_named():
    body, speed = rod(10)
    body.displacement[:, 0] = 1e-6 * np.random.default_rng(0).standard_normal(body.count)
    with pytest.raises(Unstable, match=r"unstable by t=.* the node at \(.*\) m moves faster than"):
        body.advance(100, 1.5 / speed)
