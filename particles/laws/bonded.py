"""Elastic perfectly brittle bonds (Rojek & Onate 2007, eqs 19-24), with bending and torsion as an option.

A bond carries tension, compression and shear until one of its strengths is passed; then the pair is an ordinary
frictional contact, as if it had never been bonded, but for the distance at which it was without force. Pairs are bonded
by `Assembly.bond`; other pairs of the law are frictional contacts from the start.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import overload

from particles.laws.checks import checked
from particles.laws.touch import NAMED, Response, carried, next_part, respond, with_part
from particles.vectors import dot, minus, moved, plus, scaled

_STRENGTHS = ("tensile_strength", "shear_strength", "bending_strength", "torsion_strength")
ENDLESS = 1e200  # strength of what cannot break (infinity would not do in fast arithmetic)


class Law(NamedTuple):
    """Constants as the kernels take them; None for what the scene does not have."""

    normal_stiffness: Any
    shear_stiffness: Any
    friction: Any
    tensile_strength: Any
    shear_strength: Any
    normal_damping: Any
    shear_damping: Any
    bending: Any
    torsion: Any


class Beam(NamedTuple):
    """Stiffness and strength of a bond against relative rotation."""

    stiffness: Any
    strength: Any


@dataclass(frozen=True)
class Bonded:
    """Constants of a bond and of the contact that it leaves behind; in the plane per metre of thickness.

    Args:
        normal_stiffness, shear_stiffness: k_n, k_t, N/m.
        tensile_strength, shear_strength: R_n, R_t, N; infinity for what cannot break.
        friction: Coulomb coefficient of unbonded contacts.
        normal_damping, shear_damping: dashpots, N s/m; that of the shear acts in bonds only.
        bending_stiffness, torsion_stiffness: moment of a bond by relative rotation across and about the normal, N m/rad
            (Potyondy & Cundall 2004, parallel bonds); zero as in Rojek & Onate. Unbonded contacts have neither.
        bending_strength, torsion_strength: N m.

    Raises:
        ValueError: a constant is negative or no number, or a needed one is zero.
    """

    normal_stiffness: float
    shear_stiffness: float
    tensile_strength: float
    shear_strength: float
    friction: float = 0.0
    normal_damping: float = 0.0
    shear_damping: float = 0.0
    bending_stiffness: float = 0.0
    torsion_stiffness: float = 0.0
    bending_strength: float = math.inf
    torsion_strength: float = math.inf

    def __post_init__(self) -> None:
        checked(
            self, tuple(field.name for field in fields(self) if field.name not in _STRENGTHS), ("normal_stiffness",)
        )
        for name in _STRENGTHS:
            value = getattr(self, name)
            if not (isinstance(value, (int, float, np.number)) and value > 0.0):
                raise ValueError(f"{name}={value!r} must be positive (infinity for what cannot break)")

    def without_friction(self) -> Bonded:
        """The same normal contact without shear (smooth wall)."""
        return Bonded(
            self.normal_stiffness, 0.0, self.tensile_strength, self.shear_strength, normal_damping=self.normal_damping
        )

    def constants(self, laws: list[Bonded], space: bool) -> Law:
        """Constants for the kernels, with what any of the `laws` of the scene has; `space` for spheres."""

        def damping(name: str) -> float | None:
            return float(getattr(self, name)) if any(getattr(law, name) for law in laws) else None

        def beam(name: str) -> Beam | None:
            stiffness = [getattr(law, f"{name}_stiffness") for law in laws]
            if not any(stiffness) or (name == "torsion" and not space):
                return None
            # a bond without what others have: a spring too weak to matter
            own = getattr(self, f"{name}_stiffness") or 1e-12 * max(stiffness)
            return Beam(own, min(getattr(self, f"{name}_strength"), ENDLESS))

        return Law(
            float(self.normal_stiffness), float(self.shear_stiffness), float(self.friction),
            min(self.tensile_strength, ENDLESS), min(self.shear_strength, ENDLESS),
            damping("normal_damping"), damping("shear_damping"), beam("bending"), beam("torsion"),
        )  # fmt: skip

    def is_viscous(self) -> bool:
        """Whether there is a dashpot."""
        return bool(self.normal_damping or self.shear_damping)

    def columns(self, laws: list[Bonded], space: bool) -> list[tuple[str, float]]:
        """What is remembered, with the factor when the labels of a pair are exchanged, a number each.

        "bond" is 1 or 0; "offset" the distance without force less the sum of the radii, m.
        """
        law = self.constants(laws, space)
        vector = 3 if space else 1
        found = [("bond", 1.0), ("offset", 1.0), *[("sliding", -1.0 if space else 1.0)] * vector]
        found += [("moment", -1.0)] * (vector if law.bending is not None else 0)
        return found + [("torsion", 1.0)] * (law.torsion is not None)

    @staticmethod
    def reaches(overlap: np.ndarray, history: dict[str, np.ndarray]) -> np.ndarray:
        """Which of k pairs carry a force across a gap (k,): bonds, and what is left of a bond that was made with a gap."""
        return (history["bond"][:, 0] > 0.5) | (overlap + history["offset"][:, 0] > 0.0)

    @staticmethod
    def _of_bonds(overlap: np.ndarray, row: list[float], columns: slice, history: dict[str, np.ndarray] | None) -> np.ndarray:
        """Constants of k contacts (k, 4); those of `columns` belong to bonds that hold."""
        found = np.tile(np.array(row, dtype=float), (overlap.size, 1))
        found[np.ones(overlap.size, dtype=bool) if history is None else history["bond"][:, 0] < 0.5, columns] = 0.0
        return found

    def stiffness(
        self, overlap: np.ndarray, radii: np.ndarray, rolling_radius: np.ndarray, history: dict[str, np.ndarray] | None = None
    ) -> np.ndarray:
        """Tangent stiffness of normal, sliding (N/m), bending and torsion (N m/rad) of k contacts (k, 4).

        Bending and torsion are those of bonds that hold; without `history` there are none.
        """
        row = [self.normal_stiffness, self.shear_stiffness, self.bending_stiffness, self.torsion_stiffness]
        return self._of_bonds(overlap, row, slice(2, 4), history)

    def damping(
        self, overlap: np.ndarray, radii: np.ndarray, rolling_radius: np.ndarray, mass: np.ndarray,
        history: dict[str, np.ndarray] | None = None,
    ) -> np.ndarray:  # fmt: skip
        """Dashpots of the same (k, 4), N s/m; that of the shear acts in bonds that hold."""
        return self._of_bonds(overlap, [self.normal_damping, self.shear_damping, 0.0, 0.0], slice(1, 2), history)

    def stored(self, overlap: np.ndarray, radii: np.ndarray, history: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Elastic energies of k bonds and contacts by channel (k,), J."""
        opening = -(overlap + history["offset"][:, 0])
        stretched = np.where(history["bond"][:, 0] > 0.5, opening, np.minimum(opening, 0.0))
        found: dict[str, np.ndarray] = {"normal": 0.5 * self.normal_stiffness * stretched**2}
        stiffness = {
            "sliding": self.shear_stiffness, "moment": self.bending_stiffness, "torsion": self.torsion_stiffness
        }  # fmt: skip
        for name, k in stiffness.items():
            square = (history[name] ** 2).sum(axis=1) if name in history else np.zeros_like(overlap)
            found[name] = 0.5 * square / k if k else np.zeros_like(overlap)
        return found


def beam_moment(beam, old, increment):
    """Moment of a bond, its energy (J) and whether it is too large; zero for a law without beams."""
    if beam is None:
        return scaled(0.0, increment), 0.0, False
    moment = moved(old, beam.stiffness, increment)
    size = dot(moment, moment)
    return moment, 0.5 * size / beam.stiffness, size > beam.strength * beam.strength


@overload(beam_moment)
def _beam_moment(beam, old, increment):
    if isinstance(beam, types.NoneType):
        return lambda beam, old, increment: (scaled(0.0, increment), 0.0, False)
    return beam_moment


def dashpot_force(damping, rate, share):
    """Force share c rate and its power; none where there is no dashpot."""
    if damping is None:
        return scaled(0.0, rate), 0.0
    force = scaled(share * damping, rate)
    return force, dot(force, rate)


@overload(dashpot_force)
def _dashpot_force(damping, rate, share):
    if isinstance(damping, types.NoneType):
        return lambda damping, rate, share: (scaled(0.0, rate), 0.0)
    return dashpot_force


def couple_of(normal, moment, torsion):
    """Couple on i of bending and torsion."""
    return scaled(-1.0, moment) if len(moment) == 1 else moved(scaled(-1.0, moment), -torsion, normal)


@overload(couple_of)
def _couple_of(normal, moment, torsion):
    if len(moment) == 1:
        return lambda normal, moment, torsion: scaled(-1.0, moment)
    return lambda normal, moment, torsion: moved(scaled(-1.0, moment), -torsion, normal)


def respond_bonded(law, touch, history):
    """Bond or frictional contact; `respond` of this law."""
    bonded, offset = history[0] > 0.5, history[1]
    opening = -(touch.overlap + offset)
    old, rest = next_part(1.0, history[2:], touch.slide)
    old_moment, rest = next_part(law.bending, rest, touch.roll)
    old_torsion, _ = next_part(law.torsion, rest, (0.0,))
    old = carried(touch.turn, old)

    # as a bond
    trial = moved(old, law.shear_stiffness, touch.slide)
    square = dot(trial, trial)
    moment, moment_energy, bends = beam_moment(law.bending, carried(touch.turn, old_moment), touch.roll)
    torsion, torsion_energy, twists = beam_moment(law.torsion, old_torsion, (touch.twist,))
    tears = law.normal_stiffness * opening > law.tensile_strength
    shears = square > law.shear_strength * law.shear_strength
    holds = bonded and not (tears or shears or bends or twists)
    breaks = bonded and not holds

    # as a contact with friction
    touching = opening < 0.0
    spring = -law.normal_stiffness * opening
    dash, dash_power = dashpot_force(law.normal_damping, (touch.opening,), 1.0)
    push = max(0.0, spring - dash[0]) if touching else 0.0
    limit = law.friction * push
    slips = square > limit * limit
    slid = scaled(limit / math.sqrt(square) if slips else 1.0, trial)
    soft = 0.5 / law.shear_stiffness if law.shear_stiffness > 0.0 else 0.0
    sliding_work = max(0.0, soft * dot(plus(old, slid), minus(trial, slid)))

    kept = trial if holds else slid
    viscous, viscous_power = dashpot_force(law.shear_damping, touch.slide_rate, 1.0 if holds else 0.0)
    normal = (spring - dash[0]) if holds else push
    normal_power = dash_power if holds else ((spring - push) * touch.opening if touching else 0.0)
    bond_energy = (
        0.5 * law.normal_stiffness * opening * opening + soft * square + moment_energy + torsion_energy
    )  # fmt: skip
    left = (0.5 * law.normal_stiffness * opening * opening if touching else 0.0) + soft * dot(slid, slid)
    frictional = not bonded
    spent = (
        sliding_work if frictional and touching else 0.0, 0.0, 0.0, normal_power + viscous_power,
        soft * dot(old, old) if frictional and not touching else 0.0, bond_energy - left if breaks else 0.0,
    )  # fmt: skip
    weight = 1.0 if holds else 0.0
    moment, torsion = scaled(weight, moment), scaled(weight, torsion)
    apart = not holds and opening > 0.0 and touch.overlap < 0.0
    new = with_part(1.0, (weight, 0.0 if apart else offset), kept)
    new = with_part(law.torsion, with_part(law.bending, new, moment), torsion)
    return Response(normal, plus(kept, viscous), couple_of(touch.normal, moment, torsion[0]), new, spent)


@overload(respond)
def _respond(law, touch, history):
    if isinstance(law, NAMED) and law.instance_class is Law:
        return respond_bonded
