"""Lattice particles, particle-based manifold elements and continuum elements in one body (Zhao et al. 2012)."""

from bridge.manifold.body import Manifold
from bridge.manifold.criterion import principal, ultimate_strain
from bridge.manifold.kinds import CONTINUUM, MANIFOLD, PARTICLES

__all__ = ["CONTINUUM", "MANIFOLD", "Manifold", "PARTICLES", "principal", "ultimate_strain"]
