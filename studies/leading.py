"""How a study of particles alone runs on several ranks: rank 0 leads, all ranks move the particles."""

from __future__ import annotations

from collections.abc import Callable

from studies.foundation_command import unstable
from studies.options import check_cores


def led(script: Callable[[], str]) -> int:
    """Exit status of a study on all ranks (collective).

    Args:
        script: runs the study and says what it found, on rank 0; returns what made it unstable, or nothing.
    """
    check_cores()

    from particles import Unstable
    from particles.driving import NotSettled
    from particles.spread import lead

    try:
        message = lead(script)
    except (NotSettled, Unstable) as failure:  # before the run itself
        message = str(failure)
    return unstable(message) if message else 0
