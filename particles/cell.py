"""Periodic cells with homogeneous deformation, for representative volumes without walls."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numba import njit, types
from numba.extending import overload

from particles.system import INLINE, INNER, Cell


class PeriodicCell:
    """A box that repeats in some directions, with edges (rows) that may shear: y over x, z over x and y.

    Args:
        size: lengths along the axes (2,) or (3,), m.
        periodic: which axes repeat (default all).

    Raises:
        ValueError: lengths that are not positive, or no periodic axis.
    """

    def __init__(self, size: Sequence[float] | np.ndarray, periodic: Sequence[bool] | None = None) -> None:
        lengths = np.array(size, dtype=float)
        flags = np.ones(lengths.size, dtype=bool) if periodic is None else np.array(periodic, dtype=bool)
        if lengths.shape not in ((2,), (3,)) or not (np.isfinite(lengths) & (lengths > 0.0)).all():
            raise ValueError(f"size={size} must be two or three positive lengths (m)")
        if flags.shape != lengths.shape or not flags.any():
            raise ValueError(f"periodic={periodic} must be one truth value for each axis, at least one of them true")
        self.axes = lengths.size
        self.periodic = flags
        matrix = np.eye(3)
        matrix[range(self.axes), range(self.axes)] = lengths
        repeats = np.zeros(3)
        repeats[: self.axes] = flags
        self.arrays = Cell(matrix, matrix.copy(), np.zeros((3, 3)), np.zeros((3, 3)), repeats, np.zeros((2, 3)))
        self.at_start = self.arrays._replace(matrix=matrix.copy())
        self._whole = np.eye(3)  # the present edges in terms of those of the start, carried along: whole numbers

    @property
    def matrix(self) -> np.ndarray:
        """Edge vectors as columns (axes, axes), m: upper triangular."""
        return self.arrays.matrix[: self.axes, : self.axes].copy()

    @property
    def start(self) -> np.ndarray:
        """Edges (axes, axes) as columns at the start, m."""
        return self.at_start.matrix[: self.axes, : self.axes].copy()

    @property
    def carried(self) -> np.ndarray:
        """The edges of the start as the deformation has carried them along (axes, axes), m; they may lean over any far."""
        found = self.arrays.matrix @ np.linalg.inv(self._whole)
        return found[: self.axes, : self.axes]

    def set_gradient(self, gradient: np.ndarray, centre: np.ndarray) -> None:
        """Deform at a velocity gradient L (axes, axes), 1/s, from now on; the flow changes by the change of L times x.

        The flow's velocity at a place x is L (x - a) + b with an anchor a that starts in the packing's `centre` (axes,), m,
        and goes on at the flow's velocity b there: a field L x about a fixed origin would accelerate the packing as a whole
        by L L x, by more the farther it lies from the origin.
        """
        place, velocity = self.arrays.anchor[:, : self.axes]
        velocity += self.velocity_gradient @ (centre - place) + (gradient - self.velocity_gradient) @ centre
        place[:] = centre
        self.arrays.gradient[: self.axes, : self.axes] = gradient

    def take_off(self, a: int, b: int) -> None:
        """Take as many whole edges a off edge b as bring it nearest to upright: the same lattice."""
        m = self.arrays.matrix
        number = np.round(m[a, b] / m[a, a])
        m[:, b] -= number * m[:, a]
        self._whole[:, b] -= number * self._whole[:, a]

    @property
    def volume(self) -> float:
        """Volume (in the plane area), m3 (m2)."""
        return float(np.linalg.det(self.matrix))

    @property
    def velocity_gradient(self) -> np.ndarray:
        """L (axes, axes), 1/s: edges move by L times themselves; set it by `Assembly.deform`."""
        return self.arrays.gradient[: self.axes, : self.axes].copy()


def checked_gradient(cell: PeriodicCell, gradient: Any) -> np.ndarray:
    """L (axes, axes) that keeps the edges in their form.

    Raises:
        ValueError: it does not, or is not finite.
    """
    found = np.array(gradient, dtype=float)
    if found.shape != (cell.axes, cell.axes) or not np.isfinite(found).all():
        raise ValueError(f"velocity_gradient of shape {found.shape} must be finite numbers ({cell.axes}, {cell.axes}), 1/s")
    if np.any(np.tril(found, -1)):
        raise ValueError("velocity_gradient must be zero below the diagonal: y shears along x, z along x and y (1/s)")
    fixed = ~cell.periodic
    if found[:, fixed].any() or found[fixed].any():
        raise ValueError("velocity_gradient must be zero along axes that are not periodic (1/s)")
    return found


def reduce_tilt(cell: PeriodicCell) -> None:
    """Take whole edges off edges that lean over by more than half of them: the same lattice, with a box that is not flat."""
    for b in range(cell.axes - 1, 0, -1):
        for a in range(b - 1, -1, -1):
            if cell.periodic[a] and cell.periodic[b]:
                cell.take_off(a, b)


@njit(**INNER)
def move_cell(cell, step):
    """Deform the edges by one step."""
    if cell is None:
        return
    for a in range(3):
        for b in range(3):
            cell.rate[a, b] = 0.0
            for c in range(3):
                cell.rate[a, b] += cell.gradient[a, c] * cell.matrix[c, b]
    for a in range(3):
        for b in range(3):
            cell.matrix[a, b] += step * cell.rate[a, b]
    for c in range(3):
        cell.anchor[0, c] += step * cell.anchor[1, c]


def image_numbers(cell):
    """Edges, their rates and one over the lengths of periodic axes as numbers for the pair loop; None without a cell."""
    if cell is None:
        return None
    m, r, p = cell.matrix, cell.rate, cell.repeats
    return (
        (m[0, 0], m[1, 1], m[2, 2], m[0, 1], m[0, 2], m[1, 2]), (r[0, 0], r[1, 1], r[2, 2], r[0, 1], r[0, 2], r[1, 2]),
        (p[0] / m[0, 0], p[1] / m[1, 1], p[2] / m[2, 2]),
    )  # fmt: skip


@overload(image_numbers)
def _image_numbers(cell):
    if isinstance(cell, types.NoneType):
        return lambda cell: None
    return image_numbers


@njit(**INLINE)
def image_in_plane(image, bx, by):
    """Branch to the nearest image, and the velocity of that image against the particle itself."""
    if image is None:
        return bx, by, 0.0, 0.0
    edge, rate, inverse = image
    ky = np.floor(by * inverse[1] + 0.5)
    kx = np.floor((bx - ky * edge[3]) * inverse[0] + 0.5)
    return (
        bx - ky * edge[3] - kx * edge[0], by - ky * edge[1], -ky * rate[3] - kx * rate[0], -ky * rate[1]
    )  # fmt: skip


@njit(**INLINE)
def image_in_space(image, b):
    """The same for spheres."""
    if image is None:
        return b, (0.0, 0.0, 0.0)
    edge, rate, inverse = image
    x, y, z = b
    kz = np.floor(z * inverse[2] + 0.5)
    y -= kz * edge[5]
    x -= kz * edge[4]
    ky = np.floor(y * inverse[1] + 0.5)
    x -= ky * edge[3]
    kx = np.floor(x * inverse[0] + 0.5)
    return (
        (x - kx * edge[0], y - ky * edge[1], z - kz * edge[2]),
        (-kx * rate[0] - ky * rate[3] - kz * rate[4], -ky * rate[1] - kz * rate[5], -kz * rate[2]),
    )


def nearest_image(cell: PeriodicCell | None, branch: np.ndarray) -> np.ndarray:
    """Branches (k, axes) to the nearest images."""
    return branch if cell is None else branch + image_of(cell.matrix, cell.periodic, branch) @ cell.matrix.T


def image_of(edges: np.ndarray, periodic: np.ndarray, branch: np.ndarray) -> np.ndarray:
    """Whole edges (columns of `edges`) to be added to branches (k, axes) for the nearest images (k, axes)."""
    left, numbers = branch.copy(), np.zeros_like(branch)
    for a in np.flatnonzero(periodic)[::-1]:
        numbers[:, a] = -np.floor(left[:, a] / edges[a, a] + 0.5)
        left += numbers[:, a, None] * edges[:, a]
    return numbers
