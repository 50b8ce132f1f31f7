"""Discrete elements in Numba: discs with rolling resistance, rigid plates, neighbour list, explicit stepping."""

from particles.assembly import Assembly
from particles.laws import LiChu
from particles.motion import Unstable
from particles.walls import Plate

__all__ = ["Assembly", "LiChu", "Plate", "Unstable"]
