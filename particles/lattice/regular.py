"""Compiled loops over runs: rows one after the other whose neighbours in each direction are rows one after the other, too.

All neighbours of such a row are joined to it, so that the least squares reduce to differences of opposite neighbours, and a run
is a stencil that needs no table of neighbours. Directions are those of `particles.lattice.directions`: pairs of
opposite ones. Strains are stored as xx, yy, zz, yz, xz, xy (tensor shear), forces in N.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from particles.system import KERNEL

U = np.uintp  # indices without a sign need no look whether they count from the end


@njit(**KERNEL)
def strain_hexagonal(first, count, near, spacing, ux, uy, xx, yy, xy):
    """Strain of a run of the hexagonal lattice:  H = sum (u+ - u-) X / (3 d^2) over three pairs of neighbours."""
    c, height = 1.0 / (3.0 * spacing), 0.5 * math.sqrt(3.0)
    s = U(first)
    a, b, p, m, q, r = U(near[0]), U(near[1]), U(near[2]), U(near[3]), U(near[4]), U(near[5])
    for i in range(U(count)):
        xp, xq, yp, yq = ux[p + i] - ux[m + i], ux[q + i] - ux[r + i], uy[p + i] - uy[m + i], uy[q + i] - uy[r + i]
        xx[s + i] = c * (ux[a + i] - ux[b + i] + 0.5 * (xp - xq))
        yy[s + i] = c * height * (yp + yq)
        xy[s + i] = 0.5 * c * (height * (xp + xq) + uy[a + i] - uy[b + i] + 0.5 * (yp - yq))


@njit(**KERNEL)
def force_hexagonal(first, count, near, spacing, kn, ks, ux, uy, xx, yy, xy, fx, fy):
    """Force on a run of the hexagonal lattice, as `force_cubic`."""
    c, height = 0.5 * ks * spacing, 0.5 * math.sqrt(3.0)
    s = U(first)
    a, b, p, m, q, r = U(near[0]), U(near[1]), U(near[2]), U(near[3]), U(near[4]), U(near[5])
    for i in range(U(count)):
        wp = 0.5 * (ux[p + i] + ux[m + i]) + height * (uy[p + i] + uy[m + i])  # along n = (1/2, height)
        wq = height * (uy[q + i] + uy[r + i]) - 0.5 * (ux[q + i] + ux[r + i])  # along n = (-1/2, height)
        nx = ux[a + i] + ux[b + i] + 0.5 * (wp - wq) - 3.0 * ux[s + i]
        ny = height * (wp + wq) - 3.0 * uy[s + i]
        # t = (-height, 1/2) and (-height, -1/2) across the oblique bonds; t.e.n of the difference of opposite strains
        ep = height * 0.5 * (yy[p + i] - yy[m + i] - xx[p + i] + xx[m + i]) - 0.5 * (xy[p + i] - xy[m + i])
        eq = height * 0.5 * (xx[q + i] - xx[r + i] - yy[q + i] + yy[r + i]) - 0.5 * (xy[q + i] - xy[r + i])
        fx[s + i] = kn * nx - c * height * (ep + eq)
        fy[s + i] = kn * ny + c * (xy[a + i] - xy[b + i] + 0.5 * (ep - eq))


@njit(**KERNEL)
def worst_hexagonal(first, count, near, spacing, normal, shear, ux, uy, xx, yy, xy):
    """Largest share of their limits (m) that bonds of a run of the hexagonal lattice have reached."""
    height = 0.5 * math.sqrt(3.0)
    reach, across = 1.0 / normal, 0.5 * spacing / shear  # shear deformations from sums of the strains of both ends
    worst = 0.0
    s = U(first)
    a, p, q = U(near[0]), U(near[2]), U(near[4])
    for i in range(U(count)):
        x, y, cxx, cyy, cxy = ux[s + i], uy[s + i], xx[s + i], yy[s + i], xy[s + i]
        n = max(0.5 * (ux[p + i] - x) + height * (uy[p + i] - y), height * (uy[q + i] - y) - 0.5 * (ux[q + i] - x), ux[a + i] - x)
        tp = 0.5 * (height * (yy[p + i] + cyy - xx[p + i] - cxx) - xy[p + i] - cxy)
        tq = 0.5 * (height * (xx[q + i] + cxx - yy[q + i] - cyy) - xy[q + i] - cxy)
        worst = max(worst, reach * n, across * max(abs(tp), abs(tq), abs(xy[a + i] + cxy)))
    return worst
