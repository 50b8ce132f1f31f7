"""One run of an element test from parameters to the files that it leaves behind."""

from __future__ import annotations

import contextlib
import sys
import warnings
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mpi4py import MPI

from bridge import output
from bridge.run import Outcome, Stopwatch
from particles.crew import ranks
from particles.spread import parallel
from studies.lab import Parameters
from studies.lab_model import ElementTest, fitted_moduli
from studies.resuming import Runs, Start

SERIES = ("particles", "contacts")
FIGURES = ("curves.png", "packing.png", "contact_rose.png")
FILES = ("summary.json", "history.csv", *FIGURES)
END = 0.2  # share of the strain over which the state at the end is averaged
LARGEST_INERTIA = 1e-3  # inertial number of a quasi-static test
LARGEST_ERROR = 0.01  # of the energy balance, as a share of the work of the cell


class State(NamedTuple):
    """The packing at one time: particles inside the cell, contacts as lines that may reach over its edges."""

    time: float  # s
    strain: float
    matrix: np.ndarray  # (axes, axes) edges as columns, m
    positions: np.ndarray  # (n, axes), m
    radii: np.ndarray  # (n,), m
    fluctuation: np.ndarray  # (n, axes) displacement beyond that of the cell since the loading began, m
    rotation: np.ndarray  # (n,) counter-clockwise in the plane (in space that of x and z), rad
    ends: np.ndarray  # (k, 2, axes), m
    normal_force: np.ndarray  # (k,), N
    tangential_force: np.ndarray  # (k,), N


@dataclass
class Finished:
    """A run that has ended."""

    parameters: Parameters
    model: ElementTest
    summary: dict[str, Any]
    outcome: Outcome
    states: list[State]


def state(model: ElementTest) -> State:
    """The packing as it is now."""
    soil = model.soil
    matrix, moved = model.cell.matrix, soil.displacements
    places = soil.positions
    affine = soil.reference @ model.deformation.T
    turn = moved[:, 2] if soil.axes == 2 else -moved[:, 4]
    inside = places - np.floor(places @ np.linalg.inv(matrix).T) @ matrix.T
    found = soil.contacts()
    first = inside[found.first]
    ends = np.stack([first, first + (found.first_arm + found.second_arm)[:, None] * found.normal], axis=1)
    along = np.sqrt(np.maximum((found.force**2).sum(axis=1) - found.push**2, 0.0))
    return State(
        model.time, model.strain, matrix, inside, soil.radii, places - affine, turn, ends, found.push, along
    )  # fmt: skip


def carry_out(
    p: Parameters, folder: Path, *, samples: int = 400, frames: int = 6, figures: bool = True, progress: bool = True,
    checkpoint_every: float = 0.0, start: Start | None = None,
) -> Finished:  # fmt: skip
    """Prepare, load and write what the run leaves behind.

    Args:
        p: parameters.
        folder: for the results, made if need be.
        samples: rows of the history.
        frames: times of the field files; 0 writes none.
        figures: whether pictures are drawn.
        progress: show a bar on terminals.
        checkpoint_every: seconds of wall time between checkpoints; 0 for none but at Ctrl-C or SIGTERM.
        start: where the study was stopped.
    """
    watch = Stopwatch()
    options = {"samples": samples, "frames": frames, "figures": figures}
    runs = Runs(p.study, p, options, folder, watch, checkpoint_every, start)
    with warnings.catch_warnings(record=True) as caught, watch.phase("setup"):
        warnings.simplefilter("always", UserWarning)
        model = ElementTest(p, runs.begun(p.study))
    heard = [str(w.message) for w in caught if w.category is UserWarning]
    folder = output.prepare_folder(folder, MPI.COMM_SELF)
    if start is None:
        output.clear(folder, FILES, SERIES)
    history = output.HistoryFile(folder / "history.csv")
    series = {name: output.Series(folder / "fields", name) for name in SERIES} if frames else {}
    states: list[State] = []

    def on_frame() -> None:
        states.append(state(model))
        if series:
            write_fields(series, states[-1])

    def enter(s: State) -> None:
        for one in series.values():
            one.enter(s.time)

    with runs, contextlib.closing(history):
        outcome = runs.run(
            p.study, model, states, State, lambda steps: np.linspace(0, steps, max(frames, 1) + 1), samples=samples,
            on_sample=history.write, on_frame=on_frame, enter=enter, label=p.study, progress=progress,
        )  # fmt: skip
    energy = model.energies()
    heard += doubts(model, energy) if outcome.stable else []
    for words in heard:
        print(f"Warning: {words}", file=sys.stderr)
    done = Finished(p, model, {}, outcome, states)
    if figures and outcome.stable:
        with watch.phase("output"):
            from studies import lab_figures

            lab_figures.draw(done, folder)
    done.summary = summarise(done, watch, energy, heard)
    output.write_json(folder / "summary.json", done.summary)
    if outcome.stable:
        runs.finished()
    return done


def write_fields(series: dict[str, output.Series], s: State) -> None:
    """Add a state to the ParaView series."""
    count, axes = s.positions.shape
    data = {"radius": s.radii, "fluctuation": s.fluctuation, "rotation": s.rotation}
    series["particles"].write(s.time, s.positions, ("vertex", np.arange(count)[:, None]), data)
    lines = np.arange(2 * len(s.ends)).reshape(-1, 2)
    forces = {"normal_force": s.normal_force, "tangential_force": s.tangential_force}
    series["contacts"].write(s.time, s.ends.reshape(-1, axes), ("line", lines), None, forces)


def doubts(model: ElementTest, energy: dict[str, float]) -> list[str]:
    """What a run has to say against itself."""
    p, found = model.parameters, []
    if not model.settled:
        found.append("the isotropic compression did not come to rest at the confining stress")
    if p.inertial_number > LARGEST_INERTIA:
        found.append(
            f"inertial_number={p.inertial_number:g} is above {LARGEST_INERTIA:g}: the test is not quasi-static"
        )
    error = abs(energy["balance"] / energy["external_work"])
    if not error <= LARGEST_ERROR:
        found.append(f"the energy balance is off by {100 * error:.1f} % of the work of the cell; take a smaller step_ratio")
    return found


def results(done: Finished) -> dict[str, tuple[float, str]]:
    """Named numbers with their units."""
    p, outcome, model = done.parameters, done.outcome, done.model
    strain = outcome.column("shear_strain" if p.study == "shear" else "axial_strain")
    ratio, volume = outcome.column("stress_ratio"), outcome.column("volumetric_strain")
    angle = outcome.column("friction_angle_deg")
    peak, end = int(np.argmax(ratio)), strain >= (1.0 - END) * strain[-1]
    values = {
        "friction_angle_peak": (angle[peak], "deg"), "friction_angle_end": (angle[end].mean(), "deg"),
        "stress_ratio_peak": (ratio[peak], "1"), "stress_ratio_end": (ratio[end].mean(), "1"),
        "strain_peak": (strain[peak], "1"), "volumetric_strain_end": (volume[-1], "1"),
        "volumetric_strain_min": (volume.min(), "1"), "dilatancy_angle": (dilatancy_angle(p, strain, volume), "deg"),
        "porosity_isotropic": (model.isotropic["porosity"], "1"), "porosity_end": (outcome.history[-1]["porosity"], "1"),
        "coordination_isotropic": (model.isotropic["coordination"], "1"),
        "coordination_end": (outcome.column("coordination")[end].mean(), "1"),
        "inertial_number": (p.inertial_number, "1"),
    }  # fmt: skip
    if model.probe is not None:
        young, poisson = fitted_moduli(model.probe)
        values |= {
            "deviator_stress_peak": (outcome.column("deviator_stress_Pa").max(), "Pa"), "young_modulus": (young, "Pa"),
            "poisson_ratio": (poisson, "1"), "young_modulus_voigt": (model.voigt[0], "Pa"),
            "poisson_ratio_voigt": (model.voigt[1], "1"),
        }  # fmt: skip
    held = "normal_stress_Pa" if p.study == "shear" else "lateral_stress_Pa"
    return values | {"held_stress_error": (np.abs(outcome.column(held) / p.pressure - 1.0).max(), "1")}


def dilatancy_angle(p: Parameters, strain: np.ndarray, volume: np.ndarray) -> float:
    """Angle of dilatancy (deg) where the packing dilates fastest, by least squares over a window of a tenth of the strain.

    Simple shear: tan psi = d eps_v / d gamma. Plane compression: sin psi = (d eps_v) / (2 d eps_1 + d eps_v); in space
    sin psi = d eps_v / (2 d eps_1 + d eps_v) as well (Schanz & Vermeer 1996), eps_1 positive in compression, eps_v in
    dilation.
    """
    steepest = 0.0
    for start in range(len(strain)):
        window = (strain >= strain[start]) & (strain <= strain[start] + 0.1 * strain[-1])
        if strain[start] + 0.1 * strain[-1] > strain[-1] or window.sum() < 3:
            break
        steepest = max(steepest, float(np.polyfit(strain[window], volume[window], 1)[0]))
    return float(np.degrees(np.arctan(steepest) if p.study == "shear" else np.arcsin(steepest / (2.0 + steepest))))


def summarise(done: Finished, watch: Stopwatch, energy: dict[str, float], heard: list[str]) -> dict[str, Any]:
    """The content of summary.json."""
    p, model, outcome = done.parameters, done.model, done.outcome
    stepping = watch.seconds["stepping"]
    found = results(done) if len(outcome.history) > 2 else {}
    return {
        "study": p.study, "method": "dem", "seed": p.seed,
        "parameters": asdict(p) | {"rate": p.rate, "normal_stiffness": p.normal_stiffness},
        "versions": output.versions(), "ranks": ranks(), "threads": 1,
        "counts": {"particles": model.soil.count, "contacts": len(model.soil.contacts().first), "fine_steps": outcome.steps},
        "steps": {"fine": model.step, "fine_critical": model.step / p.step_ratio},
        "seconds": watch.seconds | {"total": sum(watch.seconds.values())},
        "particle_steps_per_second": model.soil.count * outcome.steps / stepping if stepping > 0.0 else 0.0,
        "results": {name: {"value": value, "unit": unit, "published": None} for name, (value, unit) in found.items()},
        "parallel": parallel(model.soil),
        "energy": energy | {"balance_error": abs(energy["balance"] / energy["external_work"])},
        "stable": outcome.stable, "message": outcome.message, "warnings": heard,
    }  # fmt: skip
