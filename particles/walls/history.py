"""Histories of walls: force, place and work every so many steps of a run, written down by the compiled loop."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit

from particles.system import INNER, Records, System
from particles.walls.rows import ACTION, OWNER, PLACE, WORK

if TYPE_CHECKING:
    from particles.walls.wall import Wall

ROW = 14  # time; reaction (6); displacement of the centre and rotation (6); work


class WallHistory(NamedTuple):
    """What a wall went through, a row a record; d = 2 or 3, rotational quantities have one component in the plane."""

    time: np.ndarray  # (k,) s
    force: np.ndarray  # (k, d) of the particles on the wall, N
    moment: np.ndarray  # (k,) or (k, 3) of these forces about the wall's present centre, N m
    position: np.ndarray  # (k, d) of the centre, m
    rotation: np.ndarray  # (k,) or (k, 3) sum of the steps' rotations, rad
    work: np.ndarray  # (k,) done on the particles by the wall's motion since the start, J

    def columns(self) -> dict[str, np.ndarray]:
        """The same as columns of numbers (k,) by name: time, force_x, ..., moment, x, ..., rotation, work."""
        axes = "xyz"[: self.force.shape[1]]
        found: dict[str, np.ndarray] = {"time": self.time}
        found |= {f"force_{axis}": self.force[:, k] for k, axis in enumerate(axes)}
        found |= self._rotational("moment", self.moment)
        found |= {axis: self.position[:, k] for k, axis in enumerate(axes)}
        return found | self._rotational("rotation", self.rotation) | {"work": self.work}

    @staticmethod
    def _rotational(name: str, values: np.ndarray) -> dict[str, np.ndarray]:
        return {name: values} if values.ndim == 1 else {f"{name}_{axis}": values[:, k] for k, axis in enumerate("xyz")}


def history_of(rows: list[np.ndarray], reference: np.ndarray) -> WallHistory:
    """History from logged rows (k, ROW) of a wall whose centre started at `reference` (d,)."""
    axes = reference.size
    log = np.concatenate([np.zeros((0, ROW)), *rows])
    turning = (lambda at: log[:, at + 5]) if axes == 2 else (lambda at: log[:, at + 3 : at + 6])
    return WallHistory(log[:, 0], log[:, 1 : 1 + axes], turning(1), reference + log[:, 7 : 7 + axes], turning(7), log[:, 13])


def recording(walls: list[Wall], system: System, steps: int) -> System:
    """The same system with room for what is recorded in the coming steps; as it is where no wall is recorded."""
    chosen = np.array([k for k, wall in enumerate(walls) if wall.record], dtype=np.int64)
    if not chosen.size:
        return system
    every = np.array([walls[k].record for k in chosen], dtype=np.int64)
    left = np.array([walls[k].until_record for k in chosen], dtype=np.int64)
    room = int(((steps + every - left) // every).max())
    return system._replace(records=Records(chosen, every, left, np.zeros((chosen.size, room, ROW)), np.zeros_like(chosen)))


def recorded(walls: list[Wall], system: System) -> System:
    """The same system without that room; the rows go to the walls."""
    records = system.records
    if records is None:
        return system
    for r, k in enumerate(records.wall):
        walls[k].keep_records(records.log[r, : records.count[r]].copy(), int(records.left[r]))
    return system._replace(records=None)


@njit(**INNER)
def record_walls(records, walls, time):
    """Write down the walls whose turn it is, after an evaluation at `time`."""
    if records is None:
        return
    for r in range(records.wall.size):
        records.left[r] -= 1
        if records.left[r] > 0:
            continue
        records.left[r] = records.every[r]
        row = records.log[r, records.count[r]]
        records.count[r] += 1
        k = records.wall[r]
        b = int(walls.wall[k, OWNER])
        row[0], row[13] = time, walls.wall[k, WORK]
        for c in range(6):
            row[1 + c], row[7 + c] = walls.wall[k, ACTION + c], walls.body[b, PLACE + c]
