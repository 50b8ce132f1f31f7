"""Lattices and bodies of lattice particles and elements on one rank and on several: cost of a step; writes JSON, prints a table.

    python3 -m benchmarks.lattice_ranks [--ranks 1,2] [--output lattice_ranks.json]
"""

import argparse
import json
import resource
import time
from pathlib import Path

import numpy as np
from mpi4py import MPI

from benchmarks.ranks import on_ranks
from bridge.manifold import Manifold
from meshes import Box, packings
from particles.crew import lead
from particles.lattice import Lattice, LatticeMaterial

SPACING = 1e-3
ROCK = {"young_modulus": 12.5e9, "poisson_ratio": 0.2, "density": 2650.0}
STEPS, REPEATS = 50, 12  # the best of several runs: the cores may be shared with other work


def shaken(body, sites):
    """Waves of some amplitude all through a body."""
    body.velocity = 0.1 * np.sin(300.0 * sites + np.arange(3))
    return body


def block(size, limit=np.inf):
    """A free block of a cubic lattice (sites along each axis), with bonds that break at `limit` (m)."""
    sites = packings.simple_cubic(Box((0, 0, 0), tuple(SPACING * n for n in size)), 0.5 * SPACING)
    return Lattice(sites, SPACING, LatticeMaterial(**ROCK, normal_limit=limit))


def intact(size):
    body = block(size)
    return shaken(body, body.reference)


def limited(size):
    """The same with a limit that is not reached: every bond is looked at in every step."""
    body = block(size, 1e-3)
    return shaken(body, body.reference)


def cracked(size):
    """The same after a pull that has broken bonds in planes across it, and all through the block."""
    body = block(size, 5e-7)
    body.velocity = 1.6 * np.sin(150.0 * body.reference[:, [2, 0, 1]]) * [0.2, 0.2, 1.0]
    body.advance(60)
    return body


def tunnel(size):
    """Elements round a zone of free particles across the middle, all shaken."""
    sites = packings.simple_cubic(Box((0, 0, 0), tuple(SPACING * n for n in size)), 0.5 * SPACING)
    height = SPACING * size[2]

    def free(x):
        return np.abs(x[:, 2] - 0.5 * height) < 0.25 * height

    body = Manifold(Lattice(sites, SPACING, LatticeMaterial(**ROCK, normal_limit=1e-3), first=free), 4, free=free)
    body.set_motion(velocity=lambda x: 0.1 * np.sin(300.0 * x + np.arange(3)))
    return body


CASES = {
    "300,000, intact": (intact, (50, 60, 100)), "300,000, with limits": (limited, (50, 60, 100)), "300,000, cracked": (cracked, (50, 60, 100)),
    "150,000 in elements": (tunnel, (48, 60, 104)),
}  # fmt: skip


def measured(make):
    """Best time of a step (s) over the repeats and where it went on the ranks in that repeat; rank 0 leads."""
    start = time.perf_counter()
    body = make()
    made = time.perf_counter() - start
    body.advance(STEPS)
    best = np.inf
    for _ in range(REPEATS):
        before = body.parallel()
        start = time.perf_counter()
        body.advance(STEPS)
        spent = (time.perf_counter() - start) / STEPS
        if spent < best:
            best, found = spent, [_less(one, two) for one, two in zip(body.parallel().get("ranks", []), before.get("ranks", []))]
    broken = body.energies()["broken_bonds"]
    return {"step": best, "made": made, "broken_bonds": broken, "ranks": found, "megabytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024}


def _less(now, before):
    return {
        "particles": now["particles"], "halo": now["halo"],
        "seconds": {name: (value - before["seconds"][name]) / STEPS for name, value in now["seconds"].items()},
    }  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ranks", default="1,2")
    parser.add_argument("--output", type=Path, default=Path("out/benchmarks/lattice_ranks.json"))
    parser.add_argument("--case", choices=CASES, help="this one, here")
    options = parser.parse_args()
    if options.case:
        build, size = CASES[options.case]
        found = lead(lambda: measured(lambda: build(size)))
        if MPI.COMM_WORLD.rank == 0:
            print(json.dumps(found))
        return
    report: dict = {}
    for name in CASES:
        for ranks in map(int, options.ranks.split(",")):
            found = report.setdefault(name, {})[ranks] = on_ranks(ranks, "lattice_ranks", name)
            alone = report[name].get(1, found)["step"]
            shares = "; ".join(
                " + ".join(f"{1e3 * value:.3f} {what}" for what, value in one["seconds"].items()) + f", {one['particles']} rows, halo {one['halo']}"
                for one in found["ranks"]
            )
            print(f"{name:22s}{ranks:2d} ranks {1e3 * found['step']:8.3f} ms a step, {alone / found['step']:5.2f} times one rank; {shares}", flush=True)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    options.output.write_text(json.dumps(report, indent=1) + "\n")


if __name__ == "__main__":
    main()
