"""What a contact law sees of two particles, and what it answers; the laws themselves register with `respond`.

Tangential vectors have one component in the plane (along the tangent e_z x n) and three in space; rotations one (about
e_z) or three. So a law is written once for both (see `particles.vectors`).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit, types
from numba.extending import overload

from particles.columns import STRIDE
from particles.system import INLINE
from particles.vectors import cross, dot, head, moved, plus, scaled, tail

NAMED = (types.NamedTuple, types.NamedUniTuple)  # types of named tuples in compiled code
FLAT = 1e300  # radius of a wall, m (infinity would not do in fast arithmetic)
NOTHING = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # spent by a law that spends nothing


class Touch(NamedTuple):
    """Kinematics of a pair in one step (i first, j second), increments exactly objective for any rotation."""

    overlap: Any  # r_i + r_j - d, m; negative for a gap
    opening: Any  # rate of d at the end of the step, m/s
    slide: Any  # tangential displacement increment of j against i, m
    slide_rate: Any  # its rate at the end of the step, m/s
    roll: Any  # rotation increment of i against j, without its part about n, rad
    roll_rate: Any  # rad/s
    twist: Any  # rotation increment of i against j about n (zero in the plane), rad
    twist_rate: Any  # rad/s
    mean_radius: Any  # rolling radius l_i l_j / (l_i + l_j), mean over the step, m
    radius: Any  # the same at the end of the step, m
    normal: Any  # unit vector from i to j
    distance: Any  # between the centres, m (against a wall: to the contact point)
    radii: Any  # (r_i, r_j), m; r_j is FLAT for a wall
    reduced_mass: Any  # 1 / (1/m_i + 1/m_j), kg
    turn: Any  # how tangential vectors turn with the pair in the step: () in the plane, see `carried`


class Response(NamedTuple):
    """Actions of a contact: on i -normal n + tangential and the couple, on j the opposite (moments of force added later)."""

    normal: Any  # N, positive when it pushes
    tangential: Any  # force on i, N
    couple: Any  # on i, N m
    history: Any  # tuple of what is remembered
    spent: Any  # friction by channel (sliding, rolling, moment), J; dashpot power, W; lost on opening, on breaking, J


def respond(law, touch, history):
    """`Response` of a contact law (its named tuple of constants) to a touch; each law has its own (numba overload)."""
    return law.respond(law.numbers, touch, history)


@overload(respond)
def _user_respond(law, touch, history):
    """Laws of a driver script carry their compiled function with them."""
    if isinstance(law, NAMED) and "respond" in law.fields:

        def call(law, touch, history):
            return law.respond(law.numbers, touch, history)

        return call


def carried(turn, vector):
    """A tangential vector of the last step, turned with the pair (length kept): unchanged in the plane."""
    return _turned(turn, vector) if len(turn) else vector


def _turned(turn, vector):
    """Turn about the old normal, then by the smallest rotation from the old normal to the new one."""
    old_normal, (sine, cosine), normal, share = turn
    once = moved(scaled(cosine, vector), sine, cross(old_normal, vector))
    return moved(once, -share * dot(normal, once), plus(old_normal, normal))


@overload(carried)
def _carried(turn, vector):
    return _turned if len(turn) else lambda turn, vector: vector


class Channel(NamedTuple):
    """A tangential or rolling spring with a Coulomb limit; damping is None where no law has a dashpot."""

    stiffness: Any
    friction: Any
    damping: Any


def limited(channel, old, increment, rate, normal, touching):
    """One channel: trial, return to the limit, dashpot below it (as much of it as the limit allows).

    Friction work is the mean force of the step times the slip. Where a spring turns round and its limit falls below the new
    force, all in one step, that product lies between -k |increment|^2 / 8 and zero; then nothing is booked. The same is lost where
    the contact opens, which is a limit of zero.

    Args:
        channel: `Channel`, or None for an absent one.
        old: elastic value before the step, carried along.
        increment, rate: displacement and rate that drive it.
        normal: normal force, N.
        touching: False gives zeros and books the stored energy as lost.

    Returns:
        Elastic value, total value, friction work (J), dashpot power (W), energy lost on opening (J).
    """
    choose = _absent if channel is None else _limited_vector
    return choose(channel, old, increment, rate, normal, touching)


def _absent(channel, old, increment, rate, normal, touching):
    return old, scaled(0.0, increment), 0.0, 0.0, 0.0


def _limited_vector(channel, old, increment, rate, normal, touching):
    limit = channel.friction * normal
    trial = moved(old, channel.stiffness, increment)
    square = dot(trial, trial)
    slips = square > limit * limit
    kept = limit / math.sqrt(square) if slips else 1.0
    new = scaled(kept, trial)
    total, power = dashpot(channel.damping, new, trial, rate, limit, slips)
    given = max(0.0, 0.5 * (1.0 - kept) * (dot(old, trial) + kept * square) / channel.stiffness)
    return new, total, given if touching else 0.0, power, 0.0 if touching else given


def _limited_number(channel, old, increment, rate, normal, touching):
    limit = channel.friction * normal
    trial = old[0] + channel.stiffness * increment[0]
    new = min(max(trial, -limit), limit)
    total, power = dashpot(channel.damping, (new,), (trial,), rate, limit, new != trial)
    given = max(0.0, 0.5 * (old[0] + new) * (trial - new) / channel.stiffness)
    return (new,), total, given if touching else 0.0, power, 0.0 if touching else given


@overload(limited)
def _limited(channel, old, increment, rate, normal, touching):
    if isinstance(channel, types.NoneType):
        return _absent
    return _limited_number if len(increment) == 1 else _limited_vector


def dashpot(damping, spring, trial, rate, limit, slips):
    """Spring and dashpot together, the latter cut where the sum would pass the limit; the dashpot's power.

    Where it slips there is no dashpot; elsewhere the spring carries its `trial`, which is known earlier.
    """
    return (spring, 0.0) if damping is None else _dashpot_vector(damping, spring, trial, rate, limit, slips)


def _dashpot_vector(damping, spring, trial, rate, limit, slips):
    square, mixed = dot(rate, rate), dot(trial, rate)
    room = max(0.0, limit * limit - dot(trial, trial))
    allowed = (math.sqrt(mixed * mixed + square * room) - mixed) / square if square > 0.0 else damping
    acting = 0.0 if slips else min(damping, allowed)
    return moved(spring, acting, rate), acting * square


def _dashpot_number(damping, spring, trial, rate, limit, slips):
    wanted = spring[0] + (0.0 if slips else damping * rate[0])
    total = min(max(wanted, -limit), limit)
    return (total,), (total - spring[0]) * rate[0]


@overload(dashpot)
def _dashpot(damping, spring, trial, rate, limit, slips):
    if isinstance(damping, types.NoneType):
        return lambda damping, spring, trial, rate, limit, slips: (spring, 0.0)
    return _dashpot_number if len(spring) == 1 else _dashpot_vector


def next_part(channel, values, pattern):
    """The part of a history that belongs to a channel (zeros where it is absent) and what follows."""
    return (scaled(0.0, pattern), values) if channel is None else (head(values, pattern), tail(values, pattern))


@overload(next_part)
def _next_part(channel, values, pattern):
    if isinstance(channel, types.NoneType):
        return lambda channel, values, pattern: (scaled(0.0, pattern), values)
    return lambda channel, values, pattern: (head(values, pattern), tail(values, pattern))


def with_part(channel, values, new):
    """Append a channel's new values to a history, where it is present."""
    return values if channel is None else (*values, *new)


@overload(with_part)
def _with_part(channel, values, new):
    if isinstance(channel, types.NoneType):
        return lambda channel, values, new: values
    return lambda channel, values, new: values + new


def pushed(spring, damping, opening, touching):
    """Normal force max(0, spring - c opening), zero in a gap (N), and the power that the dashpot takes (W)."""
    if damping is None:
        return (spring if touching else 0.0), 0.0
    total = max(0.0, spring - damping * opening)
    return (total if touching else 0.0), ((spring - total) * opening if touching else 0.0)


@overload(pushed)
def _pushed(spring, damping, opening, touching):
    if isinstance(damping, types.NoneType):
        return lambda spring, damping, opening, touching: (spring if touching else 0.0, 0.0)
    return pushed


# ---------------------------------------------------------------------------------------- constants by pair of materials


def numbers_of(law: Any) -> list[float]:
    """All numbers in a named tuple of constants, in order; None and functions are left out."""
    if isinstance(law, tuple):
        return [number for member in law for number in numbers_of(member)]
    return [float(law)] if isinstance(law, (int, float, np.number)) else []


def with_numbers(template, numbers, place, stride):
    """The named tuple `template` with its numbers replaced by numbers[place], numbers[place + stride], ..."""
    values = iter(numbers[place::stride])

    def fill(member):
        if isinstance(member, tuple):
            filled = [fill(part) for part in member]
            return type(member)(*filled) if hasattr(member, "_fields") else tuple(filled)
        return float(next(values)) if isinstance(member, (int, float, np.number)) else member

    return fill(template)


@overload(with_numbers)
def _with_numbers(template, numbers, place, stride):
    scope: dict[str, Any] = {}
    count = 0

    def text(kind, path):
        nonlocal count
        if isinstance(kind, NAMED):
            name = f"made{len(scope)}"
            scope[name] = kind.instance_class
            return f"{name}(" + ", ".join(text(k, f"{path}.{f}") for k, f in zip(kind.types, kind.fields)) + ")"
        if isinstance(kind, types.BaseTuple):
            return "(" + "".join(text(k, f"{path}[{n}]") + ", " for n, k in enumerate(kind.types)) + ")"
        if isinstance(kind, types.Number):
            count += 1
            return f"numbers[place + {count - 1} * stride]"
        return path

    body = text(template, "template")
    exec(f"def filled(template, numbers, place, stride):\n    return {body}", scope)  # noqa: S102
    return scope["filled"]


def law_at(law, table, scratch, place):
    """Constants of a pair: one law for all, or those gathered in the scratch columns from `place` on."""
    return law if table is None else with_numbers(law, scratch, place, STRIDE)


@overload(law_at)
def _law_at(law, table, scratch, place):
    if isinstance(table, types.NoneType):
        return lambda law, table, scratch, place: law
    return lambda law, table, scratch, place: with_numbers(law, scratch, place, STRIDE)


@njit(**INLINE)
def wall_law(law, row):
    """Constants of a contact with a wall from their row."""
    return with_numbers(law, row, 0, 1)
