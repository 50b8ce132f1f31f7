"""Packings as text, a line `x y r` (or `x y z r`) for each particle, comments after #; histories of walls as CSV."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from particles.walls.history import WallHistory


def write_packing(file: str | os.PathLike, positions: Any, radii: Any, comment: str = "", unit: str = "m") -> None:
    """Write a packing; `read_packing` gives the same bits back.

    Args:
        file: path of the text file.
        positions: (n, 2) or (n, 3).
        radii: (n,).
        comment: lines for the head of the file.
        unit: of all lengths, for the head of the file.

    Raises:
        ValueError: arrays that are not a packing.
    """
    positions, radii = np.asarray(positions, dtype=float), np.asarray(radii, dtype=float)
    if positions.ndim != 2 or positions.shape[1] not in (2, 3):
        raise ValueError(f"positions of shape {positions.shape} must have the shape (n, 2) or (n, 3)")
    if radii.shape != positions.shape[:1]:
        raise ValueError(f"radii of shape {radii.shape} must have the shape ({len(positions)},), one for each position")
    if not np.isfinite(positions).all() or not (np.isfinite(radii) & (radii > 0.0)).all():
        raise ValueError("positions must be finite and radii positive")
    names = " ".join("xyz"[: positions.shape[1]]) + " r"
    head = [*comment.splitlines(), f"{len(radii)} particles: {names} ({unit})"]
    rows = (" ".join(map(repr, row)) for row in np.column_stack((positions, radii)).tolist())
    Path(file).write_text("".join(f"# {line}\n" for line in head) + "".join(f"{row}\n" for row in rows))


def write_history(file: str | os.PathLike, history: WallHistory) -> None:
    """Write the history of a wall as CSV, a column a component with its name on top; numbers keep all their bits."""
    columns = history.columns()
    rows = np.column_stack(list(columns.values())).tolist()
    Path(file).write_text("".join(f"{','.join(line)}\n" for line in [list(columns), *(map(repr, row) for row in rows)]))


def read_packing(file: str | os.PathLike) -> tuple[np.ndarray, np.ndarray]:
    """Read a packing, in the file's unit; columns may be separated by spaces, tabs, commas or semicolons.

    Returns:
        Positions (n, 2) or (n, 3) and radii (n,).

    Raises:
        ValueError: a file that cannot be read, with the line and the rule.
    """
    try:
        lines = Path(file).read_text().splitlines()
    except (OSError, UnicodeDecodeError) as failure:
        reason = failure.strerror if isinstance(failure, OSError) else "it is not text"
        raise ValueError(
            f"{file} could not be read ({reason}); it must be a text file with lines x y r or x y z r"
        ) from None
    rows: list[list[float]] = []
    for number, line in enumerate(lines, start=1):
        words = line.split("#")[0].replace(",", " ").replace(";", " ").split()
        if not words:
            continue
        try:
            row = [float(word) for word in words]
        except ValueError:
            raise ValueError(
                f"{file}, line {number}: {line.strip()!r} must be numbers; comments begin with #"
            ) from None
        if len(row) not in (3, 4) or (rows and len(row) != len(rows[0])):
            wanted = f"{len(rows[0])} columns like the lines before" if rows else "3 columns (x y r) or 4 (x y z r)"
            raise ValueError(f"{file}, line {number}: {len(row)} columns must be {wanted}")
        if not np.isfinite(row).all():
            raise ValueError(f"{file}, line {number}: {line.strip()!r} must be finite numbers")
        if not row[-1] > 0.0:
            raise ValueError(f"{file}, line {number}: radius {row[-1]:g} must be positive; it is the last column")
        rows.append(row)
    if not rows:
        raise ValueError(f"{file} must have at least one line x y r or x y z r")
    table = np.array(rows)
    return np.ascontiguousarray(table[:, :-1]), table[:, -1].copy()
