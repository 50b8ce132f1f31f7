"""What a run leaves behind: summary.json, history.csv and ParaView series; rank 0 writes."""

from __future__ import annotations

import csv
import json
import math
import os
import platform
import re
import tempfile
from collections.abc import Iterable, Mapping
from importlib import metadata
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from mpi4py import MPI

from bridge.run import on_root


def check_folder(path: str | os.PathLike, comm: Any = MPI.COMM_WORLD) -> Path:
    """See whether an output folder can be made and written to, without making it (collective).

    Raises:
        ValueError: on every rank, where it cannot, or the name is empty.
    """

    def look() -> Path:
        if not str(path).strip():
            raise ValueError("output= is empty; it must name a folder")
        folder = Path(path)
        try:
            there = next(place for place in (folder, *folder.absolute().parents) if place.exists())
        except (OSError, ValueError) as failure:  # a name too long, or with a zero byte
            raise ValueError(f"output={folder} cannot be written to ({failure})") from None
        if not there.is_dir():
            raise ValueError(f"output={folder} cannot be written to ({there} is no folder)")
        if not os.access(there, os.W_OK | os.X_OK):
            raise ValueError(f"output={folder} cannot be written to (no permission to write to {there})")
        return folder

    return on_root(comm, look)


def prepare_folder(path: str | os.PathLike, comm: Any = MPI.COMM_WORLD) -> Path:
    """Make the output folder and see that files can be written there (collective).

    Raises:
        ValueError: on every rank, where that fails.
    """
    folder = check_folder(path, comm)

    def make() -> Path:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError as failure:
            raise ValueError(f"output={folder} cannot be written to ({failure.strerror})") from None
        return folder

    return on_root(comm, make)


def clear(folder: Path, names: Iterable[str], series: Iterable[str] = ()) -> None:
    """Remove what an earlier run left in a folder, so that no old file passes for a new one; nothing else is touched.

    Args:
        folder: Of the run.
        names: Of its files.
        series: Names of its `Series` in the folder `fields`.
    """
    old = [folder / name for name in names]
    for name in series:
        old.append(folder / "fields" / f"{name}.pvd")
        numbered = re.compile(re.escape(name) + r"_\d{3,}\.vtu")
        old += [file for file in folder.glob(f"fields/{name}_*.vtu") if numbered.fullmatch(file.name)]
    for file in old:
        if file.is_file():
            file.unlink()


def write_text(path: Path, text: str) -> None:
    """Write a file in one go: others see the old content or all of the new."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    temporary.write_text(text, encoding="utf-8")
    os.replace(temporary, path)


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write JSON in one go; NaN and infinity become null, arrays lists."""
    write_text(path, json.dumps(_plain(content), indent=1, allow_nan=False) + "\n")


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if value is None or isinstance(value, (bool, int, float)) else str(value)


def versions() -> dict[str, str]:
    """Versions of what computes."""
    found = {"python": platform.python_version()}
    for name, module in (("grainbridge", None), ("numpy", "numpy"), ("numba", "numba"), ("dolfinx", "dolfinx")):
        try:
            found[name] = __import__(module).__version__ if module else metadata.version(name)
        except (ImportError, metadata.PackageNotFoundError):
            found[name] = "unknown"
    return found


class HistoryFile:
    """A CSV file, one row a sample, complete after each row."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("w", newline="", encoding="utf-8")
        self._writer: csv.DictWriter | None = None

    def write(self, row: Mapping[str, float | str]) -> None:
        """Append a row of numbers and words; the first one names the columns."""
        if self._writer is None:
            self._writer = csv.DictWriter(self._file, fieldnames=list(row))
            self._writer.writeheader()
        self._writer.writerow({name: value if isinstance(value, str) else format(value, ".9g") for name, value in row.items()})
        self._file.flush()

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class Series:
    """A ParaView series: one .vtu file a time and a .pvd file that lists them (complete after each `write`).

    Args:
        folder: Where the files go.
        name: Of the series.
    """

    def __init__(self, folder: Path, name: str) -> None:
        self._folder, self._name = folder, name
        folder.mkdir(parents=True, exist_ok=True)
        self._root = ElementTree.Element("VTKFile", type="Collection", version="0.1")
        self._collection = ElementTree.SubElement(self._root, "Collection")

    def write(
        self,
        time: float,
        points: np.ndarray,
        cells: tuple[str, np.ndarray],
        point_data: Mapping[str, np.ndarray] | None = None,
        cell_data: Mapping[str, np.ndarray] | None = None,
    ) -> None:
        """Write one time.

        Args:
            time: s.
            points: (n, 2) or (n, 3), m.
            cells: meshio's name of the cell type ("vertex", "line", "triangle", "quad", "hexahedron") and node numbers (cells, nodes).
            point_data: arrays (n,) or (n, 2); the latter become vectors.
            cell_data: arrays (cells,).
        """
        import meshio

        mesh = meshio.Mesh(
            _three(points), [cells], point_data={name: _three(values) for name, values in (point_data or {}).items()},
            cell_data={name: [_three(values)] for name, values in (cell_data or {}).items()},
        )  # fmt: skip
        meshio.write(self._folder / self._next_file, mesh, file_format="vtu", binary=True)
        self.enter(time)
        ElementTree.indent(self._root)
        text = ElementTree.tostring(self._root, encoding="unicode", xml_declaration=True)
        write_text(self._folder / f"{self._name}.pvd", text + "\n")


    @property
    def _next_file(self) -> str:
        return f"{self._name}_{len(self._collection):04d}.vtu"

    def enter(self, time: float) -> None:
        """List the next file at a time (s): one that an earlier part of the run has written."""
        file = self._next_file
        ElementTree.SubElement(self._collection, "DataSet", timestep=f"{time:.9g}", part="0", file=file)


def _three(values: np.ndarray) -> np.ndarray:
    """Vectors (n, 2) with a third component of zero; other arrays as they are."""
    values = np.asarray(values)
    if values.ndim == 2 and values.shape[1] == 2:
        return np.column_stack([values, np.zeros(len(values))])
    return np.ascontiguousarray(values)
