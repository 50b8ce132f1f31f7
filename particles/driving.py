"""Quasi-static driving: how far from equilibrium, settling with damping, walls at a strain rate, inertial number."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from particles.network import contacts

if TYPE_CHECKING:
    from particles.assembly import Assembly

QUASI_STATIC = 1e-3  # inertial number below which strength and fabric no longer depend on the rate (da Cruz et al. 2005)


class NotSettled(RuntimeError):
    """Equilibrium was not reached in the steps allowed."""


class Unbalanced(NamedTuple):
    """Resultant forces on the free particles over the mean contact force."""

    mean: float
    largest: float


class Settled(NamedTuple):
    """How equilibrium was reached."""

    steps: int
    unbalanced: Unbalanced
    mass_damping: float  # the last one used, 1/s; 0 with local damping


def unbalanced(soil: Assembly) -> Unbalanced:
    """Unbalanced force ratios of the last evaluation: resultants (loads, no damping) over the mean contact force.

    Contacts with walls count; held components do not. Without a force in any contact the mean resultant is the measure of
    the largest one, and the ratio of means is infinite, or zero where there are no forces at all.
    """
    largest, total, moved, force, acting = soil.force_sums()
    if not total:
        return Unbalanced(0.0, 0.0)
    if not acting:
        return Unbalanced(math.inf, math.inf)
    return Unbalanced(total / moved * acting / force, largest * acting / force)


def sums_of(soil: Assembly, contacts_only: bool = False) -> np.ndarray:
    """See `Assembly.force_sums`; with `contacts_only` the first three are zero."""
    sums = np.zeros(5)
    if not contacts_only:
        resultant = np.linalg.norm(soil.forces[:, : soil.axes] * free_components(soil)[:, : soil.axes], axis=1)
        moved = np.ones(soil.count, dtype=bool)
        moved[[i for i, free in soil._held.items() if not free[: soil.axes].any()]] = False
        sums[:3] = resultant[moved].max(initial=0.0), resultant[moved].sum(), moved.sum()
    force = np.linalg.norm(contacts(soil, with_walls=True).force, axis=1)
    sums[3:] = force.sum(), np.count_nonzero(force)
    return sums


def free_components(soil: Assembly) -> np.ndarray:
    """1 for the free components of all particles (n, freedoms), 0 for the held ones."""
    free = np.ones((soil.count, soil.freedoms))
    for i, components in soil._held.items():
        free[i] = components
    return free


def settle(
    soil: Assembly,
    step: float,
    tolerance: float = 1e-3,
    damping: str = "local",
    factor: float | None = None,
    most: int = 200_000,
    every: int = 50,
    **loads: Any,
) -> Settled:
    """Go on until the mean unbalanced force is below `tolerance` times the mean contact force.

    Args:
        step: s.
        damping: "local": force -factor |F| sgn(v) on each component. "adaptive": dynamic relaxation (Bardet & Proubet
            1991): mass damping c = 2 factor w, critical for the present lowest frequency w = sqrt(u K u / u M u) of the
            displacements u of the last steps, K u being the change of the resultants.
        factor: default 0.7 for "local" and 1 for "adaptive".
        most: steps.
        every: steps between two looks.
        loads: gravity, as in `Assembly.advance`.

    Raises:
        NotSettled: the ratio was not reached in `most` steps; the message says how far it came.
        ValueError: a tolerance or damping that makes no sense.
    """
    if not (np.isfinite(tolerance) and tolerance > 0.0):
        raise ValueError(f"tolerance={tolerance} must be positive (unbalanced over contact force)")
    if damping not in ("local", "adaptive"):
        raise ValueError(f"damping={damping!r} must be 'local' or 'adaptive'")
    if every < 1 or most < 1:
        raise ValueError(f"every={every} and most={most} must be whole numbers from 1 upwards")
    if damping == "local":
        loads = {**loads, "local_damping": 0.7 if factor is None else factor}
    # before anything is known: a wave through the assembly, from the highest frequency that the step allows
    frequency = 2.0 / step / max(soil.count, 1) ** (1.0 / soil.axes)
    rate, done = 0.0, 0
    inertia = _inertia(soil)
    while True:
        if damping == "adaptive":
            rate = min(2.0 * (1.0 if factor is None else factor) * frequency, 1.0 / step)
            loads = {**loads, "mass_damping": rate}
            soil.prepare(step, **loads)  # forces of the state that the next displacements start from
            place, force = soil.displacements, soil.forces
        count = min(every, most - done)
        soil.advance(count, step, **loads)
        done += count
        ratio = unbalanced(soil)
        if ratio.mean <= tolerance:
            return Settled(done, ratio, rate)
        if done >= most:
            raise NotSettled(
                f"unbalanced force ratio {ratio.mean:.3g} (largest {ratio.largest:.3g}) after {done} steps of {step:g} s has "
                f"not come down to tolerance={tolerance:g}"
            )
        if damping == "adaptive":
            moved = (soil.displacements - place) * free_components(soil)
            work, mass = -float(np.sum(moved * (soil.forces - force))), float(np.sum(inertia * moved**2))
            if work > 0.0 and mass > 0.0:
                frequency = math.sqrt(work / mass)


def _inertia(soil: Assembly) -> np.ndarray:
    """Masses and moments of inertia (n, freedoms)."""
    rotations = soil.freedoms - soil.axes
    return np.hstack([np.repeat(soil.masses[:, None], soil.axes, 1), np.repeat(soil.inertias[:, None], rotations, 1)])


def strain_velocity(
    rate: float, length: float, normal: Sequence[float], start: float = 0.0, logarithmic: bool = True
) -> Callable[[float], np.ndarray]:
    """Velocity of a wall, as a function of time (s), that strains the body between it and a plane at rest.

    L' = rate L, so that ln(L / length) = rate (t - start), or with `logarithmic=False` L' = rate length. For two walls that
    both move give each half of the length.

    Args:
        rate: 1/s, negative in compression.
        length: distance of the wall from the plane at `start`, m.
        normal: outward, from the plane to the wall; its length does not matter.

    Raises:
        ValueError: numbers that make no sense.
    """
    outward = np.array(normal, dtype=float)
    if not (np.isfinite(rate) and np.isfinite(length) and length > 0.0 and np.isfinite(outward).all() and outward.any()):
        raise ValueError(f"rate={rate} and normal={normal} must be finite, length={length} positive (m)")
    speed = rate * length * outward / np.linalg.norm(outward)

    def velocity(time: float) -> np.ndarray:
        return speed * (math.exp(rate * (time - start)) if logarithmic else 1.0)

    return velocity


def inertial_number(soil: Assembly, rate: float, pressure: float) -> float:
    """I = |rate| d sqrt(rho / p) with the mean diameter d and the mean density of the particles (da Cruz et al. 2005).

    Args:
        rate: largest strain rate, 1/s.
        pressure: mean pressure, Pa, positive in compression.

    Raises:
        ValueError: the pressure is not positive.
    """
    if not (np.isfinite(pressure) and pressure > 0.0):
        raise ValueError(f"pressure={pressure} must be positive (Pa)")
    radii = soil.radii
    solid = np.pi * radii**2 if soil.axes == 2 else 4.0 / 3.0 * np.pi * radii**3
    return float(abs(rate) * 2.0 * radii.mean() * math.sqrt(soil.masses.sum() / solid.sum() / pressure))


def is_quasi_static(soil: Assembly, rate: float, pressure: float, limit: float = QUASI_STATIC) -> bool:
    """Whether a test at this strain rate (1/s) and pressure (Pa) has an inertial number below `limit`."""
    return inertial_number(soil, rate, pressure) < limit
