"""Torsion of a circular Cosserat bar: torque and micro-rotation converge to the closed form of Gauthier & Jahsman (1975)."""

import numpy as np
import pytest
from scipy.special import iv

from continuum import Body
from meshes import domains
from tests.continuum.space import GRAINS, solve

RADIUS, TWIST = 1.0, 1e-3  # m, rad/m


def closed_form():
    """Radial micro-rotation (function of r) and torque, divided by the twist.

    u = twist (-z y, z x, 0), phi = (phi_r(r), 0, twist z): of equilibrium remains (alpha + beta + gamma) (phi_r'' + phi_r'/r - phi_r/r^2)
    = 4 Gc (phi_r + twist r / 2), so that phi_r = -twist r / 2 + C I_1(p r), p^2 = 4 Gc / (alpha + beta + gamma), and m_rr = 0 at
    the surface gives C (Gauthier & Jahsman 1975; the torque is the integral of r sigma_z,theta + m_zz).
    """
    shear, gc, alpha = GRAINS.shear_modulus, GRAINS.cosserat_shear, GRAINS.couple_alpha
    sum_of_two = GRAINS.couple_beta + GRAINS.couple_modulus
    a, p = RADIUS, np.sqrt(4.0 * gc / (alpha + sum_of_two))
    c = 0.5 * sum_of_two / ((alpha + sum_of_two) * p * iv(0, p * a) - sum_of_two * iv(1, p * a) / a)
    torque = np.pi * (0.5 * shear * a**4 + sum_of_two * a**2)
    torque += c * np.pi * (4.0 * gc * a**2 * iv(2, p * a) / p + 2.0 * alpha * a * iv(1, p * a))
    return lambda r: -0.5 * r + c * iv(1, p * r), torque


def errors(cells, cell, layers):
    """Of the torque and of the radial micro-rotation (root mean square), as shares."""
    length = 0.5
    domain = domains.box((-1, -1, 0), (1, 1, length), (cells, cells, layers), cell)
    x, y = domain.mesh.geometry.x[:, 0].copy(), domain.mesh.geometry.x[:, 1].copy()
    domain.mesh.geometry.x[:, 0] = RADIUS * x * np.sqrt(1.0 - 0.5 * y**2)  # of the square, a disc
    domain.mesh.geometry.x[:, 1] = RADIUS * y * np.sqrt(1.0 - 0.5 * x**2)
    body = Body(domain, GRAINS)
    body.fix("bottom", "xyzc")
    body.fix("top", "xyc")
    x, y, z = body.coordinates.T
    prescribed = np.zeros_like(body.mass)
    prescribed[:, [0, 1, 5]] = TWIST * np.column_stack([-z * y, z * x, z])
    solve(body, np.where(body.fixed, prescribed, 0.0))
    turned, torque = closed_form()
    r = np.hypot(x, y)
    found = body.displacement[:, 3] * x + body.displacement[:, 4] * y
    scale = TWIST * RADIUS * np.abs(turned(RADIUS))
    return abs(body.reaction("top")[5] / (TWIST * torque) - 1.0), np.sqrt(np.mean((found - TWIST * r * turned(r)) ** 2)) / scale


@pytest.mark.parametrize("cell, layers, most", [("hexahedron", (1, 1, 1), 2e-3), ("tetrahedron", (1, 2, 4), 3e-2)])
def test_torque_and_micro_rotation_converge_at_second_order(cell, layers, most):
    """Trilinear cells have the motion along the bar exactly, so that one layer does; tetrahedra do not have it."""
    found = np.array([errors(n, cell, k) for n, k in zip((6, 12, 24), layers)])
    assert np.log2(found[:-1] / found[1:]) == pytest.approx(np.full((2, 2), 2.0), abs=0.25), found
    assert found[-1].max() < most
