"""Pictures of the study `interface`: profiles along the strip, what passes two sections, the map of reflections."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bridge.run import Outcome
from studies import drawing
from studies.interface import Parameters
from studies.interface_model import Passage
from studies.interface_run import Profile

PARTICLES, CELLS, ZONE = "#c1272d", "#1f5fa8", "0.9"
MARKERS = "osD^vP*X"


def draw(p: Parameters, outcome: Outcome, profiles: list[Profile], passages: list[Passage], folder: Path) -> None:
    """All figures into the folder of the run."""
    along(p, profiles, folder / "profiles.png")
    passing(p, outcome, folder / "passage.png")
    if passages:
        reflections(p, passages, folder / "map.png")


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


def reflections(p: Parameters, passages: list[Passage], path: Path) -> None:
    """Reflection against the overlap: a row a pulse, a column an element size, a line a tie."""
    waves, sizes = (sorted({getattr(one.setting, name) for one in passages}) for name in ("wavelength", "element"))
    drawn, axes = drawing.figure(len(waves), len(sizes), (3.6, 2.9), sharex=True, sharey=True)
    for row, wave in zip(axes, waves):
        for ax, size in zip(row, sizes):
            here = [one for one in passages if (one.setting.wavelength, one.setting.element) == (wave, size)]
            for k, tie in enumerate(dict.fromkeys(one.setting.tie for one in here)):
                line = [(1e3 * one.setting.overlap, 100 * one.reflection) for one in here if one.setting.tie == tie]
                style = {"color": "k", "lw": 1.6} if k == 0 else {"color": f"C{k - 1}", "lw": 1.0}
                ax.plot(*zip(*line), marker=MARKERS[k % len(MARKERS)], ms=4, label=tie, **style)
            ax.axhline(100 * p.wanted, color="0.4", ls=":", lw=1.0)
            title = f"pulse {1e3 * wave:g} mm, elements {1e3 * size:g} mm: {wave / size:.3g} in a pulse"
            ax.set_title(title, fontsize=8)
            ax.set(yscale="log")
            ax.grid(alpha=0.3, which="both")
            ax.yaxis.set_major_formatter("{x:g}")
    for ax in axes[-1]:
        ax.set_xlabel("overlap (mm)")
    for ax in axes[:, 0]:
        ax.set_ylabel("reflection (%)")
    axes[0, 0].legend(fontsize=6)
    drawing.save(drawn, path)
