"""The runs of a calibration: table of the relations, refinement, check on other packings; and what they leave behind."""

from __future__ import annotations

import contextlib
import math
import sys
import warnings
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI
from scipy.stats import ttest_ind

from bridge import output
from bridge.run import Stopwatch
from particles import Unstable
from particles.crew import ranks
from studies.calibrate import MICRO, Targets, rock_test
from studies.calibration import Calibrated, Micro, Relations, refine
from studies.resuming import Results, Start
from studies.rock import Compression, Parameters
from studies.rock_results import spread
from studies.rock_run import tested

FILES = ("summary.json", "runs.csv", "relations.csv", "relations.png")
NAMES = ("young_modulus", "poisson_ratio", "compressive_strength", "tensile_strength")
UNITS = ("Pa", "1", "Pa", "Pa")
PUBLISHED = {"normal_stiffness": 1.61129e10, "stiffness_ratio": 0.2, "bond_strength": 0.29e5, "strength_ratio": 1.0}
DOUBTFUL = 0.01  # probability of a scatter as large as that between calibration and check, below which a result is doubted
CONVERGED = 0.02  # of a target, within which the refinement has reached it


@dataclass
class Laboratory:
    """Runs of the tests on specimens of one kind; `record` takes a row of each packing.

    Args:
        target: says which tests are made.
        specimen: packing, sizes and driving of them; its micro parameters do not matter.
        record: called with a phase, micro parameters, seed and responses.
        watch: takes the seconds.
        kept: has the results of runs that have been made before.
    """

    target: Targets
    specimen: Compression
    record: Callable[[dict[str, float]], None]
    watch: Stopwatch
    kept: Results | None = None
    samples: int = 600
    progress: bool = True

    def measure(self, micro: Micro, seeds: Iterable[int], phase: int) -> tuple[np.ndarray, np.ndarray]:
        """Responses y (packings, 3 or 4) and radii (packings,) of runs.

        Raises:
            Unstable: a specimen blew up.
        """
        rows, radii = [], []
        for seed in seeds:
            values: list[float] = []
            for kind in self.target.tests:
                found = self._once(partial(self._test, kind, micro, seed))
                radius, broken, *results = map(float, found)
                if not broken:
                    warnings.warn(f"packing {seed} of {kind.study} did not break with k_t / k_n = {micro.stiffness_ratio:.3g}", stacklevel=2)
                values += results
                if kind is Compression:
                    radii.append(radius)
            if not all(math.isfinite(value) for value in values) or min(values[0], *values[2:]) <= 0.0:
                raise ValueError(
                    f"speed={self.specimen.speed:g} must be lower, or the specimen larger: packing {seed} gave no moduli or strength"
                )
            self.record({"phase": phase, "packing": seed, **micro._asdict(), **dict(zip(NAMES, values))})
            rows.append([math.log(values[0]), values[1], *map(math.log, values[2:])])
        return np.array(rows), np.array(radii)


    def _once(self, find: Callable[[], np.ndarray]) -> np.ndarray:
        return find() if self.kept is None else self.kept.once(find)

    def _test(self, kind: type[Parameters], micro: Micro, seed: int) -> np.ndarray:
        """Radius of the specimen's discs (m), whether it broke (0, 1), and the results of the test."""
        options = {"stopwatch": self.watch, "progress": self.progress, "watcher": None if self.kept is None else self.kept.keeper}
        one = tested(rock_test(kind, micro, self.specimen, self.target), seed, self.samples, **options)
        if not one.outcome.stable:
            raise Unstable(one.outcome.message)
        broken = one.model.is_broken(one.outcome.history[-1])
        return np.array([one.model.radius, broken, *(one.results[name][0] for name in NAMES if name in kind.published)])


def tabulated(laboratory: Laboratory, seeds: range) -> Relations:
    """The relations from runs over the grid, with stiffness and strength about those that the target will need.

    The ends of the grid come first: they tell whether the Poisson ratio can be reached.
    """
    target, specimen = laboratory.target, laboratory.specimen
    scale = math.sqrt(specimen.smallest_radius * specimen.largest_radius)
    radius = 0.0

    def row(ratio: float) -> list[np.ndarray]:
        nonlocal radius
        found = []
        for strength in target.strength_grid:
            micro = Micro(target.young_modulus, ratio, target.compressive_strength * scale, strength)
            y, radii = laboratory.measure(micro, seeds, 0)
            y[:, 0] -= math.log(micro.normal_stiffness)
            y[:, 2:] += np.log(radii / micro.bond_strength)[:, None]
            found.append(y)
            radius = float(radii.mean())
        return found

    lowest, *middle, highest = target.stiffness_grid
    ends = [row(lowest), row(highest)]
    Relations((lowest, highest), target.strength_grid, np.array(ends), radius).check_poisson_ratio(target.poisson_ratio)
    values = np.array([ends[0], *map(row, middle), ends[1]])
    return Relations(target.stiffness_grid, target.strength_grid, values, radius)


def carry_out(
    target: Targets, specimen: Compression, folder: Path, *, figures: bool = True, progress: bool = True,
    checkpoint_every: float = 0.0, start: Start | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Calibrate and write what the runs leave behind; returns the content of summary.json.

    Args:
        target: what is wanted.
        specimen: packing, sizes and driving of the specimens.
        folder: for the results, made if need be.
        figures: whether pictures are drawn.
        progress: show bars on terminals.
        checkpoint_every: seconds of wall time between checkpoints; 0 for none but at Ctrl-C or SIGTERM.
        start: where the study was stopped: tests that have ended are not made again.

    Raises:
        ValueError: the target is out of reach of the grid.
        Unstable: a specimen blew up.
    """
    watch = Stopwatch()
    folder = output.prepare_folder(folder, MPI.COMM_SELF)
    output.clear(folder, FILES)
    rows = output.HistoryFile(folder / "runs.csv")
    kept = Results("calibrate", target, {"specimen": asdict(specimen), "figures": figures}, folder, watch, checkpoint_every, start)
    laboratory = Laboratory(target, specimen, rows.write, watch, kept, progress=progress)
    seeds = range(specimen.seed, specimen.seed + target.packings)
    fresh = range(seeds.stop, seeds.stop + target.check_packings)
    phase = count(1)

    def measure(micro: Micro) -> np.ndarray:
        return laboratory.measure(micro, seeds, next(phase))[0]

    with kept, contextlib.closing(rows), warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        relations = tabulated(laboratory, seeds)
        write_relations(folder / "relations.csv", relations, seeds)
        first = relations.inverse(target.responses)
        result = refine(relations, target.responses, first, measure, target.rounds)
        checked, _ = laboratory.measure(result.micro, fresh, -1)
    heard = sorted({str(w.message) for w in caught if w.category is UserWarning})
    if figures:
        with watch.phase("output"):
            from studies.calibrate_figures import draw

            draw(relations, result, checked, folder / "relations.png")
    summary = summarise(target, specimen, relations, first, result, checked, watch, heard)
    for words in summary["warnings"]:
        print(f"Warning: {words}", file=sys.stderr)
    output.write_json(folder / "summary.json", summary)
    kept.finished()
    return summary


def write_relations(path: Path, relations: Relations, seeds: range) -> None:
    """The table of the relations, a row a run."""
    file = output.HistoryFile(path)
    names = ("E_over_k_n", "poisson_ratio", "sigma_c_r_over_R_n", "sigma_t_r_over_R_n")
    for i, ratio in enumerate(relations.stiffness_ratios):
        for j, strength in enumerate(relations.strength_ratios):
            for seed, y in zip(seeds, relations.values[i, j]):
                values = [math.exp(y[0]), y[1], *np.exp(y[2:])]
                file.write({"stiffness_ratio": ratio, "strength_ratio": strength, "packing": seed, **dict(zip(names, values))})
    file.close()


def macro(y: np.ndarray) -> np.ndarray:
    """Responses (..., 3 or 4) as moduli and strengths."""
    return np.concatenate([np.exp(y[..., :1]), y[..., 1:2], np.exp(y[..., 2:])], axis=-1)


def summarise(
    target: Targets, specimen: Compression, relations: Relations, start: np.ndarray, result: Calibrated, checked: np.ndarray,
    watch: Stopwatch, heard: list[str],
) -> dict[str, Any]:  # fmt: skip
    """The content of summary.json."""
    errors = dict(zip(PUBLISHED, result.errors))
    before = relations.micro(start)
    found = {
        name: {
            "value": value, "standard_error": value * errors.get(name, 0.0), "from_relations": first,
            "unit": unit, "published": PUBLISHED[name],
        }
        for name, value, first, unit in zip(PUBLISHED, result.micro, before, ("N/m", "1", "N", "1"))
    }  # fmt: skip
    wanted, own, fresh = macro(target.responses), macro(result.measured), macro(checked)
    check = {}
    for k, (name, unit) in enumerate(zip(NAMES, UNITS[: len(wanted)])):
        mean, deviation = spread(fresh[:, k])
        reached = float(own[:, k].mean())
        chance = float(ttest_ind(own[:, k], fresh[:, k], equal_var=False).pvalue) if min(len(own), len(fresh)) > 1 else math.nan
        check[name] = {
            "target": wanted[k], "value": mean, "deviation": deviation, "each": fresh[:, k], "calibrated": reached,
            "p_value": chance, "unit": unit,
        }
        if abs(reached - wanted[k]) > CONVERGED * max(abs(wanted[k]), CONVERGED):
            heard.append(f"{name.replace('_', ' ')} came to {reached:.4g} instead of {wanted[k]:.4g}; allow more rounds")
        if chance < DOUBTFUL:
            heard.append(f"{name.replace('_', ' ')} of the check, {mean:.4g}, differs from {reached:.4g} by more than scatter; take more packings")
    settings = {key: value for key, value in asdict(specimen).items() if key not in (*MICRO, "strain", "inner", "packings")}
    return {
        "study": "calibrate", "method": "dem", "seed": specimen.seed, "parameters": asdict(target) | settings,
        "versions": output.versions(), "ranks": ranks(), "threads": 1,
        "counts": {"packings": len(own), "check_packings": len(fresh), "rounds": result.rounds, "table": relations.values[..., 0].size},
        "seconds": watch.seconds | {"total": sum(watch.seconds.values())}, "results": found, "check": check,
        "stable": True, "message": "", "warnings": heard,
    }  # fmt: skip
