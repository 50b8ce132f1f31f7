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
def strain_cubic(first, count, near, spacing, ux, uy, uz, xx, yy, zz, yz, xz, xy):
    """Strain of a run of the 18-neighbour lattice:  H = sum (u+ - u-) X / (10 d^2) over nine pairs of neighbours."""
    c = 0.1 / spacing
    s = U(first)
    a, b, e, f, g, h = U(near[0]), U(near[1]), U(near[2]), U(near[3]), U(near[4]), U(near[5])
    p3, m3, p4, m4, p5, m5 = U(near[6]), U(near[7]), U(near[8]), U(near[9]), U(near[10]), U(near[11])
    p6, m6, p7, m7, p8, m8 = U(near[12]), U(near[13]), U(near[14]), U(near[15]), U(near[16]), U(near[17])
    for i in range(U(count)):
        x3, x4, x5, x6 = ux[p3 + i] - ux[m3 + i], ux[p4 + i] - ux[m4 + i], ux[p5 + i] - ux[m5 + i], ux[p6 + i] - ux[m6 + i]
        x7, x8 = ux[p7 + i] - ux[m7 + i], ux[p8 + i] - ux[m8 + i]
        y3, y4, y5, y6 = uy[p3 + i] - uy[m3 + i], uy[p4 + i] - uy[m4 + i], uy[p5 + i] - uy[m5 + i], uy[p6 + i] - uy[m6 + i]
        y7, y8 = uy[p7 + i] - uy[m7 + i], uy[p8 + i] - uy[m8 + i]
        z3, z4, z5, z6 = uz[p3 + i] - uz[m3 + i], uz[p4 + i] - uz[m4 + i], uz[p5 + i] - uz[m5 + i], uz[p6 + i] - uz[m6 + i]
        z7, z8 = uz[p7 + i] - uz[m7 + i], uz[p8 + i] - uz[m8 + i]
        x_by_y = ux[e + i] - ux[f + i] + x3 - x4 + x7 + x8
        x_by_z = ux[g + i] - ux[h + i] + x5 - x6 + x7 - x8
        y_by_x = uy[a + i] - uy[b + i] + y3 + y4 + y5 + y6
        y_by_z = uy[g + i] - uy[h + i] + y5 - y6 + y7 - y8
        z_by_x = uz[a + i] - uz[b + i] + z3 + z4 + z5 + z6
        z_by_y = uz[e + i] - uz[f + i] + z3 - z4 + z7 + z8
        xx[s + i] = c * (ux[a + i] - ux[b + i] + x3 + x4 + x5 + x6)
        yy[s + i] = c * (uy[e + i] - uy[f + i] + y3 - y4 + y7 + y8)
        zz[s + i] = c * (uz[g + i] - uz[h + i] + z5 - z6 + z7 - z8)
        yz[s + i] = 0.5 * c * (y_by_z + z_by_y)
        xz[s + i] = 0.5 * c * (x_by_z + z_by_x)
        xy[s + i] = 0.5 * c * (x_by_y + y_by_x)


@njit(**KERNEL)
def force_cubic(first, count, near, spacing, kn, ks, ux, uy, uz, xx, yy, zz, yz, xz, xy, fx, fy, fz):
    """Force on a run of the 18-neighbour lattice with the same stiffnesses all around it (Zhao et al. 2012, eqs 3-8).

    F = kn sum n n.(u+ + u- - 2 u) + ks/2 sum (I - n n)(e+ - e-) X over nine pairs: what the strain of the particle itself adds
    cancels between opposite bonds.
    """
    c = 0.5 * ks * spacing
    s = U(first)
    a, b, e, f, g, h = U(near[0]), U(near[1]), U(near[2]), U(near[3]), U(near[4]), U(near[5])
    p3, m3, p4, m4, p5, m5 = U(near[6]), U(near[7]), U(near[8]), U(near[9]), U(near[10]), U(near[11])
    p6, m6, p7, m7, p8, m8 = U(near[12]), U(near[13]), U(near[14]), U(near[15]), U(near[16]), U(near[17])
    for i in range(U(count)):
        w3 = ux[p3 + i] + ux[m3 + i] + uy[p3 + i] + uy[m3 + i]
        w4 = ux[p4 + i] + ux[m4 + i] - uy[p4 + i] - uy[m4 + i]
        w5 = ux[p5 + i] + ux[m5 + i] + uz[p5 + i] + uz[m5 + i]
        w6 = ux[p6 + i] + ux[m6 + i] - uz[p6 + i] - uz[m6 + i]
        w7 = uy[p7 + i] + uy[m7 + i] + uz[p7 + i] + uz[m7 + i]
        w8 = uy[p8 + i] + uy[m8 + i] - uz[p8 + i] - uz[m8 + i]
        nx = ux[a + i] + ux[b + i] + 0.5 * (w3 + w4 + w5 + w6) - 6.0 * ux[s + i]
        ny = uy[e + i] + uy[f + i] + 0.5 * (w3 - w4 + w7 + w8) - 6.0 * uy[s + i]
        nz = uz[g + i] + uz[h + i] + 0.5 * (w5 - w6 + w7 - w8) - 6.0 * uz[s + i]
        d3 = xx[p3 + i] - xx[m3 + i] - yy[p3 + i] + yy[m3 + i]
        d4 = xx[p4 + i] - xx[m4 + i] - yy[p4 + i] + yy[m4 + i]
        d5 = xx[p5 + i] - xx[m5 + i] - zz[p5 + i] + zz[m5 + i]
        d6 = xx[p6 + i] - xx[m6 + i] - zz[p6 + i] + zz[m6 + i]
        d7 = yy[p7 + i] - yy[m7 + i] - zz[p7 + i] + zz[m7 + i]
        d8 = yy[p8 + i] - yy[m8 + i] - zz[p8 + i] + zz[m8 + i]
        sx = xy[e + i] - xy[f + i] + xz[g + i] - xz[h + i] + 0.5 * (d3 + d4 + d5 + d6)
        sx += xy[p7 + i] - xy[m7 + i] + xz[p7 + i] - xz[m7 + i] + xy[p8 + i] - xy[m8 + i] - xz[p8 + i] + xz[m8 + i]
        sy = xy[a + i] - xy[b + i] + yz[g + i] - yz[h + i] + 0.5 * (d4 - d3 + d7 + d8)
        sy += xy[p5 + i] - xy[m5 + i] + yz[p5 + i] - yz[m5 + i] + xy[p6 + i] - xy[m6 + i] - yz[p6 + i] + yz[m6 + i]
        sz = xz[a + i] - xz[b + i] + yz[e + i] - yz[f + i] + 0.5 * (d6 - d5 + d8 - d7)
        sz += xz[p3 + i] - xz[m3 + i] + yz[p3 + i] - yz[m3 + i] + xz[p4 + i] - xz[m4 + i] - yz[p4 + i] + yz[m4 + i]
        fx[s + i] = kn * nx + c * sx
        fy[s + i] = kn * ny + c * sy
        fz[s + i] = kn * nz + c * sz


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
def worst_cubic(first, count, near, spacing, normal, shear, ux, uy, uz, xx, yy, zz, yz, xz, xy):
    """Largest share of their limits (m), normal or the square of the shear, that bonds of a run have reached."""
    reach, oblique = 1.0 / normal, math.sqrt(0.5) / normal
    across = 0.25 * spacing * spacing / (shear * shear)  # shear deformations from sums of the strains of both ends
    worst = 0.0
    s = U(first)
    a, e, g = U(near[0]), U(near[2]), U(near[4])
    p3, p4, p5, p6, p7, p8 = U(near[6]), U(near[8]), U(near[10]), U(near[12]), U(near[14]), U(near[16])
    for i in range(U(count)):
        x, y, z = ux[s + i], uy[s + i], uz[s + i]
        n = max(ux[a + i] - x, uy[e + i] - y, uz[g + i] - z)
        m = max(ux[p3 + i] - x + uy[p3 + i] - y, ux[p4 + i] - x - uy[p4 + i] + y)
        m = max(m, ux[p5 + i] - x + uz[p5 + i] - z, ux[p6 + i] - x - uz[p6 + i] + z)
        m = max(m, uy[p7 + i] - y + uz[p7 + i] - z, uy[p8 + i] - y - uz[p8 + i] + z)
        cxx, cyy, czz, cyz, cxz, cxy = xx[s + i], yy[s + i], zz[s + i], yz[s + i], xz[s + i], xy[s + i]
        t = max((xy[a + i] + cxy) ** 2 + (xz[a + i] + cxz) ** 2, (xy[e + i] + cxy) ** 2 + (yz[e + i] + cyz) ** 2)
        t = max(t, (xz[g + i] + cxz) ** 2 + (yz[g + i] + cyz) ** 2)
        t = max(t, 0.5 * (xx[p3 + i] + cxx - yy[p3 + i] - cyy) ** 2 + (xz[p3 + i] + cxz + yz[p3 + i] + cyz) ** 2)
        t = max(t, 0.5 * (xx[p4 + i] + cxx - yy[p4 + i] - cyy) ** 2 + (xz[p4 + i] + cxz - yz[p4 + i] - cyz) ** 2)
        t = max(t, 0.5 * (xx[p5 + i] + cxx - zz[p5 + i] - czz) ** 2 + (xy[p5 + i] + cxy + yz[p5 + i] + cyz) ** 2)
        t = max(t, 0.5 * (xx[p6 + i] + cxx - zz[p6 + i] - czz) ** 2 + (xy[p6 + i] + cxy - yz[p6 + i] - cyz) ** 2)
        t = max(t, 0.5 * (yy[p7 + i] + cyy - zz[p7 + i] - czz) ** 2 + (xy[p7 + i] + cxy + xz[p7 + i] + cxz) ** 2)
        t = max(t, 0.5 * (yy[p8 + i] + cyy - zz[p8 + i] - czz) ** 2 + (xy[p8 + i] + cxy - xz[p8 + i] - cxz) ** 2)
        worst = max(worst, reach * n, oblique * m, across * t)
    return worst


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
