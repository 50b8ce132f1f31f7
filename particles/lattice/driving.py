"""What acts on a lattice from outside: loads and prescribed motion over time, absorbing faces."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from particles.lattice.state import Drive

if TYPE_CHECKING:
    from particles.lattice.lattice import Lattice

Where = Any  # a region, a function of points, a mask or row numbers
History = float | Callable[[float], float]


def rows_of(where: Where, reference: np.ndarray) -> np.ndarray:
    """Row numbers from a region (`contains`), a function of points (n, axes) giving bools, a mask (n,) or numbers.

    Raises:
        ValueError: it names no row, or has the wrong shape.
    """
    if hasattr(where, "contains"):
        found = np.asarray(where.contains(reference))
    elif callable(where):
        found = np.asarray(where(reference))
    else:
        found = np.asarray(where)
    if found.dtype == bool:
        if found.shape != (len(reference),):
            raise ValueError(f"where of shape {found.shape} must give one bool for each of {len(reference)} points")
        found = np.flatnonzero(found)
    if len(found) == 0:
        raise ValueError("where names no particle; it must contain at least one centre")
    return found.astype(np.int32)


class Driving:
    """Loads, prescribed velocities and dashpots of points (n, axes), gathered for the compiled loops."""

    def __init__(self, reference: np.ndarray) -> None:
        self._reference = reference
        self._drive: Any = None
        self._loads: list[tuple[np.ndarray, np.ndarray]] = []
        self._load_histories: list[History] = []
        self._holder: np.ndarray = np.full((3, 0), -1, dtype=np.int32)  # which history holds a component of a row, -1 for none
        self._held_histories: list[History] = []
        self._dashpots: list[tuple[np.ndarray, np.ndarray]] = []

    def load(self, where: Where, force: Any, history: History = 1.0) -> None:
        """Put a force (3,) or (rows, 3), N, times a history on each row."""
        rows = rows_of(where, self._reference)
        self._loads.append((rows, np.broadcast_to(_three(force), (len(rows), 3))))
        self._load_histories.append(history)

    def hold(self, where: Where, directions: str, velocity: History = 0.0) -> None:
        """Move components ("x", "yz", ...) of rows with a velocity (m/s); a later call wins."""
        rows = rows_of(where, self._reference)
        if not directions or set(directions) - set("xyz"):
            raise ValueError(f'directions="{directions}" must name some of "xyz"')
        if not self._held_histories:
            self._holder = np.full((3, len(self._reference)), -1, dtype=np.int32)
        for axis in map("xyz".index, directions):
            self._holder[axis, rows] = len(self._held_histories)
        self._held_histories.append(velocity)

    def absorb(self, where: Where, coefficients: Any) -> None:
        """Dashpots (3,) or (rows, 3) in N s/m on rows."""
        rows = rows_of(where, self._reference)
        self._dashpots.append((rows, np.broadcast_to(_three(coefficients), (len(rows), 3))))

    def arrange(self, free: np.ndarray) -> None:
        """Gather what acts on rows that are free (n,) bool; the histories are sampled for each run of steps."""
        loads, dashpots = (
            [(rows[free[rows]], values[free[rows]]) for rows, values in parts] for parts in (self._loads, self._dashpots)
        )
        absorbing, coefficients = _joined(dashpots)
        held = [np.empty(0, dtype=np.int32)] * 3
        if self._held_histories:
            rows = np.flatnonzero(free).astype(np.int32)
            held = [rows[holder[rows] >= 0] for holder in self._holder]
            coefficients[self.is_held(absorbing).T] = 0.0
        none = np.empty((0, 0))
        self._drive = Drive(
            *_joined(loads), _groups([rows for rows, _ in loads]), none,
            np.concatenate(held), _groups(held).astype(np.int32),
            np.concatenate([holder[rows] for holder, rows in zip(self._holder, held)]), none, absorbing, coefficients,
        )  # fmt: skip

    def is_held(self, rows: np.ndarray) -> np.ndarray:
        """Which components (3, rows) of rows are held."""
        if not self._held_histories:
            return np.zeros((3, len(rows)), dtype=bool)
        return self._holder[:, rows] >= 0

    def drive(self, time: float, step: float, steps: int) -> Drive:
        """Histories at the evaluations after `time`: one a step, the first a step later."""
        at = time + step * np.arange(1, steps + 1)
        return self._drive._replace(
            load_factor=_sampled(self._load_histories, at), held_velocity=_sampled(self._held_histories, at + 0.5 * step)
        )

    def loads(self) -> list[tuple[np.ndarray, np.ndarray, History]]:
        """Rows, forces (rows, 3) and history of each load."""
        return [(rows, force, history) for (rows, force), history in zip(self._loads, self._load_histories)]

    def dashpots(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Rows and coefficients (rows, 3) of the dashpots."""
        return self._dashpots


def _three(vector: Any) -> np.ndarray:
    """Vectors with three components; those in the plane get a zero."""
    vector = np.asarray(vector, dtype=float)
    if vector.shape[-1:] not in ((2,), (3,)) or not np.all(np.isfinite(vector)):
        raise ValueError(f"vector={vector} must have two or three finite components")
    return vector if vector.shape[-1] == 3 else np.concatenate((vector, np.zeros((*vector.shape[:-1], 1))), axis=-1)


def _rows(parts: list[np.ndarray]) -> np.ndarray:
    return np.concatenate([*parts, np.empty(0, dtype=np.int32)]).astype(np.int32)


def _joined(parts: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    return _rows([rows for rows, _ in parts]), np.concatenate([*(values for _, values in parts), np.empty((0, 3))])


def _groups(parts: list[np.ndarray]) -> np.ndarray:
    return np.repeat(np.arange(len(parts)), [len(rows) for rows in parts]).astype(np.int32)


def _sampled(histories: list[History], at: np.ndarray) -> np.ndarray:
    """Histories (steps, groups); at least one column."""
    table = np.zeros((len(at), max(1, len(histories))))
    for k, history in enumerate(histories):
        table[:, k] = [history(float(t)) for t in at] if callable(history) else history
    if not np.isfinite(table).all():
        raise ValueError(f"history must be finite; it is not between {at[0]:g} s and {at[-1]:g} s")
    return table


def face_area(lattice: Lattice) -> float:
    """Area (m2; in the plane m2 per metre) of a particle in a face across an axis, along a row in the hexagonal lattice."""
    return lattice.spacing**2 if lattice.axes == 3 else lattice.spacing


def lysmer(material: Any, area: float, normal: int) -> np.ndarray:
    """Viscous boundary (Lysmer & Kuhlemeyer 1969): rho c_p A along the normal axis, rho c_s A across, (3,) in N s/m."""
    nu = material.poisson_ratio
    shear_speed = math.sqrt(material.young_modulus / (2.0 * (1.0 + nu)) / material.density)
    coefficients = np.full(3, material.density * shear_speed * area)
    coefficients[normal] = material.density * material.wave_speed * area
    return coefficients
