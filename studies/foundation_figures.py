"""Pictures of a run of the foundation, after figures 3 to 12 of Li & Wan (2010)."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from studies import drawing
from studies.foundation import DEPTH, PAPER_STATES, WIDTH
from studies.foundation_run import PUBLISHED, Finished
from studies.snapshots import Snapshot

NAMES = {"dem": "particles", "bridging": "bridging scale", "overlap": "overlap", "fem": "continuum"}
COLOURS = {"dem": "#000000", "bridging": "#c1272d", "overlap": "#2e7d32", "fem": "#1f5fa8"}


class Field(NamedTuple):
    """A field that is drawn: title, factor to its unit, unit, colour map, figure of the paper."""

    title: str
    factor: float
    unit: str
    colours: str
    paper: str


FIELDS = {
    "volumetric_stress": Field("volumetric stress", 1e-6, "MPa", "YlGnBu_r", "fig 4"),
    "effective_stress": Field("effective stress", 1e-6, "MPa", "YlGnBu", "fig 5"),
    "volumetric_strain": Field("nominal volumetric strain", 1e2, "%", "RdBu", "fig 6"),
    "effective_strain": Field("nominal effective strain", 1e2, "%", "magma_r", "fig 7"),
}


def draw(done: Finished, folder: Path) -> None:
    """All figures of one run into its folder."""
    load_displacement([done], folder / "load_displacement.png")
    last = done.snapshots[-1]
    for name in FIELDS:
        state_figure([done], [last], name, folder / f"{name}.png", _whole())
    states = paper_states(done)
    if last.contacts is not None:
        contact_forces(done, states, folder / "contact_forces.png")
    velocities(done, states, folder / "velocities.png")


def draw_comparison(runs: list[Finished], folder: Path) -> None:
    """Figures that set the methods beside each other (figures 11 and 12)."""
    load_displacement(runs, folder / "load_displacement.png")
    for name in FIELDS:
        state_figure(
            runs, [run.snapshots[-1] for run in runs], name, folder / f"{name}.png", _near(runs[0]), share=True
        )


def paper_states(done: Finished) -> list[Snapshot]:
    """The snapshots nearest to 15, 38 and 60 mm (as far as the run went), each once."""
    places = np.array([s.displacement for s in done.snapshots])
    end = done.parameters.displacement
    wanted = [state for state in PAPER_STATES if state <= end + 1e-9] or [end]
    return [done.snapshots[k] for k in sorted({int(np.abs(places - state).argmin()) for state in wanted})]


def load_displacement(runs: list[Finished], path: Path) -> None:
    """Load over displacement of the plate (figures 3 and 11), with the numbers that the paper prints."""
    drawn, axes = drawing.figure(1, 1, (6.4, 4.2))
    ax = axes[0, 0]
    for run in runs:
        method = run.parameters.method
        load, moved = run.outcome.column("load_N") / 1e3, run.outcome.column("displacement_m") * 1e3
        ax.plot(moved, load, color=COLOURS[method], lw=1.6, label=_label(run))
        if method != "fem":
            peak = int(np.argmax(load))
            ax.plot(moved[peak], load[peak], "o", color=COLOURS[method], ms=5, mfc="white")
        published = PUBLISHED[method].get("load") if run.parameters.is_papers_scene else None
        if published is not None:
            ax.plot(
                60.0, published / 1e3, "D" if method == "dem" else "s", color=COLOURS[method], ms=6, mfc="none", mew=1.2,
                label=f"Li & Wan 2010, table 2: {NAMES[method]}", clip_on=False, zorder=5,
            )  # fmt: skip
    if any(run.parameters.is_papers_scene and run.parameters.method != "fem" for run in runs):
        ax.axvline(38.0, color="0.6", lw=0.9, ls=":", label="Li & Wan 2010: peak of A at 38 mm")
    particle_loads = [run.outcome.column("load_N").max() / 1e3 for run in runs if run.parameters.method != "fem"]
    if len(runs) > 1 and particle_loads:
        ax.set_ylim(0.0, 1.6 * max(particle_loads))  # the linear continuum does not yield and leaves the picture
    ax.set(xlabel="displacement of the plate (mm)", ylabel="load (kN per m)", title="Load on the plate")
    ax.set_xlim(left=0.0)
    ax.set_ylim(bottom=0.0)
    ax.grid(alpha=0.3)
    ax.legend(fontsize=8)
    drawing.save(drawn, path)


def state_figure(
    runs: list[Finished], states: list[Snapshot], name: str, path: Path, window: tuple[float, ...], share: bool = False
) -> None:
    """One field at one state of each run; `share`: one colour scale, that of the first run's particles."""
    field = FIELDS[name]
    tall = (window[3] - window[2]) / (window[1] - window[0])
    drawn, axes = drawing.figure(len(runs), 1, (7.6, 7.0 * tall + 0.6))
    scale = drawing.limits(*_values(states[0], name, window))
    if field.colours == "RdBu":
        scale = (-max(np.abs(scale)), max(np.abs(scale)))
    for ax, run, state in zip(axes[:, 0], runs, states):
        used = scale if share or len(runs) == 1 else drawing.limits(*_values(state, name, window))
        shown = paint(ax, run, state, name, used)
        drawing.place(ax, window, f"{field.title}, {_label(run)}, {1e3 * state.displacement:.3g} mm")
        drawn.colorbar(shown, ax=ax, label=f"{field.title} ({field.unit})", extend="both", fraction=0.03, pad=0.01)
    drawing.save(drawn, path)


def paint(ax: Any, run: Finished, state: Snapshot, name: str, scale: tuple[float, float]) -> Any:
    """Cells, discs and plate with one field; returns what the colour bar needs."""
    field = FIELDS[name]
    shown = None
    if state.continuum is not None:
        shown = drawing.cells(
            ax, state.continuum, field.factor * state.continuum.cell_fields[name], scale, field.colours
        )
    if state.particles is not None:
        shown = drawing.discs(ax, state.particles, field.factor * getattr(state.particles, name), scale, field.colours)
    _plate(ax, run, state)
    return shown


def contact_forces(done: Finished, states: list[Snapshot], path: Path) -> None:
    """Networks of contact forces (figure 8)."""
    window = _near(done)
    drawn, axes = drawing.figure(len(states), 1, (7.0, 4.2))
    scale = (0.0, float(np.percentile(np.concatenate([s.contacts.normal_force for s in states if s.contacts]), 99.9)))
    for ax, state in zip(axes[:, 0], states):
        if state.contacts is None:
            continue
        shown = drawing.force_network(ax, state.contacts, scale)
        _plate(ax, done, state)
        drawing.place(ax, window, f"contact forces, {_label(done)}, {1e3 * state.displacement:.3g} mm")
        bar = drawn.colorbar(shown, ax=ax, label="normal force (kN per m)", extend="max", fraction=0.03, pad=0.01)
        bar.ax.yaxis.set_major_formatter(lambda value, _: f"{value / 1e3:.0f}")
    drawing.save(drawn, path)


def velocities(done: Finished, states: list[Snapshot], path: Path) -> None:
    """Speed as colour and velocities as arrows (figure 9)."""
    window = _near(done) if states[-1].particles is not None else _whole()
    tall = (window[3] - window[2]) / (window[1] - window[0])
    drawn, axes = drawing.figure(len(states), 1, (7.6, 7.0 * tall + 0.6))
    scale = (0.0, 1.2 * done.parameters.speed)
    for ax, state in zip(axes[:, 0], states):
        arrows, shown = [], None
        if state.continuum is not None:
            c = state.continuum
            middle = (c.nodes + c.displacement[:, :2])[c.cells].mean(axis=1)
            speed = np.hypot(*c.velocity[c.cells].mean(axis=1)[:, :2].T)
            shown = drawing.cells(ax, c, speed, scale, "YlGnBu")
            arrows.append((middle, c.velocity[c.cells].mean(axis=1)[:, :2]))
        if state.particles is not None:
            q = state.particles
            shown = drawing.discs(ax, q, np.hypot(*q.velocity.T), scale, "YlGnBu")
            arrows.append(_thinned(q.positions, q.velocity, 0.25))
        for places, moving in arrows:
            ax.quiver(*places.T, *moving.T, angles="xy", scale_units="xy", scale=3.0 * done.parameters.speed,
                      width=0.0016, color="k", zorder=3)  # fmt: skip
        _plate(ax, done, state)
        drawing.place(ax, window, f"velocities, {_label(done)}, {1e3 * state.displacement:.3g} mm")
        drawn.colorbar(shown, ax=ax, label="speed (m/s)", extend="max", fraction=0.03, pad=0.01)
    drawing.save(drawn, path)


def _thinned(places: np.ndarray, vectors: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Mean places and vectors of the cells of a square grid."""
    _, group = np.unique(np.floor(places / spacing).astype(int), axis=0, return_inverse=True)
    group = group.ravel()
    count = np.bincount(group)[:, None]
    return tuple(  # type: ignore[return-value]
        np.column_stack([np.bincount(group, column) for column in values.T]) / count for values in (places, vectors)
    )


def _values(state: Snapshot, name: str, window: tuple[float, ...]) -> list[np.ndarray]:
    """Values that decide the colour scale: those in the window, of the particles where there are any."""
    factor = FIELDS[name].factor
    if state.particles is None:
        return [] if state.continuum is None else [factor * state.continuum.cell_fields[name]]
    x, y = state.particles.positions.T
    inside = (x > window[0]) & (x < window[1]) & (y > window[2]) & (y < window[3])
    return [factor * getattr(state.particles, name)[inside]]


def _whole() -> tuple[float, ...]:
    return (-0.1, WIDTH + 0.1, -0.1, DEPTH + 0.5)


def _near(done: Finished) -> tuple[float, ...]:
    middle = done.parameters.plate_position
    return (max(-0.1, middle - 4.5), min(WIDTH + 0.1, middle + 4.5), DEPTH - 4.5, DEPTH + 0.4)


def _plate(ax: Any, run: Finished, state: Snapshot) -> None:
    p = run.parameters
    drawing.plate(ax, p.plate_position, p.plate_width, DEPTH - state.displacement)


def _label(run: Finished) -> str:
    p = run.parameters
    if p.method == "fem":
        return f"continuum ({p.moduli} moduli)"
    discs = f"assembly {p.assembly}" if p.radius is None else f"discs of {p.radius:g} m"
    region = f", region {p.region} m" if p.method in ("bridging", "overlap") else ""
    return f"{NAMES[p.method]}, {discs}{region}"
