"""Continuum half: plane-strain Cauchy and Cosserat bodies on dolfinx, explicit in time."""

from .body import Body
from .materials import Cauchy, Cosserat, CosseratModuli

__all__ = ["Body", "Cauchy", "Cosserat", "CosseratModuli"]
