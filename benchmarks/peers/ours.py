"""Our side of the comparison with the peers."""

import time

from benchmarks.peers.common import Outcome, Scene
from particles import Assembly, Plate


def missing(scene: Scene) -> str:
    """Why a scene cannot run, in a word; empty when it can."""
    return "unplugged" if scene.bonds is not None else ""


def run(scene: Scene) -> Outcome:
    """The scene in our loops; one step beforehand on another assembly, so that compilation is not counted."""
    _assembly(scene).advance(1, scene.step)
    soil = _assembly(scene)
    start = time.perf_counter()
    soil.advance(scene.steps, scene.step)
    return Outcome(time.perf_counter() - start, soil.positions, soil.velocities)


def _assembly(scene: Scene) -> Assembly:
    soil = Assembly(scene.positions, scene.radii, scene.density, scene.law, skin=scene.skin)
    if scene.box is not None:
        soil.add_wall(*Plate.box(*scene.box, 1.0, frictionless=True))
    soil.velocities = scene.velocities
    if scene.held is not None:
        soil.hold(scene.held)
    return soil
