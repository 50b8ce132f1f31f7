"""Numbers that a caller gives, checked before any work."""

from __future__ import annotations

import math
from numbers import Real
from typing import Any


def number(name: str, value: Any, positive: bool = True) -> float:
    """A positive (or zero or positive) finite number; ValueError by name otherwise."""
    fits = isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)
    if not (fits and (value > 0.0 or (value == 0.0 and not positive))):
        raise ValueError(f"{name}={value!r} must be {'positive' if positive else 'zero or positive'}, a finite number")
    return float(value)


def count(name: str, value: Any) -> int:
    """A whole number of at least 1; ValueError by name otherwise."""
    fits = isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)
    if not (fits and value == int(value) and value >= 1):
        raise ValueError(f"{name}={value!r} must be a whole number of at least 1")
    return int(value)
