"""The study `interface`: the run that is shown, the map of reflections, and what the map advises."""

from __future__ import annotations

import contextlib
import csv
import io
import math
import sys
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mpi4py import MPI

from bridge import output
from bridge.run import Outcome, Stopwatch, run
from particles.crew import Placed, alone, ranks
from studies.interface import PUBLISHED_TRANSIT, Parameters, Setting
from studies.interface_model import Passage, Strip, passage
from studies.resuming import Results, Start

FIGURES = ("profiles.png", "passage.png", "map.png", "map_wavelength.png", "map_element.png", "map_penalty.png")
FILES = ("summary.json", "history.csv", "profiles.csv", "map.csv", *FIGURES)
SHOWN = (0.0, 0.18, 0.42, 0.75, 1.2, 1.6, 1.85)  # times of the profiles, in transits of the strip
LARGEST_DRIFT = 0.02  # of the energy of the free wave, a share of it


class Profile(NamedTuple):
    """Displacements (m) along the strip at one time (s)."""

    time: float
    particle_places: np.ndarray
    particles: np.ndarray
    node_places: np.ndarray
    nodes: np.ndarray


class Advice(NamedTuple):
    """What keeps the reflection of a pulse with a mesh below the wanted value; None where nothing in the map does."""

    wavelength: float
    element: float
    found: Passage | None


def carry_out(
    p: Parameters, folder: Path, *, samples: int = 400, map_too: bool = True, figures: bool = True, progress: bool = True,
    checkpoint_every: float = 0.0, start: Start | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Run everything and write what it leaves behind; returns the content of summary.json.

    Args:
        p: parameters.
        folder: for the results, made if need be.
        samples: rows of the history.
        map_too: whether the map is computed.
        figures: whether pictures are drawn.
        progress: show bars on terminals.
        checkpoint_every: seconds of wall time between checkpoints; 0 for none but at Ctrl-C or SIGTERM.
        start: where the study was stopped: runs of the map that have ended are not made again.
    """
    watch = Stopwatch()
    with watch.phase("setup"):
        strip = Strip(p, p.shown)
    folder = output.prepare_folder(folder, MPI.COMM_SELF)
    output.clear(folder, FILES)
    options = {"samples": samples, "map_too": map_too, "figures": figures}
    kept = Results("interface", p, options, folder, watch, checkpoint_every, start)
    history = output.HistoryFile(folder / "history.csv")
    transit = p.length / p.wave_speed
    steps = math.ceil(SHOWN[-1] * transit / strip.step)
    profiles: list[Profile] = []
    with kept, contextlib.closing(history):
        outcome = run(
            strip, steps, samples=samples, frames=[round(share * transit / strip.step) for share in SHOWN], stopwatch=watch,
            on_sample=history.write, on_frame=lambda: profiles.append(Profile(strip.time, *strip.profile())), label="interface",
            progress=progress, watcher=kept.keeper,
        )  # fmt: skip
        output.write_text(folder / "profiles.csv", profiles_as_csv(profiles))
        runs = Placed(Passages, p)

        def passed(settings: list[Setting]) -> list[Passage]:
            with watch.phase("stepping"):
                found = kept.some(settings, lambda left: [np.array(one[1:]) for one in runs.ask("of", left)])
            return [Passage(setting, *values.tolist()) for setting, values in zip(settings, found)]

        (shown,) = passed([p.shown])
        settings = list(p.settings()) if map_too else []
        passages = [one for k in _shown(range(0, len(settings), ranks()), progress) for one in passed(settings[k : k + ranks()])]
    advice = advise(p, passages)
    if passages:
        output.write_text(folder / "map.csv", map_as_csv(passages))
    heard = doubts(strip, outcome)
    for words in heard:
        print(f"Warning: {words}", file=sys.stderr)
    if figures and outcome.stable:
        with watch.phase("output"):
            from studies import interface_figures

            interface_figures.draw(p, outcome, profiles, passages, folder)
    summary = summarise(p, strip, outcome, shown, passages, advice, watch, heard)
    output.write_json(folder / "summary.json", summary)
    if outcome.stable:
        kept.finished()
    return summary


class Passages:
    """The runs of a map, each on one rank, which takes them in turn.

    Args:
        comm: the ranks.
        p: parameters.
    """

    def __init__(self, comm: Any, p: Parameters) -> None:
        self._comm, self._p = comm, p

    def of(self, settings: list[Setting]) -> list[Passage]:
        """The passages of all settings, on every rank (collective)."""
        comm = self._comm
        with alone():
            found = [passage(self._p, setting) for setting in settings[comm.rank :: comm.size]]
        parts = comm.allgather(found)
        return [parts[k % comm.size][k // comm.size] for k in range(len(settings))]

    def release(self) -> None:
        """Nothing is held."""


def _shown(parts: range, progress: bool) -> Iterable[int]:
    """The parts, with a bar on terminals."""
    if not progress or not sys.stderr.isatty():
        return parts
    from tqdm import tqdm

    return tqdm(parts, desc="map", leave=False)


def advise(p: Parameters, passages: list[Passage]) -> list[Advice]:
    """For each pulse and mesh the narrowest zone that keeps the wanted reflection, with the tie of the largest step."""
    found = []
    for wavelength, element in dict.fromkeys((one.setting.wavelength, one.setting.element) for one in passages):
        good = [
            one for one in passages
            if (one.setting.wavelength, one.setting.element) == (wavelength, element) and one.reflection <= p.wanted
            and not one.setting.is_alike
        ]  # fmt: skip
        best = min(good, key=lambda one: (one.setting.overlap, -one.step_of_lattice), default=None)
        found.append(Advice(wavelength, element, best))
    return found


def words(p: Parameters, advice: Advice) -> str:
    """One piece of advice as a sentence."""
    head = f"pulse {1e3 * advice.wavelength:g} mm, elements {1e3 * advice.element:g} mm: "
    if advice.found is None:
        return head + f"no zone of the map keeps the reflection below {100 * p.wanted:g} %; take smaller elements"
    s = advice.found.setting
    how = f"an overlap of {1e3 * s.overlap:g} mm with {s.tie}" if s.is_overlapping else f"the bridging scale ({s.coupling})"
    return head + (
        f"{how} reflects {100 * advice.found.reflection:.2g} %, at "
        f"{advice.found.step_of_lattice:.2f} of the lattice's critical step"
    )


def map_as_csv(passages: list[Passage]) -> str:
    """The map, one row a run."""
    buffer = io.StringIO()
    writer = csv.writer(buffer)
    writer.writerow([
        "coupling", "wavelength_m", "element_m", "overlap_m", "penalty", "reflection", "transmission", "reflected_energy",
        "step_s", "step_of_lattice", "seconds",
    ])  # fmt: skip
    for one in passages:
        tie, *sizes = one.setting
        writer.writerow([tie, *(format(value, ".6g") for value in (*sizes, *one[1:]))])
    return buffer.getvalue()


def profiles_as_csv(profiles: list[Profile]) -> str:
    """Displacements along the strip, one row a column of particles or nodes and time."""
    buffer = io.StringIO()
    writer = csv.writer(buffer)
    writer.writerow(["time_s", "model", "x_m", "displacement_m"])
    for one in profiles:
        for model, places, values in (
            ("particles", one.particle_places, one.particles), ("cells", one.node_places, one.nodes),
        ):  # fmt: skip
            writer.writerows([format(one.time, ".6g"), model, f"{x:.6g}", f"{u:.6g}"] for x, u in zip(places, values))
    return buffer.getvalue()


def energy_variation(strip: Strip, outcome: Outcome) -> tuple[float, float]:
    """Of the shown run: largest deviation of the energy from the pulse's, and its slope over the whole run; shares of it."""
    balance, time = outcome.column("balance_J") / strip.given, outcome.column("time_s")
    slope = np.polyfit(time, balance, 1)[0] if len(time) > 2 else 0.0
    return float(np.abs(balance).max()), float(slope * time[-1])


def doubts(strip: Strip, outcome: Outcome) -> list[str]:
    """What the run has to say against itself."""
    found = []
    if outcome.stable:
        variation, _ = energy_variation(strip, outcome)
        if not variation <= LARGEST_DRIFT:
            found.append(f"the energy of the wave varies by {100 * variation:.1f} %; take a smaller step_ratio")
        lost = abs(outcome.history[-1]["interface_J"]) / strip.given
        if not lost <= LARGEST_DRIFT:
            found.append(f"substeps={strip.parameters.substeps} take {100 * lost:.1f} % of the pulse's energy; take fewer")
    return found


def peak_time(time: np.ndarray, values: np.ndarray) -> float:
    """When values sampled over time are largest, by a parabola through the three samples there."""
    k = int(np.clip(np.argmax(values), 1, len(values) - 2))
    a, b, _ = np.polyfit(time[k - 1 : k + 2] - time[k], values[k - 1 : k + 2], 2)
    return float(time[k] - 0.5 * b / a) if a < 0.0 else float(time[k])


def measured_speed(p: Parameters, outcome: Outcome, strip: Strip) -> float:
    """Speed (m/s) of the peak between the sections before and behind the zone."""
    peaks = [peak_time(outcome.column("time_s"), outcome.column(name)) for name in ("before_m", "behind_m")]
    return (strip.behind.x - strip.before.x) / (peaks[1] - peaks[0]) if peaks[1] > peaks[0] else math.nan


def summarise(
    p: Parameters, strip: Strip, outcome: Outcome, shown: Passage, passages: list[Passage], advice: list[Advice],
    watch: Stopwatch, heard: list[str],
) -> dict[str, Any]:  # fmt: skip
    """The content of summary.json."""
    stepping = watch.seconds["stepping"]
    values: dict[str, tuple[Any, str, Any]] = {
        "reflection": (shown.reflection, "1", None), "transmission": (shown.transmission, "1", None),
        "reflected_energy": (shown.reflected_energy, "1", None),
    }  # fmt: skip
    energy = strip.energies()
    if outcome.stable and len(outcome.history) > 2:
        variation, trend = energy_variation(strip, outcome)
        speed = measured_speed(p, outcome, strip)
        values |= {
            "wave_speed": (speed, "m/s", p.wave_speed), "transit_time": (p.length / speed, "s", PUBLISHED_TRANSIT),
            "returned_height": (outcome.column("before_m").min() / p.amplitude, "1", -1.0),
            "energy_variation": (variation, "1", None), "energy_trend": (trend, "1", None),
            "stretch": (outcome.column("stretch_m").max() / p.amplitude, "1", None),
        }  # fmt: skip
    return {
        "study": "interface", "method": p.coupling, "seed": None, "parameters": asdict(p), "versions": output.versions(),
        "ranks": ranks(), "threads": 1,
        "counts": {
            "particles": strip.soil.count, "tied": strip.tied, "elements": len(strip.body.cell_nodes),
            "coarse_steps": outcome.steps, "fine_steps": outcome.steps * p.substeps, "settings": len(passages),
        },
        "steps": {
            "coarse": strip.step, "coarse_critical": strip.body.critical_step("power"), "fine": strip.step / p.substeps,
            "fine_critical": strip.critical,
        },
        "seconds": watch.seconds | {"total": sum(watch.seconds.values())},
        "particle_steps_per_second": strip.soil.count * outcome.steps * p.substeps / stepping if stepping > 0.0 else 0.0,
        "results": {name: {"value": value, "unit": unit, "published": known} for name, (value, unit, known) in values.items()},
        "advice": [words(p, one) for one in advice],
        "energy": energy | {"pulse": strip.given, "balance_error": abs(energy["balance"]) / strip.given},
        "stable": outcome.stable, "message": outcome.message, "warnings": heard,
    }  # fmt: skip
