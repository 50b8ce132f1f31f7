"""The peers' settings are those of our law: closed forms of impacts and bonds, and our own loops, for each peer that is here.

Differences that remain are the peers' own: lever arms are radii, not corrected for the overlap; dashpots see the
velocities of half steps; spring and dashpot are cut together where a contact slides.
"""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.peers import esys, lammps, liggghts, ours, yade
from benchmarks.peers.common import Bond, Scene
from particles import LiChu

CONTACTS = [lammps.HOOKE, lammps.GRANULAR, liggghts.PEER, yade.PEER, esys.PEER]
BONDS = [lammps.BONDED, yade.BONDED, esys.BONDED]
LAW = LiChu(2.5e8, 5e7, normal_damping=4e3, sliding_damping=2e3, sliding_friction=0.5)
RADIUS = 0.05  # m
SPEED = 0.02  # m/s; so slow that the normal hardly turns in an impact


def needed(peer):
    if peer.missing():
        pytest.skip(f"{peer.name}: {peer.missing()}")
    return peer


def impact(axes, law, tangential=0.0, spin=0.0, fine=0.02):
    """Two equal particles that meet head-on with +-SPEED, +-`tangential` times SPEED across and `spin` SPEED / RADIUS."""
    positions, velocities = np.zeros((2, axes)), np.zeros((2, 3 * (axes - 1)))
    positions[1, 0] = 2.0 * RADIUS + 1e-7
    velocities[:, 0] = SPEED, -SPEED
    velocities[:, 1] = tangential * SPEED, -tangential * SPEED
    velocities[:, -1] = spin * SPEED / RADIUS
    scene = Scene(positions, np.full(2, RADIUS), velocities, law, 1.0, int(8.0 / fine))
    return replace(scene, step=fine * np.sqrt(0.5 * scene.masses[0] / law.normal_stiffness))


@pytest.mark.parametrize("axes", [2, 3])
@pytest.mark.parametrize("peer", CONTACTS, ids=lambda peer: peer.name)
def test_head_on_restitution_is_that_of_spring_and_dashpot_without_tension(peer, axes):
    scene = impact(axes, needed(peer).like(LAW), fine=0.005)
    mass = 0.5 * scene.masses[0]
    decay = 0.5 * scene.law.normal_damping / mass
    turn = np.sqrt(scene.law.normal_stiffness / mass - decay**2)
    until = (np.pi - np.arctan2(2.0 * decay * turn, turn**2 - decay**2)) / turn
    result = peer.run(scene)
    assert -result.velocities[0, 0] / SPEED == pytest.approx(np.exp(-decay * until), rel=2e-3)


@pytest.mark.parametrize("axes", [2, 3])
@pytest.mark.parametrize("peer", CONTACTS, ids=lambda peer: peer.name)
def test_oblique_impact_sticks_or_slides_as_in_closed_form(peer, axes):
    law = LiChu(2.5e8, 5e7, sliding_friction=0.5)
    sphere = axes == 3 or peer is esys.PEER
    slide = impact(axes, law, tangential=3.0)
    mass = slide.masses[0]
    sliding = needed(peer).run(slide).velocities
    assert 3.0 * SPEED - sliding[0, 1] == pytest.approx(0.5 * 2.0 * SPEED, rel=4e-3)  # friction times the normal impulse
    assert abs(sliding[0, -1]) * RADIUS == pytest.approx(SPEED / (0.4 if sphere else 0.5), rel=4e-3)

    stick = impact(axes, replace(law, sliding_friction=1e3), tangential=0.1)
    lightness = 2.0 / mass * (3.5 if sphere else 3.0)
    phase = np.pi * np.sqrt(0.5 * mass / law.normal_stiffness) * np.sqrt(law.sliding_stiffness * lightness)
    slip = lambda motion: motion[1, 1] - motion[0, 1] - RADIUS * motion[:, -1].sum()  # noqa: E731
    sticking = peer.run(stick).velocities
    assert slip(sticking) / slip(stick.velocities) == pytest.approx(np.cos(phase), abs=1e-2)


@pytest.mark.parametrize("axes", [2, 3])
@pytest.mark.parametrize("peer", CONTACTS, ids=lambda peer: peer.name)
def test_oblique_impact_that_first_sticks_then_slides_agrees_with_our_loops(peer, axes):
    if peer is esys.PEER and axes == 2:
        pytest.skip("spheres, not discs")
    law = replace(needed(peer).like(LAW), rolling_stiffness=0.0, rolling_friction=0.0, normal_damping=0.0, sliding_damping=0.0)
    scene = impact(axes, law, tangential=1.0, spin=0.1)
    theirs, mine = peer.run(scene), ours.run(scene)
    scale = np.array([1.0] * axes + [RADIUS] * (3 * axes - 3 - axes))
    assert np.abs((theirs.velocities - mine.velocities) * scale).max() < 1.5e-3 * SPEED


@pytest.mark.parametrize("peer", [lammps.GRANULAR, liggghts.PEER], ids=lambda peer: peer.name)
@pytest.mark.parametrize("axes", [2, 3])
def test_rolling_resistance_agrees_with_our_loops(peer, axes):
    law = replace(LAW, normal_damping=0.0, sliding_damping=0.0, rolling_stiffness=5e7, rolling_friction=0.05)
    scene = impact(axes, needed(peer).like(law))
    rate = 0.5 * SPEED / RADIUS
    scene.velocities[:, -1] = rate, -rate  # pressed together, they roll on each other
    theirs, mine = peer.run(scene), ours.run(scene)
    assert abs(mine.velocities[0, -1] - rate) > 0.01 * rate
    assert theirs.velocities[0, -1] - rate == pytest.approx(mine.velocities[0, -1] - rate, rel=2e-2)


@pytest.mark.parametrize("peer", [lammps.HOOKE, lammps.GRANULAR, liggghts.PEER, yade.PEER, esys.PEER], ids=lambda peer: peer.name)
def test_a_compressed_lattice_between_planes_shakes_as_ours(peer):
    count = 12
    law = replace(needed(peer).like(LAW), rolling_stiffness=0.0, rolling_friction=0.0)
    sites = np.stack(np.meshgrid(np.arange(count), np.arange(count)), axis=-1).reshape(-1, 2)
    radii = np.full(len(sites), RADIUS * 1.0005)
    velocities = np.random.default_rng(2).normal(size=(len(sites), 3)) * [0.05, 0.05, 0.0]
    law = replace(law, sliding_stiffness=1.0 if peer is esys.PEER else law.sliding_stiffness)  # its discs turn as spheres
    scene = Scene(
        RADIUS + 2 * RADIUS * sites, radii, velocities, law, 4e-6, 300, box=((0.0, 0.0), (2 * RADIUS * count,) * 2)
    )  # fmt: skip
    theirs, mine = peer.run(scene), ours.run(scene)
    travel = np.linalg.norm(mine.positions - scene.positions)
    assert np.linalg.norm(theirs.positions - mine.positions) < 0.02 * travel


MODES = {  # rotations and translations (x, ..., about z) of both, and which of the bond's numbers resists
    "normal": ([1, 0, 0, 0, 0, 0], [-1, 0, 0, 0, 0, 0]),
    "shear": ([0, 0, 0, 0, 0, 1 / RADIUS], [0, 0, 0, 0, 0, 1 / RADIUS]),
    "bending": ([0, 0, 0, 0, 1 / RADIUS, 0], [0, 0, 0, 0, -1 / RADIUS, 0]),
    "torsion": ([0, 0, 0, 1 / RADIUS, 0, 0], [0, 0, 0, -1 / RADIUS, 0, 0]),
}


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("peer", BONDS, ids=lambda peer: peer.name)
def test_two_bonded_spheres_oscillate_with_the_bonds_stiffnesses(peer, mode):
    bond = Bond(1e7, 4e6, 2e3, 1e3)
    motion = 1e-3 * np.array(MODES[mode], dtype=float)
    law = LiChu(1e7, 4e6, sliding_friction=0.5)
    positions = np.array([[0.0, 0.0, 0.0], [2 * RADIUS, 0.0, 0.0]])
    scene = Scene(
        positions, np.full(2, RADIUS), motion, law, 1.0, 400, bonds=np.array([[0, 1]]), bond=bond
    )  # fmt: skip
    mass = scene.masses[0]
    inertia = 0.4 * mass * RADIUS**2
    lightness = {"normal": 2 / mass, "shear": 2 / mass + 2 * RADIUS**2 / inertia}.get(mode, 2 / inertia)
    scene = replace(scene, step=2.0 / scene.steps / np.sqrt(getattr(bond, mode) * lightness))
    end = needed(peer).run(scene).velocities
    if mode == "shear":
        rate = lambda v: RADIUS * v[:, 5].sum() - v[1, 1] + v[0, 1]  # noqa: E731
        found = rate(end) / rate(motion)
    else:
        driven = np.abs(motion[0]).argmax()
        found = end[0, driven] / motion[0, driven]
    assert found == pytest.approx(np.cos(2.0), abs=6e-3 if mode == "shear" else 1e-4)  # Yade: one increment more in shear
