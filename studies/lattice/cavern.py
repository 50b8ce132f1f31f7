"""A blast in a cavern (Zhao et al. 2012, section 4.5): pressure on its walls, waves that leave through absorbing faces."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from studies.options import NOT_NEGATIVE, POSITIVE, check, parameter

TITLE = "A blast in a cavern: particles near the walls, continuum outside, absorbing faces"
HELP = (
    "Plane strain. A triangular pressure acts on the walls of a chamber in the middle of the rock. Particles round the chamber, one "
    "layer of manifold elements and continuum outside, against particles alone: velocity above the chamber."
)
MODELS = ("layers", "particles")


@dataclass(frozen=True)
class Parameters:
    """Parameters of the study."""

    width: float = parameter(80.0, "Width of the rock.", "m", POSITIVE)
    height: float = parameter(60.0, "Height of the rock.", "m", POSITIVE)
    chamber_width: float = parameter(4.0, "Width of the chamber.", "m", POSITIVE)
    chamber_height: float = parameter(2.0, "Height of the chamber.", "m", POSITIVE)
    zone: float = parameter(4.0, "Width of the particles' part round the chamber.", "m", POSITIVE)
    spacing: float = parameter(0.25, "Spacing of the particles.", "m", POSITIVE)
    per_element: int = parameter(4, "Particles along the edge of an element.", "", POSITIVE, limits=(1, 50))
    mass: str = parameter("higher-order", "Mass of elements.", choices=("higher-order", "lumped"))
    young_modulus: float = parameter(74e9, "Young's modulus E.", "Pa", POSITIVE)
    poisson_ratio: float = parameter(0.25, "Poisson's ratio.", "-", NOT_NEGATIVE, limits=(0, 0.45))
    density: float = parameter(2650.0, "Density.", "kg/m3", POSITIVE)
    pressure: float = parameter(30.23e6, "Peak of the pressure.", "Pa", POSITIVE)
    rise: float = parameter(0.5e-3, "Rise of the pressure.", "s", POSITIVE)
    total: float = parameter(2.5e-3, "End of the pressure.", "s", POSITIVE)
    above: float = parameter(8.0, "Height of the point that is followed above the middle of the chamber.", "m", POSITIVE)
    duration: float = parameter(8e-3, "Time that is followed.", "s", POSITIVE)

    def __post_init__(self) -> None:
        check(self)
        edge = self.per_element * self.spacing
        for name in ("width", "height"):
            share = getattr(self, name) / edge
            if abs(share - round(share)) > 1e-6 or round(share) < 1:
                raise ValueError(f"{name}={getattr(self, name):g} must be a multiple of an element's edge, {edge:g} m")
        if not self.rise < self.total:
            raise ValueError(f"rise={self.rise:g} must be less than total={self.total:g} s")
        if not self.above < 0.5 * self.height:
            raise ValueError(f"above={self.above:g} must be less than half of height={self.height:g} m")

    @property
    def wave_speed(self) -> float:
        """Of compression waves, m/s."""
        nu = self.poisson_ratio
        return math.sqrt(self.young_modulus * (1 - nu) / ((1 + nu) * (1 - 2 * nu)) / self.density)


def make(p: Parameters, name: str) -> Any:
    """One of the models."""
    from bridge.manifold import Manifold
    from meshes import Box
    from particles.lattice import LatticeMaterial
    from studies.lattice.blast import slab, surround, triangle
    from studies.lattice.common import Body

    d, x0, y0 = p.spacing, 0.5 * p.width, 0.5 * p.height
    material = LatticeMaterial(p.young_modulus, p.poisson_ratio, p.density)
    half = 0.5 * p.chamber_width, 0.5 * p.chamber_height
    chamber = Box((x0 - half[0], y0 - half[1]), (x0 + half[0], y0 + half[1]))
    rock = slab(Box((0, 0), (p.width, p.height)) - chamber, d, material)
    rock.pressure(Box((x0 - half[0] - d, y0 - half[1] - d, 0.0), (x0 + half[0] + d, y0 + half[1] + d, d)), p.pressure, triangle(p.rise, p.total))
    surround(rock, p.width, p.height, "lrbt")
    model: Any = rock
    if name == "layers":
        reach = half[0] + p.zone, half[1] + p.zone
        model = Manifold(
            rock, (p.per_element, p.per_element, 1), free=lambda x: (abs(x[:, 0] - x0) < reach[0]) & (abs(x[:, 1] - y0) < reach[1]),
            mass=p.mass,
        )  # fmt: skip
    model.hold(lambda x: x[:, 2] > -1.0, "z")
    row = [int(abs(rock.reference[:, :2] - (x0, y0 + p.above)).sum(axis=1).argmin())]

    def follow() -> dict[str, float]:
        return {"velocity_m_per_s": float(body.motion(row)[1][0, 1])}

    body = Body(name, model, follow)
    return body


def carry_out(p: Parameters, recorder: Any, figures: bool) -> None:
    """Both models: peak velocity and arrival above the chamber."""
    import numpy as np

    from studies.lattice.blast import picture
    from studies.lattice.wave import front_time

    travel = (p.above - 0.5 * p.chamber_height) / p.wave_speed
    for name in MODELS:
        body = recorder.build(lambda n=name: make(p, n))
        outcome = recorder.run(body, math.ceil(p.duration / body.step))
        speed, times = outcome.column("velocity_m_per_s"), outcome.column("time_s")
        recorder.result(f"peak_velocity_{name}", float(speed.max()), "m/s")
        recorder.result(f"arrival_{name}", front_time(times, speed, 0.02 * speed.max()), "s", travel)
        recorder.result(f"seconds_{name}", recorder.seconds[name], "s")
    layers, particles = (recorder.outcomes[name] for name in MODELS)
    times = particles.column("time_s")
    other = np.interp(times, layers.column("time_s"), layers.column("velocity_m_per_s"))
    wanted = particles.column("velocity_m_per_s")
    recorder.result("largest_difference_of_velocities", float(np.abs(other - wanted).max() / np.abs(wanted).max()), "1")
    recorder.result("time_share", recorder.seconds["layers"] / recorder.seconds["particles"], "1")
    if figures:
        picture(recorder, recorder.folder / "field.png", "speed", 0.5 * float(np.abs(wanted).max()), "speed (m/s)")
        draw(p, recorder.outcomes, recorder.folder / "velocity.png")


def draw(p: Parameters, outcomes: Any, path: Any) -> None:
    """Velocity above the chamber (as figure 23)."""
    from studies import drawing

    drawn, axes = drawing.figure(1, 1, (5.5, 3.4))
    ax = axes[0, 0]
    for (name, outcome), style in zip(outcomes.items(), ("-", "--")):
        ax.plot(1e3 * outcome.column("time_s"), outcome.column("velocity_m_per_s"), style, label=name)
    ax.axvline(1e3 * (p.above - 0.5 * p.chamber_height) / p.wave_speed, color="0.6", lw=0.8)
    ax.set(xlabel="time (ms)", ylabel=f"vertical velocity {p.above:g} m above the middle (m/s)")
    ax.grid(alpha=0.3)
    ax.legend(fontsize=8)
    drawing.save(drawn, path)
