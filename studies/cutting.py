"""Rock cutting by a pick of a roadheader, by particles and by particles and continuum (Rojek & Onate 2007, section 8).

A block of bonded rock under a flat surface (y = 0), its sides and its bottom held. A rigid pick on an arm turns about an axis
above the block, which moves along the surface meanwhile (the swing of the boom): the pick goes in, is deepest in the middle of
the block and comes out again. There is no gravity. SI units, per metre of thickness.

    dem         discs everywhere
    overlap     discs in a region at the surface that holds the cut, an elastic continuum elsewhere and over the rim of the region

The paper gives number and radii of the discs, stiffness and friction of the pick and its motion, but neither the size of the
block nor the shape of the pick, the depth of cut or the mesh. Minutes on one core: python -m studies cutting --help
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from studies.options import NOT_NEGATIVE, POSITIVE, SHARE, check, parameter, size_in_metres

TITLE = "Rock cutting by a pick: particles, and particles with a continuum (Rojek & Onate 2007)"
METHODS = ("dem", "overlap")
RADII = 1.0e-3, 1.5e-3  # m
BLOCKS = {"small": (0.38, 0.30), "full": (0.80, 0.65)}  # m; full as many discs as published
DEPTHS = {"small": 0.008, "full": 0.03}  # m
ELEMENTS = {"small": 0.02, "full": 0.025}  # m
REGIONS = {"small": "0.34x0.06", "full": "0.68x0.14"}
CLEARANCE = 0.1e-3  # m, between pick and surface at the start
PICK_LENGTH = 0.06  # m
HELD = 1.5  # discs whose centres lie nearer to the sides and the bottom than this many largest radii


@dataclass(frozen=True)
class Parameters:
    """Parameters of the study, SI units; what the paper does not give says so."""

    method: str = parameter("overlap", "What computes the block.", choices=METHODS)
    scale: str = parameter(
        "small", "Block, cut and region: small about 20,000 discs, full as many as published (hours).", choices=("small", "full")
    )
    block: str | None = parameter(None, "Width x height of the block (free), in metres.", "WxH", shown="small 0.38x0.3, full 0.8x0.65")
    depth: float | None = parameter(
        None, "Depth of cut where it is deepest (free).", "m", POSITIVE, shown="small 0.008 m, full 0.03 m"
    )
    region: str | None = parameter(
        None, "Width x depth of the discs' region of method overlap (free), in metres.", "WxD", shown="small 0.34x0.06, full 0.68x0.14"
    )
    overlap: float = parameter(0.02, "Width of the rim of the region that is shared (free).", "m", POSITIVE)
    element_size: float | None = parameter(
        None, "Size of the elements (free); it must divide the block.", "m", POSITIVE, shown="small 0.02 m, full 0.025 m"
    )
    rotation: float = parameter(1.6204, "Angular velocity of the arm.", "rad/s", POSITIVE, limits=(1e-3, 1e3))
    arm: float = parameter(0.7, "Distance of the tip from the axis.", "m", POSITIVE, limits=(1e-3, 1e3))
    swing: float = parameter(0.2, "Speed of the axis, along the surface (direction free).", "m/s", NOT_NEGATIVE, limits=(0, 1e3))
    rake: float = parameter(5.0, "Angle between the pick's face and the arm, leaning back (free).", "degrees", limits=(-60, 60))
    back: float = parameter(15.0, "Angle between the pick's back and the path (free).", "degrees", POSITIVE, limits=(1, 60))
    tool_stiffness: float = parameter(50e9, "Normal stiffness between discs and pick.", "N/m", POSITIVE, limits=(1, 1e15))
    tool_friction: float = parameter(0.4, "Friction coefficient of discs on the pick.", "-", NOT_NEGATIVE, limits=(0, 10))
    normal_stiffness: float = parameter(1.61129e10, "Normal stiffness of bonds and contacts.", "N/m", POSITIVE, limits=(1, 1e15))
    shear_stiffness: float = parameter(0.3222e10, "Shear stiffness of bonds and contacts.", "N/m", POSITIVE, limits=(1e-3, 1e15))
    strength: float = parameter(
        9.76e4, "Tensile and shear strength of a bond: 0.29e5 N times the ratio of the mean square radii's roots, 1.255 over "
        "0.373 mm, which keeps the strength of the rock.", "N", POSITIVE, limits=(1e-9, 1e15),
    )  # fmt: skip
    friction: float = parameter(0.839, "Friction coefficient of contacts without a bond.", "-", NOT_NEGATIVE, limits=(0, 10))
    bond_reach: float = parameter(
        0.02, "Discs with a distance up to 1 + this times the sum of their radii are bonded.", "-", NOT_NEGATIVE, limits=(0, 0.5)
    )
    porosity: float = parameter(0.13, "Porosity of the packing.", "-", POSITIVE, limits=(0.05, 0.6))
    seed: int = parameter(1, "Seed of the packing.", "", NOT_NEGATIVE, limits=(0, 2**32 - 1))
    density: float = parameter(2500.0, "Density of the discs.", "kg/m3", POSITIVE, limits=(1e-3, 1e6))
    young_modulus: float = parameter(
        15.6e9, "Young's modulus of the continuum: that of `ucs` with discs of these sizes.", "Pa", POSITIVE, limits=(1, 1e15)
    )
    poisson_ratio: float = parameter(0.221, "Poisson's ratio of the continuum, from the same.", "-", NOT_NEGATIVE, limits=(0, 0.49))
    damping: float = parameter(
        0.2, "Damping force (moment) as a share of the force (moment) on a disc, against its velocity (spin).", "-", NOT_NEGATIVE,
        limits=(0, 0.95),
    )  # fmt: skip
    path: float = parameter(1.0, "Share of the path that is gone.", "-", SHARE)
    step_ratio: float = parameter(0.8, "Time step as a share of the critical step of the damped discs with the pick.", "-", SHARE)

    def __post_init__(self) -> None:
        check(self)
        width, height = self.size
        if math.prod(self.size) > 5e6 * math.pi * RADII[0] ** 2:
            raise ValueError(f"block={self.block} would hold millions of discs of about a millimetre; are both lengths in metres?")
        if min(self.size) < 20.0 * RADII[1]:
            raise ValueError(f"block={self.block} must be at least {20.0 * RADII[1]:g} m wide and high")
        if not self.cut_depth < min(0.5 * height, 0.5 * self.arm):
            raise ValueError(f"depth={self.cut_depth:g} must be below half the block's height and half the arm (m)")
        if self.rake + self.back >= 85.0:
            raise ValueError(f"rake={self.rake:g} and back={self.back:g} must leave a pick between them: take less than 85 degrees together")
        margin = 0.5 * (width - self.path_length)
        if margin < 6.0 * RADII[1]:
            raise ValueError(
                f"depth={self.cut_depth:g} makes a cut of {self.path_length:.3g} m, too long for a block of {width:g} m; take a smaller "
                "depth or a wider block"
            )
        if self.method == "overlap":
            self._check_region(width, height)

    def _check_region(self, width: float, height: float) -> None:
        """ValueError for a region that does not hold the cut, or is not held by elements."""
        across, deep = self.region_size
        cells = [side / self.cell_size for side in (width, height)]
        if min(cells) < 1.0 or max(abs(cell - round(cell)) for cell in cells) > 1e-6:
            raise ValueError(f"element_size={self.cell_size:g} must divide the block of {width:g} m x {height:g} m")
        if not (across < width and deep < height):
            raise ValueError(f"region={self.region_text} must lie within the block of {width:g} m x {height:g} m")
        free = 0.5 * across - self.overlap, deep - self.overlap
        if not (free[0] > 0.5 * self.path_length and free[1] > self.cut_depth):
            raise ValueError(
                f"region={self.region_text} less overlap={self.overlap:g} must hold the cut, {self.path_length:.3g} m long and "
                f"{self.cut_depth:g} m deep"
            )

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the block, m."""
        return BLOCKS[self.scale] if self.block is None else size_in_metres("block", self.block)

    @property
    def cut_depth(self) -> float:
        """Depth of cut, m."""
        return DEPTHS[self.scale] if self.depth is None else self.depth

    @property
    def cell_size(self) -> float:
        """Size of the elements, m."""
        return ELEMENTS[self.scale] if self.element_size is None else self.element_size

    @property
    def region_text(self) -> str:
        """The region as an option."""
        return REGIONS[self.scale] if self.region is None else self.region

    @property
    def region_size(self) -> tuple[float, float]:
        """Width and depth of the discs' region, m."""
        return size_in_metres("region", self.region_text)

    @property
    def half_angle(self) -> float:
        """Angle of the arm from where the tip goes in to the vertical, rad."""
        return math.acos(1.0 - (self.cut_depth + CLEARANCE) / self.arm)

    @property
    def path_length(self) -> float:
        """Distance along the surface from where the tip goes in to where it comes out, m."""
        return 2.0 * (self.arm * math.sin(self.half_angle) + self.swing * self.half_angle / self.rotation)

    @property
    def duration(self) -> float:
        """Seconds from just above the surface on the left to the end of the path."""
        return self.path * 2.0 * self.half_angle / self.rotation

    @property
    def packing_size(self) -> float:
        """Solid area of the discs over that of one of the mean square radius: their number, about."""
        low, high = RADII
        return (1.0 - self.porosity) * math.prod(self.size) / (math.pi * (high**3 - low**3) / (3.0 * (high - low)))


# The scene -------------------------------------------------------------------------------------------------------------


def axis_at(p: Parameters, time: float) -> np.ndarray:
    """Axis of the arm (2,) at a time (s), m."""
    half = p.half_angle / p.rotation
    return np.array([p.swing * (time - half), p.arm - p.cut_depth])


def tip_at(p: Parameters, time: float) -> np.ndarray:
    """Tip of the pick (2,) at a time (s), m."""
    angle = p.rotation * time - p.half_angle
    return axis_at(p, time) + p.arm * np.array([math.sin(angle), -math.cos(angle)])


def pick(p: Parameters) -> Any:
    """The rigid pick at the start: a triangle with the tip, the top of its face and the end of its back."""
    from particles import Wall, shapes
    from particles.laws.bonded import Bonded

    rake, back, turn = math.radians(p.rake), math.radians(p.back), -p.half_angle
    local = PICK_LENGTH * np.array([[0.0, 0.0], [-math.sin(rake), math.cos(rake)], [-math.cos(back), math.sin(back)]])
    turned = local @ np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    shear = p.tool_stiffness * p.shear_stiffness / p.normal_stiffness
    law = Bonded(p.tool_stiffness, shear, p.strength, p.strength, friction=p.tool_friction)
    return Wall(
        shapes.polygon(tip_at(p, 0.0) + turned), velocity=(p.swing, 0.0), spin=p.rotation, centre=tuple(axis_at(p, 0.0)), law=law,
        name="pick",
    )  # fmt: skip


def sites(p: Parameters) -> tuple[np.ndarray, np.ndarray]:
    """Centres (n, 2) and radii (n,) of the discs that fill the block, in m; the same ones for every region."""
    from studies import packing_cache

    width, height = p.size
    bounds = (-0.5 * width, -height), (0.5 * width, 0.0)
    return packing_cache.random_dense(bounds, RADII, p.porosity, p.seed, exponent=0.0, nearest=True)


def bonded(p: Parameters, kept: Any = slice(None)) -> Any:
    """Discs of the block, or those of them that are kept, bonded as they lie, under the pick."""
    centres, radii = sites(p)
    rock = discs(p, centres[kept], radii[kept])
    rock.bond(p.bond_reach)
    return rock


def discs(p: Parameters, centres: np.ndarray, radii: np.ndarray) -> Any:
    """Discs of the rock without bonds."""
    from particles import Assembly
    from particles.laws.bonded import Bonded

    law = Bonded(p.normal_stiffness, p.shear_stiffness, p.strength, p.strength, friction=p.friction)
    return Assembly(centres, radii, p.density, law)


def region(p: Parameters, above: float = 0.0) -> Any:
    """The discs' region of method overlap, up to a height above the surface (m)."""
    from meshes import Box

    width, depth = p.region_size
    return Box((-0.5 * width, -depth), (0.5 * width, above))


def zone(p: Parameters) -> Any:
    """The rim of the region; its faces reach far above the surface, which is no interface."""
    from bridge import OverlapZone

    return OverlapZone.within(region(p, 3.0 * p.size[1]), p.overlap)


def body(p: Parameters, share: Any, comm: Any) -> Any:
    """The continuum, held at its sides and its bottom."""
    from continuum import Body, Cauchy
    from meshes import domains

    width, height = p.size
    cells = tuple(round(side / p.cell_size) for side in p.size)
    rock = Cauchy(p.young_modulus, p.poisson_ratio, p.density * (1.0 - p.porosity))
    found = Body(domains.rectangle((-0.5 * width, -height), (0.5 * width, 0.0), cells, comm=comm), rock, share=share)
    for side in ("left", "right", "bottom"):
        found.fix(side, "xy")
    return found
