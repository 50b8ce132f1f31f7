"""Spheres of elastic material: Hertz's normal force, Mindlin's tangential stiffness, rolling resistance.

Sources: Hertz (Johnson 1985, eq. 4.22); tangential stiffness of a sticking contact by Mindlin (1949), kept as a force that
shrinks with the stiffness when the contact unloads (Thornton et al. 2013), so that no energy is made; damping for a given
coefficient of restitution by Tsuji et al. (1992) in the form of Antypov & Elliott (2011); rolling by an elastic-plastic
spring (Ai et al. 2011).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import overload

from particles.laws.checks import checked
from particles.laws.touch import NAMED, Channel, Response, carried, limited, next_part, pushed, respond, with_part
from particles.vectors import dot, scaled


class Law(NamedTuple):
    """Constants as the kernels take them; None for what the scene does not have."""

    modulus: Any  # E*, Pa
    shear: Any  # 4 G*, Pa: k_t = 2 (4 G*) a with a the contact radius
    friction: Any
    damping: Any  # 2 sqrt(5/6) beta, dimensionless
    rolling: Any  # stiffness over S_n R'^2
    rolling_friction: Any


@dataclass(frozen=True)
class HertzMindlin:
    """Contact of two spheres of one material; `between` for two materials.

    Args:
        young_modulus: E, Pa.
        poisson_ratio: nu.
        friction: Coulomb coefficient.
        restitution: ratio of speeds after and before a head-on impact; 1 for no damping.
        rolling_friction: largest rolling moment over R' F_n.
        rolling_stiffness: of the rolling spring over S_n R'^2, S_n the normal tangent stiffness (only with rolling friction).

    Raises:
        ValueError: constants that make no sense.
    """

    young_modulus: float
    poisson_ratio: float
    friction: float = 0.0
    restitution: float = 1.0
    rolling_friction: float = 0.0
    rolling_stiffness: float = 1.0
    effective: tuple[float, float] | None = None  # E*, G* where the two materials differ

    def __post_init__(self) -> None:
        checked(self, ("young_modulus", "friction", "rolling_friction", "rolling_stiffness"), ("young_modulus",))
        if not -1.0 < self.poisson_ratio <= 0.5:
            raise ValueError(f"poisson_ratio={self.poisson_ratio!r} must lie in (-1, 0.5]")
        if not 0.0 < self.restitution <= 1.0:
            raise ValueError(f"restitution={self.restitution!r} must lie in (0, 1]")

    @classmethod
    def between(cls, first: HertzMindlin, second: HertzMindlin, **options: float) -> HertzMindlin:
        """Contact of two materials; what is not among the `options` (friction, ...) is taken from the first."""
        kept = {name: getattr(first, name) for name in ("friction", "restitution", "rolling_friction", "rolling_stiffness")}
        pairs = [first.moduli, second.moduli]
        effective = tuple(1.0 / sum(0.5 / pair[k] for pair in pairs) for k in (0, 1))
        return cls(first.young_modulus, first.poisson_ratio, **{**kept, **options}, effective=effective)  # type: ignore[arg-type]

    @property
    def moduli(self) -> tuple[float, float]:
        """E* and G* (Pa): E* = E / 2 (1 - nu^2), G* = G / 2 (2 - nu) of two equal spheres."""
        if self.effective is not None:
            return self.effective
        e, nu = self.young_modulus, self.poisson_ratio
        return e / (2.0 * (1.0 - nu**2)), e / (4.0 * (2.0 - nu) * (1.0 + nu))

    def without_friction(self) -> HertzMindlin:
        """The same normal contact without friction and rolling resistance (smooth wall)."""
        return HertzMindlin(self.young_modulus, self.poisson_ratio, 0.0, self.restitution, effective=self.effective)

    @property
    def damping_factor(self) -> float:
        """c / sqrt(S_n m*) of the dashpots: 2 sqrt(5/6) beta, beta = -ln e / sqrt(ln^2 e + pi^2)."""
        log = math.log(self.restitution)
        return 2.0 * math.sqrt(5.0 / 6.0) * -log / math.hypot(log, math.pi)

    def constants(self, laws: list[HertzMindlin], space: bool) -> Law:
        """Constants for the kernels, with what any of the `laws` of the scene has.

        Raises:
            ValueError: the particles are discs.
        """
        if not space:
            raise ValueError("law=HertzMindlin is for spheres (positions with three components); discs take LiChu")
        modulus, shear = self.moduli
        viscous = any(law.restitution < 1.0 for law in laws)
        rolls = any(law.rolling_friction for law in laws)
        return Law(
            modulus, 4.0 * shear, float(self.friction), self.damping_factor if viscous else None,
            float(self.rolling_stiffness) or 1.0 if rolls else None, float(self.rolling_friction) if rolls else None,
        )  # fmt: skip

    def is_viscous(self) -> bool:
        """Whether there is a dashpot."""
        return self.restitution < 1.0

    def needs_mass(self) -> bool:
        """Whether the kernel asks for the reduced mass."""
        return self.is_viscous()

    def columns(self, laws: list[HertzMindlin], space: bool) -> list[tuple[str, float]]:
        """What is remembered: contact radius of the last step (m), sliding force, rolling force (N); sign on exchange."""
        rolls = any(law.rolling_friction for law in laws)
        return [("patch", 1.0), *[("sliding", -1.0)] * 3, *[("rolling", -1.0)] * (3 if rolls else 0)]

    def stiffness(
        self, overlap: np.ndarray, radii: np.ndarray, rolling_radius: np.ndarray, history: dict[str, np.ndarray] | None = None
    ) -> np.ndarray:
        """Tangent stiffness of normal, sliding (N/m), rolling and torsion (N m/rad) of k contacts (k, 4)."""
        modulus, shear = self.moduli
        patch = np.sqrt(np.maximum(overlap, 0.0) / (1.0 / radii[:, 0] + 1.0 / radii[:, 1]))
        normal = 2.0 * modulus * patch
        rolling = self.rolling_stiffness * normal * rolling_radius**2 if self.rolling_friction else 0.0 * normal
        return np.column_stack([normal, 8.0 * shear * patch, rolling, 0.0 * patch])

    def damping(
        self, overlap: np.ndarray, radii: np.ndarray, rolling_radius: np.ndarray, mass: np.ndarray,
        history: dict[str, np.ndarray] | None = None,
    ) -> np.ndarray:  # fmt: skip
        """Dashpots of the same (k, 4), N s/m."""
        stiffness = self.stiffness(overlap, radii, rolling_radius)
        return np.column_stack(
            [self.damping_factor * np.sqrt(stiffness[:, :2] * mass[:, None]), np.zeros((overlap.size, 2))]
        )

    def stored(self, overlap: np.ndarray, radii: np.ndarray, history: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Elastic energies of k contacts by channel (k,), J."""
        stiffness = self.stiffness(overlap, radii, np.zeros_like(overlap))
        found = {"normal": (4.0 / 15.0) * stiffness[:, 0] * np.maximum(overlap, 0.0) ** 2}
        springs = {"sliding": stiffness[:, 1], "rolling": self.rolling_stiffness * stiffness[:, 0]}
        for name, spring in springs.items():
            square = (history[name] ** 2).sum(axis=1) if name in history else np.zeros_like(overlap)
            found[name] = np.where(square > 0.0, 0.5 * square / np.maximum(spring, 1e-300), 0.0)
        return found


def dashpot_of(factor, stiffness, mass):
    """Dashpot factor sqrt(k m), N s/m; None where no law has one."""
    return None if factor is None else factor * math.sqrt(stiffness * mass)


@overload(dashpot_of)
def _dashpot_of(factor, stiffness, mass):
    if isinstance(factor, types.NoneType):
        return lambda factor, stiffness, mass: None
    return lambda factor, stiffness, mass: factor * math.sqrt(stiffness * mass)


def rolling_channel(share, friction, stiffness):
    """Rolling spring of a contact, None where no law has one."""
    return None if share is None else Channel(share * stiffness, friction, None)


@overload(rolling_channel)
def _rolling_channel(share, friction, stiffness):
    if isinstance(share, types.NoneType):
        return lambda share, friction, stiffness: None
    return lambda share, friction, stiffness: Channel(share * stiffness, friction, None)


def rescaled(channel, force, before, now):
    """Elastic force of a channel when its stiffness goes from share `before` to `now` of it, and the energy lost by that.

    It shrinks with the stiffness on unloading and stays on loading: both take energy, neither makes any.
    """
    if channel is None:
        return force, 0.0
    unloads = now < before
    ratio = now / before if unloads else before / now
    square = dot(force, force)
    lost = 0.5 * square * (1.0 - ratio) / (channel.stiffness * before / now)
    return scaled(ratio if unloads else 1.0, force), lost if square > 0.0 else 0.0


@overload(rescaled)
def _rescaled(channel, force, before, now):
    if isinstance(channel, types.NoneType):
        return lambda channel, force, before, now: (force, 0.0)
    return rescaled


def respond_hertz(law, touch, history):
    """Hertz-Mindlin contact; `respond` of this law."""
    touching = touch.overlap > 0.0
    overlap = max(touch.overlap, 0.0)
    before = history[0]
    patch = math.sqrt(overlap / (1.0 / touch.radii[0] + 1.0 / touch.radii[1]))
    now = patch if touching else max(before, 1e-30)  # of a contact that opens, the last one: its energy is lost
    normal_stiffness, sliding_stiffness = 2.0 * law.modulus * now, 2.0 * law.shear * now
    spring = (4.0 / 3.0) * law.modulus * patch * overlap
    damping = dashpot_of(law.damping, normal_stiffness, touch.reduced_mass)
    push, power = pushed(spring, damping, touch.opening, touching)

    channel = Channel(sliding_stiffness, law.friction, dashpot_of(law.damping, sliding_stiffness, touch.reduced_mass))
    roller = rolling_channel(law.rolling, law.rolling_friction, normal_stiffness)
    old, rest = next_part(channel, history[1:], touch.slide)
    old_roll, _ = next_part(roller, rest, touch.roll)
    old, eased = rescaled(channel, carried(touch.turn, old), before, now)
    old_roll, eased_roll = rescaled(roller, carried(touch.turn, old_roll), before, now)
    sliding, shear, work, sliding_power, lost = limited(channel, old, touch.slide, touch.slide_rate, push, touching)
    roll = scaled(touch.mean_radius, touch.roll)
    rolling, roll_force, roll_work, _, roll_lost = limited(roller, old_roll, roll, roll, push, touching)
    spent = (work + eased, roll_work + eased_roll, 0.0, power + sliding_power, lost + roll_lost, 0.0)
    kept = with_part(roller, with_part(channel, (patch,), sliding), rolling)
    return Response(push, shear, scaled(-touch.radius, roll_force), kept, spent)


@overload(respond)
def _respond(law, touch, history):
    if isinstance(law, NAMED) and law.instance_class is Law:
        return respond_hertz
