"""The same packing, step and number of steps in LIGGGHTS (Debian package): normal, sliding and rolling resistance.

LIGGGHTS has spheres; in two dimensions, with densities that give the discs' masses. Its model is hooke/stiffness with
tangential history and rolling friction epsd2 (one rolling channel; ours has two). One core, same machine, alternating.

    python3 benchmarks/peers/liggghts.py
"""

import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks.scenes import ALL, assembly, packing

SCRIPT = """
atom_style granular
atom_modify map array
dimension 2
boundary f f p
newton off
communicate single vel yes
units si
read_data packing.data
neighbor {skin} bin
neigh_modify delay 0 every 1 check yes
fix m1 all property/global youngsModulus peratomtype 5.e9
fix m2 all property/global poissonsRatio peratomtype 0.3
fix m3 all property/global coefficientRestitution peratomtypepair 1 0.9
fix m4 all property/global coefficientFriction peratomtypepair 1 0.5
fix m5 all property/global coefficientRollingFriction peratomtypepair 1 0.05
fix m6 all property/global coefficientRollingViscousDamping peratomtypepair 1 0.1
fix m7 all property/global kn peratomtypepair 1 2.5e8
fix m8 all property/global kt peratomtypepair 1 5.e7
fix m9 all property/global gamman_abs peratomtypepair 1 400
fix m10 all property/global gammat_abs peratomtypepair 1 400
pair_style gran model hooke/stiffness tangential history rolling_friction epsd2 absolute_damping on
pair_coeff * *
fix left all wall/gran model hooke/stiffness tangential history primitive type 1 xplane 0.0 absolute_damping on
fix right all wall/gran model hooke/stiffness tangential history primitive type 1 xplane {right} absolute_damping on
fix floor all wall/gran model hooke/stiffness tangential history primitive type 1 yplane 0.0 absolute_damping on
fix lid all wall/gran model hooke/stiffness tangential history primitive type 1 yplane {top} absolute_damping on
timestep {step}
fix move all nve/sphere
fix plane all enforce2d
thermo_style custom step atoms ke
thermo 100000
thermo_modify lost ignore norm no
run 1
run {steps}
"""


def seconds(positions, radii, upper, skin, step, steps):
    """Loop time of LIGGGHTS, s; None where it is not installed or fails (says why)."""
    if shutil.which("liggghts") is None:
        print("LIGGGHTS is not installed: skipped")
        return None
    density = 2600.0 * np.pi * radii**2 / (4.0 / 3.0 * np.pi * radii**3)
    low, high = positions.min(axis=0) - 0.2, positions.max(axis=0) + 0.2
    velocities = 0.05 * np.random.default_rng(0).normal(size=(len(radii), 3)) * [1.0, 1.0, 0.0]
    lines = ["packing", "", f"{len(radii)} atoms", "1 atom types", "", f"{low[0]} {high[0]} xlo xhi"]
    lines += [f"{low[1]} {high[1]} ylo yhi", "-0.1 0.1 zlo zhi", "", "Atoms", ""]
    lines += [f"{k + 1} 1 {2 * r:.17g} {d:.17g} {x:.17g} {y:.17g} 0" for k, (r, d, (x, y)) in enumerate(zip(radii, density, positions))]
    lines += ["", "Velocities", ""]
    lines += [f"{k + 1} {vx:.17g} {vy:.17g} 0 0 0 0" for k, (vx, vy, _) in enumerate(velocities)]
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "packing.data").write_text("\n".join(lines) + "\n")
        Path(folder, "in.run").write_text(SCRIPT.format(skin=skin, step=step, steps=steps, right=upper[0], top=upper[1]))
        run = subprocess.run(["liggghts", "-in", "in.run", "-log", "none"], cwd=folder, capture_output=True, text=True)
    times = re.findall(r"Loop time of ([\d.e+-]+)", run.stdout)
    if len(times) < 2:
        print("LIGGGHTS failed: skipped\n" + run.stdout[-800:] + run.stderr[-400:])
        return None
    return float(times[-1])


def compare(steps=400, repeats=3):
    """Disc-steps per second of both on 10,000 discs, best of `repeats` alternating runs; ratio None without the peer."""
    positions, radii, upper = packing()
    soil = assembly(positions, radii, upper)
    step = 0.1 * soil.critical_step()
    soil.advance(20, step)
    ours, peer = [], []
    for _ in range(repeats):
        start = time.perf_counter()
        soil.advance(steps, step)
        ours.append(time.perf_counter() - start)
        taken = seconds(positions, radii, upper, soil.skin, step, steps)
        if taken is None:
            return {"grainbridge": len(radii) * steps / min(ours), "liggghts": None, "ratio": None}
        peer.append(taken)
    best, theirs = min(ours), min(peer)
    return {"grainbridge": len(radii) * steps / best, "liggghts": len(radii) * steps / theirs, "ratio": theirs / best}


if __name__ == "__main__":
    found = compare()
    print(f"grainbridge {found['grainbridge'] / 1e6:.1f} million disc-steps/s (law: {ALL.normal_damping:g} N s/m, all channels)")
    if found["ratio"]:
        print(f"LIGGGHTS    {found['liggghts'] / 1e6:.1f} million disc-steps/s;  ratio {found['ratio']:.2f}")
