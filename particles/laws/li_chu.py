"""Contact law of Li, Chu & Feng (2005) as used by Li & Wan (2010): normal, sliding, rolling force, rolling moment.

Each tangential channel is a spring with a Coulomb limit and a dashpot below that limit. The elastic part of a channel
is its history. The kernels here know one contact and nothing of lists.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
from numba import njit, types
from numba.extending import overload

from particles.system import FAST, FRICTION_MOMENT, FRICTION_ROLLING, FRICTION_SLIDING, LOSS

COLUMNS = 12  # of a row of constants: see LiChu.row


@dataclass(frozen=True)
class LiChu:
    """Constants of a contact of two discs, per metre of thickness (Li & Wan 2010, section 2.1 and table 1).

    Stiffnesses in N/m (moment: N m/rad), dashpots in N s/m (moment: N m s/rad), friction coefficients without unit
    (moment: m). A channel with zero stiffness is absent.

    Args:
        rolling_length: "reduced" (rolling radius l_i l_j / (l_i + l_j)) or "twice_reduced".
        rolling_force: "torque" (a pure couple pair, objective) or "contact" (the paper's wording taken literally: depends
            on the numbering of particles and does not conserve energy; for comparison only).

    Raises:
        ValueError: a constant is negative, not finite, or (normal stiffness) zero.
    """

    normal_stiffness: float
    sliding_stiffness: float = 0.0
    rolling_stiffness: float = 0.0
    moment_stiffness: float = 0.0
    normal_damping: float = 0.0
    sliding_damping: float = 0.0
    rolling_damping: float = 0.0
    moment_damping: float = 0.0
    sliding_friction: float = 0.0
    rolling_friction: float = 0.0
    moment_friction: float = 0.0
    rolling_length: str = "reduced"
    rolling_force: str = "torque"

    def __post_init__(self) -> None:
        for field in fields(self)[:11]:
            value = getattr(self, field.name)
            if not (isinstance(value, (int, float, np.number)) and math.isfinite(value) and value >= 0.0):
                raise ValueError(f"{field.name}={value!r} must be a finite number, zero or positive")
        if self.normal_stiffness == 0.0:
            raise ValueError(f"normal_stiffness={self.normal_stiffness!r} must be positive (N/m)")
        if self.rolling_length not in ("reduced", "twice_reduced"):
            raise ValueError(f"rolling_length={self.rolling_length!r} must be 'reduced' or 'twice_reduced'")
        if self.rolling_force not in ("torque", "contact"):
            raise ValueError(f"rolling_force={self.rolling_force!r} must be 'torque' or 'contact'")

    def without_friction(self) -> LiChu:
        """The same normal contact without sliding and rolling resistance (smooth wall)."""
        return LiChu(
            self.normal_stiffness,
            normal_damping=self.normal_damping,
            rolling_length=self.rolling_length,
            rolling_force=self.rolling_force,
        )

    def row(self) -> np.ndarray:
        """The constants as a row: normal k, c; then k, friction, c of sliding, rolling, moment; rolling length factor."""
        return np.array(
            [
                self.normal_stiffness, self.normal_damping,
                self.sliding_stiffness, self.sliding_friction, self.sliding_damping,
                self.rolling_stiffness, self.rolling_friction, self.rolling_damping,
                self.moment_stiffness, self.moment_friction, self.moment_damping,
                1.0 if self.rolling_length == "reduced" else 2.0,
            ]
        )  # fmt: skip


class Channel(NamedTuple):
    """One tangential or rolling channel; damping is None where no law has a dashpot."""

    stiffness: float
    friction: float
    damping: Any


class Law(NamedTuple):
    """Constants of one contact as the kernels take them; None for what the scene does not have."""

    stiffness: float
    damping: Any
    sliding: Any
    rolling: Any
    moment: Any
    length_factor: float
    literal: Any


def compile_law(laws: list[LiChu]) -> Law:
    """Constants of the first law, with a channel present if any of the laws has it."""
    rows = np.array([law.row() for law in laws])
    kinds = {law.rolling_force for law in laws}
    if len(kinds) > 1:
        raise ValueError("rolling_force must be the same in all laws of an assembly")

    def channel(first: int) -> Channel | None:
        if not rows[:, first].any():
            return None
        damping = float(rows[0, first + 2]) if rows[:, first + 2].any() else None
        return Channel(float(rows[0, first]), float(rows[0, first + 1]), damping)

    damping = float(rows[0, 1]) if rows[:, 1].any() else None
    literal = 1 if kinds == {"contact"} else None
    return Law(float(rows[0, 0]), damping, channel(2), channel(5), channel(8), float(rows[0, 11]), literal)


def _damping_of(template, value):
    """The value where the template has a dashpot; decided when the loops are compiled."""
    return None if template is None else value


@overload(_damping_of)
def _compiled_damping_of(template, value):
    if isinstance(template, types.NoneType):
        return lambda template, value: None
    return lambda template, value: value


def _channel_of(template, row, first):
    """The channel read from a row where the template has it; decided when the loops are compiled."""
    if template is None:
        return None
    return Channel(row[first], row[first + 1], _damping_of(template.damping, row[first + 2]))


@overload(_channel_of)
def _compiled_channel_of(template, row, first):
    if isinstance(template, types.NoneType):
        return lambda template, row, first: None
    return lambda template, row, first: Channel(
        row[first], row[first + 1], _damping_of(template.damping, row[first + 2])
    )


@njit(cache=True)
def law_of(template, row):
    """Constants read from a row (of several materials, or of a plate); `template` says what is present."""
    return Law(
        row[0],
        _damping_of(template.damping, row[1]),
        _channel_of(template.sliding, row, 2),
        _channel_of(template.rolling, row, 5),
        _channel_of(template.moment, row, 8),
        row[11],
        template.literal,
    )


def law_between(law, table, material, i, j):
    """Constants of a pair of discs: one law for all, or by their materials; decided when the loops are compiled."""
    return law if table is None else law_of(law, table[material[i], material[j]])


@overload(law_between)
def _compiled_law_between(law, table, material, i, j):
    if isinstance(table, types.NoneType):
        return lambda law, table, material, i, j: law
    return lambda law, table, material, i, j: law_of(law, table[material[i], material[j]])


@njit(cache=True, fastmath=FAST)
def _normal(stiffness, damping, overlap, opening_rate):
    """Normal force F = max(0, k overlap - c opening_rate), N, and the power that the dashpot takes, W."""
    spring = stiffness * overlap
    if damping is None:
        return max(0.0, spring), 0.0
    total = max(0.0, spring - damping * opening_rate)
    return total, (spring - total) * opening_rate


@njit(cache=True, fastmath=FAST)
def _limited(stiffness, friction, damping, history, contact, column, increment, rate, normal, sums, item):
    """One channel: trial, return to the Coulomb limit (slip work booked), dashpot below it; value and dashpot power."""
    limit = friction * normal
    old = history[contact, column]
    trial = old + stiffness * increment
    if abs(trial) > limit:
        new = limit if trial > 0.0 else -limit
        history[contact, column] = new
        sums[item] += 0.5 * (old + new) * (trial - new) / stiffness
        return new, 0.0
    history[contact, column] = trial
    if damping is None:
        return trial, 0.0
    total = trial + damping * rate
    if abs(total) > limit:
        total = limit if total > 0.0 else -limit
    return total, (total - trial) * rate


@njit(cache=True, fastmath=FAST)
def _respond(
    stiffness, damping, sliding, rolling, moment, literal,
    history, contact, overlap, opening_rate, slide, slide_rate, mean_radius, radius, roll, roll_rate, sums,
):  # fmt: skip
    normal, power = _normal(stiffness, damping, overlap, opening_rate)
    shear = 0.0
    couple = 0.0
    column = 0
    if sliding is not None:
        shear, taken = _limited(
            sliding.stiffness, sliding.friction, sliding.damping,
            history, contact, column, slide, slide_rate, normal, sums, FRICTION_SLIDING,
        )  # fmt: skip
        power += taken
        column += 1
    if rolling is not None:
        force, taken = _limited(
            rolling.stiffness, rolling.friction, rolling.damping,
            history, contact, column, mean_radius * roll, radius * roll_rate, normal, sums, FRICTION_ROLLING,
        )  # fmt: skip
        power += taken
        column += 1
        if literal is None:
            couple += radius * force
        else:
            shear -= force
    if moment is not None:
        value, taken = _limited(
            moment.stiffness, moment.friction, moment.damping,
            history, contact, column, roll, roll_rate, normal, sums, FRICTION_MOMENT,
        )  # fmt: skip
        couple += value
        power += taken
    return normal, shear, couple, power


@njit(cache=True, fastmath=FAST)
def respond(
    law, history, contact, overlap, opening_rate, slide, slide_rate, mean_radius, radius, roll, roll_rate, sums
):
    """Normal force, force along t on i, couple on j and dashpot power of a touching pair (N, N, N m, W).

    Args:
        law: `Law`.
        history: elastic channel values (n, channels); row `contact` is this pair's.
        overlap, opening_rate: m, m/s (positive when opening).
        slide, slide_rate: tangential displacement increment of the step (m) and rate (m/s) of j against i.
        mean_radius, radius: rolling radius, mean over the step and at its end (m).
        roll, roll_rate: relative rotation increment (rad) and rate (rad/s) of i against j.
        sums: energy sums (see `particles.system`); slip work is added, as is the new state to `history`.
    """
    return _respond(
        law.stiffness, law.damping, law.sliding, law.rolling, law.moment, law.literal,
        history, contact, overlap, opening_rate, slide, slide_rate,
        law.length_factor * mean_radius, law.length_factor * radius, roll, roll_rate, sums,
    )  # fmt: skip


@njit(cache=True, fastmath=FAST)
def _stored(channel, value):
    """Elastic energy (J) of one channel; zero where the channel is absent."""
    if channel is None:
        return 0.0
    if value == 0.0:
        return 0.0
    return 0.5 * value * value / channel.stiffness


@njit(cache=True, fastmath=FAST)
def _release(sliding, rolling, moment, history, contact, sums):
    column = 0
    if sliding is not None:
        sums[LOSS] += _stored(sliding, history[contact, column])
        history[contact, column] = 0.0
        column += 1
    if rolling is not None:
        sums[LOSS] += _stored(rolling, history[contact, column])
        history[contact, column] = 0.0
        column += 1
    if moment is not None:
        sums[LOSS] += _stored(moment, history[contact, column])
        history[contact, column] = 0.0


@njit(cache=True, fastmath=FAST)
def release(law, history, contact, sums):
    """Clear the history of an opened contact and book its elastic energy as loss."""
    _release(law.sliding, law.rolling, law.moment, history, contact, sums)
