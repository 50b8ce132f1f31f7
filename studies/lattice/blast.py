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


def slab(region: Any, spacing: float, material: Any, layer: Any = None, layers: int = 1) -> Any:
    """Layers of the cubic lattice that repeat across the plane, to be held without motion across: plane strain.

    Args:
        region: plane region.
        spacing: m.
        material: one, or a list that `layer` chooses from.
        layer: function of points.
        layers: how many.
    """
    import numpy as np

    from meshes import packings
    from particles.lattice import Lattice

    flat = packings.square(region, 0.5 * spacing)
    heights = spacing * (np.arange(layers) + 0.5)
    sites = np.column_stack((np.tile(flat, (layers, 1)), np.repeat(heights, len(flat))))
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

    columns = len(recorder.bodies) // 2 if len(recorder.bodies) > 2 else len(recorder.bodies)
    drawn, axes = drawing.figure(max(1, len(recorder.bodies) // columns), columns, (3.6, 3.4))
    for ax, (name, body) in zip(axes.T.ravel(), recorder.bodies.items()):
        x = body.lattice.reference
        side = 170.0 * body.lattice.spacing / x[:, 0].max()  # of a particle, points
        if isinstance(body.model, Manifold):
            half = 0.5 * body.model.size[:2]
            corners = body.model.centres[:, None, :2] + half * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
            faces = [COLOURS[k] for k in body.model.kind]
            ax.add_collection(PolyCollection(list(corners), facecolors=faces, edgecolors="0.8", lw=0.1))
        values = np.linalg.norm(body.motion()[1], axis=1) if what == "speed" else body.lattice.broken().astype(float)
        shown = np.ones(len(x), dtype=bool) if what == "speed" else values > 0
        points = ax.scatter(*x[shown, :2].T, c=values[shown], s=side**2, marker="s", lw=0, vmin=0, vmax=scale, cmap="inferno_r")
        ax.set(aspect="equal", title=name, xlabel="x (m)", ylabel="y (m)", xlim=(0, x[:, 0].max()), ylim=(0, x[:, 1].max()))
    drawn.colorbar(points, ax=axes.ravel().tolist(), label=label, shrink=0.7)
    drawing.save(drawn, path)
