"""A pulse along a bar with restrained sides (Zhao et al. 2012, section 4.3): particles alone and with manifold elements."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from studies.options import NOT_NEGATIVE, POSITIVE, check, parameter

TITLE = "A pulse along a bar: fronts and heights in particles, manifold elements and continuum"
HELP = (
    "One end is moved with half a sine of velocity and then held, the other one is free; nothing moves across. The first half of the bar "
    "is particles, the second one particles, manifold elements, or one layer of these and continuum."
)
MODELS = ("particles", "manifold", "layers")
POINTS = (0.5, 50.5, 150.5, 199.5)  # spacings from the moved end in the published bar
LETTERS = "ABCD"
SIDES, MASSES = ("repeated", "held"), ("higher-order", "lumped")


@dataclass(frozen=True)
class Parameters:
    """Parameters of the study."""

    width: float = parameter(0.02, "Width and depth of the bar.", "m", POSITIVE)
    length: float = parameter(0.2, "Length of the bar.", "m", POSITIVE)
    spacing: float = parameter(0.001, "Spacing of the particles.", "m", POSITIVE)
    per_element: int = parameter(5, "Particles along the edge of an element.", "", POSITIVE, limits=(1, 50))
    young_modulus: float = parameter(12.5e9, "Young's modulus E.", "Pa", POSITIVE)
    poisson_ratio: float = parameter(0.3, "Poisson's ratio.", "-", NOT_NEGATIVE, limits=(0, 0.45))
    sides: str = parameter(
        "repeated", "The sides: repeated, as if more of the bar followed, or held, where the lattice lacks bonds.", choices=SIDES
    )  # fmt: skip
    mass: str = parameter("higher-order", "Mass of elements.", choices=MASSES)
    density: float = parameter(2650.0, "Density.", "kg/m3", POSITIVE)
    height: float = parameter(0.1, "Height of the pulse.", "m/s", POSITIVE)
    duration: float = parameter(1e-5, "Duration of the pulse.", "s", POSITIVE)

    def __post_init__(self) -> None:
        check(self)
        edge = self.per_element * self.spacing
        for name in ("width", "length"):
            share = getattr(self, name) / edge
            if abs(share - round(share)) > 1e-6 or round(share) < 1:
                raise ValueError(f"{name}={getattr(self, name):g} must be a multiple of an element's edge, {edge:g} m")

    @property
    def wave_speed(self) -> float:
        """Of compression waves, m/s."""
        nu = self.poisson_ratio
        return math.sqrt(self.young_modulus * (1 - nu) / ((1 + nu) * (1 - 2 * nu)) / self.density)

    def places(self) -> list[float]:
        """Distances of the four points from the moved end, m."""
        d = self.spacing
        return [d * (math.floor(share / 200.0 * self.length / d) + 0.5) for share in POINTS]


def make(p: Parameters, name: str) -> Any:
    """One of the models."""
    from bridge.manifold import Manifold
    from meshes import Box, packings
    from particles.lattice import Lattice, LatticeMaterial
    from studies.lattice.common import Body

    d = p.spacing
    material = LatticeMaterial(p.young_modulus, p.poisson_ratio, p.density)
    sites = packings.simple_cubic(Box((0, 0, 0), (p.width, p.width, p.length)), 0.5 * d)
    bar = Lattice(sites, d, material, periodic="xy" if p.sides == "repeated" else "")
    model: Any = bar
    if name != "particles":
        half = 0.5 * p.length
        model = Manifold(bar, p.per_element, free=lambda x: x[:, 2] < half, continuum=name != "manifold", mass=p.mass)
    for axis in (0, 1) if p.sides == "held" else ():
        model.hold(lambda x, a=axis: (x[:, a] < 0.75 * d) | (x[:, a] > p.width - 0.75 * d), "xy"[axis])
    model.hold(
        lambda x: x[:, 2] < 0.75 * d, "z", lambda t: p.height * math.sin(math.pi * t / p.duration) if t < p.duration else 0.0
    )
    across = d * (math.floor(0.25 * p.width / d) + 0.5)
    rows = [
        int(bar.rows(lambda x, at=z: (abs(x - (across, across, at)) < 0.25 * d).all(axis=1))[0]) for z in p.places()
    ]  # fmt: skip

    def follow() -> dict[str, float]:
        speed = body.motion(rows)[1][:, 2]
        return {f"velocity_{letter}_m_per_s": float(one) for letter, one in zip(LETTERS, speed)}

    body = Body(name, model, follow)
    return body


def carry_out(p: Parameters, recorder: Any, figures: bool) -> None:
    """All models: arrivals and heights at the four points."""
    recorder.samples = max(recorder.samples, 400)
    until = 1.3 * p.length / p.wave_speed
    for name in MODELS:
        body = recorder.build(lambda n=name: make(p, n))
        outcome = recorder.run(body, math.ceil(until / body.step))
        for letter, place in list(zip(LETTERS, p.places()))[1:]:
            speed, times = outcome.column(f"velocity_{letter}_m_per_s"), outcome.column("time_s")
            free_end = letter == "D"
            arrival = front_time(times, speed, (1.0 if free_end else 0.5) * p.height) - p.duration / 6.0  # half a sine has half its height then
            wanted = (p.length if free_end else place) - 0.5 * p.spacing  # at the free end the mean of the wave and its reflection
            recorder.result(f"arrival_{letter}_{name}", arrival, "s", wanted / p.wave_speed)
            recorder.result(f"height_{letter}_{name}", speed.max() / p.height, "1", 2.0 if free_end else 1.0)
    if figures:
        draw(p, recorder.outcomes, recorder.folder / "velocities.png")


def front_time(time: Any, values: Any, level: float) -> float:
    """When sampled values first pass a level (NaN: never)."""
    import numpy as np

    above = np.flatnonzero(values >= level)
    if len(above) == 0 or above[0] == 0:
        return math.nan
    k = above[0]
    return float(np.interp(level, values[k - 1 : k + 1], time[k - 1 : k + 1]))


def draw(p: Parameters, outcomes: Any, path: Any) -> None:
    """Velocities at the four points (as figures 15 and 16), with the exact arrivals."""
    from studies import drawing

    drawn, axes = drawing.figure(2, 2, (4.6, 2.6), sharex=True)
    for ax, letter, place in zip(axes.ravel(), LETTERS, p.places()):
        for (name, outcome), style in zip(outcomes.items(), ("-", "--", ":")):
            ax.plot(1e6 * outcome.column("time_s"), 1e3 * outcome.column(f"velocity_{letter}_m_per_s"), style, lw=1.2, label=name)
        ax.axvline(1e6 * place / p.wave_speed, color="0.6", lw=0.8)
        ax.set(title=f"{letter}, {1e3 * place:g} mm from the moved end", ylabel="velocity (mm/s)")
        ax.grid(alpha=0.3)
    axes[0, 0].legend(fontsize=7)
    for ax in axes[1]:
        ax.set_xlabel("time (µs)")
    drawing.save(drawn, path)
