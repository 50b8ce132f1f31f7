"""Pictures of the study `interface`: profiles along the strip, what passes two sections, the map of reflections."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bridge.run import Outcome
from studies import drawing
from studies.interface import Parameters
from studies.interface_model import Passage
from studies.interface_run import Profile

PARTICLES, CELLS, ZONE = "#c1272d", "#1f5fa8", "0.9"
MARKERS = "osD^vP*X"
FLOOR = 1e-5  # least reflection that is drawn


def draw(p: Parameters, outcome: Outcome, profiles: list[Profile], passages: list[Passage], folder: Path) -> None:
    """All figures into the folder of the run."""
    along(p, profiles, folder / "profiles.png")
    passing(p, outcome, folder / "passage.png")
    for name, axis in AXES.items():
        if len({_of(one, name) for one in passages} - {0.0}) > 1 or (passages and name == "overlap"):
            reflections(p, passages, name, folder / axis.file)


def along(p: Parameters, profiles: list[Profile], path: Path) -> None:
    """Displacements along the strip at several times (as figure 19 of Rojek & Onate 2007)."""
    drawn, axes = drawing.figure(len(profiles), 1, (7.5, 1.25), sharex=True, sharey=True)
    for ax, one in zip(axes[:, 0], profiles):
        ax.axvspan(1e3 * p.inner, 1e3 * (p.inner + p.overlap), color=ZONE, label="overlap zone")
        ax.plot(1e3 * one.particle_places, one.particles / p.amplitude, color=PARTICLES, lw=1.3, label="particles")
        ax.plot(1e3 * one.node_places, one.nodes / p.amplitude, "--", color=CELLS, lw=1.3, label="cells")
        ax.text(0.99, 0.86, f"{1e6 * one.time:.1f} µs", transform=ax.transAxes, ha="right", va="top", fontsize=8)
        ax.axhline(0.0, color="0.7", lw=0.5)
        ax.set(ylabel="u / A", xlim=(0.0, 1e3 * p.length))
    axes[0, 0].legend(fontsize=7, ncols=3, loc="upper center")
    axes[-1, 0].set(xlabel="x (mm)")
    drawing.save(drawn, path)


def passing(p: Parameters, outcome: Outcome, path: Path) -> None:
    """Displacements at the two sections, and the energy by carrier, over time."""
    drawn, axes = drawing.figure(1, 2, (5.0, 3.4))
    time = 1e6 * outcome.column("time_s")
    left, right = axes[0]
    left.plot(time, outcome.column("before_m") / p.amplitude, color=PARTICLES, label="before the zone (particles)")
    left.plot(time, outcome.column("behind_m") / p.amplitude, color=CELLS, label="behind it (cells)")
    left.set(xlabel="time (µs)", ylabel="u / A", xlim=(0.0, time[-1]))
    parts = {name: outcome.column(f"{name}_J") for name in ("kinetic", "elastic", "strain", "penalty")}
    given = parts["elastic"][0]
    labels = {"kinetic": "kinetic", "elastic": "contacts", "strain": "cells", "penalty": "springs"}
    for name, values in parts.items():
        if np.abs(values).max() > 1e-6 * given:
            right.plot(time, values / given, lw=1.1, label=labels[name])
    right.plot(time, 1.0 + outcome.column("balance_J") / given, "k", lw=1.4, label="all, with losses")
    right.set(xlabel="time (µs)", ylabel="energy, share of the pulse's", xlim=(0.0, time[-1]), ylim=(0.0, 1.1))
    for ax in (left, right):
        ax.grid(alpha=0.3)
        ax.legend(fontsize=7)
    drawing.save(drawn, path)


class Axis(NamedTuple):
    """A parameter of the map that pictures go along."""

    file: str
    label: str
    factor: float  # from SI to the unit of the label
    title: str


AXES = {
    "overlap": Axis("map.png", "overlap (mm)", 1e3, "overlap {:g} mm"),
    "wavelength": Axis("map_wavelength.png", "width of the pulse (mm)", 1e3, "pulse {:g} mm"),
    "element": Axis("map_element.png", "element size (mm)", 1e3, "elements {:g} mm"),
    "penalty": Axis("map_penalty.png", "factor of the springs", 1.0, "factor {:g}"),
}


def reflections(p: Parameters, passages: list[Passage], along: str, path: Path) -> None:
    """Reflection against one of `AXES`: panels by two of the others, a line a tie; without a zone a horizontal line."""
    axis = AXES[along]
    across, down = [name for name in ("element", "wavelength", "overlap") if name != along][:2]
    columns, rows = (sorted({getattr(one.setting, name) for one in passages} - {0.0}) for name in (across, down))
    drawn, panels = drawing.figure(len(rows), len(columns), (3.6, 2.9), sharex=True, sharey=True)
    seen = [one for one in passages if one.reflection >= FLOOR]
    styles = {name: k for k, name in enumerate(dict.fromkeys(_words(one, along) for one in seen))}
    handles: dict[str, Any] = {}
    for panel_row, low in zip(panels, rows):
        for ax, high in zip(panel_row, columns):
            here = [one for one in seen if _of(one, across) in (high, 0.0) and _of(one, down) in (low, 0.0)]
            for name, k in styles.items():
                line = sorted((one for one in here if _words(one, along) == name), key=lambda one: _of(one, along))
                x, y = [axis.factor * _of(one, along) for one in line], [100 * one.reflection for one in line]
                style = {"color": f"C{k}", "lw": 1.0, "ls": "--" if line and x[0] == 0.0 else "-"}
                if line and x[0] == 0.0:
                    handles[name] = ax.axhline(y[0], **style)
                elif line:
                    (handles[name],) = ax.plot(x, y, marker=MARKERS[k % len(MARKERS)], ms=4, **style)
            ax.axhline(100 * p.wanted, color="0.4", ls=":", lw=1.0)
            ax.set_title(", ".join(AXES[name].title.format(AXES[name].factor * value) for name, value in ((down, low), (across, high))), fontsize=8)
            ax.set(yscale="log", xscale="log" if along == "penalty" else "linear")
            ax.grid(alpha=0.3, which="both")
            ax.yaxis.set_major_formatter("{x:g}")
    for ax in panels[-1]:
        ax.set_xlabel(axis.label)
    for ax in panels[:, 0]:
        ax.set_ylabel("reflection (%)")
    panels[0, 0].legend(handles.values(), handles.keys(), fontsize=6)
    drawing.save(drawn, path)


def _of(one: Passage, name: str) -> float:
    """A parameter of a passage; zero where the model has none."""
    return float(getattr(one.setting, name))


def _words(one: Passage, along: str) -> str:
    """The line that a passage belongs to."""
    s = one.setting
    if along != "penalty" or not s.is_overlapping:
        return s.tie
    return f"{'springs' if s.coupling == 'penalty' else s.tie}, overlap {1e3 * s.overlap:g} mm"
