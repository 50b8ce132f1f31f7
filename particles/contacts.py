"""The loop over neighbouring pairs (the inner loop of the code)."""

from __future__ import annotations

import math

from numba import njit

from particles.laws.li_chu import law_between, release, respond
from particles.system import FAST, POWER


@njit(cache=True, fastmath=FAST)
def turn_of(cross, dot):
    """Angle between two directions, atan2(cross, dot) in rad; a series (error below 1e-13) where it is small."""
    if abs(cross) < 0.03 * dot:
        ratio = cross / dot
        square = ratio * ratio
        return ratio * (1.0 - square * (1.0 / 3.0 - square * (0.2 - square / 7.0)))
    return math.atan2(cross, dot)


@njit(cache=True, fastmath=FAST)
def pair_forces(force, history, sums, state, acceleration, start, neighbour, material, law, table, step):
    """Add the contact forces of all listed pairs to `force` (n, 3); histories and energy sums follow.

    Increments come from the displacement of the step, h v of the half step, so that a rigid motion of any size causes
    none; dashpots use the predictor v + h a / 2. Contact is overlap > 0: the force is continuous there, so that pairs
    which just touch carry nothing, whatever the rounding.
    """
    half = 0.5 * step
    power = 0.0
    for i in range(state.shape[0]):
        x = state[i, 0]
        y = state[i, 1]
        vx = state[i, 2]
        vy = state[i, 3]
        spin = state[i, 4]
        radius = state[i, 5]
        # velocity of the predictor at the end of the step
        end_x = vx + half * acceleration[i, 0]
        end_y = vy + half * acceleration[i, 1]
        rate_i = spin + half * acceleration[i, 2]
        fx = 0.0
        fy = 0.0
        torque = 0.0
        for pair in range(start[i], start[i + 1]):
            j = neighbour[pair]
            bx = state[j, 0] - x
            by = state[j, 1] - y
            reach = radius + state[j, 5]
            square = bx * bx + by * by
            if square < reach * reach:
                distance = math.sqrt(square)
                inverse = 1.0 / distance
                nx = bx * inverse
                ny = by * inverse
                overlap = reach - distance
                # displacement increments of the step
                dx = step * (state[j, 2] - vx)
                dy = step * (state[j, 3] - vy)
                ox = bx - dx
                oy = by - dy
                turn = turn_of(ox * by - oy * bx, ox * bx + oy * by)
                opening = 0.25 * inverse * (dx * (bx + ox) + dy * (by + oy))  # half the change of the distance
                arm_i = radius - 0.5 * overlap
                arm_j = distance - arm_i
                mean_i = arm_i - 0.5 * opening
                mean_j = arm_j - 0.5 * opening
                spin_j = state[j, 4]
                slide = mean_i * (turn - step * spin) + mean_j * (turn - step * spin_j)
                rolling_radius = arm_i * arm_j * inverse
                mean_radius = mean_i * mean_j * inverse * (1.0 + opening * inverse)
                rx = state[j, 2] + half * acceleration[j, 0] - end_x
                ry = state[j, 3] + half * acceleration[j, 1] - end_y
                rate_j = spin_j + half * acceleration[j, 2]
                slide_rate = ry * nx - rx * ny - arm_i * rate_i - arm_j * rate_j
                normal, shear, couple, taken = respond(
                    law_between(law, table, material, i, j), history, pair, overlap, rx * nx + ry * ny,
                    slide, slide_rate, mean_radius, rolling_radius, step * (spin - spin_j), rate_i - rate_j, sums,
                )  # fmt: skip
                power += taken
                px = -normal * nx - shear * ny
                py = -normal * ny + shear * nx
                fx += px
                fy += py
                torque += arm_i * shear - couple
                force[j, 0] -= px
                force[j, 1] -= py
                force[j, 2] += arm_j * shear + couple
            else:
                release(law_between(law, table, material, i, j), history, pair, sums)
        force[i, 0] += fx
        force[i, 1] += fy
        force[i, 2] += torque
    sums[POWER] += power
