"""Contact law of Li, Chu & Feng (2005) as used by Li & Wan (2010): normal, sliding, rolling force, rolling moment.

Each tangential channel is a spring with a Coulomb limit and a dashpot below that limit. The elastic part of a channel
is its history.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import overload

from particles.laws.checks import checked
from particles.laws.touch import NAMED, Channel, Response, carried, limited, next_part, pushed, respond, with_part
from particles.vectors import minus, moved, scaled

CHANNELS = ("sliding", "rolling", "moment", "torsion")


class Law(NamedTuple):
    """Constants of one contact as the kernels take them; None for what the scene does not have."""

    stiffness: Any
    damping: Any
    sliding: Any
    rolling: Any
    moment: Any
    torsion: Any
    length_factor: Any
    literal: Any


@dataclass(frozen=True)
class LiChu:
    """Constants of a contact (Li & Wan 2010, section 2.1 and table 1); in the plane per metre of thickness.

    Stiffnesses in N/m (moment, torsion: N m/rad), dashpots in N s/m (N m s/rad), friction coefficients without unit
    (moment, torsion: m). A channel with zero stiffness is absent.

    Args:
        rolling_length: "reduced" (rolling radius l_i l_j / (l_i + l_j)) or "twice_reduced".
        rolling_force: "torque" (a pure couple pair, objective) or "contact" (the paper's wording taken literally, in the
            plane only: depends on the numbering of particles and does not conserve energy; for comparison).
        torsion_stiffness, torsion_damping, torsion_friction: of the relative rotation about the normal, spheres only.

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
    torsion_stiffness: float = 0.0
    torsion_damping: float = 0.0
    torsion_friction: float = 0.0

    def __post_init__(self) -> None:
        numbers = tuple(field.name for field in fields(self) if field.type == "float")
        checked(self, numbers, positive=("normal_stiffness",))
        if self.rolling_length not in ("reduced", "twice_reduced"):
            raise ValueError(f"rolling_length={self.rolling_length!r} must be 'reduced' or 'twice_reduced'")
        if self.rolling_force not in ("torque", "contact"):
            raise ValueError(f"rolling_force={self.rolling_force!r} must be 'torque' or 'contact'")

    def without_friction(self) -> LiChu:
        """The same normal contact without sliding and rolling resistance (smooth wall)."""
        gone: dict[str, Any] = {f"{name}_{kind}": 0.0 for name in CHANNELS for kind in ("stiffness", "damping", "friction")}
        return replace(self, **gone)

    def channel(self, name: str) -> Channel:
        """One channel's constants."""
        return Channel(*(float(getattr(self, f"{name}_{kind}")) for kind in ("stiffness", "friction", "damping")))

    @property
    def length_factor(self) -> float:
        """Rolling radius over l_i l_j / (l_i + l_j)."""
        return 1.0 if self.rolling_length == "reduced" else 2.0

    def constants(self, laws: list[LiChu], space: bool) -> Law:
        """Constants for the kernels, with what any of the `laws` of the scene has; `space` for spheres."""
        if len({law.rolling_force for law in laws}) > 1:
            raise ValueError("rolling_force must be the same in all laws of an assembly")
        literal = self.rolling_force == "contact"
        if literal and space:
            raise ValueError("rolling_force='contact' is for discs only; take 'torque'")

        def present(name: str) -> Channel | None:
            if not any(getattr(law, f"{name}_stiffness") for law in laws) or (name == "torsion" and not space):
                return None
            mine = self.channel(name)
            # a law without the channel that others have: a spring that its limit of zero keeps at zero
            stiffness = mine.stiffness or max(getattr(law, f"{name}_stiffness") for law in laws)
            viscous = any(getattr(law, f"{name}_damping") for law in laws)
            return Channel(stiffness, mine.friction if mine.stiffness else 0.0, mine.damping if viscous else None)

        viscous = any(law.normal_damping for law in laws)
        return Law(
            float(self.normal_stiffness), float(self.normal_damping) if viscous else None,
            present("sliding"), present("rolling"), present("moment"), present("torsion"), self.length_factor,
            1.0 if literal else None,
        )  # fmt: skip

    def is_viscous(self) -> bool:
        """Whether there is a dashpot."""
        return any(getattr(self, f"{name}_damping") for name in ("normal", *CHANNELS))

    def columns(self, laws: list[LiChu], space: bool) -> list[tuple[str, float]]:
        """What is remembered: channel and factor (1 or -1) when the labels of a pair are exchanged, a number each."""
        law = self.constants(laws, space)
        found: list[tuple[str, float]] = []
        for name in CHANNELS:
            if getattr(law, name) is not None:
                # in the plane the tangent turns with the normal; about it, torsion is the same from both ends
                sign = {"sliding": -1.0 if space else 1.0, "torsion": 1.0}.get(name, -1.0)
                found += [(name, sign)] * (3 if space and name != "torsion" else 1)
        return found

    def stiffness(
        self, overlap: np.ndarray, radii: np.ndarray, rolling_radius: np.ndarray, history: dict[str, np.ndarray] | None = None
    ) -> np.ndarray:
        """Tangent stiffness of normal, sliding (N/m), rolling and torsion (N m/rad) of k sticking contacts (k, 4)."""
        rolling = self.moment_stiffness + (self.length_factor * rolling_radius) ** 2 * self.rolling_stiffness
        one = np.ones_like(overlap)
        return np.column_stack(
            [self.normal_stiffness * one, self.sliding_stiffness * one, rolling, self.torsion_stiffness * one]
        )

    def damping(
        self, overlap: np.ndarray, radii: np.ndarray, rolling_radius: np.ndarray, mass: np.ndarray,
        history: dict[str, np.ndarray] | None = None,
    ) -> np.ndarray:  # fmt: skip
        """Dashpots of the same (k, 4), N s/m and N m s/rad."""
        rolling = self.moment_damping + (self.length_factor * rolling_radius) ** 2 * self.rolling_damping
        one = np.ones_like(overlap)
        return np.column_stack([self.normal_damping * one, self.sliding_damping * one, rolling, self.torsion_damping * one])

    def stored(self, overlap: np.ndarray, radii: np.ndarray, history: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Elastic energies of k contacts by channel (k,), J; `history` (k, components) by channel."""
        none = np.zeros_like(overlap)
        found = {"normal": 0.5 * self.normal_stiffness * np.maximum(overlap, 0.0) ** 2}
        for name in CHANNELS:
            stiffness = getattr(self, f"{name}_stiffness")
            found[name] = 0.5 * (history[name] ** 2).sum(axis=1) / stiffness if stiffness and name in history else none
        return found


def _shear_and_couple(literal, shear, rolling, radius):
    """Force and couple on i of the sliding and the rolling channel."""
    return (shear, scaled(-radius, rolling)) if literal is None else (minus(shear, rolling), scaled(0.0, rolling))


@overload(_shear_and_couple)
def _compiled_shear_and_couple(literal, shear, rolling, radius):
    if isinstance(literal, types.NoneType):
        return lambda literal, shear, rolling, radius: (shear, scaled(-radius, rolling))
    return lambda literal, shear, rolling, radius: (minus(shear, rolling), scaled(0.0, rolling))


def _along(normal, couple, twist):
    """A couple with a part about the normal added (in space)."""
    return moved(couple, twist, normal) if len(couple) == 3 else couple


@overload(_along)
def _compiled_along(normal, couple, twist):
    if len(couple) == 3:
        return lambda normal, couple, twist: moved(couple, twist, normal)
    return lambda normal, couple, twist: couple


def respond_li_chu(law, touch, history):
    """Actions of the four channels (and torsion); `respond` of this law."""
    touching = touch.overlap > 0.0
    normal, power = pushed(law.stiffness * touch.overlap, law.damping, touch.opening, touching)
    sliding, rest = next_part(law.sliding, history, touch.slide)
    rolling, rest = next_part(law.rolling, rest, touch.roll)
    moment, rest = next_part(law.moment, rest, touch.roll)
    torsion, _ = next_part(law.torsion, rest, (touch.twist,))
    radius = law.length_factor * touch.radius
    mean = law.length_factor * touch.mean_radius

    sliding, shear, work_s, power_s, lost_s = limited(
        law.sliding, carried(touch.turn, sliding), touch.slide, touch.slide_rate, normal, touching
    )
    rolling, roll_force, work_r, power_r, lost_r = limited(
        law.rolling, carried(touch.turn, rolling), scaled(mean, touch.roll), scaled(radius, touch.roll_rate), normal, touching
    )
    moment, roll_moment, work_m, power_m, lost_m = limited(
        law.moment, carried(touch.turn, moment), touch.roll, touch.roll_rate, normal, touching
    )
    torsion, twist_moment, work_t, power_t, lost_t = limited(
        law.torsion, torsion, (touch.twist,), (touch.twist_rate,), normal, touching
    )
    shear, couple = _shear_and_couple(law.literal, shear, roll_force, radius)
    couple = _along(touch.normal, minus(couple, roll_moment), -twist_moment[0])
    kept = with_part(law.rolling, with_part(law.sliding, (), sliding), rolling)
    kept = with_part(law.torsion, with_part(law.moment, kept, moment), torsion)
    spent = (
        work_s, work_r, work_m + work_t, power + power_s + power_r + power_m + power_t, lost_s + lost_r + lost_m + lost_t, 0.0
    )  # fmt: skip
    return Response(normal, shear, couple, kept, spent)


@overload(respond)
def _respond(law, touch, history):
    if isinstance(law, NAMED) and law.instance_class is Law:
        return respond_li_chu
