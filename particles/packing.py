"""Random dense packings of discs or spheres: jammed in a region, just touching, to a target porosity.

A packing is compressed beyond jamming, relaxed, and its radii are exchanged between the particles until the wanted
porosity is where it jams; then its sizes are reduced until the overlaps vanish.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from particles.outline import Faces, Outline, outline_of
from particles.relaxation import Planes, descend, list_pairs, push_apart, sort_by_cell

Sampler = Callable[[np.random.Generator, int], Any]

TOLERANCE = 2e-3  # unbalanced force (root mean square) as a share of the mean contact force
COMPRESSED = {2: 0.865, 3: 0.66}  # first solid fraction; raised where these sizes do not jam there
OVERLAP = 2e-6  # largest mean overlap of contacts of a finished packing, as a share of the mean radius
CLOSING = 1.4  # mean overlap falls by this times the relative change of the radii (harmonic packings near jamming)
ROUGH = 0.02  # the same ratio while density and sizes are still being sought
SURPLUS = 1.008  # jammed to the wanted solid fraction: a packing well exchanged settles sooner; rattlers are taken out
SLIGHT = 1e-3  # mean overlap, of the mean radius, that a change of sizes may remove
MARGIN = 1.002  # radii are drawn inside the range by this factor; the final change of sizes keeps them inside it
LONGEST = 20_000  # steps of one relaxation
EXCHANGES = 150  # of radii, at most


class NotReached(RuntimeError):
    """The porosity asked for cannot be reached with these particles.

    Attributes:
        porosity: the one that was reached.
        steps: of relaxation that were made.
    """

    def __init__(self, message: str, porosity: float, steps: int) -> None:
        super().__init__(message)
        self.porosity, self.steps = porosity, steps


class Equilibrium(NamedTuple):
    """How well a packing is in equilibrium; lengths as shares of the mean radius."""

    porosity: float
    mean_overlap: float  # over the contacts
    largest_overlap: float
    unbalanced: float  # root mean square force on a particle, as a share of the mean contact force
    coordination: float  # contacts (walls included) of a particle, without rattlers
    rattlers: float  # share of the particles with too few contacts to be held


class _Bed:
    """Particles in an outline that are relaxed at changing sizes; rows change their order."""

    def __init__(self, outline: Faces | Outline, places: np.ndarray, radii: np.ndarray) -> None:
        self.outline, self.places, self.radii = outline, places, radii
        self.axes = (0,) * places.shape[1]
        self.velocity = np.zeros_like(places)
        self.steps = 0  # of relaxation so far
        self.list()

    @property
    def solid_fraction(self) -> float:
        return float(_solid(self.radii, len(self.axes)).sum() / self.outline.measure)

    def list(self) -> None:
        """Sort the rows by position and list the pairs and tangent planes that may come into contact."""
        outline, skin = self.outline, 0.5 * float(self.radii.mean())
        periodic = outline.period > 0.0
        self.places[:, periodic] -= outline.period[periodic] * np.floor(
            (self.places[:, periodic] - outline.lower[periodic]) / outline.period[periodic]
        )
        width = 2.0 * float(self.radii.max()) + skin
        cells, order, start = sort_by_cell(self.places, outline.lower, outline.upper, width, self.axes)
        self.places, self.velocity, self.radii = self.places[order], self.velocity[order], self.radii[order]
        self.first, self.second = list_pairs(self.places, self.radii, cells, start, outline.period, skin, self.axes)
        self.planes: Planes = outline.planes(self.places, self.radii, skin)
        self.reach = 0.45 * skin

    def settle(self, tolerance: float, most: int = LONGEST, loose: float = 1e-8) -> float:
        """Relax; mean overlap of the contacts as a share of the mean radius, 0 where it falls below `loose`."""
        control = np.array([0.1, 0.1, 0.0])
        radius = float(self.radii.mean())
        self.velocity[:] = 0.0
        used, overlap, settled = 0, math.inf, False
        while used < most:
            steps, overlap, settled = descend(
                self.places, self.velocity, np.empty_like(self.places), self.radii, self.first, self.second,
                self.outline.period, self.planes, control, self.reach, most - used, tolerance, loose * radius, self.axes,
            )  # fmt: skip
            used += max(steps, 1)
            self.list()
            if settled and (steps < 20 or not self.outline.curved):  # tangent planes must have followed
                break
        self.settled = settled
        self.steps += used
        return 0.0 if overlap < loose * radius else overlap / radius

    def contacts(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows of both particles (second -1: a wall) and overlap (m) of every contact."""
        first = np.repeat(np.arange(self.radii.size), np.diff(self.first))
        branch = self.places[self.second] - self.places[first]
        period = self.outline.period
        branch -= period * np.rint(branch / np.where(period > 0.0, period, 1.0))
        overlap = self.radii[first] + self.radii[self.second] - np.linalg.norm(branch, axis=1)
        row, normal, offset = self.planes
        beyond = np.einsum("ij,ij->i", normal, self.places[row]) - offset + self.radii[row]
        first, second = np.r_[first, row], np.r_[self.second, np.full(row.size, -1)]
        overlap = np.r_[overlap, beyond]
        touching = overlap > 0.0
        return first[touching], second[touching], overlap[touching]

    def exchange(self) -> None:
        """Exchange radii: a step down the energy's gradient in the radii, onto a permutation of them.

        The sizes stay as drawn, the jamming density rises (Brito, Lerner & Wyart 2018; Kapteijns et al. 2019).
        """
        first, second, overlap = self.contacts()
        both = np.r_[first, second[second >= 0]]
        load = np.bincount(both, np.r_[overlap, overlap[second >= 0]], self.radii.size)
        number = np.bincount(both, minlength=self.radii.size)
        free = np.ones(self.radii.size, dtype=bool)
        free[first[second < 0]] = False  # or small ones would gather at the walls
        wanted = self.radii[free] - (load / np.maximum(number, 1))[free]
        sizes = np.empty_like(wanted)
        sizes[np.argsort(wanted, kind="stable")] = np.sort(self.radii[free])
        self.radii[free] = sizes
        self.list()

    def keep(self, kept: np.ndarray) -> None:
        """Take out the other particles."""
        self.places, self.velocity, self.radii = self.places[kept], self.velocity[kept], self.radii[kept]
        self.list()

    def thin(self, solid_fraction: float, rng: np.random.Generator) -> None:
        """Take out particles at random, down to the solid fraction but not below."""
        share = _solid(self.radii, len(self.axes)) / self.outline.measure
        surplus, kept = float(share.sum()) - solid_fraction, np.ones(self.radii.size, dtype=bool)
        for row in rng.permutation(self.radii.size):
            if share[row] <= surplus:
                surplus -= share[row]
                kept[row] = False
        self.keep(kept)

    def counts(self) -> np.ndarray:
        """Contacts (n,) of each particle, 0 for rattlers: those with too few contacts are taken out, repeatedly."""
        first, second, _ = self.contacts()
        wall = second < 0
        kept = np.ones(self.radii.size, dtype=bool)
        while True:
            held = kept[first] & (wall | kept[second])
            counts = np.bincount(np.r_[first[held], second[held & ~wall]], minlength=kept.size)
            rattling = kept & (counts < len(self.axes) + 1)
            if not rattling.any():
                return np.where(kept, counts, 0)
            kept &= ~rattling

    def jam(self) -> None:
        """Reduce the sizes until the particles just touch (O'Hern et al. 2003, from above)."""
        overlap, slope, shrink = 0.0, CLOSING, -SLIGHT
        for _ in range(60):
            goal = max(0.2 * overlap, 0.5 * OVERLAP)
            reached = self.settle(TOLERANCE, loose=0.02 * goal)
            # well compressed it may creep on; what has not settled near the end is about to come apart
            if reached == 0.0 or (reached < 0.1 * SLIGHT and not self.settled):
                shrink = -0.5 * shrink if shrink > 0.0 else 1.5 * shrink  # back by half, further each time
            elif reached <= OVERLAP and self.settled:
                return
            else:
                if shrink > 0.0 and reached < overlap:
                    slope = min(max((overlap - reached) / shrink, 0.5 * CLOSING), 2.0 * CLOSING)
                overlap = reached
                shrink = (overlap - max(0.2 * overlap, 0.5 * OVERLAP)) / slope
            self.radii *= 1.0 - shrink
        warnings.warn(f"packing: not settled, mean overlap {overlap:.1e} of the mean radius", stacklevel=3)


def _solid(radii: np.ndarray, axes: int) -> np.ndarray:
    """Areas (m2) of discs or volumes (m3) of spheres."""
    return np.pi * radii**2 if axes == 2 else 4.0 / 3.0 * np.pi * radii**3


def power_law(radius_range: tuple[float, float], exponent: float) -> Sampler:
    """Sampler of radii with number density proportional to r^-exponent on a range (0: uniform)."""
    low, high = radius_range

    def sample(rng: np.random.Generator, count: int) -> np.ndarray:
        share = rng.random(count)
        if abs(exponent - 1.0) < 1e-9:
            return low * (high / low) ** share
        power = 1.0 - exponent
        # relative to the smallest radius, so that no power overflows at any length scale
        return low * (1.0 + share * ((high / low) ** power - 1.0)) ** (1.0 / power)

    return sample


def random_dense(
    region: Any,
    radius_range: tuple[float, float] = (0.02, 0.05),
    porosity: float = 0.16,
    seed: int = 1,
    exponent: float = 2.2,
    sampler: Sampler | None = None,
    periodic: bool = False,
    nearest: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Random dense packing of discs or spheres in frictionless equilibrium that just touch (mean overlap 2e-6 radii).

    Up to the density at which particles of these sizes jam when placed at random (solid fraction about 0.845 in 2D, 0.64 in
    3D), the porosity is met by taking out particles that carry no load. Beyond, radii are exchanged among the particles
    until they jam at the wanted porosity; the wider the range of sizes, the denser (2D, r_max / r_min = 2.5: 12 per cent).

    Args:
        region: ((x0, y0), (x1, y1)), the same with z, or an object with `bounds` and `distance(points)` (m, negative
            inside). The particles lie within it and touch its outline; details of it should be larger than they are. Re-entrant corners are exact in a difference of
            regions; in a union, whose distance is a bound, particles may cut them by some per cent of a radius.
        radius_range: smallest and largest radius, m.
        porosity: share of voids in the region, met within 0.002.
        seed: of the random numbers; the same seed gives the same packing.
        exponent: number density of radii proportional to r^-exponent (0: uniform). The default gives the root mean square
            radius of 0.031 m that Li & Wan's assembly C needs (6835 discs of 0.02 to 0.05 m in 7 m x 3.5 m).
        sampler: own radii instead of radius_range and exponent: sampler(rng, count) gives count radii (m). The finished
            radii differ from them by a common factor within about 0.002 of one.
        periodic: particles that leave a box on one side enter it on the other; the box has no walls.
        nearest: where the porosity cannot be reached, return the packing that comes nearest to it.

    Returns:
        Positions (n, 2) or (n, 3) and radii (n,), m.

    Raises:
        ValueError: sizes, region or porosity that make no sense.
        NotReached: particles of these sizes jam at a higher porosity, or at a lower one without so many that carry no load
            and could be taken out.
    """
    if sampler is None:
        low, high = map(float, radius_range)
        if not (0.0 < low <= high < math.inf):
            raise ValueError(f"radius_range={radius_range} must be two positive radii in ascending order (m)")
        if not math.isfinite(exponent):
            raise ValueError(f"exponent={exponent} must be a finite number")
        margin = min(MARGIN, math.sqrt(high / low))
        sampler = power_law((low * margin, high / margin), exponent)
    if not 0.05 <= porosity <= 0.6:
        raise ValueError(
            f"porosity={porosity} must lie in [0.05, 0.6]; random discs jam at about 0.15, spheres at 0.36"
        )
    outline, rng = outline_of(region, periodic), np.random.default_rng(seed)
    solid = 1.0 - porosity
    bed = _compressed(outline, sampler, solid * SURPLUS, rng)
    _approach(bed, solid * SURPLUS, rng)
    bed.jam()
    jams = bed.solid_fraction
    _loosen(bed, solid, rng)
    reached = 1.0 - bed.solid_fraction
    if abs(reached - porosity) > 2e-3 and not nearest:
        why = "no denser; a wider range of sizes packs denser" if reached > porosity else "can spare no more particles"
        raise NotReached(
            f"porosity={porosity:g} could not be reached: {reached:.4f} after {bed.steps} steps of relaxation; these "
            f"{bed.radii.size} particles jam without friction at {1.0 - jams:.4f} and {why}. Ask for a porosity near that, or "
            "for the packing as it came out by nearest=True",
            reached, bed.steps,
        )  # fmt: skip
    return bed.places, bed.radii


def _fill(sampler: Sampler, rng: np.random.Generator, measure: float, axes: int) -> np.ndarray:
    """Radii until their area or volume is `measure`."""
    radii, count = np.empty(0), 1000
    while _solid(radii, axes).sum() < measure:
        if count > 100_000_000:
            raise ValueError(
                "radii: more than 100 million particles would be needed; are radii and region in one unit?"
            )
        drawn = np.asarray(sampler(rng, count), dtype=float)
        if drawn.shape != (count,) or not (np.isfinite(drawn) & (drawn > 0.0)).all():
            raise ValueError(f"sampler must give {count} positive finite radii (m) when asked for as many")
        radii, count = np.r_[radii, drawn], 2 * count
    return radii[: int(np.searchsorted(np.cumsum(_solid(radii, axes)), measure)) + 1]


def _scatter(outline: Faces | Outline, rng: np.random.Generator, count: int) -> np.ndarray:
    """Random places (count, axes) inside."""
    places = np.empty((0, outline.lower.size))
    while len(places) < count:
        some = outline.lower + rng.random((count, outline.lower.size)) * (outline.upper - outline.lower)
        places = np.concatenate((places, some[outline.inside(some)]))
    return places[:count]


def _compressed(outline: Faces | Outline, sampler: Sampler, solid: float, rng: np.random.Generator) -> _Bed:
    """Particles at random places, relaxed, denser than they jam and than `solid`."""
    axes = outline.lower.size
    start = max(COMPRESSED[axes], solid)
    while True:
        radii = _fill(sampler, rng, start * outline.measure, axes)
        if not (outline.upper - outline.lower > 4.0 * radii.max()).all():
            raise ValueError(
                f"region from {outline.lower} to {outline.upper} must be at least two of the largest particles wide "
                f"(their radius is {radii.max():g} m)"
            )
        bed = _Bed(outline, _scatter(outline, rng, radii.size), radii)
        if bed.settle(5.0 * ROUGH) > SLIGHT:
            return bed
        start *= 1.03


def _approach(bed: _Bed, solid: float, rng: np.random.Generator) -> None:
    """Bring the bed to its jamming density: at `solid`, or where it jams if that is denser, or as near as it can be."""
    equal = not np.ptp(bed.radii) > 0.0
    # exchanges reach equilibrium too, so what goes before them can be rough
    overlap = _relieve(bed, solid, ROUGH if equal else 5.0 * ROUGH, rng)
    for _ in range(0 if equal else EXCHANGES):
        if overlap < SLIGHT:
            break
        bed.exchange()
        overlap = bed.settle(ROUGH, most=40)
    _relieve(bed, 0.0, ROUGH, rng)


def _relieve(bed: _Bed, solid: float, tolerance: float, rng: np.random.Generator) -> float:
    """Take out particles at random until the mean overlap is slight, or down to `solid`; the mean overlap reached."""
    overlap, before = bed.settle(tolerance), math.inf
    while overlap > 4.0 * SLIGHT and bed.solid_fraction < before:
        before = bed.solid_fraction
        jams = before * (1.0 - len(bed.axes) * (overlap - 3.0 * SLIGHT) / CLOSING)
        bed.thin(max(jams, solid), rng)
        overlap = bed.settle(tolerance)
    return overlap


def _loosen(bed: _Bed, solid: float, rng: np.random.Generator) -> None:
    """Take out rattlers that carry no load, in random order, until the solid fraction is met or none is left."""
    first, second, overlap = bed.contacts()
    load = np.bincount(np.r_[first, second[second >= 0]], np.r_[overlap, overlap[second >= 0]], bed.radii.size)
    rattlers = rng.permutation(np.flatnonzero((bed.counts() == 0) & (load < 10.0 * TOLERANCE * overlap.mean())))
    surplus = (bed.solid_fraction - solid) * bed.outline.measure
    taken = np.cumsum(_solid(bed.radii[rattlers], len(bed.axes)))
    kept = np.ones(bed.radii.size, dtype=bool)
    kept[rattlers[: int(np.searchsorted(taken, surplus))]] = False
    bed.keep(kept)


def equilibrium(positions: Any, radii: Any, region: Any, periodic: bool = False) -> Equilibrium:
    """Overlaps, unbalanced forces and coordination of a packing in its region, for equal contact stiffnesses.

    Args:
        positions, radii: (n, 2) or (n, 3) and (n,), m.
        region, periodic: as in `random_dense`.
    """
    bed = _Bed(outline_of(region, periodic), np.array(positions, dtype=float), np.array(radii, dtype=float))
    force = np.empty_like(bed.places)
    push_apart(force, bed.places, bed.radii, bed.first, bed.second, bed.outline.period, bed.planes, bed.axes)
    overlap, counts = bed.contacts()[2], bed.counts()
    mean = float(overlap.mean()) if overlap.size else 0.0
    unbalanced = math.sqrt(float((force**2).sum()) / len(force))
    scale = float(bed.radii.mean())
    return Equilibrium(
        porosity=1.0 - bed.solid_fraction,
        mean_overlap=mean / scale,
        largest_overlap=float(overlap.max(initial=0.0)) / scale,
        unbalanced=unbalanced / mean if mean else 0.0,
        coordination=float(counts[counts > 0].mean()) if counts.any() else 0.0,
        rattlers=float((counts == 0).mean()),
    )
