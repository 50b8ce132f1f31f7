"""LIGGGHTS (Debian package): hooke/stiffness, tangential history, rolling resistance epsd2, absolute dashpots.

epsd2 is our rolling channel with the stiffness of the sliding one and without a dashpot. In the plane LIGGGHTS takes
densities for those of discs, and m r^2 / 2 for their moment of inertia; lever arms are corrected for the overlap, as ours.
"""

import re
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path

from benchmarks.peers.common import Outcome, Peer, Scene, launch, outcome, read_dump, write_atoms
from particles import LiChu

SCRIPT = """
atom_style granular
atom_modify map array
dimension {axes}
boundary f f {side}
newton off
communicate single vel yes
units si
read_data packing.data
neighbor {skin} bin
neigh_modify delay 0 every 1 check yes
fix m1 all property/global youngsModulus peratomtype 5.e9
fix m2 all property/global poissonsRatio peratomtype 0.3
fix m3 all property/global coefficientRestitution peratomtypepair 1 0.9
fix m4 all property/global coefficientFriction peratomtypepair 1 {law.sliding_friction}
fix m5 all property/global coefficientRollingFriction peratomtypepair 1 {law.rolling_friction}
fix m6 all property/global coefficientRollingViscousDamping peratomtypepair 1 0
fix m7 all property/global kn peratomtypepair 1 {law.normal_stiffness}
fix m8 all property/global kt peratomtypepair 1 {law.sliding_stiffness}
fix m9 all property/global gamman_abs peratomtypepair 1 {law.normal_damping}
fix m10 all property/global gammat_abs peratomtypepair 1 {law.sliding_damping}
pair_style gran model hooke/stiffness tangential history {rolling} absolute_damping on limitForce on
pair_coeff * *
{planes}
timestep {step}
group free id <= {free}
fix move free nve/sphere
thermo {steps}
thermo_modify lost ignore norm no
dump final all custom {steps} final*.txt id x y z vx vy vz omegax omegay omegaz
dump_modify final format "%d{format}"
run {steps}
"""


def _run(scene: Scene) -> Outcome:
    planes = []
    if scene.box is not None:
        wall = "all wall/gran model hooke/stiffness tangential no_history primitive type 1"
        for axis, bounds in zip("xy", zip(*scene.box)):
            for side, place in zip(("low", "high"), bounds):
                planes.append(
                    f"fix {side}{axis} {wall} {axis}plane {place:.17g} tangential_damping off absolute_damping on limitForce on"
                )
    flat = scene.axes == 2
    if flat:
        planes.append("fix flat all enforce2d")
    rolling = "rolling_friction epsd2" if scene.law.rolling_stiffness else ""
    script = SCRIPT.format(
        axes=scene.axes, side="p" if flat else "f", skin=scene.skin, law=scene.law, rolling=rolling,
        planes="\n".join(planes), step=f"{scene.step:.17g}", steps=scene.steps, free=scene.free.sum(), format=" %.17g" * 9,
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_atoms(scene, folder / "packing.data", 4.0 * scene.radii.max(), discs=flat)
        (folder / "in.run").write_text(script)
        printed = launch(["liggghts", "-in", "in.run", "-log", "none"], folder)
        seconds = float(re.findall(r"Loop time of ([\d.e+-]+)", printed)[-1])
        return outcome(scene, seconds, read_dump(scene, folder / f"final{scene.steps}.txt"))


def _like(law: LiChu) -> LiChu:
    stiffness = law.sliding_stiffness if law.rolling_stiffness else 0.0
    return replace(
        law, rolling_stiffness=stiffness, rolling_damping=0.0,
        moment_stiffness=0.0, moment_damping=0.0, moment_friction=0.0,
    )  # fmt: skip


PEER = Peer("LIGGGHTS hooke epsd2", lambda: "" if shutil.which("liggghts") else "missing", _like, _run)
