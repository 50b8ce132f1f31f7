"""Pictures of rock tests: stress and cracks against strain, the broken specimen, cracks of all packings."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.collections import EllipseCollection, LineCollection

from studies import drawing
from studies.cracks import cracks
from studies.rock import Parameters
from studies.rock_run import AVERAGING, Tested

MPA = 1e-6
STRENGTH = {"ucs": "compressive_strength", "brazilian": "tensile_strength"}


def draw(done: list[Tested], folder: Path) -> None:
    """All figures into the folder of the run."""
    curves(done, folder / "curves.png")
    specimen(done[0], folder / "specimen.png")
    all_cracks(done, folder / "cracks.png")


def curves(done: list[Tested], path: Path) -> None:
    """Stress of the plates and averaged stress, number of cracks and strains of the inner volume."""
    p = done[0].model.parameters
    brazilian = p.study == "brazilian"
    drawn, axes = drawing.figure(1, 3, (4.6, 3.6))
    colours = matplotlib.colormaps["viridis"](np.linspace(0.0, 0.9, len(done)))
    for k, (one, colour) in enumerate(zip(done, colours)):
        column, first = one.outcome.column, k == 0
        strain = 100.0 * column("strain")
        stress = MPA * column("plate_stress_Pa")
        peak = one.results[STRENGTH[p.study]][0] * MPA
        axes[0, 0].plot(strain, stress, color=colour, lw=1.2, label=f"packing {one.model.seed}: {peak:.1f} MPa")
        other = -column("averaged_stress_lateral_Pa") if brazilian else column("averaged_stress_axial_Pa")
        axes[0, 0].plot(strain, MPA * other, "--", color=colour, lw=0.9, label="averaged, inner volume" if first else None)
        axes[0, 1].plot(strain, column("cracks"), color=colour, lw=1.2)
        axes[0, 2].plot(100.0 * column("inner_strain_axial"), stress, color=colour, lw=1.2, label="axial" if first else None)
        axes[0, 2].plot(100.0 * column("inner_strain_lateral"), stress, "--", color=colour, lw=0.9, label="lateral" if first else None)
    name = "2 P / (π D), MPa" if brazilian else "axial stress, MPa"
    title = "plates, and averaged lateral tension (dashed)" if brazilian else "plates, and averaged (dashed)"
    axes[0, 0].set(xlabel="approach of the plates / height, %", ylabel=name, ylim=(0.0, None), title=title)
    axes[0, 1].set(xlabel="approach of the plates / height, %", ylabel="bonds broken", ylim=(0.0, None))
    peaks = [one.outcome.history[int(np.argmax(one.outcome.column("plate_stress_Pa")))] for one in done]
    reach = 130.0 * max(abs(row[name]) for row in peaks for name in ("inner_strain_axial", "inner_strain_lateral"))
    axes[0, 2].set(xlabel="strain of the inner volume, %", ylabel=name, xlim=(-reach, reach), ylim=(0.0, None))
    for ax in axes[0]:
        ax.grid(alpha=0.3)
    axes[0, 0].legend(fontsize=7)
    axes[0, 2].legend(fontsize=7)
    drawing.save(drawn, path)


def specimen(one: Tested, path: Path) -> None:
    """One packing: averaged stress near the peak, cracks, displacement of the broken specimen."""
    p = one.model.parameters
    drawn, axes = drawing.figure(1, 3, (4.8, 4.7))
    radii = one.model.soil.radii
    highest = max(one.states, key=lambda state: state.load)
    part, word = ((0, "lateral") if p.study == "brazilian" else (1, "axial"))
    stress = MPA * highest.stress[:, part, part]
    title = f"{word} stress at {MPA * p.stress(highest.load):.0f} MPa, tension +\n(averaged over circles of {AVERAGING:g} r$_{{max}}$)"
    scale = _symmetric(stress) if p.study == "brazilian" else drawing.limits(stress)
    bar = _discs(axes[0, 0], highest.positions, radii, stress, scale, "RdBu_r" if p.study == "brazilian" else "viridis")
    drawn.colorbar(bar, ax=axes[0, 0], shrink=0.7, label="MPa")
    _place(axes[0, 0], p, title)
    later = _cracks(axes[0, 1], one)
    _place(axes[0, 1], p, f"cracks: {len(cracks(one.model.soil).time) - later} up to the peak (blue),\n{later} after it (orange)")
    last = one.states[-1]
    aside = 1e3 * last.displacement[:, 0]
    bar = _discs(axes[0, 2], last.positions, radii, aside, _symmetric(aside), "coolwarm")
    drawn.colorbar(bar, ax=axes[0, 2], shrink=0.7, label="mm")
    _place(axes[0, 2], p, "displacement to the right, at the end")
    drawing.save(drawn, path)


def all_cracks(done: list[Tested], path: Path) -> None:
    """Cracks of all packings."""
    columns = min(len(done), 5)
    drawn, axes = drawing.figure(math.ceil(len(done) / columns), columns, (3.2, 3.4))
    for ax in axes.ravel()[len(done) :]:
        ax.set_axis_off()
    for ax, one in zip(axes.ravel(), done):
        p = one.model.parameters
        _cracks(ax, one)
        _place(ax, p, f"packing {one.model.seed}: {MPA * one.results[STRENGTH[p.study]][0]:.1f} MPa")
    drawing.save(drawn, path)


def _symmetric(values: np.ndarray) -> tuple[float, float]:
    """Colour scale about zero that holds nearly all of the values."""
    most = max(map(abs, drawing.limits(values)))
    return -most, most


def _discs(ax: Any, places: np.ndarray, radii: np.ndarray, values: np.ndarray, scale: tuple[float, float], colours: str) -> Any:
    size = 2.0 * radii
    drawn = EllipseCollection(
        size, size, np.zeros(len(size)), units="x", offsets=places, offset_transform=ax.transData,
        array=np.ma.masked_invalid(values), cmap=matplotlib.colormaps[colours], linewidths=0.0,
    )  # fmt: skip
    drawn.set_clim(*scale)
    return ax.add_collection(drawn)


def _cracks(ax: Any, one: Tested) -> int:
    """Cracks over pale discs, blue up to the peak load, orange after it; returns the number of the latter."""
    soil = one.model.soil
    _discs(ax, soil.reference, soil.radii, np.zeros(soil.count), (-0.5, 5.0), "Greys")
    peak = one.outcome.history[int(np.argmax(one.outcome.column("plate_stress_Pa")))]["time_s"]
    found = cracks(one.model.soil)
    lines, later = found.lines, found.time > peak
    for part, colour in ((later, "#f08a24"), (~later, "#1f2f8f")):
        ax.add_collection(LineCollection(list(lines[part]), colors=colour, linewidths=1.3))
    return int(later.sum())


def _place(ax: Any, p: Parameters, title: str) -> None:
    half = 0.56 * p.size[0], 0.53 * p.size[1]
    drawing.place(ax, (-half[0], half[0], -half[1], half[1]), title)
