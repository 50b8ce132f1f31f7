"""Continuum half: plane-strain Cauchy and Cosserat bodies on dolfinx, explicit in time."""

from .body import Body
from .materials import Cauchy, Cosserat, CosseratModuli
from .motion import Unstable

__all__ = ["Body", "Cauchy", "Cosserat", "CosseratModuli", "Unstable"]
