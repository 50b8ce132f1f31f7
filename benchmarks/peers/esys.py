"""ESyS-Particle (Debian package): rotational frictional spheres, and its rotational bonds; one worker process.

No contact dashpots, no rolling resistance. Like Yade a leap-frog, with the same reading of first and last velocities. Its
master process, which waits for the worker, keeps a second core busy. Planes have a spring only. In the plane its particles have
the moment of inertia 2/5 m r^2 of spheres (ours 1/2 m r^2), so that there only motions without spins agree. The contact search
needs cells wider than the largest particle. The bending angle of its bonds is half the relative rotation.
"""

import shutil
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.peers.common import Outcome, Peer, Scene, arrays, launch, outcome
from particles import LiChu

SCRIPT = """
import time
import numpy as np
from esys.lsm import *
from esys.lsm.geometry import TaggedIdConnection
from esys.lsm.util import BoundingBox, Vec3

given = np.load("scene.npz")
kn, ks, friction = map(float, given["law"])
places, radii, skin = given["places"], given["radii"], float(given["skin"])
vector = lambda values: Vec3(*map(float, values))
low, high = places.min(axis=0) - 4 * radii.max(), places.max(axis=0) + 4 * radii.max()
world = LsmMpi(numWorkerProcesses=1, mpiDimList=[1, 1, 1])
world.initNeighbourSearch(particleType="RotSphere", gridSpacing=2.1 * float(radii.max()) + skin, verletDist=skin / 2)
world.setSpatialDomain(BoundingBox(vector(low), vector(high)))
if given["flat"]:
    world.force2dComputations(True)
steps = int(given["steps"])
world.setTimeStepSize(float(given["step"]))
world.setNumTimeSteps(steps + 1)
for k, (place, velocity, spin, radius, mass, free) in enumerate(
    zip(places, given["velocities"], given["spins"], radii, given["masses"], given["free"])
):
    particle = RotSphere(k, vector(place), float(radius), float(mass))
    particle.setTag(1 if free else 2)
    particle.setLinearVelocity(vector(velocity))
    particle.setAngularVelocity(vector(spin))
    world.createParticle(particle)
if not given["free"].all():
    world.setParticleNonDynamic(2)
world.createInteractionGroup(RotFrictionPrms(
    name="contacts", normalK=kn, dynamicMu=friction, staticMu=friction, shearK=ks, scaling=False, rigid=True,
))
if len(given["pairs"]):
    normal, shear, bending, torsion = map(float, given["bond"])
    world.createConnections([TaggedIdConnection(int(a), int(b), 3) for a, b in given["pairs"]])
    world.createInteractionGroup(RotBondPrms(
        name="bonds", normalK=normal, shearK=shear, torsionK=torsion, bendingK=2 * bending, normalBrkForce=1e30,
        shearBrkForce=1e30, torsionBrkForce=1e30, bendingBrkForce=1e30, tag=3, scaling=False,
    ))
    world.createExclusion("bonds", "contacts")
for axis, sense, place in given["bounds"]:
    name, normal = f"plane{axis:g}{sense:g}", np.zeros(3)
    normal[int(axis)] = sense
    world.createWall(name=name, posn=vector(place * np.abs(normal)), normal=vector(normal))
    world.createInteractionGroup(NRotElasticWallPrms(name="of" + name, wallName=name, normalK=kn))

def state():
    table = {}
    for one in world.getParticleList():
        vectors = one.getPosn(), one.getLinearVelocity(), one.getAngularVelocity()
        table[one.getId()] = [v[c] for v in vectors for c in range(3)]
    return np.array([table[k] for k in range(len(radii))])

start = time.perf_counter()
for _ in range(steps):
    world.runTimeStep()
seconds = time.perf_counter() - start
final = state()
world.runTimeStep()
final[:, 3:] = 0.5 * (final[:, 3:] + state()[:, 3:])
np.savez("final.npz", seconds=seconds, table=final)
world.exit()
"""


def _run(scene: Scene) -> Outcome:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        np.savez(folder / "scene.npz", **arrays(scene))
        (folder / "scene.py").write_text(SCRIPT)
        launch(["mpirun", "-np", "2", "esysparticle", "scene.py"], folder)
        final = np.load(folder / "final.npz")
        return outcome(scene, float(final["seconds"]), final["table"])


def _like(law: LiChu) -> LiChu:
    return LiChu(law.normal_stiffness, law.sliding_stiffness, sliding_friction=law.sliding_friction)


def _missing() -> str:
    return "" if shutil.which("esysparticle") and shutil.which("mpirun") else "missing"


PEER = Peer("ESyS-Particle RotFriction", _missing, _like, _run)
BONDED = Peer("ESyS-Particle RotBond", _missing, _like, _run)
