"""Linear contact with sliding friction only (Cundall & Strack 1979): the Li-Chu law without its rolling channels."""

from __future__ import annotations

from particles.laws.li_chu import LiChu


def linear_sliding(
    normal_stiffness: float,
    sliding_stiffness: float,
    friction: float,
    normal_damping: float = 0.0,
    sliding_damping: float = 0.0,
) -> LiChu:
    """Springs (N/m), Coulomb limit (-) and dashpots (N s/m) in the normal and the tangential direction.

    What the law lacks costs nothing: the loops are compiled without rolling.
    """
    return LiChu(
        normal_stiffness, sliding_stiffness, normal_damping=normal_damping, sliding_damping=sliding_damping,
        sliding_friction=friction,
    )  # fmt: skip
