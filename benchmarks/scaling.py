"""A model of the cost of a step on several ranks, fitted to runs on one rank and on two; how far it says that ranks help.

A step of the busiest rank takes  a n + m (n - n0 / k) + c b + e h + l + r log2 P  with n particles, b listed contacts across borders, h
rows of its halo, P ranks; n0 particles fit into the cache that the k ranks of a machine share, m is what one beyond it costs more. Runs of several sizes, whose border is made longer by stripes that go to the two ranks in turn, tell the numbers
apart: a, m, n0 and c from the time that ranks compute, e and l (packing, latency) from that of exchanges, r from sums over the ranks. A run
that the fit has not seen is predicted and measured. What is said about more ranks than two stands on the model and on the
latency and the width of a network that are given.

    python3 -m benchmarks.scaling [--latency 2e-6] [--width 1e10] [--output scaling.json]
"""

import argparse
import json
import os
import time
from pathlib import Path

import numpy as np
from mpi4py import MPI
from scipy.optimize import nnls

from benchmarks import ranks
from particles.exchange import SharedAssembly

STEPS, REPEATS = 10, 15  # the best of many short runs: the cores may be shared with other work
SCENES = {"discs": (ranks.discs, (1, 3, 4), 2), "spheres": (ranks.spheres, (12, 17, 27), 23)}  # sizes of the fit, size to predict
STRIPES = (2, 4, 16)
FACES = {"discs": 4, "spheres": 6}  # neighbours in the midst of many ranks
NUMBERS = {"discs": 9, "spheres": 15}  # numbers a row in a message, with dashpots
SIZES, MANY = (1_000, 10_000, 100_000), (2, 16, 128, 1_000)


def measured(make, stripes):
    """Seconds of a step and what it was spent on (the best of the repeats), and the counts of the busiest rank; on rank 0."""
    comm, whole = MPI.COMM_WORLD, make()
    across = whole.positions[:, 0]
    owner = np.floor((across - across.min()) / (np.ptp(across) + 1e-9) * stripes).astype(int) % comm.size
    step = comm.bcast(0.1 * whole.critical_step() if comm.rank == 0 else None)
    soil = SharedAssembly(make, comm, owner=owner)
    soil.advance(STEPS, step)
    best = {"step": np.inf}
    for _ in range(REPEATS):
        before = soil.seconds
        comm.Barrier()
        start = time.perf_counter()
        soil.advance(STEPS, step)
        total = time.perf_counter() - start
        spent = [soil.seconds[name] - before[name] for name in ("exchange", "agreement")]
        found = np.array(comm.allgather([total - sum(spent), *spent, soil.part.count, soil._border.start[-1], soil.halo]))
        slowest = comm.allreduce(total, op=MPI.MAX) / STEPS
        if slowest < best["step"]:
            busy, exchange, agreement = found[:, :3].T / STEPS
            counts = dict(zip(("particles", "border", "halo"), found[:, 3:].max(axis=0).tolist()))
            best = {"step": slowest, "ranks": comm.size, "busy": busy.max(), "exchange": exchange.min(), "agreement": agreement.min(), **counts}
    return best


def fitted(runs):
    """Constants of the model (s): by least squares of relative errors, none negative."""

    def fit(values, *columns):
        weight = 1.0 / np.asarray(values)
        return nnls(np.array(columns).T * weight[:, None], np.ones(len(weight)))[0]

    of = {name: np.array([run[name] for run in runs]) for name in runs[0]}
    two = of["halo"] > 0
    totals = (of["particles"] * of["ranks"]).min(), (of["particles"] * of["ranks"]).max()

    def computing(cached):
        beyond = np.maximum(of["particles"] - cached / of["ranks"], 0.0)
        found = fit(of["busy"], of["particles"], beyond, of["border"])
        error = found @ [of["particles"], beyond, of["border"]] / of["busy"] - 1.0
        return np.square(error).sum(), cached, found

    _, cached, (a, m, c) = min((computing(size) for size in np.geomspace(*totals, 60)), key=lambda tried: tried[0])
    e, latency = fit(of["exchange"][two], of["halo"][two], np.ones(two.sum()))
    return {"a": a, "m": m, "c": c, "e": e, "l": latency, "r": float(of["agreement"][two].min()), "n0": cached}


def computed(model, particles, together):
    """Seconds that a rank computes in a step if `together` ranks share the cache."""
    return model["a"] * particles + model["m"] * max(0.0, particles - model["n0"] / together)


def predicted(model, o):
    """Seconds of a step of a run on one rank or two."""
    own = computed(model, o["particles"], o["ranks"])
    return own + (o["ranks"] > 1) * (model["c"] * o["border"] + model["e"] * o["halo"] + model["l"] + model["r"])


def shares(kind, model, per_halo, latency, width):
    """Share of a step that computing its own particles takes on a rank in the midst of P, by size and P."""
    space = kind == "spheres"
    table = {}
    for size in SIZES:
        side = size ** (2.0 / 3.0) if space else size**0.5
        row = []
        for count in MANY:
            faces = min(FACES[kind], 2 * int(np.log2(count)) - 1)
            halo = per_halo["rows"] * side * faces
            ways = faces * latency + 8 * NUMBERS[kind] * halo / width
            own = computed(model, size, os.cpu_count())
            rest = model["c"] * per_halo["border"] * halo + model["e"] * halo + ways + 2 * latency * np.log2(count)
            row.append(own / (own + rest))
        table[size] = row
    return table


def run(kind, size, stripes):
    """One measurement; no stripes: on one rank."""
    return ranks.on_ranks(2 if stripes else 1, "scaling", f"{kind},{size},{max(stripes, 1)}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--latency", type=float, default=2e-6, help="of a message in the network, s")
    parser.add_argument("--width", type=float, default=1e10, help="of the network, bytes a second")
    parser.add_argument("--output", type=Path, default=Path("out/benchmarks/scaling.json"))
    parser.add_argument("--case", help="kind,size,stripes: this one, here")
    options = parser.parse_args()
    if options.case:
        kind, size, stripes = options.case.split(",")
        found = measured(lambda: SCENES[kind][0](int(size)), int(stripes))
        if MPI.COMM_WORLD.rank == 0:
            print(json.dumps(found))
        return
    report = {}
    for kind, (_, sizes, unseen) in SCENES.items():
        runs = [run(kind, size, stripes) for size in sizes for stripes in (0, *STRIPES)]
        model = fitted(runs)
        worst = max(abs(predicted(model, o) / o["step"] - 1.0) for o in runs)
        constants = ", ".join(f"{name} {1e9 * value:.3g} ns" for name, value in model.items() if name != "n0")
        print(f"{kind}: {constants}, n0 {model['n0']:.0f}; off by {worst:.0%} at most")
        checks = []
        for stripes in (0, 2, 16):
            o = run(kind, unseen, stripes)
            said = predicted(model, o)
            checks.append(o | {"stripes": stripes, "predicted": said})
            print(
                f"  {o['particles']:.0f} a rank, halo {o['halo']:.0f}: measured {1e3 * o['step']:.3f} ms, predicted {1e3 * said:.3f} ms",
                flush=True,
            )
        side = [o["particles"] ** (2.0 / 3.0 if kind == "spheres" else 0.5) for o in checks]
        per_halo = {"rows": checks[1]["halo"] / side[1], "border": checks[1]["border"] / checks[1]["halo"]}
        table = shares(kind, model, per_halo, options.latency, options.width)
        for size, row in table.items():
            print(f"  {size:7d} a rank: " + ", ".join(f"{share:.2f} on {count}" for share, count in zip(row, MANY)))
        report[kind] = {"runs": runs, "model": model, "worst": worst, "checks": checks, "per_halo": per_halo, "shares": table}
    options.output.parent.mkdir(parents=True, exist_ok=True)
    options.output.write_text(json.dumps(report | {"cores": os.cpu_count()}, indent=1) + "\n")


if __name__ == "__main__":
    main()
