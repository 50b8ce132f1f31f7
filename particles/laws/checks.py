"""Checks of constants that the laws share."""

from __future__ import annotations

import math
from typing import Any

import numpy as np


def checked(law: Any, names: tuple[str, ...], positive: tuple[str, ...] = ()) -> None:
    """Raise a ValueError where a named constant is not a finite number, is negative, or (`positive`) zero."""
    for name in names:
        value = getattr(law, name)
        if not (isinstance(value, (int, float, np.number)) and math.isfinite(value) and value >= 0.0):
            raise ValueError(f"{name}={value!r} must be a finite number, zero or positive")
        if name in positive and value == 0.0:
            raise ValueError(f"{name}={value!r} must be positive")
