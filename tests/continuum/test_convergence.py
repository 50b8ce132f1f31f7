"""Cosserat shear layer: the static solution converges to the closed form at second order."""

import numpy as np
import pytest
from petsc4py import PETSc

from continuum import Body, Cosserat
from meshes import domains

HEIGHT, SLIP = 1.0, 1e-3  # m
MATERIAL = Cosserat(500e6, 0.2, 70e6, 0.2, 2042.0)


def shear_layer(y):
    """u(y), phi(y) and shear stress tau of a layer with u(0) = phi(0) = phi(H) = 0, u(H) = SLIP.

    From (G + Gc) u' + 2 Gc phi = tau and B phi'' = 2 Gc (u' + 2 phi):
    phi = -tau/2G + A cosh k(y - H/2), k^2 = 4 G Gc / B(G + Gc) (Mindlin 1963, in plane strain).
    """
    g, gc, b = MATERIAL.shear_modulus, MATERIAL.cosserat_shear, MATERIAL.couple_modulus
    k = np.sqrt(4 * g * gc / (b * (g + gc)))
    amplitude = 1 / (2 * g * np.cosh(k * HEIGHT / 2))  # times tau

    def integral(s):  # of phi / tau from 0 to s
        return -s / (2 * g) + amplitude / k * (np.sinh(k * (s - HEIGHT / 2)) + np.sinh(k * HEIGHT / 2))

    tau = SLIP * (g + gc) / (HEIGHT - 2 * gc * integral(HEIGHT))
    u = tau * (y - 2 * gc * integral(y)) / (g + gc)
    return u, tau * (-1 / (2 * g) + amplitude * np.cosh(k * (y - HEIGHT / 2))), tau


def solve_static(body, prescribed):
    """Displacements in equilibrium with `prescribed` values on the fixed components, by a direct solver."""
    fixed = body.boundaries.fixed_flat.astype(np.int32)
    matrix = body._matrix.copy()
    solution, right = matrix.createVecs()
    solution.array[:] = prescribed.ravel()
    matrix.zeroRowsColumns(fixed, 1.0, solution, right)
    solver = PETSc.KSP().create()
    solver.setOperators(matrix)
    solver.setType("preonly")
    solver.getPC().setType("lu")
    solver.solve(right, solution)
    body.displacement[:] = solution.array.reshape(body.displacement.shape)


def layer_errors(cells, cell):
    body = Body(domains.rectangle((0, 0), (0.25, HEIGHT), (cells // 4, cells), cell), MATERIAL)
    body.fix("bottom", "xyr")
    body.fix("top", "xyr")
    body.fix(everywhere, "y")
    y = body.coordinates[:, 1]
    prescribed = np.zeros_like(body.displacement)
    prescribed[:, 0] = np.where(y > HEIGHT - 1e-9, SLIP, 0.0)
    solve_static(body, prescribed)
    u, phi, tau = shear_layer(y)
    load = body.reaction("top")[0] / 0.25
    return (
        np.sqrt(np.mean((body.displacement[:, 0] - u) ** 2)) / SLIP,
        np.sqrt(np.mean((body.displacement[:, 2] - phi) ** 2)) / np.abs(phi).max(),
        abs(load / tau - 1.0),
    )


def everywhere(points):
    return np.ones(len(points), dtype=bool)


def test_shear_layer_converges_at_second_order(cell):
    counts = np.array([8, 16, 32])
    errors = np.array([layer_errors(int(n), cell) for n in counts])
    rates = np.log2(errors[:-1] / errors[1:])
    assert rates == pytest.approx(np.full_like(rates, 2.0), abs=0.15), f"{errors}"
    assert errors[-1].max() < 5e-3


def test_the_layer_is_stiffer_than_without_couples():
    """The closed form itself: held rotations stiffen the layer above the classical tau = G SLIP / H."""
    assert shear_layer(0.0)[2] > MATERIAL.shear_modulus * SLIP / HEIGHT
