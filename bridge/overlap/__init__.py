"""Coupling of particles and continuum over a zone that both carry (Rojek & Onate 2007, section 5)."""

from bridge.overlap.coupling import Overlap
from bridge.overlap.zone import OverlapZone

__all__ = ["Overlap", "OverlapZone"]
