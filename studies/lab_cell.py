"""A periodic cell whose normal stresses are held by a servo on its velocity gradient."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from particles.driving import unbalanced

RESPONSE = 5.0  # response time of the servo, in intervals between two looks at the stress
INTEGRAL = 5.0  # time of its integral part, in response times
SETTLED = 10  # looks within the tolerance before a state counts as reached


class ServoCell:
    """Advances an assembly in a periodic cell: some entries of the velocity gradient are imposed, some stresses held.

    A held axis a gets the rate L_aa = e / (M T) + integral of e / (M T 5 T), e = target - sigma_aa (Pa, tension
    positive), so that a cell of modulus M is back at its stress after the response time T; the integral takes away the
    error that a steady rate leaves. Because the field of L is given to the particles too, the stress follows at once, and
    no wave has to cross the cell.

    Args:
        soil: Assembly with a periodic cell.
        step: time step, s.
        modulus: M, Pa, of the cell; an upper bound is safe and slower.
        interval: steps between two looks at the stress.
    """

    def __init__(self, soil: Any, step: float, modulus: float, interval: int = 20) -> None:
        self.soil, self.step, self.interval = soil, step, interval
        self.stress = soil.cell_stress()  # at the last look, Pa, tension positive
        self._softness = 1.0 / (modulus * RESPONSE * interval * step)  # rate for an error in stress, 1/(Pa s)
        self._imposed = np.zeros((soil.axes, soil.axes))
        self._targets: dict[int, float] = {}
        self._trend = np.zeros(soil.axes)  # integral part, 1/s
        self._wait = 0

    def state(self) -> dict[str, Any]:
        """All that `restored` needs."""
        axes, targets = (np.array(list(some)) for some in (self._targets, self._targets.values()))
        return {
            "step": self.step, "interval": self.interval, "stress": self.stress, "softness": self._softness, "imposed": self._imposed,
            "trend": self._trend, "wait": self._wait, "axes": axes, "targets": targets,
        }  # fmt: skip

    @classmethod
    def restored(cls, soil: Any, state: dict[str, Any]) -> ServoCell:
        """The servo of a state, on an assembly that is in its state again."""
        servo = cls(soil, float(state["step"]), 1.0, int(state["interval"]))
        servo.stress, servo._imposed = np.array(state["stress"]), np.array(state["imposed"])
        servo._softness, servo._wait, servo._trend = float(state["softness"]), int(state["wait"]), np.array(state["trend"])
        servo._targets = dict(zip(state["axes"].tolist(), state["targets"].tolist()))
        return servo

    def impose(self, gradient: Any, pressures: Mapping[int, float]) -> None:
        """From now on: velocity gradient (axes, axes), 1/s, and pressures (Pa, compression positive) held by axis."""
        self._imposed = np.array(gradient, dtype=float)
        self._targets = {axis: -float(pressure) for axis, pressure in pressures.items()}
        self._wait = 0

    def advance(self, steps: int) -> None:
        """Make steps; the servo looks at the stress every `interval` of them."""
        while steps > 0:
            if self._wait == 0:
                self._correct()
                self._wait = self.interval
            some = min(steps, self._wait)
            self.soil.advance(some, self.step)
            steps -= some
            self._wait -= some

    def _correct(self) -> None:
        self.stress = self.soil.cell_stress()
        gradient = self._imposed.copy()
        for axis, target in self._targets.items():
            fastest = self._softness * abs(target)
            rate = self._softness * (target - self.stress[axis, axis])
            self._trend[axis] = np.clip(self._trend[axis] + rate / (INTEGRAL * RESPONSE), -fastest, fastest)
            gradient[axis, axis] = np.clip(self._trend[axis] + rate, -fastest, fastest)
        self.soil.deform(gradient)

    def compress(self, pressure: float, tolerance: float, most: int = 500_000) -> bool:
        """Isotropic compression until all normal stresses stay at the pressure (Pa); False if that takes too long.

        Args:
            tolerance: of the stresses, as a share, and of the mean unbalanced over the mean contact force.
            most: steps.
        """
        axes = self.soil.axes
        self.impose(np.zeros((axes, axes)), dict.fromkeys(range(axes), pressure))
        good = 0
        for _ in range(0, most, self.interval):
            self.advance(self.interval)
            near = np.abs(np.diag(self.soil.cell_stress()) / pressure + 1.0).max() < tolerance
            good = good + 1 if near and unbalanced(self.soil).mean < tolerance else 0
            if good == SETTLED:
                return True
        return False

    def rest(self) -> None:
        """Stop the cell: no rates, no trend."""
        self._trend[:] = 0.0
        self.impose(np.zeros_like(self._imposed), {})
        self.soil.deform(self._imposed)
