"""Compiled loops for any cluster of bonds: surfaces, interfaces of materials, broken bonds (Zhao et al. 2012, section 2.2)."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from particles.lattice.blocks import mask_of
from particles.lattice.state import BROKEN, EXPLICIT, JOINED
from particles.system import KERNEL, OUTER

TURNS = 40  # at most, of the iteration for the polar decomposition
LEAST = 1e-3  # determinant of a gradient: a neighbourhood that is pressed flat has no rotation
CUT = 1e-8  # of the largest moment of a cluster: smaller ones have no direction
SPANNING = 1e-5  # determinant over the cube of the trace of moments that are inverted directly; at most 1/27


@njit(**KERNEL)
def gradient_of(state, terms, i):
    """Displacement gradient (xx, xy, ..., zz by rows) by least squares:  H = sum (u_k - u_i) (A (X_k - mean X))."""
    u, c = state.displacement, state.cluster
    ux, uy, uz = u[0, i], u[1, i], u[2, i]
    hxx = hxy = hxz = hyx = hyy = hyz = hzx = hzy = hzz = 0.0
    for k in range(state.near.shape[1]):
        if state.bonds[i, k] & JOINED:
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
    hxx, hxy, hxz, hyx, hyy, hyz, hzx, hzy, hzz = gradient_of(state, terms, i)
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
def shear_of(state, terms, i, j, k):
    """Shear deformation (I - n n) e X of the bond from i to j, its strain the mean of both ends; vector in m."""
    e = state.strain
    x, y, z = terms.vectors[k, 0], terms.vectors[k, 1], terms.vectors[k, 2]
    yz, xz, xy = 0.5 * (e[3, i] + e[3, j]), 0.5 * (e[4, i] + e[4, j]), 0.5 * (e[5, i] + e[5, j])
    ex = 0.5 * (e[0, i] + e[0, j]) * x + xy * y + xz * z
    ey = xy * x + 0.5 * (e[1, i] + e[1, j]) * y + yz * z
    ez = xz * x + yz * y + 0.5 * (e[2, i] + e[2, j]) * z
    along = (ex * x + ey * y + ez * z) / (x * x + y * y + z * z)
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
    scale = 1.0 / math.sqrt(d[k, 0] * d[k, 0] + d[k, 1] * d[k, 1] + d[k, 2] * d[k, 2])
    nx, ny, nz = scale * d[k, 0], scale * d[k, 1], scale * d[k, 2]
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
def force_special(state, terms, moment, rotation, i):
    """Force (N) on one row by its own bonds: F = k_n u_n n + k_s u_s; broken bonds push only."""
    fx = fy = fz = 0.0
    for k in range(state.near.shape[1]):
        flags = state.bonds[i, k]
        if flags & EXPLICIT:
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


@njit(**KERNEL)
def _set_cluster(state, terms, i):
    """Inverse moments and mean arm of a row whose cluster spans space; whether it does."""
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
    c = state.cluster
    c[6, i], c[7, i], c[8, i] = x, y, z
    ux, uy, uz = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy  # cofactors
    det = xx * ux + xy * uy + xz * uz
    if not det > SPANNING * (xx + yy + zz) ** 3:
        return False
    c[0, i], c[1, i], c[2, i] = ux / det, (xx * zz - xz * xz) / det, (xx * yy - xy * xy) / det
    c[3, i], c[4, i], c[5, i] = (xy * xz - xx * yz) / det, uz / det, uy / det
    return True


@njit(**OUTER)
def _set_flat_cluster(state, terms, i):
    """Inverse moments by the pseudo-inverse, the mean arm being known."""
    c = state.cluster
    mean = np.array((c[6, i], c[7, i], c[8, i]))
    moments = mean.reshape(3, 1) * mean  # of the row itself, whose arm is zero
    for k in range(state.near.shape[1]):
        if state.bonds[i, k] & JOINED:
            arm = terms.vectors[k] - mean
            moments += arm.reshape(3, 1) * arm
    value, vector = np.linalg.eigh(moments)
    inverse = np.zeros((3, 3))
    for p in range(3):
        if value[p] > CUT * value[2]:
            for a in range(3):
                for b in range(3):
                    inverse[a, b] += vector[a, p] * vector[b, p] / value[p]
    c[0, i], c[1, i], c[2, i] = inverse[0, 0], inverse[1, 1], inverse[2, 2]
    c[3, i], c[4, i], c[5, i] = inverse[1, 2], inverse[0, 2], inverse[0, 1]


@njit(**OUTER)
def set_clusters(state, terms, rows):
    """Bits of some rows, inverse moments A (pseudo-inverse) and mean arms of their clusters: each row itself and what is joined to it."""
    for i in rows:
        state.mask[i] = mask_of(state.bonds, i)
        if state.strain_kind[i] and not _set_cluster(state, terms, i):
            _set_flat_cluster(state, terms, i)


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
