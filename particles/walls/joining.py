"""What a wall must be like to join an assembly."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from particles.cell import PeriodicCell
from particles.walls.periodic import check_deformation, check_planes
from particles.walls.wall import Wall

KINDS = {2: "discs in the plane", 3: "spheres in space"}


def check_joining(walls: Sequence[Any], present: Sequence[Wall], axes: int, cell: PeriodicCell | None) -> None:
    """Raise a ValueError where one of `walls` cannot join the `present` ones of an assembly; see `Assembly.add_wall`."""
    for wall in walls:
        if not isinstance(wall, Wall):
            raise ValueError(f"wall={wall!r} must be a Wall or a Plate")
        if wall.taken:
            raise ValueError(f"{wall.name} belongs to an assembly already: make one wall for each")
        if wall.axes != axes:
            raise ValueError(
                f"{wall.name} has points of {wall.axes} components, but the particles are {KINDS[axes]}: make its "
                f"shape of points of {axes} components"
            )
        if wall.body_taken and not any(wall.is_fixed_to(other) for other in present):
            raise ValueError(f"{wall.name} is fixed to a wall of another assembly: fix it to one of this assembly")
    if cell is not None:
        check_planes(list(walls), cell)
        if cell.velocity_gradient.any():
            check_deformation(list(walls))
