"""A plate with a hole in tension (Zhao et al. 2012, section 4.2): particles round the hole against elements everywhere."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from studies.options import NOT_NEGATIVE, POSITIVE, check, parameter

TITLE = "A plate with a hole in tension: particles round the hole against manifold elements there"
HELP = (
    "The bottom is fixed, the top is pulled. Round the hole lie particles, then one layer of manifold elements, then continuum; or "
    "manifold elements in place of the particles. Displacements along the middle of the plate are compared."
)
MODELS = ("particles", "manifold")
PUBLISHED = {"particles": (9.58, 9.60, 9.62, 9.60, 9.60, 9.58), "manifold": (9.50, 9.52, 9.53, 9.53, 9.52, 9.50)}  # 1e-6 m
SHARES = (0.005, 0.105, 0.205, 0.795, 0.895, 0.995)  # of the width: the points


@dataclass(frozen=True)
class Parameters:
    """Parameters of the study."""

    width: float = parameter(0.1, "Width.", "m", POSITIVE)
    height: float = parameter(0.2, "Height.", "m", POSITIVE)
    thickness: float = parameter(0.01, "Thickness.", "m", POSITIVE)
    radius: float = parameter(0.02, "Radius of the hole.", "m", POSITIVE)
    spacing: float = parameter(0.001, "Spacing of the particles.", "m", POSITIVE)
    per_element: int = parameter(5, "Particles along the edge of an element.", "", POSITIVE, limits=(1, 50))
    young_modulus: float = parameter(12.5e9, "Young's modulus E.", "Pa", POSITIVE)
    poisson_ratio: float = parameter(0.3, "Poisson's ratio.", "-", NOT_NEGATIVE, limits=(0, 0.45))
    density: float = parameter(2650.0, "Density.", "kg/m3", POSITIVE)
    traction: float = parameter(1e6, "Pull on the top.", "Pa", POSITIVE)
    zone: float = parameter(1.5, "Half width of the particles' part, in radii of the hole.", "-", POSITIVE)
    steps: int = parameter(12000, "Most steps to the equilibrium.", "", POSITIVE)

    def __post_init__(self) -> None:
        check(self)
        edge = self.per_element * self.spacing
        for name in ("width", "height", "thickness"):
            share = getattr(self, name) / edge
            if abs(share - round(share)) > 1e-6 or round(share) < 1:
                raise ValueError(f"{name}={getattr(self, name):g} must be a multiple of an element's edge, {edge:g} m")
        if not 2.0 * self.zone * self.radius <= self.width - 2 * edge:
            raise ValueError(f"zone={self.zone:g} radii must leave an element on both sides of width={self.width:g} m")


def make(p: Parameters, name: str) -> Any:
    """One of the models."""
    from bridge.manifold import Manifold
    from meshes import Box, packings
    from meshes.regions import Cylinder
    from particles.lattice import Lattice, LatticeMaterial
    from studies.lattice.common import Body

    d = p.spacing
    material = LatticeMaterial(p.young_modulus, p.poisson_ratio, p.density)
    middle, reach = (0.5 * p.width, 0.5 * p.height), p.zone * p.radius
    region = Box((0, 0, 0), (p.width, p.height, p.thickness)) - Cylinder((*middle, -d), (*middle, p.thickness + d), p.radius)
    plate = Lattice(packings.simple_cubic(region, 0.5 * d), d, material, local_damping=0.8)
    near = Box((middle[0] - reach, middle[1] - reach, -d), (middle[0] + reach, middle[1] + reach, p.thickness + d))
    model = (
        Manifold(plate, p.per_element, free=near) if name == "particles"
        else Manifold(plate, p.per_element, manifold=near, cut="manifold")
    )  # fmt: skip
    model.hold(lambda x: x[:, 1] < 0.75 * d, "xyz")
    plate.traction(lambda x: x[:, 1] > p.height - 0.75 * d, (0, p.traction, 0))
    at = [((int(share * p.width / d) + 0.5) * d, middle[1] + 0.5 * d, (int(0.5 * p.thickness / d) + 0.5) * d) for share in SHARES]
    rows = [int(abs(plate.reference - one).sum(axis=1).argmin()) for one in at]

    def follow() -> dict[str, float]:
        moved = body.motion(rows)[0][:, 1]
        return {f"displacement_{k + 1}_m": float(one) for k, one in enumerate(moved)}

    body = Body(name, model, follow)
    return body


def carry_out(p: Parameters, recorder: Any, figures: bool) -> None:
    """Both models: displacements at the six points."""
    from studies.lattice.common import at_rest

    for name in MODELS:
        body = recorder.build(lambda n=name: make(p, n))
        outcome = recorder.run(body, p.steps, until=at_rest(1e-8))
        for k in range(len(SHARES)):
            recorder.result(f"displacement_{k + 1}_{name}", outcome.history[-1][f"displacement_{k + 1}_m"], "m", 1e-6 * PUBLISHED[name][k])
    worst = 0.0
    for k in range(len(SHARES)):
        one, two = (recorder.results[f"displacement_{k + 1}_{name}"]["value"] for name in MODELS)
        worst = max(worst, abs(one / two - 1.0))
    recorder.result("largest_difference", worst, "1", 0.0094)
    if figures:
        draw(p, recorder, recorder.folder / "displacement.png")


def draw(p: Parameters, recorder: Any, path: Any) -> None:
    """Displacement along the load over the plate, and kinds of elements."""
    from studies import drawing

    drawn, axes = drawing.figure(1, len(MODELS), (3.4, 5.0))
    for ax, (name, body) in zip(axes[0], recorder.bodies.items()):
        x = body.lattice.reference
        level = x[:, 2].min() + round(0.5 * p.thickness / p.spacing) * p.spacing
        shown = abs(x[:, 2] - level) < 0.1 * p.spacing
        moved = body.motion(shown)[0][:, 1]
        drawn_points = ax.scatter(1e3 * x[shown, 0], 1e3 * x[shown, 1], c=1e6 * moved, s=1.2, marker="s", lw=0)
        drawn.colorbar(drawn_points, ax=ax, label="displacement (µm)", shrink=0.7)
        ax.set(aspect="equal", title=name, xlabel="x (mm)", ylabel="y (mm)")
    drawing.save(drawn, path)
