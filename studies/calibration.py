"""From macroscopic to micro parameters of bonded discs: dimensionless relations, their inverse, refinement by runs.

Rojek & Onate (2007), eqs 57-59: E = k_n Phi_E, nu = Phi_nu, sigma_c = R_n / r Phi_c, and likewise sigma_t = R_n / r Phi_t, with
functions of k_t / k_n and R_t / R_n for one kind of packing; r is the root mean square radius. Their third group, k_n r / R_n,
is that of small strains and is left out; what this neglects the refinement makes good.

Responses are written y = (ln E, nu, ln sigma_c, ln sigma_t) and unknowns x = (ln k_n, ln k_t/k_n, ln R_n, ln R_t/R_n), the last
of each only where a tensile strength is wanted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.optimize import approx_fprime, least_squares

SHIFT = 1e-6  # of an unknown for derivatives of the interpolated relations
SMALLEST_CHANGE = 2e-3  # of the unknowns (logarithms), below which the refinement ends
SCATTER = np.array([0.01, 0.005, 0.06, 0.06])  # of responses from packing to packing, about: weights of their misfits
MISSED = 0.05  # of a response, beyond which a target counts as out of reach: strengths scatter by as much

Measure = Callable[["Micro"], np.ndarray]  # responses y (packings, 3 or 4) of runs


class Micro(NamedTuple):
    """Micro parameters."""

    normal_stiffness: float  # N/m
    stiffness_ratio: float  # k_t / k_n
    bond_strength: float  # R_n, N
    strength_ratio: float  # R_t / R_n


@dataclass(frozen=True)
class Relations:
    """Dimensionless responses (ln Phi_E, Phi_nu, ln Phi_c, ln Phi_t) over a grid of ratios; between them by monotone cubics.

    Args:
        stiffness_ratios: (k,) k_t / k_n, ascending, two or more.
        strength_ratios: (m,) R_t / R_n, ascending.
        values: (k, m, packings, 3 or 4).
        radius: root mean square radius, m.
    """

    stiffness_ratios: Sequence[float]
    strength_ratios: Sequence[float]
    values: np.ndarray
    radius: float

    def __call__(self, stiffness_ratio: float, strength_ratio: float) -> np.ndarray:
        """Dimensionless responses (3 or 4,), means over the packings; ratios outside the grid count as its edge."""
        ratios, strengths = np.log(self.stiffness_ratios), np.log(self.strength_ratios)
        place = np.clip(math.log(stiffness_ratio), ratios[0], ratios[-1])
        rows = PchipInterpolator(ratios, self.values.mean(axis=2), axis=0)(place)
        if len(strengths) == 1:
            return rows[0]
        return PchipInterpolator(strengths, rows, axis=0)(np.clip(math.log(strength_ratio), strengths[0], strengths[-1]))

    def responses(self, x: np.ndarray) -> np.ndarray:
        """Responses y of unknowns x."""
        micro = self.micro(x)
        y = self(micro.stiffness_ratio, micro.strength_ratio).copy()
        y[0] += x[0]
        y[2:] += x[2] - math.log(self.radius)
        return y

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """Derivatives dy / dx."""
        low, high = self.bounds()
        inside = np.clip(x, low + 2.0 * SHIFT, high - 2.0 * SHIFT)
        return np.atleast_2d(approx_fprime(inside, self.responses, SHIFT))

    def micro(self, x: np.ndarray) -> Micro:
        """Unknowns as micro parameters."""
        normal, ratio, tensile = map(float, np.exp(x[:3]))
        return Micro(normal, ratio, tensile, float(np.exp(x[3])) if len(x) > 3 else float(self.strength_ratios[0]))

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Smallest and largest unknowns: those of the grid, others without limits."""
        low, high = np.full(4, -np.inf), np.full(4, np.inf)
        low[1], high[1] = np.log([self.stiffness_ratios[0], self.stiffness_ratios[-1]])
        low[3], high[3] = np.log([self.strength_ratios[0], self.strength_ratios[-1]])
        count = self.values.shape[-1]
        return low[:count], high[:count]

    def check_poisson_ratio(self, wanted: float) -> None:
        """Raises ValueError for a Poisson ratio that the grid does not reach; two stiffness ratios are enough, as it falls with them."""
        reached = self.values[..., 1].mean(axis=(1, 2))
        low, high = reached.min(), reached.max()
        span = f"{self.stiffness_ratios[0]:g} to {self.stiffness_ratios[-1]:g}"
        if not low <= wanted <= high:
            raise ValueError(
                f"poisson_ratio={wanted:g} must be between {low:.3f} and {high:.3f}, which stiffness ratios from {span} give; "
                "extend --stiffness-ratios"
            )

    def inverse(self, target: np.ndarray) -> np.ndarray:
        """Unknowns x whose responses are the target y.

        Raises:
            ValueError: a Poisson ratio or ratio of strengths that the grid does not reach.
        """
        self.check_poisson_ratio(target[1])
        bounds = self.bounds()
        middle = np.log(math.sqrt(self.stiffness_ratios[0] * self.stiffness_ratios[-1]))
        start = np.array([target[0], middle, target[2] + math.log(self.radius), 0.0])[: len(target)]
        if len(start) > 3:
            start[3] = 0.5 * (bounds[0][3] + bounds[1][3])
        weight = 1.0 / SCATTER[: len(target)]
        found = least_squares(
            lambda x: weight * (self.responses(x) - target), start, bounds=bounds, xtol=1e-12, ftol=1e-12, gtol=1e-12
        )
        if np.abs(found.fun / weight).max() > MISSED:
            reached = math.exp(self.responses(found.x)[-1]) * 1e-6
            raise ValueError(
                f"tensile_strength={math.exp(target[-1]):g} cannot be reached beside that compressive strength: strength ratios from "
                f"{self.strength_ratios[0]:g} to {self.strength_ratios[-1]:g} come as near as {reached:.1f} MPa; extend "
                "--strength-ratios, or leave the tensile strength out"
            )
        return found.x


class Calibrated(NamedTuple):
    """Micro parameters that give the target, as means over the packings."""

    micro: Micro
    x: np.ndarray  # as unknowns
    measured: np.ndarray  # responses y (packings, 3 or 4) of the last runs
    errors: np.ndarray  # standard errors of the unknowns from the scatter over packings (NaN with one)
    rounds: int  # of runs


def refine(relations: Relations, target: np.ndarray, start: np.ndarray, measure: Measure, rounds: int) -> Calibrated:
    """Correct unknowns until runs have the target responses on the average over packings.

    Least squares with the derivatives of the relations, so that a round of runs is one evaluation; misfits count by the scatter
    that such responses have, so that moduli are met and strengths that exclude each other share what is left.

    Args:
        start: unknowns, from `Relations.inverse`.
        measure: the runs.
        rounds: most evaluations.
    """
    seen: list[tuple[float, np.ndarray, np.ndarray]] = []
    weight = 1.0 / SCATTER[: len(target)]

    def misfit(x: np.ndarray) -> np.ndarray:
        measured = measure(relations.micro(x))
        off = weight * (measured.mean(axis=0) - target)
        seen.append((float(off @ off), x.copy(), measured))
        return off

    low, high = relations.bounds()
    least_squares(
        misfit, np.clip(start, low + SHIFT, high - SHIFT), jac=lambda x: weight[:, None] * relations.jacobian(x), bounds=(low, high),
        max_nfev=rounds, xtol=SMALLEST_CHANGE, ftol=1e-4, gtol=1e-3, method="trf",
    )  # fmt: skip
    _, x, measured = min(seen, key=lambda one: one[0])
    return Calibrated(relations.micro(x), x, measured, standard_errors(relations.jacobian(x), measured), len(seen))


def standard_errors(jacobian: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """Standard errors of unknowns: the scatter of the responses over packings, carried through the relations."""
    count = len(measured)
    if count < 2:
        return np.full(jacobian.shape[1], np.nan)
    back = np.linalg.pinv(jacobian)
    return np.sqrt(np.diag(back @ np.atleast_2d(np.cov(measured.T)) @ back.T) / count)
