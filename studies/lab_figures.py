"""Pictures of an element test: curves, the packing with its force chains, the orientation of the contacts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.patches import Polygon

from studies import drawing
from studies.lab_run import Finished, State
from studies.snapshots import ContactFields

BINS = 36  # of the contact rose, over 360 degrees


def draw(done: Finished, folder: Path) -> None:
    """All figures of one run into its folder."""
    curves(done, folder / "curves.png")
    packing(done, folder / "packing.png")
    contact_rose(done, folder / "contact_rose.png")


def curves(done: Finished, path: Path) -> None:
    """Stress ratio, volumetric strain, coordination and the share of friction in the work against strain."""
    p, outcome = done.parameters, done.outcome
    shear = p.study == "shear"
    strain = 100.0 * outcome.column("shear_strain" if shear else "axial_strain")
    name = "shear strain (%)" if shear else "axial strain (%)"
    ratio, angle = outcome.column("stress_ratio"), outcome.column("friction_angle_deg")
    drawn, axes = drawing.figure(2, 2, (4.4, 3.1), sharex=True)
    peak = int(np.argmax(ratio))
    axes[0, 0].plot(strain, ratio, "k", lw=1.2)
    axes[0, 0].plot(strain[peak], ratio[peak], "o", color="#c1272d", mfc="white",
                    label=f"peak: {ratio[peak]:.2f} at {strain[peak]:.2g} %, {angle[peak]:.1f}°")  # fmt: skip
    axes[0, 0].set(ylabel="τ / σ$_n$" if shear else "axial over lateral stress", ylim=(0.0 if shear else 1.0, None))
    axes[0, 0].legend(fontsize=8)
    axes[0, 1].plot(strain, 100.0 * outcome.column("volumetric_strain"), "k", lw=1.2)
    axes[0, 1].set(ylabel="volumetric strain (%), dilation positive")
    axes[0, 1].axhline(0.0, color="0.6", lw=0.8)
    axes[1, 0].plot(strain, angle, "k", lw=1.2)
    axes[1, 0].set(ylabel="mobilised friction angle (deg)", xlabel=name, ylim=(0.0, None))
    axes[1, 1].plot(strain, outcome.column("coordination"), "k", lw=1.2)
    axes[1, 1].set(ylabel="coordination number (no rattlers)", xlabel=name)
    for ax in axes.flat:
        ax.grid(alpha=0.3)
        ax.set_xlim(left=0.0)
    drawing.save(drawn, path)


def packing(done: Finished, path: Path) -> None:
    """First and last state: rotations (in space on a slice through the middle), and beside them the force chains."""
    first, last = done.states[0], done.states[-1]
    flat = done.parameters.axes == 2
    drawn, axes = drawing.figure(1, 3 if flat else 2, (4.6, 4.6))
    scale = drawing.limits(np.degrees(last.rotation))
    scale = (-max(np.abs(scale)), max(np.abs(scale)))
    shown: Any = None
    if flat:
        forces = (0.0, float(np.percentile(last.normal_force, 99.5)))
        _cell(axes[0, 0], first, "before loading")
        _grey(axes[0, 0], first)
        drawing.force_network(axes[0, 0], _contacts(first), forces)
        _cell(axes[0, 1], last, f"contact forces at {100 * last.strain:.3g} %")
        _grey(axes[0, 1], last)
        bar = drawing.force_network(axes[0, 1], _contacts(last), forces)
        drawn.colorbar(bar, ax=axes[0, :2], label="normal force (N per m)", fraction=0.02, pad=0.01)
        shown = _rotations(axes[0, 2], last, scale)
    else:
        for ax, one in zip(axes[0], (first, last)):
            shown = _rotations(ax, one, scale)
    drawn.colorbar(shown, ax=axes[0, -1], label="rotation (deg)", fraction=0.046, pad=0.01, extend="both")
    drawing.save(drawn, path)


def contact_rose(done: Finished, path: Path) -> None:
    """Shares of contacts, and mean normal forces, by the direction of the contact, before and after the loading.

    In space by the angle to the axis of compression, over the solid angle, so that isotropy is a circle.
    """
    drawn, axes = drawing.figure(1, 2, (4.2, 4.6), subplot_kw={"projection": "polar"})
    edges = np.linspace(0.0, 2.0 * np.pi, BINS + 1)
    middle = 0.5 * (edges[1:] + edges[:-1])
    for one, colour, name in ((done.states[0], "0.6", "before loading"), (done.states[-1], "#c1272d", "at the end")):
        branch = one.ends[:, 1] - one.ends[:, 0]
        across = branch[:, 0] if branch.shape[1] == 2 else np.hypot(branch[:, 0], branch[:, 1])
        angle = np.arctan2(branch[:, -1], across)
        # a contact has no sense of direction, and in space no side: all images of it
        images = [angle, angle + np.pi] if branch.shape[1] == 2 else [angle, angle + np.pi, np.pi - angle, -angle]
        place = np.concatenate(images) % (2.0 * np.pi)
        count = np.histogram(place, edges)[0]
        force = np.histogram(place, edges, weights=np.tile(one.normal_force, len(images)))[0] / np.maximum(count, 1)
        weight = np.ones(BINS) if branch.shape[1] == 2 else np.abs(np.cos(middle))
        density = count / count.sum() * weight.sum() / weight
        for ax, values in ((axes[0, 0], density), (axes[0, 1], force / one.normal_force.mean())):
            ax.plot(np.r_[middle, middle[0]], np.r_[values, values[0]], color=colour, lw=1.5, label=name)
    for ax, title in zip(axes[0], ("number of contacts by direction", "mean normal force by direction")):
        ax.set_title(title, pad=14)
        ax.set_ylim(bottom=0.0)
    axes[0, 0].legend(fontsize=8, loc="lower left", bbox_to_anchor=(-0.1, -0.1))
    drawing.save(drawn, path)


def _contacts(s: State) -> ContactFields:
    return ContactFields(s.ends, s.normal_force, s.tangential_force)


def _cell(ax: Any, s: State, title: str) -> None:
    """Outline of the cell (in space its section at the middle of y)."""
    m = s.matrix[[0, -1]][:, [0, -1]]
    corners = np.array([[0, 0], m[:, 0], m[:, 0] + m[:, 1], m[:, 1]])
    ax.add_patch(Polygon(corners, fill=False, lw=0.8, ec="k"))
    low, high, margin = corners.min(axis=0), corners.max(axis=0), 3.0 * s.radii.max()
    drawing.place(ax, (low[0] - margin, high[0] + margin, low[1] - margin, high[1] + margin), title)
    ax.set(ylabel="y (m)" if s.matrix.shape[0] == 2 else "z (m)")


def _discs(ax: Any, places: np.ndarray, radii: np.ndarray, **options: Any) -> Any:
    size = 2.0 * radii
    return ax.add_collection(
        EllipseCollection(size, size, np.zeros(len(size)), units="x", offsets=places, offset_transform=ax.transData,
                          **options)  # fmt: skip
    )


def _grey(ax: Any, s: State) -> None:
    _discs(ax, s.positions, s.radii, facecolor="0.92", edgecolor="0.75", linewidths=0.2)


def _rotations(ax: Any, s: State, scale: tuple[float, float]) -> Any:
    """Discs, or sections of spheres with the plane in the middle of y, by rotation; in the plane a line shows it too."""
    _cell(ax, s, f"rotation at {100 * s.strain:.3g} %")
    places, radii, turn = s.positions, s.radii, s.rotation
    if s.matrix.shape[0] == 3:
        off = places[:, 1] - 0.5 * s.matrix[1, 1]
        cut = np.abs(off) < radii
        places, radii, turn = places[cut][:, [0, 2]], np.sqrt(radii[cut] ** 2 - off[cut] ** 2), turn[cut]
    shown = _discs(ax, places, radii, array=np.degrees(turn), cmap="RdBu_r", edgecolor="0.5", linewidths=0.2)
    shown.set_clim(*scale)
    arm = radii[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
    ax.add_collection(LineCollection(list(np.stack([places, places + arm], axis=1)), colors="k", linewidths=0.25))
    return shown
