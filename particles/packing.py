"""Random dense packings: discs of given sizes jammed in a box, brought back to just touching, to a target porosity."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
from numba import njit

from particles import neighbours
from particles.system import FAST

MARGIN = 1.01  # radii are drawn inside the range by this factor; the final common scaling keeps them inside it
TOLERANCE = 2e-3  # unbalanced force (root mean square) as a share of the mean contact force
OVERLAP = 2e-6  # mean overlap of contacts aimed at, as a share of the mean radius
JAMMED = 0.846  # first guess of the solid fraction at jamming
LONGEST = 30_000  # sweeps of one relaxation; a packing that does not settle in these counts as loose


@njit(cache=True, fastmath=FAST)
def _push(force, places, radii, start, neighbour, lower, upper):
    """Unit-stiffness repulsion of overlapping discs and box walls; sum of overlaps and number of contacts."""
    force[:] = 0.0
    overlaps = 0.0
    contacts = 0
    for i in range(places.shape[0]):
        x = places[i, 0]
        y = places[i, 1]
        radius = radii[i]
        fx = 0.0
        fy = 0.0
        for pair in range(start[i], start[i + 1]):
            j = neighbour[pair]
            bx = places[j, 0] - x
            by = places[j, 1] - y
            reach = radius + radii[j]
            square = bx * bx + by * by
            if square < reach * reach:
                distance = math.sqrt(square)
                push = (reach - distance) / distance
                fx -= push * bx
                fy -= push * by
                force[j, 0] += push * bx
                force[j, 1] += push * by
                overlaps += reach - distance
                contacts += 1
        for c in range(2):
            place = x if c == 0 else y
            low = lower[c] + radius - place
            high = place + radius - upper[c]
            push = max(low, 0.0) - max(high, 0.0)
            if push != 0.0:
                overlaps += abs(push)
                contacts += 1
                if c == 0:
                    fx += push
                else:
                    fy += push
        force[i, 0] += fx
        force[i, 1] += fy
    return overlaps, contacts


@njit(cache=True, fastmath=FAST)
def _move(places, velocity, force, mix, step):
    """One sweep of FIRE (Bitzek et al. 2006): steer along the force, step; power, sum of squared forces, top speed squared."""
    power = 0.0
    forces = 0.0
    speeds = 0.0
    for i in range(places.shape[0]):
        square = force[i, 0] * force[i, 0] + force[i, 1] * force[i, 1]
        power += force[i, 0] * velocity[i, 0] + force[i, 1] * velocity[i, 1]
        forces += square
        speeds += velocity[i, 0] * velocity[i, 0] + velocity[i, 1] * velocity[i, 1]
    keep = 1.0 - mix if power > 0.0 else 0.0
    steer = mix * math.sqrt(speeds / forces) if power > 0.0 and forces > 0.0 else 0.0
    fastest = 0.0
    for i in range(places.shape[0]):
        for c in range(2):
            velocity[i, c] = keep * velocity[i, c] + (steer + step) * force[i, c]
            places[i, c] += step * velocity[i, c]
        fastest = max(fastest, velocity[i, 0] * velocity[i, 0] + velocity[i, 1] * velocity[i, 1])
    return power, forces, fastest


@njit(cache=True)
def _settle(places, velocity, force, radii, start, neighbour, lower, upper, skin, control, sweeps, tolerance, tiny):
    """Sweeps until the unbalanced force (root mean square) is below `tolerance` times the mean contact force.

    Args:
        control: (3,) FIRE's step, mixing and number of sweeps since the last turn; kept between calls.
        tiny: mean overlap (m) below which the packing counts as loose.

    Returns:
        Sweeps made, mean overlap (m), whether it has settled (else the list is stale or `sweeps` are used up).
    """
    travel = 0.0
    mean = 0.0
    for sweep in range(sweeps):
        overlaps, contacts = _push(force, places, radii, start, neighbour, lower, upper)
        mean = overlaps / max(contacts, 1)
        power, forces, fastest = _move(places, velocity, force, control[1], control[0])
        if forces <= places.shape[0] * (tolerance * mean) ** 2 or overlaps < tiny * places.shape[0]:
            return sweep, mean, True
        if power > 0.0:
            control[2] += 1.0
            if control[2] > 5.0:
                control[0] = min(1.1 * control[0], 0.5)
                control[1] *= 0.99
        else:
            control[2] = 0.0
            control[0] = max(0.5 * control[0], 0.02)
            control[1] = 0.1
        travel += control[0] * math.sqrt(fastest)
        if travel > 0.4 * skin:
            return sweep + 1, mean, False
    return sweeps, mean, False


class _Box:
    """Discs in a box that are relaxed at changing sizes."""

    def __init__(self, lower: np.ndarray, upper: np.ndarray, radii: np.ndarray, rng: np.random.Generator) -> None:
        self.lower, self.upper, self.radii = lower, upper, radii
        self.places = lower + rng.random((radii.size, 2)) * (upper - lower)
        self.sweeps = 0

    @property
    def solid_fraction(self) -> float:
        return float(np.pi * np.sum(self.radii**2) / np.prod(self.upper - self.lower))

    def _list(self, skin: float) -> tuple[np.ndarray, np.ndarray]:
        order = np.lexsort((self.places[:, 0], np.floor(self.places[:, 1] / (2.0 * self.radii.max()))))
        self.places, self.radii = np.ascontiguousarray(self.places[order]), self.radii[order]
        none = np.zeros(self.radii.size, dtype=bool)
        width = 2.0 * self.radii.max() + skin
        start, _, second = neighbours.list_pairs(self.places, self.radii, none, width, skin, 2, 4 * self.radii.size, None)
        return start, second[: start[-1]]

    def settle(self, tolerance: float) -> float:
        """Relax to equilibrium; mean overlap of the contacts as a share of the mean radius, 0 if there is no jam."""
        control = np.array([0.1, 0.1, 0.0])
        mean_radius = float(self.radii.mean())
        velocity = np.zeros_like(self.places)
        settled, overlap, used = False, 0.0, 0
        while not settled and used < LONGEST:
            skin = 0.3 * mean_radius
            start, neighbour = self._list(skin)
            velocity[:] = 0.0  # rows were sorted anew
            made, overlap, settled = _settle(
                self.places, velocity, np.zeros_like(self.places), self.radii, start, neighbour, self.lower, self.upper,
                skin, control, LONGEST - used, tolerance, 0.1 * OVERLAP * mean_radius,
            )  # fmt: skip
            used += made + 1
        self.sweeps += used
        return overlap / mean_radius if settled and overlap > 0.1 * OVERLAP * mean_radius else 0.0

    def jam(self) -> None:
        """Change the sizes until the discs are jammed with negligible overlap (O'Hern et al. 2003)."""
        # begin well compressed: a stiff packing settles in far fewer sweeps, and follows the later small changes
        self.radii *= 1.02
        change, jammed = 2e-3, False
        overlap = self.settle(10.0 * TOLERANCE)
        for _ in range(60):
            if overlap == 0.0:  # loose: back by half of the last change, and on by more where that was not enough
                change *= 0.5 if jammed else 3.0
                jammed = False
                self.radii *= 1.0 + change
            elif overlap <= OVERLAP:
                return
            else:
                # mean overlap falls by about 1.5 to 2 times the relative change of size
                jammed = True
                change = 0.38 * (overlap - 0.3 * OVERLAP)
                self.radii *= 1.0 - change
            overlap = self.settle(TOLERANCE)
        warnings.warn(f"packing: mean overlap {overlap:.1e} of the mean radius is left", stacklevel=3)


def _contact_counts(box: _Box) -> np.ndarray:
    """Load-carrying contacts of each disc: discs with fewer than three and their contacts are taken out, repeatedly."""
    start, second = box._list(1e-12)
    first = np.repeat(np.arange(box.radii.size), np.diff(start))
    gap = np.hypot(*(box.places[second] - box.places[first]).T) - box.radii[first] - box.radii[second]
    first, second = first[gap < 0.0], second[gap < 0.0]
    walls = ((box.places - box.radii[:, None] < box.lower) | (box.places + box.radii[:, None] > box.upper)).sum(axis=1)
    kept = np.ones(box.radii.size, dtype=bool)
    while True:
        both = kept[first] & kept[second]
        counts = walls + np.bincount(first[both], minlength=kept.size) + np.bincount(second[both], minlength=kept.size)
        loose = kept & (counts < 3)
        if not loose.any():
            return np.where(kept, counts, 0)
        kept &= ~loose


def _draw(count: int, radius_range: tuple[float, float], exponent: float, rng: np.random.Generator) -> np.ndarray:
    """Radii with number density proportional to r^-exponent on the range."""
    low, high = radius_range[0] * MARGIN, radius_range[1] / MARGIN
    share = rng.random(count)
    if low >= high:
        return np.full(count, math.sqrt(radius_range[0] * radius_range[1]))
    if abs(exponent - 1.0) < 1e-9:
        return low * (high / low) ** share
    power = 1.0 - exponent
    return (low**power + share * (high**power - low**power)) ** (1.0 / power)


def random_dense(
    region: Any,
    radius_range: tuple[float, float] = (0.02, 0.05),
    porosity: float = 0.16,
    seed: int = 1,
    exponent: float = 2.2,
) -> tuple[np.ndarray, np.ndarray]:
    """Random dense packing in a box, in equilibrium, discs in contact just touching (mean overlap about 2e-6 radii).

    Discs at random places are relaxed and their common size changed until they jam without overlap (O'Hern et al. 2003);
    the porosity is then met by taking out discs that carry no load. What can be reached is about 14 to 18 per cent.

    Args:
        region: ((x0, y0), (x1, y1)), or an object with `bounds` (the same) and `contains(points)`: its bounds are packed
            and discs with centres outside are dropped.
        radius_range: smallest and largest radius, m.
        porosity: share of voids in the box; a warning says what was reached if that is off by more than 0.002.
        seed: of the random numbers; the same seed gives the same packing.
        exponent: number density of radii proportional to r^-exponent (0: uniform). The default gives the root mean square
            radius of 0.031 m that Li & Wan's assembly C needs (6835 discs of 0.02 to 0.05 m in 7 m x 3.5 m).

    Returns:
        Positions (n, 2) and radii (n,), m.

    Raises:
        ValueError: sizes or porosity that make no sense.
    """
    lower, upper = np.asarray(region.bounds if hasattr(region, "bounds") else region, dtype=float)
    low, high = map(float, radius_range)
    if not (0.0 < low <= high < math.inf):
        raise ValueError(f"radius_range={radius_range} must be two positive radii in ascending order (m)")
    if lower.shape != (2,) or not np.isfinite([lower, upper]).all() or not (upper - lower > 4.0 * high).all():
        raise ValueError(f"region from {lower} to {upper} must be at least two of the largest discs wide and high")
    if not 0.1 <= porosity <= 0.5:
        raise ValueError(f"porosity={porosity} must lie in [0.1, 0.5]; random discs jam at about 0.15")
    if not math.isfinite(exponent):
        raise ValueError(f"exponent={exponent} must be a finite number")
    rng = np.random.default_rng(seed)
    area = float(np.prod(upper - lower))
    jammed = JAMMED
    for _ in range(4):
        guess = int(2.0 * area / (np.pi * low * high)) + 16
        radii = _draw(guess, (low, high), exponent, rng)
        solid = np.cumsum(np.pi * radii**2)
        radii = radii[: max(1, int(np.searchsorted(solid, jammed * area)))]
        box = _Box(lower, upper, radii.copy(), rng)
        box.jam()
        jammed = box.solid_fraction
        if low <= box.radii.min() and box.radii.max() <= high:
            break
    positions, radii = _loosened(box, 1.0 - porosity, rng)
    reached = 1.0 - np.pi * np.sum(radii**2) / area
    if abs(reached - porosity) > 2e-3:
        warnings.warn(
            f"packing: porosity {reached:.4f} was reached, not {porosity:g} (jammed without friction: {1 - jammed:.4f})",
            stacklevel=2,
        )
    if hasattr(region, "contains"):
        inside = np.asarray(region.contains(positions), dtype=bool)
        positions, radii = positions[inside], radii[inside]
    return positions, radii


def _loosened(box: _Box, solid_fraction: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Take out load-free discs, in random order, until the solid fraction is met (or none is left)."""
    rattlers = np.flatnonzero(_contact_counts(box) == 0)
    rng.shuffle(rattlers)
    surplus = (box.solid_fraction - solid_fraction) * float(np.prod(box.upper - box.lower))
    taken = np.cumsum(np.pi * box.radii[rattlers] ** 2)
    kept = np.ones(box.radii.size, dtype=bool)
    kept[rattlers[: int(np.searchsorted(taken, surplus))]] = False
    return box.places[kept], box.radii[kept]
