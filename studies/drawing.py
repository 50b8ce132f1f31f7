"""Discs, meshes and contact forces drawn with matplotlib; kept apart from what a study wants to show."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import EllipseCollection, LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from studies.snapshots import ContactFields, ContinuumFields, ParticleFields

STYLE = {"font.size": 9, "axes.titlesize": 10, "figure.dpi": 130, "axes.grid": False}
PERCENTILES = (1.0, 99.0)  # of a colour scale: single discs do not decide it


def figure(rows: int, columns: int, size: tuple[float, float], **options: Any) -> tuple[Figure, np.ndarray]:
    """Figure without a window and its axes (rows, columns); `size` in inches a panel."""
    with matplotlib.rc_context(STYLE):
        made = Figure(figsize=(size[0] * columns, size[1] * rows), layout="constrained")
        FigureCanvasAgg(made)
        return made, made.subplots(rows, columns, squeeze=False, **options)


def save(drawn: Figure, path: Path) -> None:
    """Write a PNG."""
    drawn.savefig(path, dpi=130)


def limits(*values: np.ndarray) -> tuple[float, float]:
    """Colour scale that holds nearly all of the values, zero included."""
    joined = np.concatenate([np.ravel(part) for part in values])
    joined = joined[np.isfinite(joined)]
    low, high = np.percentile(joined, PERCENTILES) if joined.size else (0.0, 1.0)
    low, high = min(low, 0.0), max(high, 0.0)
    return (float(low), float(high)) if high > low else (0.0, 1.0)


def place(axes: Any, window: Sequence[float], title: str) -> None:
    """Window (x0, x1, y0, y1) in m, equal aspect, labels."""
    axes.set(xlim=window[:2], ylim=window[2:], aspect="equal", title=title, xlabel="x (m)", ylabel="y (m)")


def plate(axes: Any, centre: float, width: float, level: float) -> None:
    """The rigid plate with its lower face at a level (m)."""
    axes.add_patch(Rectangle((centre - 0.5 * width, level), width, 0.12, facecolor="0.25", edgecolor="none", zorder=4))


def discs(axes: Any, particles: ParticleFields, values: np.ndarray, scale: tuple[float, float], colours: str) -> Any:
    """Discs coloured by values (n,), light grey where they are NaN; returns what a colour bar needs."""
    palette = matplotlib.colormaps[colours].with_extremes(bad="0.85")
    size = 2.0 * particles.radii
    drawn = EllipseCollection(
        size, size, np.zeros(len(size)), units="x", offsets=particles.positions, offset_transform=axes.transData,
        array=np.ma.masked_invalid(values), cmap=palette, linewidths=0.0,
    )  # fmt: skip
    drawn.set_clim(*scale)
    return axes.add_collection(drawn)


def cells(axes: Any, continuum: ContinuumFields, values: np.ndarray, scale: tuple[float, float], colours: str) -> Any:
    """Deformed cells coloured by values (cells,)."""
    corners = (continuum.nodes + continuum.displacement[:, :2])[continuum.cells]
    drawn = PolyCollection(
        list(corners), array=np.asarray(values), cmap=matplotlib.colormaps[colours], edgecolors="0.6", linewidths=0.3
    )
    drawn.set_clim(*scale)
    return axes.add_collection(drawn)


def force_network(axes: Any, contacts: ContactFields, scale: tuple[float, float], widest: float = 2.5) -> Any:
    """Contacts as lines, width and colour by the normal force; weak ones are left out."""
    shown = contacts.normal_force > 0.02 * scale[1]
    force = contacts.normal_force[shown]
    order = np.argsort(force)
    width = 0.15 + widest * np.minimum(force / scale[1], 1.5)
    drawn = LineCollection(
        list(contacts.ends[shown][order]), array=force[order], cmap=matplotlib.colormaps["inferno_r"],
        linewidths=width[order], capstyle="round",
    )  # fmt: skip
    drawn.set_clim(*scale)
    return axes.add_collection(drawn)
