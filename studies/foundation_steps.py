"""Time steps of the foundation: how many particle steps make a coarse one, and where growth is to be feared."""

from __future__ import annotations

import math
import warnings

from studies.foundation import MOST_STEPS, Parameters

COARSE_RATIO = 0.5  # default coarse step as a share of the continuum's critical step
TRUSTED_RATIO = 0.7  # of the continuum's critical step: up to there subcycling does not grow, multiplier and respa by 2 1/s
SOUND = ("subcycling", "multiplier", "respa")  # variants that need no damping
ENOUGH_DAMPING = 0.05  # of sqrt(k_N/m): with it paper and resync have not been seen to grow


def check_number_of_steps(p: Parameters, step: float) -> None:
    """Refuse a run of too many steps.

    Raises:
        ValueError: it takes more than `MOST_STEPS` steps of `step` seconds.
    """
    if p.duration > MOST_STEPS * step:
        raise ValueError(
            f"speed={p.speed} and displacement={p.displacement} make more than {MOST_STEPS} steps of {step:.3g} s; take a "
            "higher speed, a smaller displacement or a longer step"
        )


def fit_substeps(p: Parameters, fine: float, coarse_critical: float) -> tuple[float, int]:
    """Particle step (s) and the number of them in a coarse step; a default particle step shrinks where one is too long.

    Args:
        p: Parameters.
        fine: Particle step that is wanted, s.
        coarse_critical: Critical step of the continuum, s.

    Raises:
        ValueError: the steps asked for are longer than the continuum's critical step.
    """
    substeps = p.substeps
    if substeps is None:
        allowed = COARSE_RATIO * coarse_critical
        if p.step is None and fine > allowed:
            warnings.warn(
                f"region={p.region} with this mesh leaves an element so small or such a sliver that the continuum's critical "
                f"step is {coarse_critical:.3g} s; the particles' step is shortened from {fine:.3g} to {allowed:.3g} s, a "
                "region along the elements' edges spares that",
                stacklevel=3,
            )
            return allowed, 1
        substeps = max(1, int(allowed / fine))
        if p.variant == "paper":
            substeps = min(substeps, 2)
    if substeps * fine > coarse_critical:
        cause = f"step={p.step}" if p.substeps is None else f"substeps={p.substeps}"
        raise ValueError(
            f"{cause} makes a coarse step of {substeps * fine:.4g} s; it must be at most the continuum's critical step of "
            f"{coarse_critical:.4g} s"
        )
    return fine, substeps


def warn_of_growth(p: Parameters, substeps: int, coarse_ratio: float, mean_radius: float) -> None:
    """Warn where theory or experience expects a bridging run to grow, without the growth test.

    Args:
        p: Parameters.
        substeps: Particle steps in a coarse step.
        coarse_ratio: Coarse step as a share of the continuum's critical step.
        mean_radius: Of the discs, m.
    """
    found = []
    if p.variant in SOUND:
        if coarse_ratio > TRUSTED_RATIO:
            found.append(
                f"variant={p.variant} with a coarse step of {coarse_ratio:.2f} of the continuum's critical step may grow; "
                "take fewer substeps or see --growth-test"
            )
    else:
        if p.variant == "paper" and substeps > 2:
            found.append(
                f"variant=paper with substeps={substeps}: the micro-rotation of covered elements limits the coarse step; "
                "take at most 2 substeps or see --growth-test"
            )
        enough = ENOUGH_DAMPING * math.sqrt(p.normal_stiffness / (p.density * math.pi * mean_radius**2))
        if p.damping < 0.99 * enough:
            found.append(
                f"variant={p.variant} with damping={p.damping:g} 1/s may grow: it wants {enough:.0f} 1/s, "
                f"{ENOUGH_DAMPING:g} sqrt(k_N/m); take variant=subcycling, more damping, or see --growth-test"
            )
    for words in found:
        warnings.warn(words, stacklevel=3)
