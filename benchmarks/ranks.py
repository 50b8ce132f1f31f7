"""Particles on one rank and on several: cost of a step, time in messages and in waiting; writes JSON, prints a table.

    python3 -m benchmarks.ranks [--ranks 1,2] [--output ranks.json]
"""

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from mpi4py import MPI

from benchmarks import scenes
from benchmarks.peers.common import PLAIN
from benchmarks.peers.compare import SPHERES, face_centred_cubic
from particles import Assembly
from particles.exchange import SharedAssembly

ROOT = Path(__file__).resolve().parents[1]
STEPS, REPEATS = 5, 100  # the best of many short runs: the cores may be shared with other work


def discs(blocks):
    """`blocks` x `blocks` dense packings of 10,000 discs between plates, all channels, dashpots."""
    return scenes.assembly(*scenes.packing(blocks=blocks))


def spheres(cells):
    """Spheres on a face-centred cubic lattice, shaken, the outermost ones held; all channels."""
    positions, edge = face_centred_cubic(cells, 0.0495)
    soil = Assembly(positions, np.random.default_rng(1).uniform(0.0245, 0.025, len(positions)), law=SPHERES)
    soil.velocities = 0.05 * np.random.default_rng(0).normal(size=(soil.count, 6)) * [1, 1, 1, 0, 0, 0] * ~edge[:, None]
    soil.hold(edge)
    return soil


CASES = {"91,000 discs": (discs, 3), "50,000 spheres": (spheres, 23)}


def measured(make):
    """Best time of a step (s) over the repeats, and where it went on the ranks in that repeat (rank 0 returns them)."""
    comm = MPI.COMM_WORLD
    if comm.size == 1:
        soil = part = make()
    else:
        soil = SharedAssembly(make, comm)
        part = soil.part
    step = comm.bcast(0.1 * part.critical_step() if comm.rank == 0 else None)
    soil.advance(STEPS, step)
    best: dict = {"step": np.inf}
    for _ in range(REPEATS):
        before, lists = dict(soil.seconds) if comm.size > 1 else {}, soil.rebuilds
        comm.Barrier()
        start = time.perf_counter()
        soil.advance(STEPS, step)
        mine = time.perf_counter() - start
        spent = {name: value - before[name] for name, value in soil.seconds.items()} if before else {}
        found = comm.allgather((mine, spent, part.count, soil.halo if before else 0))
        slowest = max(one[0] for one in found) / STEPS
        if slowest < best["step"]:
            waits = [sum(one[1].values()) for one in found]
            best = {
                "step": slowest, "ranks": comm.size, "particles": [one[2] for one in found], "halo": [one[3] for one in found],
                "waiting": [wait / STEPS for wait in waits], "lists": soil.rebuilds - lists,
                "busy": [(one[0] - wait) / STEPS for one, wait in zip(found, waits)],
            }  # fmt: skip
    return best


def on_ranks(count, module, case):
    """What a benchmark's `--case` prints on that many ranks, in processes of their own."""
    command = ["mpirun", "--allow-run-as-root", "--oversubscribe", "-n", str(count)] if count > 1 else []
    command += [sys.executable, "-m", f"benchmarks.{module}", "--case", case]
    made = subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True, env=PLAIN).stdout
    return json.loads(made[made.index("{") : made.rindex("}") + 1])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ranks", default="1,2")
    parser.add_argument("--output", type=Path, default=Path("out/benchmarks/ranks.json"))
    parser.add_argument("--case", choices=CASES, help="this one, here")
    options = parser.parse_args()
    if options.case:
        build, size = CASES[options.case]
        found = measured(lambda: build(size))
        if MPI.COMM_WORLD.rank == 0:
            print(json.dumps(found))
        return
    report: dict = {}
    for name in CASES:
        for ranks in map(int, options.ranks.split(",")):
            found = report.setdefault(name, {})[ranks] = on_ranks(ranks, "ranks", name)
            alone = report[name].get(1, found)["step"]
            print(
                f"{name:16s}{ranks:3d} ranks {1e3 * found['step']:8.3f} ms a step, {alone / found['step']:5.2f} times one rank; "
                f"busy {1e3 * max(found['busy']):.3f} ms, waiting {1e3 * min(found['waiting']):.3f} to "
                f"{1e3 * max(found['waiting']):.3f} ms, halo {found['halo']}, lists {found['lists']}", flush=True,
            )  # fmt: skip
    options.output.parent.mkdir(parents=True, exist_ok=True)
    options.output.write_text(json.dumps(report, indent=1) + "\n")


if __name__ == "__main__":
    main()
