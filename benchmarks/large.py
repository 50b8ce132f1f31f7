"""Large systems: cost of a step from 10,000 to a million discs, memory, and the share of list rebuilds in a dense shear.

Each size runs in a process of its own, so that the memory is its own. Prints a table, writes JSON.

    python3 -m benchmarks.large [--output large.json] [--quick]
"""

import argparse
import json
import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from benchmarks import scenes
from benchmarks.peers.compare import SPHERES, face_centred_cubic
from particles import Assembly, PeriodicCell, listing
from particles.packing import random_dense

ROOT = Path(__file__).resolve().parents[1]
LIMIT = 8.0  # GB


def measured(soil, steps, repeats, **loads):
    """Nanoseconds a particle and step (best of repeats), rebuilds in all steps, peak memory of the process (GB)."""
    step = 0.1 * soil.critical_step()
    soil.advance(40, step, **loads)
    best, rebuilds = np.inf, soil.rebuilds
    for _ in range(repeats):
        start = time.perf_counter()
        soil.advance(steps, step, **loads)
        best = min(best, time.perf_counter() - start)
    return {
        "particles": soil.count,
        "ns_per_particle_step": 1e9 * best / steps / soil.count,
        "pairs_per_particle": int(soil.system.start[-1]) / soil.count,
        "rebuilds_per_100_steps": 100.0 * (soil.rebuilds - rebuilds) / (steps * repeats),
        "peak_memory_GB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,
    }


def discs(blocks):
    """`blocks` x `blocks` dense packings of 10,000 discs between plates, all channels, dashpots, mass damping."""
    return measured(scenes.assembly(*scenes.packing(blocks=blocks)), 20, 4, mass_damping=20.0)


def spheres(cells):
    """Spheres on a face-centred cubic lattice, shaken until they touch at random, outermost ones held; all channels."""
    positions, edge = face_centred_cubic(cells, 0.0495)
    soil = Assembly(positions, np.random.default_rng(1).uniform(0.0245, 0.025, len(positions)), law=SPHERES)
    soil.velocities = 0.05 * np.random.default_rng(0).normal(size=(soil.count, 6)) * [1, 1, 1, 0, 0, 0] * ~edge[:, None]
    soil.hold(edge)
    return measured(soil, 10, 3)


def shear(strain, speed):
    """Share of the time that goes into new lists in simple shear of a dense packing of discs in a periodic cell.

    Args:
        strain: to shear by.
        speed: shear strain in a step.
    """
    size = np.array(scenes.BLOCK)
    positions, radii = random_dense(((0.0, 0.0), scenes.BLOCK), seed=1, periodic=True)
    soil = Assembly(positions, radii * scenes.SQUEEZE, law=scenes.ALL, cell=PeriodicCell(size))
    step = 0.3 * soil.critical_step()
    soil.deform([[0.0, speed / step], [0.0, 0.0]])
    soil.advance(int(0.02 / speed), step, mass_damping=20.0)
    inside, rebuild, before = 0.0, listing.rebuild, soil.rebuilds

    def timed(of):
        nonlocal inside
        start = time.perf_counter()
        rebuild(of)
        inside += time.perf_counter() - start

    listing.rebuild = timed
    start = time.perf_counter()
    soil.advance(int(strain / speed), step, mass_damping=20.0)
    total = time.perf_counter() - start
    listing.rebuild = rebuild
    return {"share_of_rebuilds": inside / total, "rebuilds": soil.rebuilds - before, "strain": strain, "strain_a_step": speed}


CASES = {
    "10^4 discs": (discs, 1), "10^5 discs": (discs, 3), "10^6 discs": (discs, 10),
    "20,000 spheres": (spheres, 17), "300,000 spheres": (spheres, 42),
    "shear, 2e-6 a step": (shear, 0.1, 2e-6), "shear, 2e-5 a step": (shear, 0.3, 2e-5),
}  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("out/benchmarks/large.json"))
    parser.add_argument("--quick", action="store_true", help="without the largest cases")
    parser.add_argument("--case", choices=CASES, help="this one, here")
    options = parser.parse_args()
    if options.case:
        build, *arguments = CASES[options.case]
        print(json.dumps(build(*arguments)))
        return
    report = {}
    for name in CASES:
        if options.quick and ("10^6" in name or "300,000" in name):
            continue
        command = [sys.executable, "-m", "benchmarks.large", "--case", name]
        report[name] = found = json.loads(subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE).stdout)
        print(f"{name:30s}" + "  ".join(f"{what} {value:.4g}" for what, value in found.items()), flush=True)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    options.output.write_text(json.dumps(report, indent=1) + "\n")


if __name__ == "__main__":
    main()
