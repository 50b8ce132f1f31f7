"""A bar in tension, four ways (Zhao et al. 2012, section 4.1): particles, with manifold elements, with continuum, coupled directly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from studies.options import NOT_NEGATIVE, POSITIVE, check, parameter

TITLE = "A bar in tension: particles, manifold elements and continuum against P L / E"
HELP = (
    "A laterally free bar is fixed at its bottom and pulled at its top. The lower quarter is left to particles; above follow "
    "manifold elements, continuum elements, or both. Local damping finds the equilibrium. A mesh of Hex8 tells what the fixed "
    "bottom does to an isotropic bar."
)
MODELS = ("particles", "manifold", "direct", "layers")
PUBLISHED = {"particles": -0.0587, "manifold": -0.0587, "direct": None, "layers": -0.0328}
REFERENCE = 8  # elements across of the mesh of Hex8
LIMIT = 0.06  # of the error, Zhao et al. (2012), table 1


@dataclass(frozen=True)
class Parameters:
    """Parameters of the study."""

    width: float = parameter(0.01, "Width and depth of the bar.", "m", POSITIVE)
    length: float = parameter(0.02, "Length of the bar.", "m", POSITIVE)
    spacing: float = parameter(0.001, "Spacing of the particles.", "m", POSITIVE)
    per_element: int = parameter(5, "Particles along the edge of an element.", "", POSITIVE, limits=(1, 50))
    young_modulus: float = parameter(12.5e9, "Young's modulus E.", "Pa", POSITIVE)
    poisson_ratio: float = parameter(0.3, "Poisson's ratio.", "-", NOT_NEGATIVE, limits=(0, 0.45))
    density: float = parameter(2650.0, "Density.", "kg/m3", POSITIVE)
    traction: float = parameter(1e6, "Pull P on the top.", "Pa", POSITIVE)
    steps: int = parameter(6000, "Most steps to the equilibrium.", "", POSITIVE)

    def __post_init__(self) -> None:
        check(self)
        edge = self.per_element * self.spacing
        for name in ("width", "length"):
            share = getattr(self, name) / edge
            if abs(share - round(share)) > 1e-6 or round(share) < 1:
                raise ValueError(f"{name}={getattr(self, name):g} must be a multiple of an element's edge, {edge:g} m")
        if round(self.length / edge) < 4:
            raise ValueError(f"length={self.length:g} must be at least four elements, {4 * edge:g} m, for the three layers")


def make(p: Parameters, name: str) -> Any:
    """One of the models."""
    from bridge.manifold import Manifold
    from meshes import Box, packings
    from particles.lattice import Lattice, LatticeMaterial
    from studies.lattice.common import Body

    d = p.spacing
    material = LatticeMaterial(p.young_modulus, p.poisson_ratio, p.density)
    sites = packings.simple_cubic(Box((0, 0, 0), (p.width, p.width, p.length)), 0.5 * d)
    bar = Lattice(sites, d, material, local_damping=0.8)
    quarter = 0.25 * p.length
    model: Any = bar
    if name != "particles":
        model = Manifold(
            bar, p.per_element, free=lambda x: x[:, 2] < quarter, layers=0 if name == "direct" else 1, continuum=name != "manifold"
        )
    model.hold(lambda x: x[:, 2] < 0.75 * d, "xyz")
    bar.traction(lambda x: x[:, 2] > p.length - 0.75 * d, (0, 0, p.traction))
    ends = [bar.rows(lambda x: x[:, 2] < 0.75 * d), bar.rows(lambda x: x[:, 2] > p.length - 0.75 * d)]

    def follow() -> dict[str, float]:
        lower, upper = (body.motion(rows)[0][:, 2].mean() for rows in ends)
        return {"elongation_m": float(upper - lower)}

    body = Body(name, model, follow)
    return body


def carry_out(p: Parameters, recorder: Any, figures: bool) -> None:
    """All models, their elongations and profiles along the axis."""
    import numpy as np

    from studies.lattice.common import at_rest
    from studies.lattice.hex8 import bar

    expected = p.traction * (p.length - p.spacing) / p.young_modulus
    recorder.result("expected_elongation", expected, "m")
    with recorder.watch.phase("setup"):
        face = (np.stack(np.meshgrid(*2 * [np.arange(0.5, 10)], [0]), axis=-1) * 0.1 * p.width).reshape(-1, 3)
        face[:, 2] = p.length - p.spacing  # fixed and pulled at the centres of the end layers
        isotropic = bar(p, p.length - 0.5 * p.spacing, REFERENCE, (0, 0, p.traction), face)[:, 2].mean()
    recorder.result("error_hex8", float(isotropic) / expected - 1.0, "1")
    profiles = {}
    for name in MODELS:
        body = recorder.build(lambda n=name: make(p, n))
        outcome = recorder.run(body, p.steps, until=at_rest())
        found = outcome.history[-1]["elongation_m"]
        recorder.result(f"elongation_{name}", found, "m")
        recorder.result(f"error_{name}", found / expected - 1.0, "1", PUBLISHED[name])
        z, moved = body.lattice.reference[:, 2], body.motion()[0][:, 2]
        levels = np.unique(np.round(z / p.spacing, 3))
        profiles[name] = levels * p.spacing, np.array([moved[np.abs(z / p.spacing - level) < 0.1].mean() for level in levels])
    worst = max(abs(recorder.results[f"error_{name}"]["value"]) for name in MODELS if name != "direct")
    recorder.result("largest_error_of_those_that_should_agree", worst, "1", LIMIT)
    if figures:
        draw(p, profiles, recorder.folder / "profiles.png")


def draw(p: Parameters, profiles: Any, path: Any) -> None:
    """Displacement along the axis, and its difference from the isotropic bar."""
    from studies import drawing

    drawn, axes = drawing.figure(1, 2, (4.6, 3.4))
    left, right = axes[0]
    for name, (z, moved) in profiles.items():
        bar = p.traction * (z - z[0]) / p.young_modulus
        left.plot(1e3 * z, 1e6 * moved, label=name, lw=1.2)
        right.plot(1e3 * z, 1e6 * (moved - bar), label=name, lw=1.2)
    left.plot(1e3 * z, 1e6 * bar, "k--", lw=1.0, label="P z / E")
    left.set(xlabel="z (mm)", ylabel="displacement (µm)")
    right.set(xlabel="z (mm)", ylabel="difference from P z / E (µm)")
    for ax in (left, right):
        ax.axvspan(0, 250 * p.length, color="0.93")
        ax.grid(alpha=0.3)
    left.legend(fontsize=7)
    drawing.save(drawn, path)
