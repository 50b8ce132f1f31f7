"""Discrete elements in Numba: discs with rolling resistance, rigid plates, neighbour list, explicit stepping."""

from pathlib import Path

from particles.caches import drop_stale

drop_stale(Path(__file__).parent)

from particles.assembly import Assembly  # noqa: E402
from particles.laws import LiChu  # noqa: E402
from particles.motion import Unstable  # noqa: E402
from particles.packing import random_dense  # noqa: E402
from particles.walls import Plate  # noqa: E402

__all__ = ["Assembly", "LiChu", "Plate", "Unstable", "random_dense"]
