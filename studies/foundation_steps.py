"""Time steps of the foundation: how many particle steps make a coarse one, and where growth is to be feared."""

from __future__ import annotations

import math
import warnings

from studies.foundation import Parameters

TRUSTED_RATIO = 0.7  # of the continuum's critical step: up to there respa and multiplier have not been seen to grow
ENOUGH_DAMPING = 0.05  # of sqrt(k_N/m): with it paper and resync have not been seen to grow


def warn_of_growth(p: Parameters, substeps: int, coarse_ratio: float, mean_radius: float) -> None:
    """Warn where theory or experience expects a bridging run to grow, without the growth test.

    Args:
        p: Parameters.
        substeps: Particle steps in a coarse step.
        coarse_ratio: Coarse step as a share of the continuum's critical step.
        mean_radius: Of the discs, m.
    """
    found = []
    if p.variant in ("respa", "multiplier"):
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
                f"{ENOUGH_DAMPING:g} sqrt(k_N/m); take variant=respa, more damping, or see --growth-test"
            )
    for words in found:
        warnings.warn(words, stacklevel=3)
