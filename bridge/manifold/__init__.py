"""Lattice particles, particle-based manifold elements and continuum elements in one body (Zhao et al. 2012)."""

from bridge.manifold.body import LOST, Manifold
from bridge.manifold.criterion import bond_limits, principal, ultimate_strain
from bridge.manifold.kinds import CONTINUUM, MANIFOLD, PARTICLES
from bridge.manifold.recoarsening import Recoarsening

__all__ = ["CONTINUUM", "LOST", "MANIFOLD", "Manifold", "PARTICLES", "Recoarsening", "bond_limits", "principal", "ultimate_strain"]
