"""Geometry: named regions, gmsh domains with named parts, particle layouts.

`regions` and `packings` need numpy only; `domains` (dolfinx and gmsh) is imported on request:
`from meshes import domains`.
"""

from . import packings
from .regions import Box, Disc, HalfPlane, Region

__all__ = ["Box", "Disc", "HalfPlane", "Region", "packings"]
