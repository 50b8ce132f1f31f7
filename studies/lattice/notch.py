"""A notched specimen torn apart, with elements released as the crack comes (Zhao et al. 2012, section 4.4)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from studies.options import NOT_NEGATIVE, POSITIVE, SHARE, check, parameter

TITLE = "A notched specimen torn apart: elements are released as the crack comes"
HELP = (
    "The top of a plate with a notch in its side is drawn up slowly, its bottom is fixed. The body is manifold elements at free faces and "
    "round the notch, continuum elements elsewhere; manifold elements are released where the largest principal strain comes near the "
    "ultimate strain, and the crack runs through particles. The same by particles alone. With the hexagonal lattice the plate is a "
    "sheet in plane stress, of the height that whole elements have, and energies are per metre of thickness."
)
MODELS = ("release", "particles")
PLACES, FACES = ("particles", "centre"), ("manifold", "continuum")
LATTICES = ("cubic", "hexagonal")
LEAST_DROP = 0.5  # of the load, of its peak: the specimen has failed


@dataclass(frozen=True)
class Parameters:
    """Parameters of the study."""

    width: float = parameter(0.1, "Width.", "m", POSITIVE)
    height: float = parameter(0.2, "Height.", "m", POSITIVE)
    thickness: float = parameter(0.005, "Thickness.", "m", POSITIVE)
    notch: float = parameter(0.02, "Depth of the notch.", "m", POSITIVE)
    spacing: float = parameter(0.001, "Spacing of the particles.", "m", POSITIVE)
    per_element: int = parameter(5, "Particles along the edge of an element.", "", POSITIVE, limits=(1, 50))
    lattice: str = parameter("cubic", "Lattice of the particles.", choices=LATTICES)
    young_modulus: float = parameter(12.5e9, "Young's modulus E.", "Pa", POSITIVE)
    poisson_ratio: float = parameter(0.3, "Poisson's ratio.", "-", NOT_NEGATIVE, limits=(0, 0.45))
    density: float = parameter(2650.0, "Density.", "kg/m3", POSITIVE)
    ultimate_strain: float = parameter(4e-4, "Ultimate strain of the release.", "-", POSITIVE)
    reduction: float = parameter(0.8, "Share of it at which elements are released.", "-", SHARE)
    strain_at: str = parameter("particles", "Where in an element the strain is taken: at its centre or its particles.", choices=PLACES)
    margin: int = parameter(1, "Elements round an overstrained one that are released with it.", "", NOT_NEGATIVE, limits=(0, 10))
    faces: str = parameter("manifold", "Elements at free faces: as soft as the lattice there, or continuum.", choices=FACES)
    ultimate_deformation: float = parameter(5e-7, "Deformation at which bonds break.", "m", POSITIVE)
    speed: float = parameter(0.02, "Speed of the top.", "m/s", POSITIVE)
    damping: float = parameter(0.0, "Local damping alpha.", "-", NOT_NEGATIVE, limits=(0, 0.9))
    elongation: float = parameter(5e-5, "Largest displacement of the top.", "m", POSITIVE)
    models: str = parameter("both", "With release, particles alone, or both.", choices=("both", *MODELS))

    def __post_init__(self) -> None:
        check(self)
        edge = self.per_element * self.spacing
        if self.lattice == "hexagonal" and self.poisson_ratio > 1.0 / 3.0:
            raise ValueError(f"poisson_ratio={self.poisson_ratio:g} must be at most 1/3 in the hexagonal lattice (plane stress); take cubic")
        for name in ("width", "height", "thickness") if self.lattice == "cubic" else ("width",):
            share = getattr(self, name) / edge
            if abs(share - round(share)) > 1e-6 or round(share) < 1:
                raise ValueError(f"{name}={getattr(self, name):g} must be a multiple of an element's edge, {edge:g} m")
        share = self.notch / edge
        if abs(share - round(share)) > 1e-6 or round(share) < 1:
            raise ValueError(f"notch={self.notch:g} must be a multiple of an element's edge, {edge:g} m; its opening is one element")
        if not self.notch < self.width - 2 * edge:
            raise ValueError(f"notch={self.notch:g} must be less than {self.width - 2 * edge:g} m, two elements from the other side")

    @property
    def edges(self) -> tuple[float, float]:
        """Width and height of an element, m."""
        edge = self.per_element * self.spacing
        row = math.sqrt(3.0) * self.spacing  # two rows of the hexagonal lattice
        return edge, edge if self.lattice == "cubic" else max(1, round(edge / row)) * row

    @property
    def tall(self) -> float:
        """Height of the specimen, whole elements, m."""
        edge = self.edges[1]
        return max(1, round(self.height / edge)) * edge

    @property
    def middle(self) -> float:
        """Height (m) of the middle of the notch, a row of elements next to the middle of the specimen."""
        edge = self.edges[1]
        return (round(0.5 * self.tall / edge - 0.25) + 0.5) * edge

    @property
    def deep(self) -> float:
        """Thickness (m) for which forces of a sheet count; 1 in space."""
        return self.thickness if self.lattice == "hexagonal" else 1.0


def sites(p: Parameters) -> Any:
    """Places of the particles (n, axes), m."""
    import numpy as np

    from meshes import Box, packings

    d, high = p.spacing, p.edges[1]
    if p.lattice == "cubic":
        inside = packings.simple_cubic(Box((0, 0, 0), (p.width, p.height, p.thickness)), 0.5 * d)
    else:
        rise = math.sqrt(0.75) * d
        i, j = (ticks.ravel() for ticks in np.meshgrid(np.arange(round(p.width / d)), np.arange(round(p.tall / rise))))
        inside = np.column_stack(((i + 0.25 + 0.5 * (j % 2)) * d, (j + 0.5) * rise))
    return inside[~((inside[:, 0] < p.notch) & (np.abs(inside[:, 1] - p.middle) < 0.5 * high))]


def make(p: Parameters, name: str) -> Any:
    """One of the models."""
    from bridge.manifold import Manifold, ultimate_strain
    from particles.crew import ranks
    from particles.lattice import Lattice, LatticeMaterial
    from studies.lattice.common import Body

    d, (edge, high), tall = p.spacing, p.edges, p.tall
    material = LatticeMaterial(p.young_modulus, p.poisson_ratio, p.density, normal_limit=p.ultimate_deformation)
    body = Lattice(sites(p), d, material, plane="stress", local_damping=p.damping, audit=ranks() == 1)
    model: Any = body
    if name == "release":
        model = Manifold(
            body, p.per_element, manifold=lambda x: (x[:, 0] < p.notch + 3.1 * edge) & (abs(x[:, 1] - p.middle) < 3.1 * high), faces=p.faces, release=ultimate_strain(p.ultimate_strain, p.reduction),
            strain_at=p.strain_at, margin=p.margin,
        )  # fmt: skip
    ramp = 4.0 * p.height / material.wave_speed  # the speed comes smoothly, so that no wave runs ahead

    def lower(x: Any) -> Any:
        return x[:, 1] < 0.75 * d

    model.hold(lower, "xyz")
    model.hold(lambda x: x[:, 1] > tall - 0.75 * d, "xz")
    model.hold(
        lambda x: x[:, 1] > tall - 0.75 * d, "y",
        lambda t: p.speed * (math.sin(0.5 * math.pi * t / ramp) ** 2 if t < ramp else 1.0),
    )  # fmt: skip
    upper = body.rows(lambda x: x[:, 1] > tall - 0.75 * d)

    def follow() -> dict[str, float]:
        if isinstance(model, Manifold):
            load, released = model.internal_force(lower)[1], model.released
        else:
            load, released = model.internal_force()[lower(body.reference), 1].sum(), 0
        broken = body.broken() > 0
        reach = body.reference[broken, 0].max() if broken.any() else p.notch
        return {
            "displacement_m": float(wrapped.motion(upper)[0][:, 1].mean()), "load_N": float(load * p.deep), "released_1": float(released),
            "crack_tip_m": float(reach),
        }  # fmt: skip

    wrapped = Body(name, model, follow)
    return wrapped


def carry_out(p: Parameters, recorder: Any, figures: bool) -> None:
    """Both models: load against displacement, release and growth of the crack."""
    import numpy as np

    from studies.lattice.notch_figures import Stage, draw, stage

    stages: dict[str, list[Any]] = {}
    for name in MODELS if p.models == "both" else (p.models,):
        body = recorder.build(lambda n=name: make(p, n))
        ramp = 4.0 * p.height / body.lattice.materials[0].wave_speed
        steps = math.ceil((p.elongation / p.speed + 0.5 * ramp) / body.step)
        watched = _Watch(lambda b=body: stage(b))
        outcome = recorder.run(body, steps, until=watched, on_sample=watched.note, stages=watched.stages, kind=Stage)
        stages[name] = watched.stages
        load = outcome.column("load_N")
        top = int(np.argmax(load))
        recorder.result(f"failure_load_{name}", load[top], "N")
        recorder.result(f"failure_displacement_{name}", outcome.column("displacement_m")[top], "m")
        recorder.result(f"crack_tip_{name}", outcome.column("crack_tip_m")[-1], "m")
        recorder.result(f"broken_bonds_{name}", outcome.column("broken_bonds_1")[-1], "1")
        recorder.result(f"seconds_{name}", recorder.seconds[name], "s")
        if name == "release" and body.model.released:
            first = body.model.release_log[1][0]
            recorder.result("first_release_time", first, "s")
            recorder.result("released_elements", body.model.released, "1")
            recorder.result("distance_of_first_release_from_the_tip", first_release_distance(p, body), "m")
    if p.models == "both":
        one, two = (recorder.results[f"failure_load_{name}"]["value"] for name in MODELS)
        recorder.result("difference_of_failure_loads", one / two - 1.0, "1")
        one, two = (recorder.results[f"failure_displacement_{name}"]["value"] for name in MODELS)
        recorder.result("difference_of_failure_displacements", one / two - 1.0, "1")
        recorder.result("time_share", recorder.seconds["release"] / recorder.seconds["particles"], "1")
    if figures:
        draw(p, recorder.outcomes, stages, recorder.folder)


class _Watch:
    """Keeps a stage whenever elements have been released or bonds have broken, and ends the run when the load has dropped."""

    def __init__(self, look: Any) -> None:
        self._look, self._peak, self._before, self._grown = look, 0.0, -1.0, -1.0
        self.stages: list[Any] = []

    def note(self, row: dict[str, float]) -> None:
        """See a row, before it is asked about."""
        self._peak = max(self._peak, row["load_N"])
        self._before, self._grown = self._grown, row["broken_bonds_1"] + row["released_1"]

    def __call__(self, row: dict[str, float]) -> bool:
        if self._grown > self._before:
            self.stages.append(self._look())
        return row["broken_bonds_1"] > 0 and row["load_N"] < LEAST_DROP * self._peak


def first_release_distance(p: Parameters, body: Any) -> float:
    """Distance (m) of the nearest edge of the first released element from the tip of the notch."""
    import numpy as np

    first = body.model.first_released
    arm = np.abs(body.model.centres[first, :2] - (p.notch, p.middle)) - 0.5 * body.model.size[:2]
    return float(np.linalg.norm(np.maximum(arm, 0.0), axis=1).min())
