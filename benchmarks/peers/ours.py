"""Our side of the comparison with the peers."""

import math
import time

from benchmarks.peers.common import Outcome, Scene
from particles import Assembly, Bonded, Plate


def run(scene: Scene) -> Outcome:
    """The scene in our loops; one step beforehand on another assembly, so that compilation is not counted."""
    _assembly(scene).advance(1, scene.step)
    soil = _assembly(scene)
    start = time.perf_counter()
    soil.advance(scene.steps, scene.step)
    return Outcome(time.perf_counter() - start, soil.positions, soil.velocities)


def _assembly(scene: Scene) -> Assembly:
    law, bond = scene.law, scene.bond
    if bond is not None:
        law = Bonded(
            bond.normal, bond.shear, math.inf, math.inf, bending_stiffness=bond.bending, torsion_stiffness=bond.torsion
        )
    soil = Assembly(scene.positions, scene.radii, scene.density, law)
    if scene.bonds is not None:
        soil.bond(0.03, scene.bonds)
    if scene.box is not None:
        soil.add_wall(*Plate.box(*scene.box, 1.0, frictionless=True))
    soil.velocities = scene.velocities
    if scene.held is not None:
        soil.hold(scene.held)
    return soil
