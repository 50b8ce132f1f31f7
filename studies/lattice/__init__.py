"""Studies of lattice particles, manifold elements and continuum (Zhao, Khalili, Fang & Zhao 2012)."""
