"""The zone that particles and continuum carry together, and which of the two carries how much of it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.checks import number

Array = NDArray[np.float64]

PROFILES = {
    "linear": lambda share: share,
    "smooth": lambda share: share * share * (3.0 - 2.0 * share),  # without a kink at the faces
}


class Shrunk:
    """The part of a region that lies deeper than a depth (m) below its outline."""

    def __init__(self, region: Any, depth: float):
        self.region, self.depth = region, float(depth)

    def distance(self, points) -> Array:
        """Signed distance (n,) in m, negative inside."""
        return np.asarray(self.region.distance(points)) + self.depth


class OverlapZone:
    """The zone between two faces: particles alone inside the first, continuum alone outside the second.

    Called with points (n, 2) or (n, 3) it gives the continuum's share alpha (n,): 0 where particles are alone, 1 where the
    continuum is, between them g0 / (g0 + g1) with the distances to the inner and the outer face (Rojek & Onate 2007, eqs
    63-67, where the faces are parallel). A face that is to be no interface (a free surface) must lie well outside the body.

    Args:
        inner: Region with `distance` (negative inside) of particles alone.
        outer: Region of all particles; it holds the inner one.
        profile: "linear" as published, or "smooth", 3 alpha^2 - 2 alpha^3.
    """

    def __init__(self, inner: Any, outer: Any, profile: str = "linear"):
        for name, region in (("inner", inner), ("outer", outer)):
            if not hasattr(region, "distance"):
                raise ValueError(f"{name}={region!r} must be a region (an object with distance), such as Box or HalfPlane")
        if profile not in PROFILES:
            raise ValueError(f"profile={profile!r} must be one of {', '.join(PROFILES)}")
        self.inner, self.outer, self.profile = inner, outer, profile

    @classmethod
    def within(cls, region: Any, width: float, profile: str = "linear") -> OverlapZone:
        """The band of a width (m) inside the outline of the particles' region."""
        return cls(Shrunk(region, number("width", width)), region, profile)

    def __call__(self, points) -> Array:
        to_inner, to_outer = self.distances(points)
        with np.errstate(invalid="ignore"):
            share = to_inner / (to_inner + to_outer)
        share = np.where(to_inner <= 0.0, 0.0, np.where(to_outer <= 0.0, 1.0, share))
        return PROFILES[self.profile](share)

    def distances(self, points) -> tuple[Array, Array]:
        """Distances (n,) in m from the inner face outwards and from the outer face inwards."""
        return np.asarray(self.inner.distance(points), dtype=float), -np.asarray(self.outer.distance(points), dtype=float)
