"""Lattice sites, their order, and who is next to whom."""

from __future__ import annotations

from itertools import product

import numpy as np

from particles.lattice.lanes import WIDTH

# Pairs of opposite directions, in steps of the lattice: axes and face diagonals of the cubic lattice
CUBIC = ((1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, -1, 0), (1, 0, 1), (1, 0, -1), (0, 1, 1), (0, 1, -1))
# steps (along a row, up a row): the second axis of the hexagonal lattice points 60 degrees up
HEXAGONAL = ((1, 0, 0), (0, 1, 0), (-1, 1, 0))
TOLERANCE = 1e-6  # of the spacing: how far from its place a site may lie


def directions(axes: int) -> np.ndarray:
    """Steps (18 or 6, 3) to the neighbours; row 2 p + 1 is the opposite of row 2 p."""
    half = np.array(CUBIC if axes == 3 else HEXAGONAL)
    return np.stack((half, -half), axis=1).reshape(-1, 3)


def vectors(axes: int, spacing: float) -> np.ndarray:
    """Reference bond vectors (18 or 6, 3) in m."""
    return spacing * (directions(axes) @ basis(axes).T)


def whole_cluster(spacing: float) -> np.ndarray:
    """Inverse moments (xx, yy, zz, yz, xz, xy in 1/m2) and mean arm of a row of the cubic lattice with all neighbours, (9, 8)."""
    arms = vectors(3, spacing)
    moments = np.linalg.inv(arms.T @ arms)
    found = np.concatenate((np.diag(moments), (moments[1, 2], moments[0, 2], moments[0, 1]), arms.mean(axis=0)))
    return np.repeat(found[:, None], WIDTH, axis=1)


def basis(axes: int) -> np.ndarray:
    """Steps of the lattice as columns (3, 3), in spacings."""
    return np.eye(3) if axes == 3 else np.array([(1.0, 0.5, 0.0), (0.0, 0.5 * np.sqrt(3.0), 0.0), (0.0, 0.0, 1.0)])


def places(sites: np.ndarray, spacing: float) -> np.ndarray:
    """Whole-number coordinates (n, 3) of sites (n, 2 or 3), the smallest zero.

    Raises:
        ValueError: a site lies beside the lattice through the first one, or two share a place.
    """
    axes = sites.shape[1]
    inverse = np.linalg.inv(basis(axes))
    offset = np.zeros((len(sites), 3))
    offset[:, :axes] = (sites - sites[0]) / spacing
    steps = offset @ inverse.T
    whole = np.rint(steps)
    beside = np.abs(steps - whole).max(axis=1) > TOLERANCE
    if beside.any():
        kind = "cubic" if axes == 3 else "hexagonal"
        raise ValueError(
            f"site {sites[np.argmax(beside)]} lies beside the {kind} lattice of spacing={spacing:g} m through {sites[0]}: "
            f"take sites of meshes.packings.{'simple_cubic' if axes == 3 else 'hexagonal'} with half the spacing as radius"
        )
    found = (whole - whole.min(axis=0)).astype(np.int64)
    if len(np.unique(found, axis=0)) < len(found):
        raise ValueError("two sites have the same place; each site must be given once")
    return found


def slow_first(found: np.ndarray) -> tuple[int, int, int]:
    """Axes of places (n, 3) from slow to fast: the longest one is fastest, the shortest one next, so that neighbours lie near in memory."""
    short, middle, long = np.argsort(np.ptp(found, axis=0), kind="stable")
    return int(middle), int(short), int(long)


def order(found: np.ndarray, later: np.ndarray) -> np.ndarray:
    """Order of sites: those that are not `later` (n,) bool come first, as what elements leave to particles shall lie together."""
    slow, next_one, fast = slow_first(found)
    return np.lexsort((found[:, fast], found[:, next_one], found[:, slow], later))


def neighbours(found: np.ndarray, steps: np.ndarray, periodic: tuple[bool, ...]) -> np.ndarray:
    """Row (n, steps) int32 of the neighbour in each direction, -1 where there is none.

    Args:
        found: places (n, 3).
        steps: (k, 3).
        periodic: axes along which the lattice repeats.

    Raises:
        ValueError: the sites do not repeat.
    """
    shape = found.max(axis=0) + 1
    wide = shape + 2  # a margin instead of a look whether a neighbour is outside
    stride = np.array((wide[1] * wide[2], wide[2], 1))
    keys = (found + 1) @ stride
    rows = np.argsort(keys, kind="stable").astype(np.int32)
    keys = keys[rows]
    images = _images(found, len(steps), periodic)
    table = np.empty((len(found), len(steps)), dtype=np.int32)
    for k, step in enumerate(steps):
        table[:, k] = _rows_at(found + step, keys, rows, stride, wide)
        for image in images:
            missing = np.flatnonzero(table[:, k] < 0)
            table[missing, k] = _rows_at(found[missing] + step + image, keys, rows, stride, wide)
    return table


def renumbered(table: np.ndarray, order: np.ndarray) -> np.ndarray:
    """A table of neighbours (n, steps) for rows in another order (n,)."""
    row = np.empty(len(order) + 1, dtype=np.int32)
    row[order], row[-1] = np.arange(len(order)), -1
    return row[table[order]]


def _rows_at(places: np.ndarray, keys: np.ndarray, rows: np.ndarray, stride: np.ndarray, wide: np.ndarray) -> np.ndarray:
    """Rows (k,) of places (k, 3), -1 where there is no site; `keys` are those of `rows`, ascending."""
    wanted = (places + 1) @ stride
    where = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    return np.where((keys[where] == wanted) & np.all((places >= -1) & (places + 1 < wide), axis=1), rows[where], -1)


def _images(found: np.ndarray, ways: int, periodic: tuple[bool, ...]) -> np.ndarray:
    """Translations (k, 3) by which a lattice repeats, at most once along each axis.

    Rows of the hexagonal lattice repeat after their sites; upwards a sheet may be a parallelogram along the axes of the lattice, or
    upright with an even number of rows.
    """
    shape = found.max(axis=0) + 1
    shifts = np.diag(shape)
    if ways == len(HEXAGONAL) * 2 and any(periodic):
        first, last = np.full(shape[1], shape[0]), np.zeros(shape[1], dtype=np.int64)
        np.minimum.at(first, found[:, 1], found[:, 0])
        np.maximum.at(last, found[:, 1], found[:, 0])
        shifts[0, 0] = (last - first).max() + 1
        if periodic[1] and first.max() > first.min():
            if shape[1] % 2:
                raise ValueError(f'periodic="y" needs an even number of rows of the hexagonal lattice, not {shape[1]}')
            shifts[1, 0] = -(shape[1] // 2)
    chosen = [range(-1, 2) if axis else (0,) for axis in periodic]
    combined = np.array(list(product(*chosen)))
    return combined[np.any(combined != 0, axis=1)] @ shifts


def follows(table: np.ndarray) -> np.ndarray:
    """Which rows (n,) have as neighbours the rows after the neighbours of the row before; uint8."""
    result = np.zeros(len(table), dtype=np.uint8)
    result[1:] = np.all(table[1:] == table[:-1] + 1, axis=1)
    return result
