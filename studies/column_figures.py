"""Pictures of falling columns: runout against aspect ratio, states of the collapse, fronts over time."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.collections import EllipseCollection

from studies import drawing
from studies.column import GRAVITY, lube, staron_hinch
from studies.column_run import Fallen


def draw(fallen: list[Fallen], folder: Path) -> None:
    """All figures into the folder of the run."""
    runout(fallen, folder / "runout.png")
    collapse(fallen, folder / "collapse.png")
    fronts(fallen, folder / "fronts.png")


def runout(fallen: list[Fallen], path: Path) -> None:
    """Runout against aspect ratio beside the published scaling, and the profiles of the heaps."""
    drawn, axes = drawing.figure(1, 2, (5.0, 3.8))
    aspects = np.array([one.column.aspect for one in fallen])
    found = np.array([one.outcome.history[-1]["runout"] for one in fallen])
    line = np.geomspace(0.6 * aspects.min(), 1.5 * aspects.max(), 200)
    ax = axes[0, 0]
    ax.loglog(line, lube(line), color="#1f5fa8", label="sand, Lube et al. 2005: 1.2 a, 1.9 a$^{2/3}$")
    ax.loglog(line, staron_hinch(line), "--", color="0.5", label="discs that roll freely, Staron & Hinch 2005: 2.5 a, 3.25 a$^{0.7}$")
    ax.loglog(aspects, found, "o", color="#c1272d", label="here")
    ax.set(xlabel="aspect ratio a = H / L0", ylabel="runout (L - L0) / L0")
    ax.grid(alpha=0.3, which="both")
    ax.legend(fontsize=7)
    for one in fallen:
        middle, top = one.column.surface()
        width = one.column.width
        axes[0, 1].plot(middle / width, top / width, lw=1.2, label=f"a = {one.column.aspect:.2g}, {one.column.heap_angle():.0f}°")
    axes[0, 1].set(xlabel="x / L0", ylabel="height / L0", title="final heaps", xlim=(0.0, None), ylim=(0.0, None))
    axes[0, 1].grid(alpha=0.3)
    axes[0, 1].legend(fontsize=7)
    drawing.save(drawn, path)


def collapse(fallen: list[Fallen], path: Path) -> None:
    """The column in the middle of the list: states of the fall; stripes show what was layered before."""
    one = fallen[len(fallen) // 2]
    places, soil = one.places, one.column.soil
    start = places[0]
    layer = (start[:, 1] // (one.column.height / 8.0)).astype(int) % 2 + 2 * (start[:, 0] > 0.5 * one.column.width)
    right = one.column.front + 2.0 * soil.radii.max()
    chosen = np.unique(np.round(np.linspace(0, len(places) - 1, 4)).astype(int))
    tall = 1.05 * one.column.height / (1.1 * right)
    drawn, axes = drawing.figure(len(chosen), 1, (7.0, 7.0 * tall + 0.6))
    times = np.linspace(0.0, one.column.time, len(places))
    for ax, k in zip(axes[:, 0], chosen):
        _discs(ax, places[k], soil.radii, layer)
        drawing.place(ax, (0.0, 1.1 * right, 0.0, 1.05 * one.column.height), f"a = {one.column.aspect:.2g}, {times[k]:.2f} s")
        ax.axhline(0.0, color="k", lw=1.0)
    drawing.save(drawn, path)


def fronts(fallen: list[Fallen], path: Path) -> None:
    """Fronts over time, in column widths and in sqrt(H / g)."""
    drawn, axes = drawing.figure(1, 1, (5.4, 3.8))
    for one in fallen:
        time = one.outcome.column("time_s") / math.sqrt(one.column.height / GRAVITY)
        axes[0, 0].plot(time, one.outcome.column("runout"), lw=1.3, label=f"a = {one.column.aspect:.2g}")
    axes[0, 0].set(xlabel="time / sqrt(H/g)", ylabel="runout of the front (L - L0) / L0", xlim=(0.0, None), ylim=(0.0, None))
    axes[0, 0].grid(alpha=0.3)
    axes[0, 0].legend(fontsize=8)
    drawing.save(drawn, path)


def _discs(ax: Any, places: np.ndarray, radii: np.ndarray, values: np.ndarray) -> None:
    size = 2.0 * radii
    drawn = EllipseCollection(
        size, size, np.zeros(len(size)), units="x", offsets=places, offset_transform=ax.transData, array=values, cmap="tab20c",
        linewidths=0.0,
    )  # fmt: skip
    drawn.set_clim(0, 19)
    ax.add_collection(drawn)
