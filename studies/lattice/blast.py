"""What the studies `cavern` and `tunnel` share: plane strain, a triangular pressure, absorbing outer faces, pictures."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


def triangle(rise: float, total: float) -> Callable[[float], float]:
    """A pulse of height one that rises linearly and falls linearly to zero."""

    def history(t: float) -> float:
        if t <= 0.0 or t >= total:
            return 0.0
        return t / rise if t < rise else (total - t) / (total - rise)

    return history


def slab(region: Any, spacing: float, material: Any, layer: Any = None) -> Any:
    """One layer of the cubic lattice that repeats across the plane, without motion across: plane strain.

    Args:
        region: plane region.
        spacing: m.
        material: one, or a list that `layer` chooses from.
        layer: function of points.
    """
    import numpy as np

    from meshes import packings
    from particles.lattice import Lattice

    flat = packings.square(region, 0.5 * spacing)
    sites = np.column_stack((flat, np.full(len(flat), 0.5 * spacing)))
    return Lattice(sites, spacing, material, layer=layer, periodic="z")


def surround(body: Any, width: float, height: float, sides: str) -> None:
    """Absorbing faces at "left", "right", "bottom", "top" (first letters) of a rectangle from the origin."""
    d = body.spacing
    where = {
        "l": (lambda x: x[:, 0] < 0.75 * d, "x"), "r": (lambda x: x[:, 0] > width - 0.75 * d, "x"),
        "b": (lambda x: x[:, 1] < 0.75 * d, "y"), "t": (lambda x: x[:, 1] > height - 0.75 * d, "y"),
    }  # fmt: skip
    for side in sides:
        body.absorb(*where[side])


def picture(recorder: Any, path: Any, what: str, scale: float, label: str) -> None:
    """All bodies: speed ("speed") or broken bonds ("damage") of the particles, and elements by kind."""
    import numpy as np
    from matplotlib.collections import PolyCollection

    from bridge.manifold import Manifold
    from studies import drawing
    from studies.lattice.notch_figures import COLOURS

    drawn, axes = drawing.figure(1, len(recorder.bodies), (3.6, 3.4))
    for ax, (name, body) in zip(axes[0], recorder.bodies.items()):
        x = body.lattice.reference
        if isinstance(body.model, Manifold):
            half = 0.5 * body.model.size[:2]
            corners = body.model.centres[:, None, :2] + half * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
            faces = [COLOURS[k] for k in body.model.kind]
            ax.add_collection(PolyCollection(list(corners), facecolors=faces, edgecolors="0.8", lw=0.1))
        values = np.linalg.norm(body.motion()[1], axis=1) if what == "speed" else body.lattice.broken().astype(float)
        shown = np.ones(len(x), dtype=bool) if what == "speed" else values > 0
        points = ax.scatter(*x[shown, :2].T, c=values[shown], s=0.6, marker="s", lw=0, vmin=0, vmax=scale, cmap="inferno_r")
        ax.set(aspect="equal", title=name, xlabel="x (m)", ylabel="y (m)", xlim=(0, x[:, 0].max()), ylim=(0, x[:, 1].max()))
    drawn.colorbar(points, ax=axes[0].tolist(), label=label, shrink=0.7)
    drawing.save(drawn, path)
