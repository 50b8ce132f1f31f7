"""Continuum half: Cauchy and Cosserat bodies in plane strain and in space; dolfinx, explicit in time."""

from .body import Body
from .materials import Cauchy, Cosserat, CosseratModuli
from .motion import Unstable

__all__ = ["Body", "Cauchy", "Cosserat", "CosseratModuli", "Unstable"]
