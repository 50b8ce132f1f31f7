"""Figures of the rock cutting study."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.collections import EllipseCollection, LineCollection, PolyCollection
from matplotlib.patches import Polygon

from studies import drawing
from studies.cracks import cracks
from studies.cutting import Parameters
from studies.cutting_run import Finished, State

NAMES = {"dem": "particles", "overlap": "particles and continuum"}
COLOURS = {"dem": "#1f2f8f", "overlap": "#f08a24"}
SMOOTHED = 0.02  # of the run, the running mean of the force


def draw(done: Finished, folder: Path) -> None:
    """All figures into the folder of the run."""
    force([done], folder / "force.png")
    chosen = [done.states[round(share * (len(done.states) - 1))] for share in (1 / 3, 2 / 3, 1.0)]
    states(done, chosen, folder / "states.png")
    parts = [[done.states[k] for k in part] for part in np.array_split(np.arange(len(done.states)), 3)]
    stress(done, [max(part, key=lambda now: now.force) for part in parts], folder / "stress.png")


def force(runs: list[Finished], path: Path) -> None:
    """Cutting force (between samples, and its running mean), and broken bonds, against time."""
    drawn, axes = drawing.figure(1, 2, (6.0, 3.6))
    for done in runs:
        method, column = done.model.p.method, done.outcome.column
        time, felt = 1e3 * column("time_s"), 1e-3 * column("cutting_force_N")
        width = max(1, round(SMOOTHED * len(felt)))
        smooth = np.convolve(felt, np.full(width, 1.0 / width), mode="same")
        mean = 1e-3 * done.results["mean_cutting_force"][0]
        axes[0, 0].plot(time, felt, color=COLOURS[method], lw=0.4, alpha=0.5)
        axes[0, 0].plot(time, smooth, color=COLOURS[method], lw=1.3, label=f"{NAMES[method]}: mean {mean:.3g} kN")
        axes[0, 0].axhline(mean, color=COLOURS[method], lw=0.9, ls="--")
        axes[0, 1].plot(time, column("cracks"), color=COLOURS[method], lw=1.3, label=NAMES[method])
    axes[0, 0].set(xlabel="time, ms", ylabel="cutting force, kN per m", ylim=(0.0, None), title="work of the pick over the way of its tip")
    axes[0, 1].set(xlabel="time, ms", ylabel="bonds broken", ylim=(0.0, None))
    for ax in axes[0]:
        ax.grid(alpha=0.3)
        ax.legend(fontsize=8)
    drawing.save(drawn, path)


def states(done: Finished, chosen: list[State], path: Path) -> None:
    """What has come loose (coloured by piece), what holds (grey), cracks (black), mesh."""
    drawn, axes = drawing.figure(len(chosen), 1, (8.0, 3.3))
    found = cracks(done.model.soil)
    for ax, now in zip(axes[:, 0], chosen):
        _mesh(ax, now)
        colours = np.where(now.fragment == 0, np.nan, (now.fragment * 0.618034) % 1.0)
        _discs(ax, now, colours, (0.0, 1.0), "hsv")
        moved = found.time <= now.time
        still = moved & (now.fragment[found.pairs] == 0).all(axis=1)
        ax.add_collection(LineCollection(list(found.lines[still]), colors="black", linewidths=0.8))
        _pick(ax, now)
        drawing.place(ax, _window(done.model.p), f"{1e3 * now.time:.0f} ms: {int(moved.sum())} bonds broken, {int((now.fragment > 0).sum())} discs loose")
    drawing.save(drawn, path)


def stress(done: Finished, chosen: list[State], path: Path) -> None:
    """Mean stress of discs (averaged over circles) and cells, tension positive, when the pick presses hard."""
    drawn, axes = drawing.figure(len(chosen), 1, (8.0, 3.3))
    shown = [now.particles.volumetric_stress[now.fragment == 0] for now in chosen]
    most = 1e-6 * max(map(abs, drawing.limits(*shown)))
    for ax, now in zip(axes[:, 0], chosen):
        if now.continuum is not None:
            c = now.continuum
            corners = (c.nodes + c.displacement[:, :2])[c.cells]
            cells = PolyCollection(list(corners), array=1e-6 * c.cell_fields["volumetric_stress"], cmap=matplotlib.colormaps["RdBu_r"], linewidths=0.0)
            cells.set_clim(-most, most)
            ax.add_collection(cells)
        values = np.where(now.fragment == 0, 1e-6 * now.particles.volumetric_stress, np.nan)
        bar = _discs(ax, now, values, (-most, most), "RdBu_r")
        drawn.colorbar(bar, ax=ax, shrink=0.8, label="mean stress, MPa")
        _pick(ax, now)
        drawing.place(ax, _window(done.model.p), f"{1e3 * now.time:.0f} ms: {1e-3 * now.force:.0f} kN on the pick")
    drawing.save(drawn, path)


def _window(p: Parameters) -> tuple[float, float, float, float]:
    """The block, and some air above it."""
    width, height = p.size
    return -0.51 * width, 0.51 * width, -min(1.03 * height, 0.3 * width), 0.12 * width


def _discs(ax: Any, now: State, values: np.ndarray, scale: tuple[float, float], colours: str) -> Any:
    size = 2.0 * now.particles.radii
    palette = matplotlib.colormaps[colours].with_extremes(bad="0.8")
    drawn = EllipseCollection(
        size, size, np.zeros(len(size)), units="x", offsets=now.particles.positions, offset_transform=ax.transData,
        array=np.ma.masked_invalid(values), cmap=palette, linewidths=0.0,
    )  # fmt: skip
    drawn.set_clim(*scale)
    return ax.add_collection(drawn)


def _mesh(ax: Any, now: State) -> None:
    if now.continuum is not None:
        c = now.continuum
        corners = (c.nodes + c.displacement[:, :2])[c.cells]
        ax.add_collection(PolyCollection(list(corners), facecolors="0.95", edgecolors="0.6", linewidths=0.3))


def _pick(ax: Any, now: State) -> None:
    ax.add_patch(Polygon(now.pick, facecolor="0.25", edgecolor="none", zorder=4))
