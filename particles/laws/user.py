"""A contact law from a driver script, at the speed of the built-in ones.

    from typing import NamedTuple
    from particles.laws import Response, UserLaw, kernel
    from particles.vectors import scaled

    class Soft(NamedTuple):
        stiffness: float
        cubic: float

    @kernel
    def soft(constants, touch, history):
        overlap = max(touch.overlap, 0.0)
        push = constants.stiffness * overlap + constants.cubic * overlap**3
        none = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        return Response(push, scaled(0.0, touch.slide), scaled(0.0, touch.roll), (), none)

    law = UserLaw(soft, Soft(1e7, 1e12), stiffness=lambda overlap: (1e7 + 3e12 * overlap**2, 0.0, 0.0))

The kernel sees one contact (`particles.laws.touch.Touch`) and answers with a `Response`: what is remembered goes in and
out as a tuple of numbers. Written without `if` statements around assignments (use `a if condition else b`) the loop over
the pairs becomes vector code.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numba.core.dispatcher import Dispatcher

from particles.laws.touch import numbers_of
from particles.system import FAST


class Law(NamedTuple):
    """The kernel and its constants, as the loops take them."""

    respond: Any
    numbers: Any


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function of (constants, touch, history) for use in `UserLaw`."""
    return njit(function, fastmath=FAST, error_model="numpy", forceinline=True)


class UserLaw:
    """A law made of a compiled function.

    Args:
        respond: function of (constants, touch, history) that returns a `Response`, compiled with `kernel`.
        constants: named tuple of numbers.
        columns: what is remembered: (name, sign) for each number, sign -1 where it changes when the labels of the pair
            are exchanged (components of tangential vectors in space, rotations), 1 where not.
        viscous: whether the kernel reads rates (opening, slide_rate, roll_rate, twist_rate).
        needs_mass: whether it reads the reduced mass.
        stiffness: function of the overlap (m, array) that returns normal, sliding (N/m) and rolling (N m/rad) stiffness, for
            the critical time step.
        stored: function of (overlap, history by name) that returns the elastic energy of contacts (J); without it energies
            lack what this law stores.

    Raises:
        ValueError: something is not of the kind that is wanted.
    """

    def __init__(
        self,
        respond: Any,
        constants: Any,
        columns: Sequence[tuple[str, float]] = (),
        *,
        viscous: bool = False,
        needs_mass: bool = False,
        stiffness: Callable[[np.ndarray], tuple],
        stored: Callable[[np.ndarray, dict[str, np.ndarray]], np.ndarray] | None = None,
    ) -> None:
        if not (isinstance(respond, Dispatcher) or callable(respond)):
            raise ValueError(f"respond={respond!r} must be a function compiled with particles.laws.kernel")
        if not (isinstance(constants, tuple) and hasattr(constants, "_fields")):
            raise ValueError(f"constants={constants!r} must be a named tuple of numbers")
        if not np.isfinite(numbers_of(constants)).all():
            raise ValueError(f"constants={constants!r} must be finite numbers")
        numbers: Any = constants
        self._law = Law(respond, numbers._replace(**{name: float(getattr(numbers, name)) for name in numbers._fields}))
        self._columns, self._viscous, self._massive = list(columns), bool(viscous), bool(needs_mass)
        self._stiffness, self._stored = stiffness, stored

    def without_friction(self) -> UserLaw:
        """Refuse: what is friction in a law of a script is not known here.

        Raises:
            ValueError: always.
        """
        raise ValueError("frictionless walls need a law of their own where the particles have a UserLaw: give `law=`")

    def constants(self, laws: list[UserLaw], space: bool) -> Law:
        """Kernel and constants."""
        if len({id(law._law.respond) for law in laws}) > 1:
            raise ValueError("the laws of an assembly must share one kernel; take constants for what differs")
        return self._law

    def is_viscous(self) -> bool:
        """Whether the kernel reads rates."""
        return self._viscous

    def needs_mass(self) -> bool:
        """Whether the kernel asks for the reduced mass."""
        return self._massive

    def columns(self, laws: list[UserLaw], space: bool) -> list[tuple[str, float]]:
        """What is remembered."""
        return self._columns

    def stiffness(
        self, overlap: np.ndarray, radii: np.ndarray, rolling_radius: np.ndarray, history: dict[str, np.ndarray] | None = None
    ) -> np.ndarray:
        """Tangent stiffness of normal, sliding (N/m), rolling and torsion (N m/rad) of k contacts (k, 4)."""
        one = np.ones_like(overlap)
        return np.column_stack([*(one * part for part in self._stiffness(overlap)), 0.0 * one])

    def damping(
        self, overlap: np.ndarray, radii: np.ndarray, rolling_radius: np.ndarray, mass: np.ndarray,
        history: dict[str, np.ndarray] | None = None,
    ) -> np.ndarray:  # fmt: skip
        """None known: leave room for the kernel's dashpots in the step."""
        return np.zeros((overlap.size, 4))

    def stored(self, overlap: np.ndarray, radii: np.ndarray, history: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Elastic energy of k contacts (k,), J."""
        return {"normal": np.zeros_like(overlap) if self._stored is None else self._stored(overlap, history)}
