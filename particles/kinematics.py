"""Kinematics of two particles in one step: exactly objective increments, rates, and how vectors turn with the pair.

Positions are those at the end of the step, velocities those of its middle, so that step times velocity is the
displacement. Lever arms reach to the middle of the overlap and add up to the distance; with radii as arms a rigid
rotation would cause sliding.
"""

from __future__ import annotations

import math

from numba import njit

from particles.laws.touch import Touch
from particles.system import INLINE
from particles.vectors import cross, dot, minus, moved, plus, scaled

PLANE = (0.0,) * 6  # normal; distance, one over it; half of its change in the step; angle by which the normal turned
SPACE = (0.0,) * 13  # normals at both ends; distance, one over it, half of its change; ratio of spins; then as `turning`


@njit(**INLINE)
def angle_of(y, x):
    """atan2(y, x) without branches, so that it becomes vector code; relative error below 1e-15.

    atan(t) / t of t^2 up to tan(pi / 8)^2 is a Chebyshev expansion of degree 10; larger angles are turned by pi / 4.
    """
    a, b = abs(y), abs(x)
    small, large = min(a, b), max(a, b)
    wide = small > 0.4142135623730950 * large
    t = ((small - large) if wide else small) / ((small + large) if wide else large)
    z = t * t
    p = 0.05689178034926939 + z * (-0.04350313629933318 + z * 0.02116160244337266)
    p = 0.07689974133404093 + z * (-0.06640402143462348 + z * p)
    p = 0.11111106252974476 + z * (-0.09090774642360651 + z * p)
    p = 0.1999999999888116 + z * (-0.14285714182904508 + z * p)
    angle = t + t * z * (-0.33333333333328574 + z * p) + (0.785398163397448309616 if wide else 0.0)
    angle = 1.570796326794896619231 - angle if a > b else angle
    angle = 3.141592653589793238463 - angle if x < 0.0 else angle
    return -angle if y < 0.0 else angle


@njit(**INLINE)
def tangent_ratio(square):
    """tan(x) / x of x^2 = `square`, Chebyshev expansion of degree 8: error below 2e-14 up to x = 0.5."""
    p = 3.640396966747745926e-3 + square * (1.272760238698562286e-3 + square * 9.481221423312804409e-4)
    p = 2.187012882587830259e-2 + square * (8.855948919221069703e-3 + square * p)
    p = 1.333333341033962106e-1 + square * (5.396822253589417724e-2 + square * p)
    return 1.000000000000011183 + square * (3.333333333260910088e-1 + square * p)


@njit(**INLINE)
def turning(tangents, share, old_normal, normal):
    """How tangential vectors turn with a pair, for `particles.laws.touch.carried`: about the old normal, then on with it.

    About the normal they turn as both bodies do in the mean: exactly so for a rigid rotation of any size, and to the second
    order in the step for any other motion.

    Args:
        tangents, share: their product is the sum of the rotations of both bodies, each as 2 tan(|turn| / 2) / |turn| turn.
        old_normal, normal: at the start and at the end of the step.

    Returns:
        Old normal; sine and cosine of the angle about it; the new one; one over (1 + the product of the two).
    """
    tangent = 0.125 * share * dot(tangents, plus(old_normal, normal))
    square = tangent * tangent
    less = 1.0 / (1.0 + square)
    return old_normal, (2.0 * tangent * less, (1.0 - square) * less), normal, 1.0 / (1.0 + dot(old_normal, normal))


@njit(**INLINE)
def frame_in_plane(bx, by, dx, dy):
    """What of a pair of discs takes long to find out, in the order of `PLANE`: its direction and how that turned.

    Args:
        bx, by: from i to j at the end of the step, m.
        dx, dy: change of that in the step, m.
    """
    distance = math.sqrt(bx * bx + by * by)
    inverse = 1.0 / distance
    ox, oy = bx - dx, by - dy
    # half the change of the distance, to the third order in that change
    half = 0.25 * inverse * (dx * (bx + ox) + dy * (by + oy))
    half *= 1.0 + half * inverse
    turn = angle_of(ox * by - oy * bx, ox * bx + oy * by)
    return bx * inverse, by * inverse, distance, inverse, half, turn


@njit(**INLINE)
def touch_in_plane(frame, turn_i, turn_j, rates, radius_i, radius_j, mass):
    """Touch of two discs.

    Args:
        frame: of `frame_in_plane`.
        turn_i, turn_j: rotations in the step, rad.
        rates: relative velocity (x, y) of j, spins of i and j at the end of the step.
        mass: reduced mass, kg.
    """
    nx, ny, distance, inverse, half, turn = frame
    # one over the mean distance, to the third order in its change
    strain = half * inverse
    inverse_mean = inverse * (1.0 + strain + strain * strain)
    overlap = radius_i + radius_j - distance
    arm_i = radius_i - 0.5 * overlap
    arm_j = distance - arm_i
    mean_i, mean_j = arm_i - 0.5 * half, arm_j - 0.5 * half
    rx, ry, rate_i, rate_j = rates
    return Touch(
        overlap, rx * nx + ry * ny,
        (mean_i * (turn - turn_i) + mean_j * (turn - turn_j),), (ry * nx - rx * ny - arm_i * rate_i - arm_j * rate_j,),
        (turn_i - turn_j,), (rate_i - rate_j,), 0.0, 0.0,
        mean_i * mean_j * inverse_mean, arm_i * arm_j * inverse, (nx, ny), distance, (radius_i, radius_j), mass, (),
    )  # fmt: skip


@njit(**INLINE)
def frame_in_space(b, d, spin_i, more, step):
    """The same for two spheres, in the order of `SPACE`; vectors of three, `step` in s.

    Lengths at the start of the step come from those at its end by series in the change of the squared distance, which is
    zero then; errors are of its fourth power.

    A rotation enters as 2 tan(|turn| / 2) / |turn| turn, with which a rigid rotation of any size causes no sliding; the
    ratio to the spin is that of the mean of both spins, of which each differs by the third order in the step.

    Args:
        spin_i, more: spin of i in the middle of the step and by how much that of j is more, rad/s.
    """
    before = minus(b, d)
    distance = math.sqrt(dot(b, b))
    inverse = 1.0 / distance
    change = inverse * inverse * dot(d, plus(b, before))
    half = 0.25 * distance * change * (1.0 + change * (0.25 + change * (0.125 + 0.078125 * change)))
    inverse_before = inverse * (1.0 + change * (0.5 + change * (0.375 + change * (0.3125 + 0.2734375 * change))))
    n, n_before = scaled(inverse, b), scaled(inverse_before, before)
    both = plus(plus(spin_i, spin_i), more)
    ratio = step * tangent_ratio(0.0625 * step * step * dot(both, both))
    _, (sine, cosine), _, share = turning(both, ratio, n_before, n)
    return (*n, *n_before, distance, inverse, half, ratio, sine, cosine, share)


@njit(**INLINE)
def touch_in_space(frame, middle_i, more, rate, spin_i, faster, radius_i, radius_j, mass):
    """Touch of two spheres, all vectors of three.

    Args:
        frame: of `frame_in_space`.
        middle_i, more: spin of i in the middle of the step and by how much that of j is more, rad/s.
        rate, spin_i, faster: relative velocity of j, spin of i and by how much that of j is more, at the end of the step.
        mass: reduced mass, kg.
    """
    x, y, z, ox, oy, oz, distance, inverse, half, ratio, sine, cosine, share = frame
    n, n_before = (x, y, z), (ox, oy, oz)
    overlap = radius_i + radius_j - distance
    arm_i = radius_i - 0.5 * overlap
    arm_j = distance - arm_i
    mean_i, mean_j = arm_i - 0.5 * half, arm_j - 0.5 * half
    mean, halved = mean_i + mean_j, 0.5 * ratio
    surface = moved(scaled(halved * mean, middle_i), halved * mean_j, more)
    slide = moved(scaled(mean, minus(n, n_before)), -1.0, cross(surface, plus(n, n_before)))
    slide = moved(slide, -dot(slide, n), n)  # the mean normal leaves a little along the new one, of the step's square
    roll = scaled(-ratio, more)
    twist = dot(roll, n)
    twist_rate = -dot(faster, n)
    opening = dot(rate, n)
    slide_rate = moved(moved(rate, -opening, n), -1.0, cross(moved(scaled(distance, spin_i), arm_j, faster), n))
    strain = half * inverse
    inverse_mean = inverse * (1.0 + strain * (1.0 + strain * (1.0 + strain)))
    return Touch(
        overlap, opening, slide, slide_rate, moved(roll, -twist, n), moved(scaled(-1.0, faster), -twist_rate, n), twist, twist_rate,
        mean_i * mean_j * inverse_mean, arm_i * arm_j * inverse, n, distance, (radius_i, radius_j), mass,
        (n_before, (sine, cosine), n, share),
    )  # fmt: skip
