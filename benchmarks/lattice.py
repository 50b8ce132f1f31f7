"""Speed of lattice bonds, beside Yade's JCFpm bonds between the same neighbours where Yade (Debian package) is installed.

    python -m benchmarks.lattice
"""

from __future__ import annotations

import shutil
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.peers.common import launch
from particles.lattice import Lattice, LatticeMaterial

EDGE, STEPS, TIMES = (14, 14, 28), 100, 3
SCRIPT = """
import time
import numpy as np
from yade import *
from yade import utils

given = np.load("scene.npz")
O.materials.append(JCFpmMat(young=1e9, poisson=0.2, density=2650.0, frictionAngle=0.5, tensileStrength=1e30, cohesion=1e30, type=1))
for place, velocity in zip(given["places"], given["velocities"]):
    body = utils.sphere(place, 0.5)
    body.state.vel = Vector3(*velocity)
    O.bodies.append(body)
reach = 1.45  # of the diameter: 6 + 12 neighbours
O.engines = [
    ForceResetter(),
    InsertionSortCollider([Bo1_Sphere_Aabb(aabbEnlargeFactor=reach, label="box")]),
    InteractionLoop(
        [Ig2_Sphere_Sphere_ScGeom(interactionDetectionFactor=reach, label="near")],
        [Ip2_JCFpmMat_JCFpmMat_JCFpmPhys(cohesiveTresholdIteration=1)],
        [Law2_ScGeom_JCFpmPhys_JointedCohesiveFrictionalPM()],
    ),
    NewtonIntegrator(damping=0.0),
]
O.dt = 0.1 * utils.PWaveTimeStep()
O.run(2, wait=True)
best = 1e300
for _ in range(int(given["times"])):
    start = time.perf_counter()
    O.run(int(given["steps"]), wait=True)
    best = min(best, time.perf_counter() - start)
np.savez("final.npz", seconds=best, bonds=O.interactions.countReal())
"""


def yade(places: np.ndarray, velocities: np.ndarray) -> tuple[float, int]:
    """Seconds of the steps, and bonds."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        np.savez(folder / "scene.npz", places=places, velocities=velocities, steps=STEPS, times=TIMES)
        (folder / "scene.py").write_text(SCRIPT)
        launch(["yade", "-n", "-x", "-j1", "scene.py"], folder)
        final = np.load(folder / "final.npz")
        return float(final["seconds"]), int(final["bonds"])


def ours(places: np.ndarray, velocities: np.ndarray, limit: float | None) -> tuple[float, int]:
    """The same by the lattice."""
    material = LatticeMaterial(1e9, 0.2, 2650.0, **({} if limit is None else {"normal_limit": limit}))
    body = Lattice(places, 1.0, material)
    body.velocity = velocities[body.order]
    body.advance(2)
    best = np.inf
    for _ in range(TIMES):
        start = time.perf_counter()
        body.advance(STEPS)
        best = min(best, time.perf_counter() - start)
    return best, int((body._state.near[:, ::2] >= 0).sum())


def main() -> None:
    places = np.stack(np.meshgrid(*map(np.arange, EDGE), indexing="ij"), axis=-1).reshape(-1, 3).astype(float)
    velocities = 1e-3 * np.random.default_rng(1).standard_normal(places.shape)
    large = np.stack(np.meshgrid(*map(np.arange, (40, 40, 80)), indexing="ij"), axis=-1).reshape(-1, 3).astype(float)
    runs = {
        "lattice, bonds that can break": lambda: ours(places, velocities, 1e-2),
        "lattice, without limits": lambda: ours(places, velocities, None),
        f"lattice, bonds that can break, {len(large)} particles": lambda: ours(large, 0.0 * large, 1e-2),
    }
    if shutil.which("yade"):
        runs = {"Yade, Law2 JointedCohesiveFrictionalPM": lambda: yade(places, velocities)} | runs
    print(f"{len(places)} particles; nanoseconds for a bond and a step, best of {TIMES} runs of {STEPS}")
    for name, run in runs.items():
        seconds, bonds = run()
        print(f"{name:56s}{bonds:8d} bonds{seconds / STEPS / bonds * 1e9:8.1f}", flush=True)


if __name__ == "__main__":
    main()
