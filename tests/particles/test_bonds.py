"""Bonds in closed form: strength in tension and shear, a beam of bonded particles, gaps, what is broken, the critical step."""

from dataclasses import replace

import numpy as np
import pytest

from particles import Assembly
from tests.particles.scenes import BEAM, BONDED, WEAK, hexagonal_lattice, square_lattice, trial

quiet = {"normal_damping": WEAK, "shear_damping": WEAK}
spaces = pytest.mark.parametrize("axes", [2, 3], ids=["discs", "spheres"])


def _bonded_pair(axes, law, gap=0.0, motion=None, ends=(1.0, 1.0)):
    """Two particles of radius 0.05 m along an oblique line, bonded; `motion` along it, across it, spin."""
    along = np.array([0.6, 0.8, 0.0])[:axes]
    soil = Assembly([np.zeros(axes), (0.1 + gap) * along], 0.05, 2600.0, law)
    assert soil.bond() == 1
    velocity = np.zeros((2, soil.freedoms))
    velocity[:, :axes] = np.outer([-0.5, 0.5], along) * motion[0]
    velocity[:, -1] = motion[1]
    soil.velocities = velocity
    return soil


def test_a_bond_that_breaks_in_a_trial_is_not_logged():
    soil = _bonded_pair(2, replace(BONDED, tensile_strength=500.0), motion=(0.0, 0.0))
    apart = np.array([[0.0, 0.0, 0.0], [6e-4, 8e-4, 0.0]])  # 1 mm along the line of centres, ten times what the bond bears
    assert not soil.trial_forces(apart, np.zeros((2, 3))).any()
    assert not len(soil.breaks) and len(soil.bonds) == 1


@spaces
@pytest.mark.parametrize("gap", [-2e-4, 0.0, 5e-4])
def test_a_bond_in_tension_breaks_at_its_strength(axes, gap):
    """k u = R_n at sin(w t) = R_n w / (k v); it takes R_n^2 / 2k; what is left is the speed of energy. All of it is logged."""
    strength, speed = 500.0, 1.0
    law = replace(BONDED, tensile_strength=strength, **quiet)
    soil = _bonded_pair(axes, law, gap, (speed, 0.0))
    step, mass = 1e-7, soil.masses[0] / 2
    frequency = np.sqrt(law.normal_stiffness / mass)
    time = np.arcsin(strength * frequency / law.normal_stiffness / speed) / frequency
    soil.advance(int(2 * time / step), step)
    energy = strength**2 / (2 * law.normal_stiffness)
    (line,) = soil.breaks
    assert line[0] == pytest.approx(time, abs=2 * step)
    assert set(line[1:3]) == {0.0, 1.0}
    np.testing.assert_allclose(line[3 : 3 + axes], 0.5 * soil.positions.sum(axis=0), atol=1e-9)
    # noticed up to a step late: the stretch is too long by up to v h
    assert line[6] == pytest.approx(energy, rel=2.5 * speed * step / (strength / law.normal_stiffness))
    assert soil.energies()["breaking"] == line[6]
    apart = np.linalg.norm(soil.velocities[1, :axes] - soil.velocities[0, :axes])
    if gap >= 0.0:  # with an overlap the surfaces part later: nothing pushes them any more, either
        assert apart == pytest.approx(np.sqrt(speed**2 - 2 * energy / mass), rel=1e-3)
    assert len(soil.bonds) == 0


@spaces
def test_a_bond_in_shear_breaks_at_its_strength(axes):
    """Both spin the same way: k_t u = R_t, energy R_t^2 / 2 k_t."""
    law = replace(BONDED, shear_strength=300.0, **quiet)
    soil = _bonded_pair(axes, law, 0.0, (0.0, 20.0))
    step = 1e-7
    soil.advance(1000, step)
    (line,) = soil.breaks
    # slide rate about 2 r w = 2 m/s, noticed up to a step late; the normal spring has a little of the energy, too
    slide = 300.0 / law.shear_stiffness
    assert line[6] == pytest.approx(0.5 * 300.0 * slide, rel=5 * 2.0 * step / slide)
    assert line[0] == pytest.approx(slide / 2.0, rel=0.01)  # the spins fall by the moment of the bond


@spaces
@pytest.mark.parametrize("kind", ["bending", "torsion"])
def test_a_cantilever_of_bonded_particles_is_a_beam(axes, kind):
    """n bonds of length d: E I = k_b d, shear stiffness k_t d, torsion k_T d; tip load P at L = n d.

    w = P L^3 / 3EI (1 - 1 / 4n^2) + P L / k_t d exactly (sum of the bonds), Timoshenko's beam but for 1 / 4n^2;
    torsion T L / k_T d. The forces of that deflection, in one small step, are the load and nothing else.
    """
    if kind == "torsion" and axes == 2:
        pytest.skip("no torsion in the plane")
    count, spacing = 12, 0.1
    places = np.zeros((count + 1, axes))
    places[:, 0] = spacing * np.arange(count + 1)
    soil = Assembly(places, 0.05, 2600.0, BEAM)
    assert soil.bond() == count
    load = np.zeros((count + 1, soil.freedoms))
    size = 1e-5  # N or N m: so small that squares of the rotations are gone
    component = 3 if kind == "torsion" else axes - 1
    load[-1, component] = size
    stiffness = soil.stiffness_matrix().toarray()[soil.freedoms :, soil.freedoms :]
    q = np.zeros_like(load)
    q[1:] = np.linalg.solve(stiffness, load[1:].ravel()).reshape(count, -1)
    length, rigidity = count * spacing, BEAM.bending_stiffness * spacing
    if kind == "torsion":
        expected = size * length / (BEAM.torsion_stiffness * spacing)
    else:
        shear = size * length / (BEAM.shear_stiffness * spacing)
        expected = size * length**3 / (3 * rigidity) * (1 - 0.25 / count**2) + shear
    assert q[-1, component] == pytest.approx(expected, rel=1e-9)
    # rounding: places of 1 m at 1e-16 and a stiffness of 1e7
    np.testing.assert_allclose(trial(soil, q)[1:], -load[1:], atol=1e7 * 4e-16 + 1e-5 * size)


@spaces
def test_a_bond_across_a_gap_belongs_to_the_network(axes):
    """It is among the contacts with its force, and the critical step knows it: 2 / w = 2 sqrt(m / 2k), whatever the range."""
    law = replace(BONDED, shear_stiffness=0.0, **quiet)
    soil = _bonded_pair(axes, law, 1.5e-3, (0.0, 0.0))
    (overlap,) = soil.contacts().overlap
    assert overlap == pytest.approx(-1.5e-3)
    assert soil.critical_step() == pytest.approx(2 * np.sqrt(soil.masses[0] / (2 * law.normal_stiffness)))
    q = np.zeros((2, soil.freedoms))
    q[1, :axes] = [6e-6, 8e-6, 0.0][:axes]
    soil.velocities = q / 1e-5
    soil.advance(1, 1e-5)
    assert soil.contacts().push == pytest.approx(-law.normal_stiffness * 1e-5, rel=1e-3)  # the pull slows it down meanwhile
    # stretched beyond the skin of the list, which is not yet stale
    far, lists = _bonded_pair(axes, law, 1.5e-3, (560.0, 0.0)), soil.rebuilds
    far.advance(1, 1e-5)
    assert far.skin < 7e-3 and far.rebuilds == lists
    assert far.contacts(contact_range=1e-6).overlap == pytest.approx(-7.1e-3, rel=1e-3)


@spaces
def test_a_broken_bond_is_as_if_it_had_never_been(axes):
    """Bonded with an overlap, torn apart, then thrown together: the same as two particles that were never bonded."""
    law = replace(BONDED, tensile_strength=300.0)
    torn = _bonded_pair(axes, law, -1e-4, (1.0, 0.0))
    torn.advance(200, 2e-6)
    assert len(torn.breaks) == 1 and len(torn.contacts().first) == 0
    velocity = -torn.velocities
    velocity[:, -1] = [30.0, -10.0]
    torn.velocities = velocity
    fresh = Assembly(torn.positions, 0.05, 2600.0, law)
    fresh.bond(pairs=np.zeros((0, 2)))
    fresh.velocities = velocity
    for _ in range(2):
        for soil in (torn, fresh):
            soil.advance(300, 1e-6)
        np.testing.assert_allclose(torn.velocities, fresh.velocities, rtol=1e-9, atol=1e-12)
    assert np.abs(fresh.velocities - velocity).max() > 0.4  # the friction of one impact on the spins


@pytest.mark.parametrize("lattice", ["square", "hexagonal"])
def test_critical_step_of_bonded_lattices_from_both_sides(lattice):
    """Infinite lattices: w^2 m = max(4 (k_n + k_t), 16 k_t) square, max(6 k_n + 2 k_t, 24 k_t) hexagonal (k_rot = 0).

    A finite piece may take a step longer by (pi / size)^2 / 2; white noise grows above that step and not below the exact one.
    """
    size, k, s = 12, BONDED.normal_stiffness, BONDED.shear_stiffness
    places = (square_lattice if lattice == "square" else hexagonal_lattice)(size, size)
    soil = Assembly(places, 0.05, 2600.0, replace(BONDED, **quiet))
    soil.bond()
    factor = max(4 * (k + s), 16 * s) if lattice == "square" else max(6 * k + 2 * s, 24 * s)
    exact, sharp = 2.0 / np.sqrt(factor / soil.masses[0]), soil.critical_step(sharp=True)
    assert exact * (1 - 1e-9) <= sharp <= exact * (1 + (np.pi / size) ** 2)
    noise = 1e-9 * np.random.default_rng(0).normal(size=(size * size, 3))
    for step, grows in ((0.99 * exact, False), (1.01 * sharp, True)):
        soil.displacements = np.zeros_like(noise)
        soil.bond()
        soil.velocities = noise
        soil.advance(80, step)
        # above the limit by exp(2 sqrt(0.02)) = 1.33 a step; spins are r times faster than places
        assert (np.abs(soil.velocities[:, :2]).max() > 1e-6) == grows
