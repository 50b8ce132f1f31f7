"""Speed of the foundation: bridging scale against particles everywhere, share of the coupling, time to the first step.

Every figure comes from whole processes of `python -m studies foundation`, taken in turns; ratios within one run are what
counts. Prints a table, writes JSON.

    python3 -m benchmarks.foundation [--output benchmarks.json] [--quick]
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
QUIET = ("--no-fields", "--no-figures", "--quiet")


def study(*options, **environment):
    """Run the study; returns its summary and the wall time of the process (s)."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "studies", "foundation", *QUIET, "--output", folder, *options]
        start = time.perf_counter()
        subprocess.run(command, cwd=ROOT, check=True, env={**os.environ, "OMP_NUM_THREADS": "1", **environment})
        wall = time.perf_counter() - start
        return json.loads((Path(folder) / "summary.json").read_text()), wall


def ratios(assembly, repeats, *options):
    """Medians over pairs of runs: how many times faster bridging steps, its coupling's share, rates of both."""
    common = ("--assembly", assembly, *options)
    study("--method", "bridging", *common)  # fills the caches
    pairs = []
    for _ in range(repeats):
        full, _ = study("--method", "dem", *common)
        coupled, _ = study("--method", "bridging", *common)
        seconds = coupled["seconds"]
        pairs.append(
            (
                full["seconds"]["stepping"] / seconds["stepping"],
                seconds["coupling"] / seconds["stepping"],
                full["particle_steps_per_second"] / 1e6,
                coupled["particle_steps_per_second"] / 1e6,
                full["counts"]["particles"] / coupled["counts"]["particles"],
            )
        )
    names = ("times_faster", "coupling_share", "million_disc_steps_per_second_dem", "million_disc_steps_per_second_bridging")
    medians = [statistics.median(column) for column in zip(*pairs)]
    return dict(zip((*names, "ratio_of_discs"), medians))


def starts():
    """Seconds from the start of the interpreter to the end of the first steps, caches filled and empty."""
    tiny = ("--displacement", "1e-3", "--samples", "1")
    study(*tiny)
    warm = min(study(*tiny)[1] for _ in range(3))
    with tempfile.TemporaryDirectory() as empty:
        cold = study(*tiny, NUMBA_CACHE_DIR=f"{empty}/numba", XDG_CACHE_HOME=f"{empty}/cache")[1]
    return {"warm_start_s": warm, "cold_start_s": cold}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, help="JSON file for the figures")
    parser.add_argument("--quick", action="store_true", help="one pair of runs, assembly A only")
    arguments = parser.parse_args()
    figures = {"start": starts()}
    for assembly in "A" if arguments.quick else "ABC":
        figures[assembly] = ratios(assembly, 1 if arguments.quick else 5)
    for name, values in figures.items():
        print(name if name == "start" else f"assembly {name}, region 6 m x 3 m")
        for what, value in values.items():
            print(f"  {what:44s}{value:10.3g}")
    if arguments.output:
        arguments.output.write_text(json.dumps(figures, indent=1))


if __name__ == "__main__":
    main()
