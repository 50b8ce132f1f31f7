"""Rotations in the overlap coupling in space: rigid motions, angular momentum, shear waves, going on from a kept state."""

from functools import cache

import numpy as np
import pytest
import scipy.sparse as sparse
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from bridge import Overlap, kept
from bridge.overlap.limit import system
from meshes import Box, packings
from particles import Assembly, PeriodicCell
from tests.bridge.space_scenes import BONDED, DENSITY, TIES, coupled, masses, parts, shaken


@pytest.mark.parametrize("cosserat", [False, True])
@pytest.mark.parametrize("constraint, rotation", TIES)
def test_rigid_motions_need_no_force(constraint, rotation, cosserat):
    """The linear system has no force, and so (it is symmetric) no resultant force and moment, whatever the motion."""
    if rotation == "micro" and not cosserat:
        pytest.skip("a Cauchy body has no micro-rotation")
    made = coupled(constraint=constraint, rotation=rotation, cosserat=cosserat)
    soil, body, tied = made.soil, made.body, np.zeros((made.soil.count, 6), dtype=bool)
    tied[made.tie.ids] = made.tie.tied
    stiffness, mass = system(made)
    scale = abs(stiffness).max()
    assert abs(stiffness - stiffness.T).max() < 1e-14 * scale
    for shift, turn in [*zip(np.eye(3), np.zeros((3, 3))), *zip(np.zeros((3, 3)), np.eye(3))]:
        spheres, nodes = (shift + np.cross(turn, places) for places in (soil.reference, body.coordinates))
        spheres = np.hstack([spheres, np.broadcast_to(turn, spheres.shape)])
        nodes = np.hstack([nodes, np.broadcast_to(turn, nodes.shape)[:, : body.rotations]])
        alone = ~tied if constraint == "lagrange" else np.ones_like(tied)
        rigid = np.concatenate([spheres[alone], nodes.ravel()])
        assert np.abs(stiffness @ rigid).max() < 1e-12 * scale
    assert mass.shape == stiffness.shape


def angular_momentum(made):
    """Of spheres and nodes together about the origin, at their reference positions, kg m2/s."""
    soil, body = made.soil, made.body
    spheres, nodes = masses(soil) * soil.velocities, body.mass * body.velocity
    swung = np.cross(soil.reference, spheres[:, :3]).sum(axis=0) + np.cross(body.coordinates, nodes[:, :3]).sum(axis=0)
    return swung + spheres[:, 3:].sum(axis=0) + nodes[:, 3:].sum(axis=0)


@pytest.mark.parametrize("rotation, substeps", [("micro", 1), ("micro", 3), ("curl", 1)])
def test_angular_momentum_is_kept_to_second_order_of_the_motion(rotation, substeps):
    """The mesh leads at reference positions, contacts act at present ones: a tenth of the motion leaves a hundredth of the error."""
    lost = []
    for speed in (1e-2, 1e-3):
        made = shaken(rotation=rotation, substeps=substeps, speed=speed, cosserat=True)
        before = angular_momentum(made)
        made.advance(100)
        assert np.abs(made.soil.velocities[:, 3:]).max() > 0.1 * speed
        lost.append(np.abs(angular_momentum(made) - before).max() / np.abs(before).max())
    assert lost[0] / lost[1] == pytest.approx(10.0, rel=0.01) and lost[0] < 1e-6


@pytest.mark.parametrize("rotation", ["curl", "micro"])
def test_rotations_follow_the_mesh(rotation):
    """A rigid rotation of the mesh about any axis turns the tied spheres by it, in velocity and in place."""
    made = coupled(rotation=rotation)
    axis = np.array([1e-6, -2e-6, 3e-6])
    made.body.displacement[:, :3] = np.cross(axis, made.body.coordinates)
    made.body.velocity[:, :3] = np.cross(1e3 * axis, made.body.coordinates)
    if rotation == "micro":
        made.body.displacement[:, 3:], made.body.velocity[:, 3:] = axis, 1e3 * axis
    made.rule.receive()
    found = made.soil.velocities[made.tie.ids]
    np.testing.assert_allclose(found[:, 3:], np.broadcast_to(1e3 * axis, (len(found), 3)), rtol=1e-9)
    np.testing.assert_allclose(made.soil.displacements[made.tie.ids, 3:], found[:, 3:] / 1e3, rtol=1e-9)
    np.testing.assert_allclose(found[:, :3], np.cross(1e3 * axis, made.soil.reference[made.tie.ids]), atol=1e-15)
    assert made.mismatch() < 1e-15


@pytest.mark.parametrize("constraint, substeps", [("lagrange", 1), ("penalty", 3)])
def test_a_kept_state_goes_on_bit_for_bit(constraint, substeps):
    scene = {"constraint": constraint, "rotation": "micro", "substeps": substeps, "mass_damping": 5.0}
    whole, again = shaken(**scene), coupled(**scene)
    whole.advance(20)
    kept.restore_coupled(again, kept.coupled_state(whole))
    for made in (whole, again):
        made.advance(20)
    np.testing.assert_array_equal(again.body.displacement, whole.body.displacement)
    np.testing.assert_array_equal(again.soil.velocities, whole.soil.velocities)
    assert again.energies() == whole.energies()


RADIUS, SIDE, FACE, FAR, END = 1e-3, 8e-3, 0.1, 0.15, 0.25  # m, of spheres, bar, zone and bar
SPEED = np.sqrt(0.25 * BONDED.normal_stiffness / RADIUS / (DENSITY * np.pi / 6.0))  # of shear waves, G = k / 4 r
LOOKS, STEPS, STEP = 13, 32, 0.01 / SPEED / 32  # s, half the critical step


def lattice(length):
    """Bar of spheres that repeats across, so that shear waves have no sides."""
    cell = PeriodicCell((1.0, SIDE, SIDE), (False, True, True))
    sites = packings.simple_cubic(Box((0, 0, 0), (length, SIDE, SIDE)), RADIUS, (RADIUS,) * 3)
    soil = Assembly(sites, RADIUS, DENSITY, BONDED, cell=cell)
    soil.bond(0.01)
    return soil


def shear_pulse(soil):
    """Rates (n, 6) that make two shear pulses of 20 mm and height one from 80 mm on, one each way."""
    k = 2.0 * np.pi / 0.02
    phase = k * (soil.reference[:, 0] - 0.08)
    rates = np.zeros((soil.count, 6))
    rates[:, 1], rates[:, 5] = SPEED * k * np.sin(phase), 0.5 * SPEED * k**2 * np.cos(phase)
    return rates * (np.abs(phase) < np.pi)[:, None]


def swung(stiffness, mass, rates):
    """Displacements (LOOKS, components) of a linear system by central differences, from rest at rates."""
    solve = splu(sparse.csc_matrix(mass)).solve
    moved, seen = np.zeros_like(rates), []
    for _ in range(LOOKS):
        for _ in range(STEPS):
            moved = moved + STEP * rates
            rates = rates - STEP * solve(stiffness @ moved)
        seen.append(moved)
    return np.array(seen)


@cache
def undisturbed():
    soil = lattice(END)
    moved = swung(soil.stiffness_matrix(1e-6), sparse.diags(masses(soil).ravel()), shear_pulse(soil).ravel())
    return soil.reference, moved.reshape(LOOKS, -1, 6)


def shear_reflected(rotation):
    """Displacement that comes back into the spheres, to the height of the pulse; mesh of 2 mm, elimination, linear system."""
    body, _, zone = parts(radius=RADIUS, width=SIDE, faces=(FACE, FAR), length=END, size=2e-3, cosserat=rotation == "micro")
    body.fix(Box((-9, -9, -9), (9, 9, 9)), "xzab" if body.turns else "xz")
    soil = lattice(FAR)
    made = Overlap(body, soil, zone, rotation=rotation, step=1e-12)
    alone = np.ones((soil.count, 6), dtype=bool)
    alone[made.tie.ids] = ~made.tie.tied
    stiffness, mass = system(made)
    rates = np.zeros(len(stiffness.indptr) - 1)
    rates[: alone.sum()] = shear_pulse(soil)[alone]
    moved = np.zeros((LOOKS, soil.count, 6))
    moved[:, alone] = swung(stiffness, mass, rates)[:, : alone.sum()]
    ahead = np.flatnonzero(soil.reference[:, 0] < FACE)
    places, wanted = undisturbed()
    there = cKDTree(places).query(soil.reference[ahead])[1]
    return np.abs(moved[:, ahead, 1] - wanted[:, there, 1]).max()


def test_a_shear_pulse_passes_best_into_micro_rotations():
    """The continuum of the lattice has its rotations: a fifth comes back of what does without, see docs/overlap.md."""
    free, micro = (shear_reflected(rotation) for rotation in ("free", "micro"))
    assert micro < 6e-4 and micro < 0.2 * free and free < 5e-3
