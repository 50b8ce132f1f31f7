"""Yade (Debian package): linear contacts of Cundall and Strack, and bonds of Law2_ScGeom6D_CohFrictPhys_CohesionMoment.

No dashpots, no rolling resistance, global damping off. Yade is a leap-frog: its velocities live at half steps, those
returned are the mean of the two around the last step; the first step takes the initial velocities for those half a
step before. Planes have a spring only. Discs are spheres whose mass and inertia are set, with the other motions blocked.
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
from yade import *
from yade import utils

given = np.load("scene.npz")
law, bond, pairs, bounds = given["law"], given["bond"], given["pairs"], given["bounds"]
kn, ks, friction = law
angle = float(np.arctan(friction))
bonded = len(pairs) > 0
if bonded:
    material = CohFrictMat(young=1.0, poisson=1.0, frictionAngle=angle, normalCohesion=1e30, shearCohesion=1e30,
                           momentRotationLaw=True, isCohesive=True, alphaKr=1.0, alphaKtw=1.0)
else:
    material = FrictMat(frictionAngle=angle)
O.materials.append(material)
blocked = "zXY" if given["flat"] else ""
for place, velocity, spin, radius, mass, inertia, free in zip(
    given["places"], given["velocities"], given["spins"], given["radii"], given["masses"], given["inertias"], given["free"]
):
    body = utils.sphere(place, float(radius), material=material)
    body.state.mass, body.state.inertia = float(mass), Vector3(*[float(inertia)] * 3)
    body.state.blockedDOFs = blocked if free else "xyzXYZ"
    body.state.vel, body.state.angVel = Vector3(*velocity), Vector3(*spin)
    O.bodies.append(body)
count = len(O.bodies)
smooth = type(material)(**{**material.dict(), "frictionAngle": 0.0, "label": "smooth", "id": -1})
for axis, sense, position in bounds:
    O.bodies.append(utils.wall(float(position), int(axis), sense=int(sense), material=smooth))
geometry = Ig2_Sphere_Sphere_ScGeom6D if bonded else Ig2_Sphere_Sphere_ScGeom
if bonded:
    physics = Ip2_CohFrictMat_CohFrictMat_CohFrictPhys(setCohesionOnNewContacts=False)
    contact = Law2_ScGeom6D_CohFrictPhys_CohesionMoment(useIncrementalForm=False, always_use_moment_law=False)
else:
    physics = Ip2_FrictMat_FrictMat_FrictPhys(kn=float(kn), ks=float(ks))
    contact = Law2_ScGeom_FrictPhys_CundallStrack()
O.engines = [
    ForceResetter(),
    InsertionSortCollider([Bo1_Sphere_Aabb(), Bo1_Wall_Aabb()], verletDist=float(given["skin"]) / 2),
    InteractionLoop([geometry(), Ig2_Wall_Sphere_ScGeom()], [physics], [contact]),
    NewtonIntegrator(damping=0.0, exactAsphericalRot=False),
]
O.dt = float(given["step"])
if bonded:
    for a, b in pairs:
        link = utils.createInteraction(int(a), int(b))
        link.phys.kn, link.phys.ks, link.phys.kr, link.phys.ktw = map(float, bond)
        link.phys.unp = link.geom.penetrationDepth
        link.phys.cohesionBroken, link.phys.momentRotationLaw = False, True
        link.phys.normalAdhesion = link.phys.shearAdhesion = 1e30
        link.phys.maxRollPl = link.phys.maxTwistPl = -1.0

bodies = [O.bodies[k] for k in range(count)]

def motion():
    return np.array([[*b.state.vel, *b.state.angVel] for b in bodies])

start = time.perf_counter()
O.run(int(given["steps"]), wait=True)
seconds = time.perf_counter() - start
places, before = np.array([list(b.state.pos) for b in bodies]), motion()
O.run(1, wait=True)
np.savez("final.npz", seconds=seconds, table=np.column_stack([places, 0.5 * (before + motion())]))
"""


def _run(scene: Scene) -> Outcome:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        np.savez(folder / "scene.npz", **arrays(scene))
        (folder / "scene.py").write_text(SCRIPT)
        launch(["yade", "-n", "-x", "-j1", "scene.py"], folder)
        final = np.load(folder / "final.npz")
        return outcome(scene, float(final["seconds"]), final["table"])


def _like(law: LiChu) -> LiChu:
    return LiChu(law.normal_stiffness, law.sliding_stiffness, sliding_friction=law.sliding_friction)


def _missing() -> str:
    return "" if shutil.which("yade") else "missing"


PEER = Peer("Yade CundallStrack", _missing, _like, _run)
BONDED = Peer("Yade CohesionMoment", _missing, _like, _run)
