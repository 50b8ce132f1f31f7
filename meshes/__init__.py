"""Geometry: named regions, gmsh domains with named parts, particle layouts.

`regions` and `packings` need numpy only; `domains` (dolfinx and gmsh) is imported on request:
`from meshes import domains`.
"""

from . import packings
from .regions import Box, Cylinder, Disc, HalfPlane, HalfSpace, Region, Sphere

__all__ = ["Box", "Cylinder", "Disc", "HalfPlane", "HalfSpace", "Region", "Sphere", "packings"]
