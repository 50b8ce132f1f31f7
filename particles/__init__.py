"""Discrete elements in Numba: discs and spheres, contact laws and bonds, rigid walls, neighbour list, explicit stepping."""

from pathlib import Path

from particles.caches import drop_stale

drop_stale(Path(__file__).parent)

from particles.assembly import Assembly  # noqa: E402
from particles.cell import PeriodicCell  # noqa: E402
from particles.laws import Bonded, HertzMindlin, LiChu, UserLaw, linear_sliding  # noqa: E402
from particles.motion import Unstable  # noqa: E402
from particles.packing import NotReached, random_dense  # noqa: E402
from particles.walls import Free, Plate, Servo, Wall, room, shapes  # noqa: E402

__all__ = [
    "Assembly", "Bonded", "Free", "HertzMindlin", "LiChu", "NotReached", "PeriodicCell", "Plate", "Servo", "Unstable",
    "UserLaw", "Wall", "linear_sliding", "random_dense", "room", "shapes",
]  # fmt: skip
