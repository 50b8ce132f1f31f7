"""A tunnel behind a weak layer under a blast (Zhao et al. 2012, section 4.6): damage against the stiffness of the layer.

The paper does not say where tunnel and layer lie: here the tunnel is in the middle and the layer upright between it and the blast.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from studies.options import NOT_NEGATIVE, POSITIVE, SHARE, check, parameter

TITLE = "A tunnel behind a weak layer under a blast: damage against the stiffness of the layer"
HELP = (
    "Plane strain. A triangular pressure acts on a part of the left edge; an upright layer of lower stiffness lies between it and a "
    "round tunnel. Rock can fail in a zone round the tunnel, or everywhere; there elements are released where their bonds come near "
    "their limits. The same by particles alone. The published spacing is 0.125 m, 16 layers across (--slab)."
)
MODELS = ("coupled", "particles")
WHERE, MASSES = ("zone", "everywhere"), ("higher-order", "lumped")


@dataclass(frozen=True)
class Parameters:
    """Parameters of the study."""

    size: float = parameter(50.0, "Width and height of the rock.", "m", POSITIVE)
    spacing: float = parameter(0.25, "Spacing of the particles.", "m", POSITIVE)
    per_element: int = parameter(4, "Particles along the edge of an element.", "", POSITIVE, limits=(1, 50))
    radius: float = parameter(2.5, "Radius of the tunnel.", "m", POSITIVE)
    slab: int = parameter(1, "Layers of particles across, which repeat.", "", POSITIVE, limits=(1, 64))
    zone: float = parameter(22.0, "Width of the zone round the tunnel; published are half a million particles of 2.56 million.", "m", POSITIVE)
    fails: str = parameter("zone", "Where bonds break: in the zone, or everywhere, with release.", choices=WHERE)
    mass: str = parameter("higher-order", "Mass of elements.", choices=MASSES)
    layer_start: float = parameter(14.0, "Where the weak layer begins.", "m", POSITIVE)
    layer_end: float = parameter(16.0, "Where it ends.", "m", POSITIVE)
    ratios: str = parameter("1,0.5,0.1,0.01", "Stiffness of the layer, shares of the rock's (models I to IV).")
    young_modulus: float = parameter(74e9, "Young's modulus E.", "Pa", POSITIVE)
    poisson_ratio: float = parameter(0.2, "Poisson's ratio.", "-", NOT_NEGATIVE, limits=(0, 0.25))
    density: float = parameter(2650.0, "Density.", "kg/m3", POSITIVE)
    pressure: float = parameter(30.23e6, "Peak of the pressure.", "Pa", POSITIVE)
    rise: float = parameter(0.5e-3, "Rise of the pressure.", "s", POSITIVE)
    total: float = parameter(2.5e-3, "End of the pressure.", "s", POSITIVE)
    ultimate_strain: float = parameter(2e-5, "Deformation over length of an axial bond at which bonds break.", "-", POSITIVE)
    shear_factor: float = parameter(1.0, "Limit of their shear deformation over that of their elongation.", "-", POSITIVE)
    reduction: float = parameter(0.8, "Share of it at which elements are released.", "-", SHARE)
    duration: float = parameter(15e-3, "Time that is followed.", "s", POSITIVE)
    models: str = parameter("both", "Coupled, particles alone, or both.", choices=("both", *MODELS))

    def __post_init__(self) -> None:
        check(self)
        edge = self.per_element * self.spacing
        share = self.size / edge
        if abs(share - round(share)) > 1e-6 or round(share) < 4:
            raise ValueError(f"size={self.size:g} must be a multiple of an element's edge, {edge:g} m, four at least")
        if not self.layer_start < self.layer_end < 0.5 * self.size - self.radius:
            raise ValueError(f"layer_end={self.layer_end:g} must lie between layer_start={self.layer_start:g} m and the tunnel")
        if not 2.0 * self.radius < self.zone <= self.size:
            raise ValueError(f"zone={self.zone:g} must lie between the tunnel's width, {2 * self.radius:g} m, and size={self.size:g} m")
        if self.slab > self.per_element and self.slab % self.per_element:
            raise ValueError(f"slab={self.slab} must be at most per_element={self.per_element} or a multiple of it")
        from studies.interface import numbers

        numbers("ratios", self.ratios)


def make(p: Parameters, name: str, ratio: float) -> Any:
    """One of the models."""
    import numpy as np

    from bridge.manifold import Manifold, bond_limits
    from meshes import Box, Disc
    from particles.lattice import LatticeMaterial
    from studies.lattice.blast import slab, surround, triangle
    from studies.lattice.common import Body

    d, middle, half = p.spacing, 0.5 * p.size, 0.5 * p.zone

    def near(x: Any) -> Any:
        """Inside the zone."""
        return np.abs(x[:, :2] - middle).max(axis=1) < half

    limits = p.ultimate_strain * d, p.shear_factor * p.ultimate_strain * d
    materials = [
        LatticeMaterial(share * p.young_modulus, p.poisson_ratio, p.density, *ends)
        for ends in (limits, (math.inf, math.inf)) for share in (1.0, ratio)
    ]  # fmt: skip
    body = slab(
        Box((0, 0), (p.size, p.size)) - Disc((middle, middle), p.radius), d, materials,
        layer=lambda x: (x[:, 0] > p.layer_start) & (x[:, 0] < p.layer_end) | (2 * (~near(x) & (p.fails == "zone"))), layers=p.slab,
    )  # fmt: skip
    low, high = 0.4 * p.size, 0.48 * p.size  # y = 20 to 24 m
    body.load(
        lambda x: (x[:, 0] < 0.75 * d) & (x[:, 1] > low) & (x[:, 1] < high), (p.pressure * d * d, 0, 0), triangle(p.rise, p.total)
    )
    surround(body, p.size, p.size, "rbt")
    model: Any = body
    if name == "coupled":
        per_element = (p.per_element, p.per_element, min(p.per_element, p.slab))
        walls = p.per_element * d, 2.0 * p.radius
        model = Manifold(
            body, per_element, mass=p.mass, release=bond_limits(materials[0], d, p.reduction), strain_at="particles", margin=1,
            check_every=max(1, p.per_element // 2),  # steps, in which a wave passes half an element
            within=near if p.fails == "zone" else None,
            manifold=near if p.fails == "zone" else lambda x: (x[:, 0] < walls[0]) | (np.abs(x[:, :2] - middle).sum(axis=1) < walls[1]),
        )  # fmt: skip
    model.hold(lambda x: x[:, 2] > -1.0, "z")

    def follow() -> dict[str, float]:
        return {"released_1": float(getattr(model, "released", 0))}

    return Body(f"{name}_{ratio:g}", model, follow)


def carry_out(p: Parameters, recorder: Any, figures: bool) -> None:
    """All stiffnesses by both models: broken bonds, released elements, seconds."""
    from studies.interface import numbers
    from studies.lattice.blast import picture

    chosen = MODELS if p.models == "both" else (p.models,)
    for ratio in numbers("ratios", p.ratios)[::-1]:
        for name in chosen:
            body = recorder.build(lambda n=name, r=ratio: make(p, n, r))
            outcome = recorder.run(body, math.ceil(p.duration / body.step))
            recorder.result(f"broken_bonds_{body.name}", outcome.history[-1]["broken_bonds_1"], "1")
            recorder.result(f"seconds_{body.name}", recorder.seconds[body.name], "s")
        if len(chosen) == 2:
            broken = [recorder.results[f"broken_bonds_{name}_{ratio:g}"]["value"] for name in MODELS]
            recorder.result(f"difference_of_broken_bonds_{ratio:g}", broken[0] / max(broken[1], 1.0) - 1.0, "1")
            seconds = [recorder.seconds[f"{name}_{ratio:g}"] for name in MODELS]
            recorder.result(f"time_share_{ratio:g}", seconds[0] / seconds[1], "1")
    if figures:
        picture(recorder, recorder.folder / "damage.png", "damage", 6.0, "broken bonds of a particle")
