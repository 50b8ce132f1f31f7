"""Speed of the particle loops: what each term costs, small and large packings, memory, compilation, LIGGGHTS.

Rates of one run belong together (ratios); the machine decides on the absolute numbers. Prints a table, writes JSON.

    python3 benchmarks/particles.py [--output benchmarks.json] [--quick]
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np  # noqa: E402

from benchmarks.peers import compare, liggghts  # noqa: E402
from benchmarks.scenes import ALL, assembly, packing  # noqa: E402

FIRST_STEP = """
import sys, time
start = time.perf_counter()
sys.path.insert(0, {root!r})
from benchmarks.scenes import ALL
from particles import Assembly, Plate
soil = Assembly([[0, 0], [0.0999, 0]], 0.05, law=ALL)
soil.add_wall(Plate.rectangle((-1, -1), (1, -0.04)))
soil.advance(1, 1e-6, mass_damping=20.0)
print(time.perf_counter() - start)
"""


def without(*channels, dashpots=True):
    """The law without these channels, and without dashpots if so asked."""
    gone = {f"{channel}_{kind}": 0.0 for channel in channels for kind in ("stiffness", "damping", "friction")}
    if not dashpots:
        gone |= {f"{channel}_damping": 0.0 for channel in ("normal", "sliding", "rolling", "moment")}
    return replace(ALL, **gone)


def rates(scenes, steps, repeats):
    """Disc-steps per second of each scene {name: (assembly, loads)}, best of `repeats`, taken in turns."""
    best = dict.fromkeys(scenes, np.inf)
    ready = {}
    for name, (soil, loads) in scenes.items():
        ready[name] = 0.1 * soil.critical_step()
        soil.advance(5, ready[name], **loads)
    for _ in range(repeats):
        for name, (soil, loads) in scenes.items():
            start = time.perf_counter()
            soil.advance(steps, ready[name], **loads)
            best[name] = min(best[name], time.perf_counter() - start)
    return {name: scenes[name][0].count * steps / taken for name, taken in best.items()}


def bytes_of(soil):
    """Bytes of all arrays per disc (pair arrays left out) and per listed pair (both lists while they are rebuilt, outer list)."""
    system, outer = soil.system, soil._outer
    pairs = int(system.start[-1])
    per_pair = (2 * (system.first.nbytes + system.second.nbytes + system.history.nbytes) + outer.second.nbytes) / max(pairs, 1)
    held = [a for a in (*system, *vars(soil).values(), outer.start, outer.places) if isinstance(a, np.ndarray)]
    total = sum(a.nbytes for a in held) - system.first.nbytes - system.second.nbytes - system.history.nbytes
    # sorting copies state, acceleration and force
    total += max(a.nbytes for a in held)
    return total / max(soil.count, 1), per_pair


def first_step(cache):
    """Seconds from import to the first step in a fresh process with this compile cache."""
    run = subprocess.run(
        [sys.executable, "-c", FIRST_STEP.format(root=str(ROOT))], env={**os.environ, "NUMBA_CACHE_DIR": cache},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return float(run.stdout)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("out/benchmarks/particles.json"))
    parser.add_argument("--quick", action="store_true", help="fewer repeats, no large packing")
    options = parser.parse_args()
    repeats, steps = (3, 100) if options.quick else (10, 200)

    positions, radii, upper = packing()
    damped = {"mass_damping": 20.0}
    scenes = {
        "all channels, dashpots, mass damping, plates": (assembly(positions, radii, upper), damped),
        "  no plates (outermost discs held)": (assembly(positions, radii, upper, walls=False), damped),
        "  no plates, no mass damping": (assembly(positions, radii, upper, walls=False), {}),
        "  no plates, no damping at all": (assembly(positions, radii, upper, without(dashpots=False), False), {}),
        "  ... no rolling moment": (assembly(positions, radii, upper, without("moment", dashpots=False), False), {}),
        "  ... no rolling": (assembly(positions, radii, upper, without("moment", "rolling", dashpots=False), False), {}),
        "  ... normal force only": (
            assembly(positions, radii, upper, without("moment", "rolling", "sliding", dashpots=False), False), {},
        ),
    }  # fmt: skip
    found = rates(scenes, steps, repeats)
    first = found["all channels, dashpots, mass damping, plates"]
    print(f"{len(radii)} discs, one core: million disc-steps/s, ratio to the first line")
    for name, rate in found.items():
        print(f"{name:50s} {rate / 1e6:7.1f} {rate / first:7.2f}")
    report = {"discs": len(radii), "disc_steps_per_second": {name.strip(): rate for name, rate in found.items()}}

    per_disc, per_pair = bytes_of(next(iter(scenes.values()))[0])
    print(f"memory: {per_disc:.0f} bytes a disc, {per_pair:.0f} a listed pair (at a rebuild)")
    report |= {"bytes_per_disc": per_disc, "bytes_per_pair": per_pair}

    if not options.quick:
        large = packing(blocks=3)
        scenes = {
            "small": (assembly(positions, radii, upper), damped),
            "large": (assembly(*large), damped),
        }
        sizes = rates(scenes, 40, 6)
        ratio = sizes["large"] / sizes["small"]
        print(f"{len(large[1])} discs: {sizes['large'] / 1e6:.1f} million disc-steps/s, {ratio:.2f} of the small packing's rate")
        report |= {"large_discs": len(large[1]), "large_rate_ratio": ratio}

    with tempfile.TemporaryDirectory() as cache:
        cold, warm = first_step(cache), min(first_step(cache) for _ in range(3))
    print(f"import to first step: {cold:.1f} s with compilation, {warm:.2f} s with filled caches")
    report |= {"first_step_cold_s": cold, "first_step_warm_s": warm}

    peer = compare.race(compare.dense_discs(400), liggghts.PEER, repeats=3 if options.quick else 8)
    if "ratio" in peer:
        print(f"LIGGGHTS: {peer['peer']:.1f} against {peer['ours']:.1f}: ratio {peer['ratio']:.2f}")
    report["liggghts"] = peer
    options.output.parent.mkdir(parents=True, exist_ok=True)
    options.output.write_text(json.dumps(report, indent=1) + "\n")


if __name__ == "__main__":
    main()
