"""What an element of a body can be."""

CONTINUUM, MANIFOLD, PARTICLES = 0, 1, 2  # values of `Manifold.kind`
