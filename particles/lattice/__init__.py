"""Distinct lattice springs: the particles of a lattice as a brittle elastic solid (Zhao, Khalili, Fang & Zhao 2012)."""

from particles.lattice.lattice import Lattice
from particles.lattice.material import LatticeMaterial

__all__ = ["Lattice", "LatticeMaterial"]
