"""A cantilever under a transverse traction (Zhao et al. 2012, section 4.2): three layers against Hex8."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from studies.options import NOT_NEGATIVE, POSITIVE, check, parameter

TITLE = "A cantilever of particles, manifold elements and continuum against Hex8"
HELP = (
    "A bar is fixed at one end and loaded across at the other. Its fixed half is continuum, its loaded half particles, with manifold "
    "elements between. Displacements along two lines are compared with those of a mesh of Hex8. The published spacing is 0.25 mm."
)
LINES = (0.2375, 0.7375)  # of the width: where the lines run


@dataclass(frozen=True)
class Parameters:
    """Parameters of the study."""

    width: float = parameter(0.01, "Width and depth of the bar.", "m", POSITIVE)
    length: float = parameter(0.02, "Length of the bar.", "m", POSITIVE)
    spacing: float = parameter(0.0005, "Spacing of the particles.", "m", POSITIVE)
    per_element: int = parameter(4, "Particles along the edge of an element.", "", POSITIVE, limits=(1, 50))
    reference: int = parameter(10, "Elements of the reference across the bar; twice as short along it.", "", POSITIVE, limits=(2, 20))
    young_modulus: float = parameter(12.5e9, "Young's modulus E.", "Pa", POSITIVE)
    poisson_ratio: float = parameter(0.3, "Poisson's ratio.", "-", NOT_NEGATIVE, limits=(0, 0.45))
    density: float = parameter(2650.0, "Density.", "kg/m3", POSITIVE)
    traction: float = parameter(1e6, "Traction across the loaded end.", "Pa", POSITIVE)
    steps: int = parameter(30000, "Most steps to the equilibrium.", "", POSITIVE)

    def __post_init__(self) -> None:
        check(self)
        edge = self.per_element * self.spacing
        for name in ("width", "length"):
            share = getattr(self, name) / edge
            if abs(share - round(share)) > 1e-6 or round(share) < 2:
                raise ValueError(f"{name}={getattr(self, name):g} must be a multiple of an element's edge, {edge:g} m, two at least")


def make(p: Parameters) -> Any:
    """The bar: continuum, manifold elements, particles."""
    from bridge.manifold import Manifold
    from meshes import Box, packings
    from particles.lattice import Lattice, LatticeMaterial
    from studies.lattice.common import Body

    d = p.spacing
    material = LatticeMaterial(p.young_modulus, p.poisson_ratio, p.density)
    bar = Lattice(packings.simple_cubic(Box((0, 0, 0), (p.width, p.width, p.length)), 0.5 * d), d, material, local_damping=0.8)
    half = 0.5 * p.length
    model = Manifold(bar, p.per_element, free=lambda x: x[:, 2] > half)
    model.hold(lambda x: x[:, 2] < 0.25 * d, "xyz")
    bar.traction(lambda x: x[:, 2] > p.length - 0.75 * d, (0, p.traction, 0))
    tip = bar.rows(lambda x: x[:, 2] > p.length - 0.75 * d)
    body = Body("layers", model, lambda: {"deflection_m": float(body.motion(tip)[0][:, 1].mean())})
    return body


def carry_out(p: Parameters, recorder: Any, figures: bool) -> None:
    """The coupled bar, the reference, and their difference along the lines."""
    import numpy as np

    from studies.lattice.common import at_rest
    from studies.lattice.hex8 import bar

    body = recorder.build(lambda: make(p))
    recorder.run(body, p.steps, until=at_rest(1e-6))
    x, lines = body.lattice.reference, []
    for k, share in enumerate(LINES):
        at = (int(share * p.width / p.spacing) + 0.5) * p.spacing
        row = np.flatnonzero((abs(x[:, :2] - at).max(axis=1) < 0.1 * p.spacing) & (x[:, 2] > 0.5 * p.length))
        row = row[np.argsort(x[row, 2])]
        moved = body.motion(row)[0][:, 1]
        with recorder.watch.phase("setup"):
            wanted = bar(p, p.length, p.reference, (0, p.traction, 0), x[row])[:, 1]
        recorder.result(f"largest_error_line_{k + 1}", float(np.abs(moved / wanted - 1.0).max()), "1", 0.02)
        recorder.result(f"end_deflection_line_{k + 1}", float(moved[-1]), "m", float(wanted[-1]))
        lines.append((x[row, 2], moved, wanted))
    if figures:
        draw(lines, recorder.folder / "lines.png")


def draw(lines: Any, path: Any) -> None:
    """Displacement along both lines (as figure 11)."""
    from studies import drawing

    drawn, axes = drawing.figure(1, 2, (4.4, 3.2))
    for ax, (z, moved, wanted), words in zip(axes[0], lines, ("first", "second")):
        ax.plot(1e3 * z, 1e6 * wanted, "k-", lw=1.0, label="Hex8")
        ax.plot(1e3 * z, 1e6 * moved, "o", ms=3, mfc="none", label="particles")
        ax.set(xlabel="z (mm)", ylabel="displacement (µm)", title=f"{words} line")
        ax.grid(alpha=0.3)
    axes[0, 0].legend(fontsize=8)
    drawing.save(drawn, path)
