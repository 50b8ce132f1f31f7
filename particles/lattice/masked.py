"""Compiled loops over blocks: eight rows of the cubic lattice one after the other, of which any bonds may be missing or broken.

The neighbours of a block in each direction are rows one after the other, too (see `particles.lattice.blocks`), and a bit of each row
says which of them are there. So rows with gaps are a stencil like those of `particles.lattice.regular`, in vector code.
Directions are those of `particles.lattice.directions`: pairs of opposite ones.
"""

from __future__ import annotations

import math

from numba import njit

from particles.lattice.lanes import WIDTH, above, all_have, even, kept, least, load, most, store, sum_of
from particles.lattice.state import BROKEN_BIT, INTACT_BIT, JOINED_BIT
from particles.system import INLINE, KERNEL

ALL_JOINED = (1 << 18) - 1 << JOINED_BIT
NEARLY = 1.0 - 1e-9  # of a limit: what may be at it but for rounding


@njit(**INLINE)
def _pair(u, v, w, at, to, words, k):
    """Differences u_j - u_i of an opposite pair of directions k and k + 1: the first less the second (x, y, z), and the sums."""
    x, y, z = load(u, at), load(v, at), load(w, at)
    plus, minus, one, two = at + to[k], at + to[k + 1], JOINED_BIT + k, JOINED_BIT + k + 1
    ax, bx = kept(words, one, load(u, plus) - x), kept(words, two, load(u, minus) - x)
    ay, by = kept(words, one, load(v, plus) - y), kept(words, two, load(v, minus) - y)
    az, bz = kept(words, one, load(w, plus) - z), kept(words, two, load(w, minus) - z)
    return ax - bx, ay - by, az - bz, ax + bx, ay + by, az + bz


@njit(**INLINE)
def _gradient(cluster, at, spacing, total, x, y, z):
    """A line of the gradient: (d B - S m) A, with B sums of differences by axes of their directions and S their total."""
    gx = spacing * x - total * load(cluster[6], at)
    gy = spacing * y - total * load(cluster[7], at)
    gz = spacing * z - total * load(cluster[8], at)
    yz, xz, xy = load(cluster[3], at), load(cluster[4], at), load(cluster[5], at)
    return (
        load(cluster[0], at) * gx + xy * gy + xz * gz,
        xy * gx + load(cluster[1], at) * gy + yz * gz,
        xz * gx + yz * gy + load(cluster[2], at) * gz,
    )


@njit(**KERNEL)
def strain_masked(at, to, mask, clusters, whole, spacing, u, e):
    """Strain of a block by least squares over what is joined to each row:  H = sum (u_k - u_i) (X_k - m) A.

    Args:
        at: first row.
        to: (18,) how many rows on the neighbours lie.
        clusters: (9, n) A and m of each row.
        whole: (9, 8) the same of rows that all neighbours are joined to.
    """
    ux, uy, uz, words = u[0], u[1], u[2], load(mask, at)
    cluster, of = clusters, at
    if all_have(words, ALL_JOINED):
        cluster, of = whole, 0
    x0, y0, z0, sx, sy, sz = _pair(ux, uy, uz, at, to, words, 0)
    x1, y1, z1, ax, ay, az = _pair(ux, uy, uz, at, to, words, 2)
    sx, sy, sz = sx + ax, sy + ay, sz + az
    x2, y2, z2, ax, ay, az = _pair(ux, uy, uz, at, to, words, 4)
    sx, sy, sz = sx + ax, sy + ay, sz + az
    x3, y3, z3, ax, ay, az = _pair(ux, uy, uz, at, to, words, 6)
    sx, sy, sz = sx + ax, sy + ay, sz + az
    x4, y4, z4, ax, ay, az = _pair(ux, uy, uz, at, to, words, 8)
    sx, sy, sz = sx + ax, sy + ay, sz + az
    x5, y5, z5, ax, ay, az = _pair(ux, uy, uz, at, to, words, 10)
    sx, sy, sz = sx + ax, sy + ay, sz + az
    x6, y6, z6, ax, ay, az = _pair(ux, uy, uz, at, to, words, 12)
    sx, sy, sz = sx + ax, sy + ay, sz + az
    x7, y7, z7, ax, ay, az = _pair(ux, uy, uz, at, to, words, 14)
    sx, sy, sz = sx + ax, sy + ay, sz + az
    x8, y8, z8, ax, ay, az = _pair(ux, uy, uz, at, to, words, 16)
    sx, sy, sz = sx + ax, sy + ay, sz + az
    xx, xy, xz = _gradient(
        cluster, of, spacing, sx, x0 + x3 + x4 + x5 + x6, x1 + x3 - x4 + x7 + x8, x2 + x5 - x6 + x7 - x8
    )
    yx, yy, yz = _gradient(
        cluster, of, spacing, sy, y0 + y3 + y4 + y5 + y6, y1 + y3 - y4 + y7 + y8, y2 + y5 - y6 + y7 - y8
    )
    zx, zy, zz = _gradient(
        cluster, of, spacing, sz, z0 + z3 + z4 + z5 + z6, z1 + z3 - z4 + z7 + z8, z2 + z5 - z6 + z7 - z8
    )
    store(e[0], at, xx)
    store(e[1], at, yy)
    store(e[2], at, zz)
    store(e[3], at, 0.5 * (yz + zy))
    store(e[4], at, 0.5 * (xz + zx))
    store(e[5], at, 0.5 * (xy + yx))


@njit(**INLINE)
def _held(words, k, stretch):
    """Elongation that acts: any of an intact bond, none above zero of a broken one."""
    return kept(words, INTACT_BIT + k, stretch) + kept(words, BROKEN_BIT + k, least(stretch, even(0.0)))


@njit(**INLINE)
def _axial(worst, limits, words, k, sign, at, to, u, one, two):
    """A bond along an axis (`sign` -1.0: against it): its elongation along the axis, strains across from the sums of both ends.

    Args:
        worst: largest share of their limits so far.
        limits: None, or `_shares`.
        u: displacements along the axis.
        one, two: shear strains of the axis with the others.
    """
    there = at + to[k]
    stretch = sign * (load(u, there) - load(u, at))
    a = kept(words, INTACT_BIT + k, load(one, there) + load(one, at))
    b = kept(words, INTACT_BIT + k, load(two, there) + load(two, at))
    if limits is not None:
        reach, across = limits
        if sign > 0.0:
            worst = most(worst, most(reach * kept(words, INTACT_BIT + k, stretch), across * (a * a + b * b)))
    return worst, sign * _held(words, k, stretch), sign * a, sign * b


@njit(**INLINE)
def _oblique(worst, limits, words, k, sign, turn, at, to, u, v, first, second, one, two):
    """A bond along (1, `turn`) of two axes (`sign` -1.0: against it): elongation times sqrt 2, strain sums in the plane and across it.

    Args:
        u, v: displacements along both axes.
        first, second: strains along them.
        one, two: shear strains of each with the third.
    """
    there = at + to[k]
    stretch = sign * (load(u, there) - load(u, at) + turn * (load(v, there) - load(v, at)))
    a = load(first, there) + load(first, at) - load(second, there) - load(second, at)
    b = load(one, there) + load(one, at) + turn * (load(two, there) + load(two, at))
    a, b = kept(words, INTACT_BIT + k, a), kept(words, INTACT_BIT + k, b)
    if limits is not None:
        reach, across = limits
        if sign > 0.0:
            reached = math.sqrt(0.5) * reach * kept(words, INTACT_BIT + k, stretch)
            worst = most(worst, most(reached, across * (0.5 * a * a + b * b)))
    return worst, sign * _held(words, k, stretch), sign * a, sign * b


@njit(**INLINE)
def _sums(springs, k, n, a, b, m, c, d):
    """Normal and shear sums of an opposite pair of bonds (n, a, b) and (m, c, d), by their stiffnesses."""
    one, two = springs[1, k], springs[1, k + 1]
    return springs[0, k] * n + springs[0, k + 1] * m, one * a + two * c, one * b + two * d


@njit(**INLINE)
def _both_axial(worst, limits, words, k, springs, at, to, u, one, two):
    """An opposite pair of axial bonds together."""
    worst, n, a, b = _axial(worst, limits, words, k, 1.0, at, to, u, one, two)
    worst, m, c, d = _axial(worst, limits, words, k + 1, -1.0, at, to, u, one, two)
    n, a, b = _sums(springs, k, n, a, b, m, c, d)
    return worst, n, a, b


@njit(**INLINE)
def _both_oblique(worst, limits, words, k, springs, turn, at, to, u, v, first, second, one, two):
    """An opposite pair of oblique bonds together."""
    worst, n, a, b = _oblique(worst, limits, words, k, 1.0, turn, at, to, u, v, first, second, one, two)
    worst, m, c, d = _oblique(worst, limits, words, k + 1, -1.0, turn, at, to, u, v, first, second, one, two)
    n, a, b = _sums(springs, k, n, a, b, m, c, d)
    return worst, n, a, b


@njit(**INLINE)
def _shares(limits, group, spacing):
    """None without limits; what makes shares of them of elongations, and of the squares of strain sums across."""
    if limits is None:
        return None
    return 1.0 / limits[group, 0], 0.25 * spacing * spacing / (limits[group, 1] * limits[group, 1])


@njit(**KERNEL)
def force_masked(at, to, mask, spacing, springs, limits, group, u, e, f):
    """Force on a block by its own bonds, as `particles.lattice.general.force_special`.

    Args:
        at: first row.
        to: (18,) how many rows on the neighbours lie.
        springs: (2, 18) stiffnesses of the bonds, see `particles.lattice.blocks.springs`.
        limits: None, or the smallest normal and shear deformation (groups, 2) at which bonds of the rows break, m.
        group: number of the group.

    Returns:
        A bit for each row whose bonds have come to their limits, but for rounding; without limits none.
    """
    words, none = load(mask, at), even(0.0)
    shares = _shares(limits, group, spacing)
    ux, uy, uz = u[0], u[1], u[2]
    xx, yy, zz, yz, xz, xy = e[0], e[1], e[2], e[3], e[4], e[5]
    worst, n0, a0, b0 = _both_axial(none, shares, words, 0, springs, at, to, ux, xy, xz)
    worst, n1, a1, b1 = _both_axial(worst, shares, words, 2, springs, at, to, uy, xy, yz)
    worst, n2, a2, b2 = _both_axial(worst, shares, words, 4, springs, at, to, uz, xz, yz)
    worst, n3, a3, b3 = _both_oblique(worst, shares, words, 6, springs, 1.0, at, to, ux, uy, xx, yy, xz, yz)
    worst, n4, a4, b4 = _both_oblique(worst, shares, words, 8, springs, -1.0, at, to, ux, uy, xx, yy, xz, yz)
    worst, n5, a5, b5 = _both_oblique(worst, shares, words, 10, springs, 1.0, at, to, ux, uz, xx, zz, xy, yz)
    worst, n6, a6, b6 = _both_oblique(worst, shares, words, 12, springs, -1.0, at, to, ux, uz, xx, zz, xy, yz)
    worst, n7, a7, b7 = _both_oblique(worst, shares, words, 14, springs, 1.0, at, to, uy, uz, yy, zz, xy, xz)
    worst, n8, a8, b8 = _both_oblique(worst, shares, words, 16, springs, -1.0, at, to, uy, uz, yy, zz, xy, xz)
    store(f[0], at, n0 + n3 + n4 + n5 + n6 + (a1 + a2 + b7 + b8 + 0.5 * (a3 + a4 + a5 + a6)))
    store(f[1], at, n1 + n3 - n4 + n7 + n8 + (a0 + b2 + b5 + b6 + 0.5 * (a4 - a3 + a7 + a8)))
    store(f[2], at, n2 + n5 - n6 + n7 - n8 + (b0 + b1 + b3 + b4 + 0.5 * (a6 - a5 + a8 - a7)))
    return above(worst, NEARLY)


@njit(**INLINE)
def _even_bonds(limits, words, at, to, u, e):
    """Largest share of its limits, elongation and strain sums of the bonds in each even direction, as `_axial` and `_oblique` give them."""
    none = even(0.0)
    ux, uy, uz = u[0], u[1], u[2]
    xx, yy, zz, yz, xz, xy = e[0], e[1], e[2], e[3], e[4], e[5]
    return (
        _axial(none, limits, words, 0, 1.0, at, to, ux, xy, xz),
        _axial(none, limits, words, 2, 1.0, at, to, uy, xy, yz),
        _axial(none, limits, words, 4, 1.0, at, to, uz, xz, yz),
        _oblique(none, limits, words, 6, 1.0, 1.0, at, to, ux, uy, xx, yy, xz, yz),
        _oblique(none, limits, words, 8, 1.0, -1.0, at, to, ux, uy, xx, yy, xz, yz),
        _oblique(none, limits, words, 10, 1.0, 1.0, at, to, ux, uz, xx, zz, xy, yz),
        _oblique(none, limits, words, 12, 1.0, -1.0, at, to, ux, uz, xx, zz, xy, yz),
        _oblique(none, limits, words, 14, 1.0, 1.0, at, to, uy, uz, yy, zz, xy, xz),
        _oblique(none, limits, words, 16, 1.0, -1.0, at, to, uy, uz, yy, zz, xy, xz),
    )


@njit(**KERNEL)
def reached_masked(at, to, mask, spacing, limits, group, u, e, found):
    """Which even directions the bonds lie in that have come to their limits, but for rounding; arguments as for `force_masked`.

    Args:
        found: (8,) int64, written: a bit for each direction.
    """
    for lane in range(WIDTH):
        found[lane] = 0
    k = 0
    for worst, _, _, _ in _even_bonds(_shares(limits, group, spacing), load(mask, at), at, to, u, e):
        rows = above(worst, NEARLY)
        for lane in range(WIDTH):
            found[lane] |= (rows >> lane & 1) << k
        k += 2


@njit(**KERNEL)
def energy_masked(at, to, mask, spacing, springs, u, e):
    """Energy (J) of the bonds that a block leaves in even directions, arguments as for `force_masked`."""
    bonds = _even_bonds(None, load(mask, at), at, to, u, e)
    (_, n0, a0, b0), (_, n1, a1, b1), (_, n2, a2, b2), (_, n3, a3, b3), (_, n4, a4, b4) = bonds[:5]
    (_, n5, a5, b5), (_, n6, a6, b6), (_, n7, a7, b7), (_, n8, a8, b8) = bonds[5:]
    normal, shear = springs[0], springs[1]
    stretched = normal[0] * (n0 * n0) + normal[2] * (n1 * n1) + normal[4] * (n2 * n2) + normal[6] * (n3 * n3) + normal[8] * (n4 * n4)
    stretched = stretched + normal[10] * (n5 * n5) + normal[12] * (n6 * n6) + normal[14] * (n7 * n7) + normal[16] * (n8 * n8)
    sheared = shear[0] * (a0 * a0 + b0 * b0) + shear[2] * (a1 * a1 + b1 * b1) + shear[4] * (a2 * a2 + b2 * b2)
    sheared = sheared + shear[6] * (0.5 * (a3 * a3) + b3 * b3) + shear[8] * (0.5 * (a4 * a4) + b4 * b4)
    sheared = sheared + shear[10] * (0.5 * (a5 * a5) + b5 * b5) + shear[12] * (0.5 * (a6 * a6) + b6 * b6)
    sheared = sheared + shear[14] * (0.5 * (a7 * a7) + b7 * b7) + shear[16] * (0.5 * (a8 * a8) + b8 * b8)
    return sum_of(0.5 * stretched + 0.25 * spacing * sheared)
