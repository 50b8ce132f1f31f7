"""Pictures of the study `notch`: stages of release and crack growth, load against displacement."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.collections import PolyCollection

from bridge.manifold import CONTINUUM, MANIFOLD, PARTICLES, Manifold
from studies import drawing

COLOURS = {CONTINUUM: "#dfe6ee", MANIFOLD: "#8fb3d9", PARTICLES: "#f3ead2"}


class Stage(NamedTuple):
    """A body at one time: kinds of elements, broken bonds, what is free."""

    time: float
    kind: np.ndarray | None
    corners: np.ndarray | None  # (elements, 4, 2), m
    cracks: np.ndarray  # (particles with broken bonds, 3): x, y, number of broken bonds


def stage(body: Any) -> Stage:
    """The body as it is now."""
    broken = body.lattice.broken()
    some = broken > 0
    cracks = np.column_stack((body.lattice.reference[some, :2], broken[some]))
    if not isinstance(body.model, Manifold):
        return Stage(body.time, None, None, cracks)
    model = body.model
    half = 0.5 * model.size[:2]
    corners = model.centres[:, None, :2] + half * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    return Stage(body.time, model.kind.copy(), corners, cracks)


def draw(p: Any, outcomes: Any, stages: dict[str, list[Stage]], folder: Path) -> None:
    """All figures."""
    curves(outcomes, folder / "load.png")
    for name, seen in stages.items():
        growth(p, pick(seen), folder / f"stages_{name}.png")


def pick(seen: list[Stage], wanted: int = 6) -> list[Stage]:
    """Stages evenly spread over the growth of release and crack."""
    index = np.unique(np.linspace(0, len(seen) - 1, min(wanted, len(seen))).astype(int))
    return [seen[k] for k in index]


def curves(outcomes: Any, path: Path) -> None:
    """Load and broken bonds against the displacement of the top."""
    drawn, axes = drawing.figure(1, 2, (4.6, 3.4))
    left, right = axes[0]
    for name, outcome in outcomes.items():
        moved = 1e6 * outcome.column("displacement_m")
        left.plot(moved, outcome.column("load_N"), label=name)
        right.plot(moved, outcome.column("broken_bonds_1"), label=name)
    left.set(xlabel="displacement of the top (µm)", ylabel="load (N)")
    right.set(xlabel="displacement of the top (µm)", ylabel="broken bonds")
    for ax in (left, right):
        ax.grid(alpha=0.3)
        ax.legend(fontsize=7)
    drawing.save(drawn, path)


def growth(p: Any, seen: list[Stage], path: Path) -> None:
    """Elements by kind and broken bonds at several times (as figures 18 and 19)."""
    drawn, axes = drawing.figure(1, len(seen), (1.9, 3.8))
    for ax, one in zip(axes[0], seen):
        if one.kind is not None and one.corners is not None:
            ax.add_collection(PolyCollection(list(1e3 * one.corners), facecolors=[COLOURS[k] for k in one.kind], edgecolors="0.7", lw=0.2))
        ax.scatter(*(1e3 * one.cracks[:, :2].T), c=one.cracks[:, 2], s=1.5, cmap=matplotlib.colormaps["autumn_r"], vmin=0, vmax=9)
        ax.set(xlim=(0, 1e3 * p.width), ylim=(0, 1e3 * p.height), aspect="equal", title=f"{1e6 * one.time:.0f} µs", xlabel="x (mm)")
    axes[0, 0].set_ylabel("y (mm)")
    drawing.save(drawn, path)
