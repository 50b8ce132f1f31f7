"""Foundation under a rigid strip plate, by particles, by a continuum, and by both (Li & Wan 2010, section 3).

A body of soil 18 m wide and 9 m deep; its bottom is fixed, its sides are held laterally and against rotation. A rigid
plate 2 m wide is pressed into the middle of the surface at 1 m/s, to 60 mm. There is no gravity. SI units, per metre of
thickness, tension positive. Assemblies of discs: A and B, square lattices turned by 45 degrees (radius 0.05 and 0.03 m);
C, random and dense (radii 0.02 to 0.05 m).

    dem         particles everywhere
    fem         a linear Cosserat continuum everywhere
    bridging    particles in a region under the plate, the continuum elsewhere, tied by the bridging-scale method
    overlap     the same region, its rim shared with the continuum (Rojek & Onate 2007)

About 5 s (bridging, A) on one core: python -m studies foundation --help
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from studies.options import NOT_NEGATIVE, POSITIVE, SHARE, check, parameter, size_in_metres

TITLE = "Foundation under a rigid strip plate: particles, continuum and both (Li & Wan 2010)"
METHODS = ("dem", "bridging", "overlap", "fem")
COMPARED = ("dem", "bridging", "fem")  # by --compare, as in the paper
VARIANTS = ("paper", "resync", "respa", "multiplier", "subcycling")
WIDTH, DEPTH = 18.0, 9.0  # m, the soil; its surface is y = DEPTH
LATTICE_RADII = {"A": 0.05, "B": 0.03}  # m
RANDOM_RADII, POROSITY = (0.02, 0.05), 0.16  # of assembly C; m, -
PAPER_STATES = (0.015, 0.038, 0.060)  # m, plate displacements of figures 8 and 9
MOST_STEPS = 10_000_000  # of a run
TOUCH = 1.0 + 1e-9  # radii of lattice discs, so that "just touching" does not hang on rounding
LARGEST_GAP = 10.0  # between ghosts along a side of the region, in largest radii (lattices have 2.8)
ELEMENT = 40.0  # cost of an element's step in that of a disc's (0.6 us against 15 ns), for sharing them out
AVERAGING = 2.5  # stresses are averages over circles of this many largest radii (Rojek & Onate 2007)


@dataclass(frozen=True)
class Parameters:
    """Parameters of the study, SI units; what is not given by the paper says so."""

    method: str = parameter("bridging", "What computes the soil.", choices=METHODS)
    assembly: str = parameter("A", "Discs: A and B lattices, C random.", choices=("A", "B", "C"))
    radius: float | None = parameter(
        None, "Radius of the discs of a lattice, instead of the assembly's.", "m", POSITIVE,
        shown="A 0.05 m, B 0.03 m, C 0.02 to 0.05 m",
    )  # fmt: skip
    seed: int = parameter(1, "Seed of the random packing C.", "", NOT_NEGATIVE, limits=(0, 2**32 - 1))
    region: str = parameter("6x3", "Width x depth of the particles' region under the plate, in metres.", "WxD")
    mesh: str = parameter(
        "structured", "Mesh of the continuum: structured, graded (gmsh), or a .msh file of 18 m x 9 m."
    )
    element_size: float = parameter(1.0, "Size of the elements (graded: far from the plate).", "m", POSITIVE)
    moduli: str = parameter(
        "packing", "Elastic moduli of the continuum: of the packing's contacts, or as printed in the paper.",
        choices=("packing", "paper"),
    )  # fmt: skip
    variant: str = parameter("subcycling", "Form of the bridging-scale method.", choices=VARIANTS)
    overlap: float = parameter(1.0, "Width of the rim of the region that method overlap shares.", "m", POSITIVE)
    constraint: str = parameter("lagrange", "Tie of method overlap.", choices=("lagrange", "penalty"))
    speed: float = parameter(1.0, "Downward speed of the plate.", "m/s", POSITIVE)
    displacement: float = parameter(
        0.06, "Displacement of the plate at the end.", "m", POSITIVE, limits=(0, 0.5 * DEPTH)
    )
    plate_width: float = parameter(2.0, "Width of the plate.", "m", POSITIVE)
    plate_position: float = parameter(9.0, "Middle of the plate, from the left side of the soil.", "m")
    damping: float = parameter(
        175.0, "Mass damping c_m of discs and continuum (not in the paper; 175 is 0.05 sqrt(k_N/m) of assembly A).",
        "1/s", NOT_NEGATIVE, limits=(0, 1e5),
    )  # fmt: skip
    step: float | None = parameter(
        None, "Time step of the particles (of the continuum where it is alone).", "s", POSITIVE, shown="step-ratio of the critical step"
    )
    step_ratio: float = parameter(0.5, "Default step as a share of the critical step (a rigorous bound).", "-", SHARE)
    substeps: int | None = parameter(
        None, "Particle steps in a step of the continuum.", "-", POSITIVE, limits=(1, MOST_STEPS),
        shown="as many as half the continuum's critical step holds",
    )  # fmt: skip
    density: float = parameter(2600.0, "Density of the discs.", "kg/m3", POSITIVE, limits=(1, 1e5))
    normal_stiffness: float = parameter(
        2.5e8, "Normal stiffness k_N of a contact.", "N/m", POSITIVE, limits=(1e3, 1e15)
    )
    sliding_stiffness: float = parameter(5.0e7, "Sliding stiffness k_s.", "N/m", NOT_NEGATIVE, limits=(0, 1e15))
    rolling_stiffness: float = parameter(
        1.0e6, "Stiffness k_r of the rolling force.", "N/m", NOT_NEGATIVE, limits=(0, 1e15)
    )
    moment_stiffness: float = parameter(
        7.0e2, "Stiffness k_w of the rolling moment.", "N m/rad", NOT_NEGATIVE, limits=(0, 1e15)
    )
    sliding_friction: float = parameter(0.5, "Friction coefficient of sliding.", "-", NOT_NEGATIVE)
    rolling_friction: float = parameter(0.05, "Friction coefficient of the rolling force.", "-", NOT_NEGATIVE)
    moment_friction: float = parameter(0.5e-3, "Friction coefficient of the rolling moment.", "m", NOT_NEGATIVE)

    def __post_init__(self) -> None:
        check(self)
        width, depth = size_in_metres("region", self.region)
        if self.plate_width >= WIDTH:
            raise ValueError(f"plate_width={self.plate_width} puts the plate outside the soil of {WIDTH:g} m")
        half = 0.5 * self.plate_width
        if not (half <= self.plate_position <= WIDTH - half):  # NaN ends here too
            raise ValueError(
                f"plate_position={self.plate_position} puts the plate of {self.plate_width:g} m outside the soil; it must "
                f"lie between {half:g} and {WIDTH - half:g} m"
            )
        if self.radius is not None:
            if self.assembly == "C":
                raise ValueError(f"radius={self.radius} is for lattices; assembly C has radii of 0.02 to 0.05 m")
            if not 0.005 <= self.radius <= 0.5:
                raise ValueError(f"radius={self.radius} must lie between 0.005 and 0.5 m")
        if not 0.05 <= self.element_size <= DEPTH:
            raise ValueError(f"element_size={self.element_size} must lie between 0.05 and {DEPTH:g} m")
        if self.mesh not in ("structured", "graded") and not Path(self.mesh).is_file():
            raise ValueError(f"mesh={self.mesh} must be structured, graded or an existing .msh file")
        if self.mesh == "graded" and self.plate_position != 0.5 * WIDTH:
            raise ValueError(f"plate_position={self.plate_position} must be {0.5 * WIDTH:g} m with mesh=graded")
        if self.method not in ("bridging", "overlap"):
            return
        left = self.plate_position - 0.5 * width
        if not (0.0 < left and left + width < WIDTH and depth < DEPTH):
            raise ValueError(
                f"region={self.region} at the plate must lie inside the mesh of {WIDTH:g} m x {DEPTH:g} m, with elements "
                "around it"
            )
        if not (left <= self.plate_position - half and self.plate_position + half <= left + width):
            raise ValueError(f"region={self.region} must be at least as wide as the plate of {self.plate_width:g} m")
        if self.method == "overlap" and not self.overlap < min(depth, 0.5 * width):
            raise ValueError(
                f"overlap={self.overlap:g} must be below {min(depth, 0.5 * width):g} m, so that region={self.region} has a part of "
                "particles alone"
            )

    @property
    def lattice_radius(self) -> float | None:
        """Radius of the discs of a lattice, None for assembly C."""
        return LATTICE_RADII.get(self.assembly) if self.radius is None else self.radius

    @property
    def duration(self) -> float:
        """Seconds until the plate has its displacement."""
        return self.displacement / self.speed

    @property
    def is_papers_scene(self) -> bool:
        """Whether the paper's numbers may stand beside the results: assembly A, loaded as in the paper."""
        same = ("assembly", "speed", "displacement", "plate_width", "plate_position", "density", "normal_stiffness",
                "sliding_stiffness", "rolling_stiffness", "moment_stiffness", "sliding_friction", "rolling_friction",
                "moment_friction")  # fmt: skip
        return self.radius in (None, 0.05) and all(getattr(self, name) == getattr(Parameters, name) for name in same)


# The scene -------------------------------------------------------------------------------------------------------------


def soil_region() -> Any:
    """The soil."""
    from meshes import Box

    return Box((0.0, 0.0), (WIDTH, DEPTH))


def particle_region(p: Parameters) -> Any:
    """The particles' region at the plate; it reaches above the surface, so that the surface is no interface."""
    from meshes import Box

    width, depth = size_in_metres("region", p.region)
    left = p.plate_position - 0.5 * width
    return Box((left, DEPTH - depth), (left + width, DEPTH + 0.5))


def contact_law(p: Parameters) -> Any:
    """Table 1. Rolling over twice the reduced radius: the rolling stiffness of a contact is r^2 k_r + k_w as in eq 24."""
    from particles import LiChu

    return LiChu(
        p.normal_stiffness, p.sliding_stiffness, p.rolling_stiffness, p.moment_stiffness,
        normal_damping=0.4, sliding_damping=0.4, rolling_damping=0.4, moment_damping=0.01,
        sliding_friction=p.sliding_friction, rolling_friction=p.rolling_friction, moment_friction=p.moment_friction,
        rolling_length="twice_reduced",
    )  # fmt: skip


def sites(p: Parameters) -> tuple[np.ndarray, np.ndarray]:
    """Centres (n, 2) and radii (n,) of the discs that fill the soil; the same ones for every region."""
    from meshes import packings

    radius = p.lattice_radius
    if radius is None:
        from studies.packing_cache import random_dense

        return random_dense(((0.0, 0.0), (WIDTH, DEPTH)), RANDOM_RADII, POROSITY, p.seed)
    centres = packings.square_45(soil_region(), radius)
    return centres, np.full(len(centres), radius * TOUCH)


def smallest_radius(p: Parameters) -> float:
    """Smallest radius of the discs, m."""
    return p.lattice_radius or RANDOM_RADII[0]


def solid_fraction(p: Parameters) -> float:
    """Solid fraction of the assembly."""
    return 1.0 - POROSITY if p.lattice_radius is None else math.pi / 4.0


def plate(p: Parameters) -> Any:
    """The rigid plate, with the discs' own contact law."""
    from particles import Plate

    left, right = p.plate_position - 0.5 * p.plate_width, p.plate_position + 0.5 * p.plate_width
    return Plate.rectangle((left, DEPTH), (right, DEPTH + 0.5), velocity=(0.0, -p.speed))


def skin(p: Parameters) -> float | None:
    """Reach of the neighbour list (m): wide in a lattice, whose second neighbours are 0.8 r from contact; None = by speed."""
    return None if p.lattice_radius is None else 0.6 * p.lattice_radius


def all_particles(p: Parameters) -> Any:
    """Discs in all of the soil under the plate; the lowest ones are held, the outermost ones laterally and in rotation."""
    from particles import Assembly

    centres, radii = sites(p)
    soil = Assembly(centres, radii, p.density, contact_law(p), skin=skin(p))
    x, y = centres.T
    reach = 1.05 * radii if p.lattice_radius is None else math.sqrt(2.0) * radii  # touching / half a lattice spacing
    soil.hold(np.flatnonzero((x < reach) | (x > WIDTH - reach)), "xr")
    lowest = y < 1.05 * radii if p.lattice_radius is None else y < y.min() + 1e-3 * radii
    soil.hold(np.flatnonzero(lowest), "xyr")
    soil.add_wall(plate(p))
    return soil


def nested_particles(p: Parameters) -> tuple[Any, np.ndarray, np.ndarray]:
    """Discs of the region and the ghosts around it under the plate, mask of the ghosts, inside share of their masses."""
    from bridge import nested_layout
    from particles import Assembly

    centres, radii = sites(p)
    if not np.any(particle_region(p).distance(centres) < -1e-6 * radii):
        raise ValueError(f"region={p.region} holds no particle: take a larger region or a smaller radius")
    layout = nested_layout(centres, radii, particle_region(p))
    _check_surrounded(p, centres[layout.kept][layout.ghost], radii.max())
    soil = Assembly(centres[layout.kept], radii[layout.kept], p.density, contact_law(p), skin=skin(p))
    soil.add_wall(plate(p))
    return soil, layout.ghost, layout.share


def overlap_zone(p: Parameters) -> Any:
    """The rim of the particles' region that the continuum shares; its faces reach far above the surface."""
    from bridge import OverlapZone
    from meshes import Box

    (left, bottom), (right, top) = particle_region(p).bounds
    return OverlapZone.within(Box((left, bottom), (right, top + 2.0 * DEPTH)), p.overlap)


def overlapping_particles(p: Parameters) -> Any:
    """Discs of the region, those on its outline too, under the plate."""
    from particles import Assembly

    centres, radii = sites(p)
    kept = particle_region(p).distance(centres) <= 1e-6 * radii
    soil = Assembly(centres[kept], radii[kept], p.density, contact_law(p), skin=skin(p))
    soil.add_wall(plate(p))
    return soil


def _check_surrounded(p: Parameters, ghosts: np.ndarray, largest: float) -> None:
    """Ghosts tie the particles to the continuum: they must line the region's left, right and lower side without gaps."""
    (left, bottom), (right, top) = particle_region(p).bounds
    outline = 1e-6 * largest  # sites on it are ghosts
    sides = {
        "left of": (ghosts[:, 0] < left + outline, 1, bottom, DEPTH),
        "right of": (ghosts[:, 0] > right - outline, 1, bottom, DEPTH),
        "below": (ghosts[:, 1] < bottom + outline, 0, left, right),
    }
    for side, (there, axis, start, end) in sides.items():
        places = np.concatenate([[start], np.sort(ghosts[there, axis]), [end]])
        if not there.any() or np.diff(places).max() > LARGEST_GAP * largest:
            raise ValueError(
                f"region={p.region} leaves too few discs (ghosts) {side} the region to tie it to the continuum; make it smaller "
                "or move it away from the soil's edge"
            )


def material(p: Parameters) -> Any:
    """Cosserat continuum: moduli of a sample of the packing (Voigt sums over its contacts) or those of the paper."""
    from continuum import Cosserat, CosseratModuli
    from meshes import Box
    from particles import Assembly, measures

    density = p.density * solid_fraction(p)
    if p.moduli == "paper":
        return Cosserat(500e6, 0.2, cosserat_shear=70e6, characteristic_length=0.05, density=density)
    centres, radii = sites(p)
    largest = radii.max()
    sample = Box((6.0 - 4.0 * largest, 2.0 - 4.0 * largest), (12.0 + 4.0 * largest, 7.0 + 4.0 * largest))
    kept = sample.contains(centres)
    soil = Assembly(centres[kept], radii[kept], p.density, contact_law(p))
    ids = np.flatnonzero(Box((6.0, 2.0), (12.0, 7.0)).contains(soil.reference))
    area = math.pi * float(np.sum(soil.radii[ids] ** 2)) / solid_fraction(p)
    return CosseratModuli(*measures.moduli(soil, area, ids), density)


def element_costs(discs: np.ndarray, substeps: int) -> Any:
    """What elements cost together with the discs (n, 2) in them that step with them, in a coarse step: for `domain`."""
    from scipy.spatial import cKDTree

    def costs(corners: np.ndarray) -> np.ndarray:
        _, nearest = cKDTree(corners.mean(axis=1)).query(discs)
        return ELEMENT + substeps * np.bincount(nearest, minlength=len(corners))

    return costs


def domain(p: Parameters, comm: Any, costs: Any = None) -> Any:
    """The mesh of the soil, spread over the ranks by the elements' costs where these are given (collective)."""
    from meshes import Box, domains

    width, depth = size_in_metres("region", p.region)
    if p.mesh == "structured":
        cells = tuple(round(side / p.element_size) for side in (WIDTH, DEPTH))
        if min(cells) < 1 or max(abs(n * p.element_size - side) for n, side in zip(cells, (WIDTH, DEPTH))) > 1e-9:
            raise ValueError(f"element_size={p.element_size} must divide {WIDTH:g} m and {DEPTH:g} m (structured mesh)")
        return domains.rectangle((0.0, 0.0), (WIDTH, DEPTH), cells=cells, comm=comm, costs=costs)
    if p.mesh == "graded":
        left = p.plate_position - 0.5 * width
        inner = None
        if p.method in ("bridging", "overlap"):
            inner = Box((left, DEPTH - depth), (left + width, DEPTH))
        near = 0.25 * p.element_size
        return domains.foundation(WIDTH, DEPTH, p.plate_width, p.element_size, near, region=inner, comm=comm, costs=costs)
    found = domains.read(p.mesh, comm, costs)
    if np.abs(found.bounds - soil_region().bounds).max() > 1e-6:
        (left, bottom), (right, top) = found.bounds
        raise ValueError(
            f"mesh={p.mesh} spans ({left:g}, {bottom:g}) to ({right:g}, {top:g}) m; it must span (0, 0) to "
            f"({WIDTH:g}, {DEPTH:g}) m"
        )
    return found


def body(p: Parameters, solid: Any, comm: Any, excluded: Any = None, share: Any = None, costs: Any = None) -> Any:
    """The continuum of a material, with its supports; what is `excluded` or beyond its `share` is the particles' (collective)."""
    from continuum import Body

    soil = Body(domain(p, comm, costs), solid, excluded=excluded, share=share)
    soil.fix("left", "xr")
    soil.fix("right", "xr")
    soil.fix("bottom", "xyr")
    return soil


def under_plate(p: Parameters) -> Any:
    """Marker of points (n, 2) on the surface under the plate."""
    reach = 0.5 * p.plate_width + 1e-6
    return lambda x: (np.abs(x[:, 1] - DEPTH) < 1e-6) & (np.abs(x[:, 0] - p.plate_position) < reach)
