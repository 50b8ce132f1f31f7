"""Weak forms. One set serves all linear materials: moduli enter as constants, so that no change of them recompiles."""

from __future__ import annotations

import ufl


def strain(w):
    """Strain eps_ij = u_j,i - e_ijk phi_k of w = (u[, phi]), in the plane phi about z; the rotation is absent in a Cauchy body."""
    dim, gradient = axes(w), ufl.grad(w)  # gradient[j, i] = w_j,i

    def turned(i, j):
        """e_ijk phi_k."""
        if i == j or not rotations(w):
            return 0.0
        about, sign = 3 - i - j, 1.0 if (j - i) % 3 == 1 else -1.0
        return sign * w[dim + (about if dim == 3 else 0)]

    return ufl.as_tensor([[gradient[j, i] - turned(i, j) for j in range(dim)] for i in range(dim)])


def curvature(w):
    """Curvature kappa_ij = phi_j,i, in the plane with the one component j of phi."""
    dim, gradient = axes(w), ufl.grad(w)
    return ufl.as_tensor([[gradient[dim + j, i] for j in range(rotations(w))] for i in range(dim)])


def internal_work(w, v, stiffness, couple):
    """Virtual work density sigma(w) : eps(v) + m(w) : kappa(v) (J/m3)."""
    i, j, k, m = ufl.indices(4)
    work = stiffness[i, j, k, m] * strain(w)[k, m] * strain(v)[i, j]
    if rotations(v):
        work += couple[i, j, k, m] * curvature(w)[k, m] * curvature(v)[i, j]
    return work


def lumped_mass(v, density, micro_inertia):
    """Density of the row sums of the mass matrix: rho N for displacements, Theta N for rotations."""
    dim = axes(v)
    mass = density * sum(v[i] for i in range(dim))
    return mass + micro_inertia * sum(v[dim + i] for i in range(rotations(v))) if rotations(v) else mass


def rotations(w) -> int:
    """Number of components of the micro-rotation in a nodal field."""
    return w.ufl_shape[0] - axes(w)


def axes(w) -> int:
    """Number of dimensions of the mesh of a nodal field."""
    return ufl.grad(w).ufl_shape[-1]


def over_uncovered(density_of, measure, weight, degree, cut_degree):
    """Integral of a density over whole cells and, weighted point by point, over the uncovered part of cut cells.

    Args:
        density_of: UFL scalar.
        measure: cell measure with the tags WHOLE and CUT.
        weight: coefficient on the points of the rule of `cut_degree`, or None where no cell is cut.
        degree: quadrature degree on whole cells.
        cut_degree: quadrature degree on cut cells.
    """
    total = density_of * measure(WHOLE, metadata={"quadrature_degree": degree})
    if weight is not None:
        cut = {"quadrature_degree": cut_degree, "quadrature_rule": "default"}
        total += weight * density_of * measure(CUT, metadata=cut)
    return total


WHOLE, CUT = 1, 2  # tags of cells; covered cells carry neither
