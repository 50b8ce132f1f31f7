"""Weak forms. One set serves all linear materials: moduli enter as constants, so that no change of them recompiles."""

from __future__ import annotations

import ufl


def strain(w):
    """Strain eps_ij = u_j,i - e_ij phi of w = (u_x, u_y[, phi]), in space u_j,i; the rotation is absent in a Cauchy body."""
    gradient = ufl.grad(w)  # gradient[j, i] = w_j,i
    if axes(w) == 3:
        return ufl.transpose(gradient)
    phi = w[2] if w.ufl_shape[0] == 3 else 0.0
    return ufl.as_tensor([[gradient[0, 0], gradient[1, 0] - phi], [gradient[0, 1] + phi, gradient[1, 1]]])


def internal_work(w, v, stiffness, couple):
    """Virtual work density sigma(w) : eps(v) + m(w) . grad(phi_v) (J/m3)."""
    i, j, k, m = ufl.indices(4)
    work = stiffness[i, j, k, m] * strain(w)[k, m] * strain(v)[i, j]
    if v.ufl_shape[0] > axes(v):
        work += couple[i, j] * ufl.grad(w[2])[j] * ufl.grad(v[2])[i]
    return work


def lumped_mass(v, density, micro_inertia):
    """Density of the row sums of the mass matrix: rho N for displacements, Theta N for the rotation."""
    mass = density * sum(v[i] for i in range(axes(v)))
    return mass + micro_inertia * v[2] if v.ufl_shape[0] > axes(v) else mass


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
