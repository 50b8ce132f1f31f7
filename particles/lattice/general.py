"""Compiled loops for any cluster of bonds: surfaces, interfaces of materials, broken bonds (Zhao et al. 2012, section 2.2)."""

from __future__ import annotations

import math

from numba import njit

from particles.lattice.blocks import mask_of
from particles.lattice.state import BROKEN, EXPLICIT, JOINED
from particles.system import INLINE, KERNEL, STEPS

ALL = -1  # bits of all directions
TURNS = 40  # at most, of the iteration for the polar decomposition
LEAST = 1e-3  # determinant of a gradient: a neighbourhood that is pressed flat has no rotation
SPANNING = 1e-5  # determinant over the cube of the trace of moments that span space, and minors over its square of those that span a plane


@njit(**KERNEL)
def gradient_of(state, terms, i, ways):
    """Displacement gradient (xx, xy, ..., zz by rows) by least squares:  H = sum (u_k - u_i) (A (X_k - mean X)), over directions with a bit."""
    u, c = state.displacement, state.cluster
    ux, uy, uz = u[0, i], u[1, i], u[2, i]
    hxx = hxy = hxz = hyx = hyy = hyz = hzx = hzy = hzz = 0.0
    for k in range(state.near.shape[1]):
        if ways >> k & 1 and state.bonds[i, k] & JOINED:
            j = state.near[i, k]
            x, y, z = terms.vectors[k, 0] - c[6, i], terms.vectors[k, 1] - c[7, i], terms.vectors[k, 2] - c[8, i]
            gx = c[0, i] * x + c[5, i] * y + c[4, i] * z
            gy = c[5, i] * x + c[1, i] * y + c[3, i] * z
            gz = c[4, i] * x + c[3, i] * y + c[2, i] * z
            dx, dy, dz = u[0, j] - ux, u[1, j] - uy, u[2, j] - uz
            hxx += dx * gx
            hxy += dx * gy
            hxz += dx * gz
            hyx += dy * gx
            hyy += dy * gy
            hyz += dy * gz
            hzx += dz * gx
            hzy += dz * gy
            hzz += dz * gz
    return hxx, hxy, hxz, hyx, hyy, hyz, hzx, hzy, hzz


@njit(**KERNEL)
def rotation_of(g):
    """Orthogonal part (by rows) of a gradient (by rows) with positive determinant, by R <- (R + R^-T) / 2 (Higham 1986)."""
    a, b, c, d, e, f, p, q, r = g
    for _ in range(TURNS):
        u, v, w = e * r - f * q, f * p - d * r, d * q - e * p  # cofactors
        x, y, z = c * q - b * r, a * r - c * p, b * p - a * q
        h, m, n = b * f - c * e, c * d - a * f, a * e - b * d
        det = a * u + b * v + c * w
        if not det > LEAST:
            return 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0
        scale = 0.5 / det
        change = abs(a - 2.0 * scale * u) + abs(e - 2.0 * scale * y) + abs(r - 2.0 * scale * n)
        change += abs(b - 2.0 * scale * v) + abs(f - 2.0 * scale * z) + abs(p - 2.0 * scale * h)
        a, b, c = 0.5 * a + scale * u, 0.5 * b + scale * v, 0.5 * c + scale * w
        d, e, f = 0.5 * d + scale * x, 0.5 * e + scale * y, 0.5 * f + scale * z
        p, q, r = 0.5 * p + scale * h, 0.5 * q + scale * m, 0.5 * r + scale * n
        if change < 1e-14:
            break
    return a, b, c, d, e, f, p, q, r


@njit(**KERNEL)
def turned_back(t, g):
    """R^T F by rows."""
    return (
        t[0] * g[0] + t[3] * g[3] + t[6] * g[6], t[0] * g[1] + t[3] * g[4] + t[6] * g[7], t[0] * g[2] + t[3] * g[5] + t[6] * g[8],
        t[1] * g[0] + t[4] * g[3] + t[7] * g[6], t[1] * g[1] + t[4] * g[4] + t[7] * g[7], t[1] * g[2] + t[4] * g[5] + t[7] * g[8],
        t[2] * g[0] + t[5] * g[3] + t[8] * g[6], t[2] * g[1] + t[5] * g[4] + t[8] * g[7], t[2] * g[2] + t[5] * g[5] + t[8] * g[8],
    )  # fmt: skip


@njit(**KERNEL)
def strain_special(state, terms, rotation, i):
    """Strain of one row: the symmetric part of the gradient H, or U - I of the polar decomposition I + H = R U."""
    hxx, hxy, hxz, hyx, hyy, hyz, hzx, hzy, hzz = gradient_of(state, terms, i, ALL)
    e = state.strain
    if rotation is not None:
        gradient = 1.0 + hxx, hxy, hxz, hyx, 1.0 + hyy, hyz, hzx, hzy, 1.0 + hzz
        turned = rotation_of(gradient)
        for c in range(9):
            rotation[c, i] = turned[c]
        hxx, hxy, hxz, hyx, hyy, hyz, hzx, hzy, hzz = turned_back(turned, gradient)
        hxx, hyy, hzz = hxx - 1.0, hyy - 1.0, hzz - 1.0
    e[0, i], e[1, i], e[2, i] = hxx, hyy, hzz
    e[3, i], e[4, i], e[5, i] = 0.5 * (hyz + hzy), 0.5 * (hxz + hzx), 0.5 * (hxy + hyx)


@njit(**KERNEL)
def add_stray_strain(state, terms, i):
    """What the strays of a row in a stretch add to its strain; rotations are small."""
    hxx, hxy, hxz, hyx, hyy, hyz, hzx, hzy, hzz = gradient_of(state, terms, i, state.stray[i])
    e = state.strain
    e[0, i] += hxx
    e[1, i] += hyy
    e[2, i] += hzz
    e[3, i] += 0.5 * (hyz + hzy)
    e[4, i] += 0.5 * (hxz + hzx)
    e[5, i] += 0.5 * (hxy + hyx)


@njit(**KERNEL)
def shear_of(state, terms, i, j, k):
    """Shear deformation (I - n n) e X of the bond from i to j, its strain the mean of both ends; vector in m."""
    e = state.strain
    x, y, z = terms.vectors[k, 0], terms.vectors[k, 1], terms.vectors[k, 2]
    yz, xz, xy = 0.5 * (e[3, i] + e[3, j]), 0.5 * (e[4, i] + e[4, j]), 0.5 * (e[5, i] + e[5, j])
    ex = 0.5 * (e[0, i] + e[0, j]) * x + xy * y + xz * z
    ey = xy * x + 0.5 * (e[1, i] + e[1, j]) * y + yz * z
    ez = xz * x + yz * y + 0.5 * (e[2, i] + e[2, j]) * z
    x, y, z = terms.units[k, 0], terms.units[k, 1], terms.units[k, 2]
    along = ex * x + ey * y + ez * z
    return ex - along * x, ey - along * y, ez - along * z


@njit(**KERNEL)
def elongation_of(state, terms, rotation, i, j, k):
    """Elongation of a bond (m), n.(u_j - u_i) or with large rotations that of its length, and its direction."""
    u, d = state.displacement, terms.vectors
    if rotation is not None:
        x, y, z = d[k, 0] + u[0, j] - u[0, i], d[k, 1] + u[1, j] - u[1, i], d[k, 2] + u[2, j] - u[2, i]
        length = math.sqrt(x * x + y * y + z * z)
        rest = math.sqrt(d[k, 0] * d[k, 0] + d[k, 1] * d[k, 1] + d[k, 2] * d[k, 2])
        return length - rest, x / length, y / length, z / length
    nx, ny, nz = terms.units[k, 0], terms.units[k, 1], terms.units[k, 2]
    return nx * (u[0, j] - u[0, i]) + ny * (u[1, j] - u[1, i]) + nz * (u[2, j] - u[2, i]), nx, ny, nz


@njit(**KERNEL)
def stiffness_of(table, state, i, j):
    """Mean of the stiffnesses of both ends."""
    return 0.5 * (table[state.material[i]] + table[state.material[j]])


@njit(**KERNEL)
def turned_by(rotation, i, j, x, y, z):
    """A vector turned by the mean of the rotations of both ends."""
    t = rotation
    return (
        0.5 * ((t[0, i] + t[0, j]) * x + (t[1, i] + t[1, j]) * y + (t[2, i] + t[2, j]) * z),
        0.5 * ((t[3, i] + t[3, j]) * x + (t[4, i] + t[4, j]) * y + (t[5, i] + t[5, j]) * z),
        0.5 * ((t[6, i] + t[6, j]) * x + (t[7, i] + t[7, j]) * y + (t[8, i] + t[8, j]) * z),
    )


@njit(**KERNEL)
def add_force(state, terms, moment, rotation, i, ways):
    """Add the force (N) on one row by its own bonds, in directions with a bit: F = k_n u_n n + k_s u_s; broken bonds push only."""
    fx = fy = fz = 0.0
    for k in range(state.near.shape[1]):
        flags = state.bonds[i, k]
        if ways >> k & 1 and flags & EXPLICIT:
            j = state.near[i, k]
            stretch, nx, ny, nz = elongation_of(state, terms, state.rotation, i, j, k)
            if flags & BROKEN:
                stretch = min(stretch, 0.0)
            normal = stiffness_of(terms.normal, state, i, j) * stretch
            fx += normal * nx
            fy += normal * ny
            fz += normal * nz
            if moment is None and not flags & BROKEN:
                sx, sy, sz = shear_of(state, terms, i, j, k)
                if rotation is not None:
                    sx, sy, sz = turned_by(rotation, i, j, sx, sy, sz)
                shear = stiffness_of(terms.shear, state, i, j)
                fx += shear * sx
                fy += shear * sy
                fz += shear * sz
    state.force[0, i] += fx
    state.force[1, i] += fy
    state.force[2, i] += fz


@njit(**KERNEL)
def moment_of(state, terms, m, i):
    """Derivative m (J) of the shear energy 1/2 k_s |u_s|^2 of the bonds of a row by its strain."""
    xx = yy = zz = yz = xz = xy = 0.0
    for k in range(state.near.shape[1]):
        if state.bonds[i, k] & (EXPLICIT | BROKEN) == EXPLICIT:
            j = state.near[i, k]
            sx, sy, sz = shear_of(state, terms, i, j, k)
            half = 0.5 * stiffness_of(terms.shear, state, i, j)
            x, y, z = half * terms.vectors[k, 0], half * terms.vectors[k, 1], half * terms.vectors[k, 2]
            xx += sx * x
            yy += sy * y
            zz += sz * z
            yz += 0.5 * (sy * z + sz * y)
            xz += 0.5 * (sx * z + sz * x)
            xy += 0.5 * (sx * y + sy * x)
    m[0, i], m[1, i], m[2, i], m[3, i], m[4, i], m[5, i] = xx, yy, zz, yz, xz, xy


@njit(**KERNEL)
def spread_moment(state, terms, m, i):
    """Forces of the shear energy by the strain of row i, on all of its cluster:  F_k = - S A (X_k - mean X)."""
    c, f = state.cluster, state.force
    sx = sy = sz = 0.0
    for k in range(state.near.shape[1]):
        if state.bonds[i, k] & JOINED:
            j = state.near[i, k]
            x, y, z = terms.vectors[k, 0] - c[6, i], terms.vectors[k, 1] - c[7, i], terms.vectors[k, 2] - c[8, i]
            gx = c[0, i] * x + c[5, i] * y + c[4, i] * z
            gy = c[5, i] * x + c[1, i] * y + c[3, i] * z
            gz = c[4, i] * x + c[3, i] * y + c[2, i] * z
            fx = m[0, i] * gx + m[5, i] * gy + m[4, i] * gz
            fy = m[5, i] * gx + m[1, i] * gy + m[3, i] * gz
            fz = m[4, i] * gx + m[3, i] * gy + m[2, i] * gz
            f[0, j] -= fx
            f[1, j] -= fy
            f[2, j] -= fz
            sx += fx
            sy += fy
            sz += fz
    f[0, i] += sx
    f[1, i] += sy
    f[2, i] += sz


@njit(**INLINE)
def _cofactors(m):
    """Of a symmetric matrix xx, yy, zz, yz, xz, xy, in the same order."""
    xx, yy, zz, yz, xz, xy = m
    return yy * zz - yz * yz, xx * zz - xz * xz, xx * yy - xy * xy, xy * xz - xx * yz, xy * yz - xz * yy, xz * yz - xy * zz


@njit(**INLINE)
def _inverse(m):
    """Of a symmetric matrix with the determinant, in the order of `_cofactors`."""
    c = _cofactors(m)
    by = 1.0 / (m[0] * c[0] + m[5] * c[5] + m[4] * c[4])
    return by * c[0], by * c[1], by * c[2], by * c[3], by * c[4], by * c[5]


@njit(**KERNEL)
def _pseudo_inverse(m):
    """Of a symmetric matrix M without negative eigenvalues, in the order of `_cofactors`; eigenvalues that are nearly zero count as zero.

    With one of them n n^T is the matrix of cofactors over its trace, and M^+ = (M + s n n^T)^-1 - n n^T / s for any s; with two
    M^+ = M / tr(M)^2.
    """
    trace, c = m[0] + m[1] + m[2], _cofactors(m)
    minors = c[0] + c[1] + c[2]
    if m[0] * c[0] + m[5] * c[5] + m[4] * c[4] > SPANNING * trace**3:
        return _inverse(m)
    if minors > SPANNING * trace * trace:
        to, off = trace / minors, 1.0 / (trace * minors)  # s is the trace
        i = _inverse((m[0] + to * c[0], m[1] + to * c[1], m[2] + to * c[2], m[3] + to * c[3], m[4] + to * c[4], m[5] + to * c[5]))
        return (
            i[0] - off * c[0], i[1] - off * c[1], i[2] - off * c[2], i[3] - off * c[3], i[4] - off * c[4], i[5] - off * c[5]
        )  # fmt: skip
    by = 1.0 / (trace * trace) if trace > 0.0 else 0.0
    return by * m[0], by * m[1], by * m[2], by * m[3], by * m[4], by * m[5]


@njit(**KERNEL)
def _set_cluster(state, terms, i):
    """Inverse moments and mean arm of a row: those of itself and what is joined to it about their mean."""
    xx = yy = zz = yz = xz = xy = x = y = z = 0.0
    members = 1.0
    for k in range(state.near.shape[1]):
        if state.bonds[i, k] & JOINED:
            members += 1.0
            a, b, c = terms.vectors[k, 0], terms.vectors[k, 1], terms.vectors[k, 2]
            x, y, z = x + a, y + b, z + c
            xx, yy, zz, yz, xz, xy = xx + a * a, yy + b * b, zz + c * c, yz + b * c, xz + a * c, xy + a * b
    x, y, z = x / members, y / members, z / members
    xx, yy, zz = xx - members * x * x, yy - members * y * y, zz - members * z * z
    yz, xz, xy = yz - members * y * z, xz - members * x * z, xy - members * x * y
    cluster, found = state.cluster, _pseudo_inverse((xx, yy, zz, yz, xz, xy))
    cluster[0, i], cluster[1, i], cluster[2, i] = found[0], found[1], found[2]
    cluster[3, i], cluster[4, i], cluster[5, i] = found[3], found[4], found[5]
    cluster[6, i], cluster[7, i], cluster[8, i] = x, y, z


@njit(**STEPS)
def set_clusters(state, terms, rows):
    """Bits of some rows, inverse moments A (pseudo-inverse) and mean arms of their clusters: each row itself and what is joined to it."""
    for i in rows:
        state.mask[i] = mask_of(state.bonds, state.stray, i)
        if state.strain_kind[i]:
            _set_cluster(state, terms, i)


@njit(**KERNEL)
def energy_of_row(state, terms, i, ways):
    """Elastic energy (J) of the bonds of a row in those even directions that have a bit."""
    total = 0.0
    for k in range(0, state.near.shape[1], 2):
        if ways >> k & 1:
            total += bond_energy(state, terms, i, k)
    return total


@njit(**KERNEL)
def bond_energy(state, terms, i, k):
    """Elastic energy (J) of the bond of row i in direction k."""
    flags = state.bonds[i, k]
    if not flags & EXPLICIT:
        return 0.0
    j = state.near[i, k]
    stretch, _, _, _ = elongation_of(state, terms, state.rotation, i, j, k)
    if flags & BROKEN:
        stretch = min(stretch, 0.0)
    energy = 0.5 * stiffness_of(terms.normal, state, i, j) * stretch * stretch
    if not flags & BROKEN:
        sx, sy, sz = shear_of(state, terms, i, j, k)
        energy += 0.5 * stiffness_of(terms.shear, state, i, j) * (sx * sx + sy * sy + sz * sz)
    return energy
