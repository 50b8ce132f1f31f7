"""Compiled code on disk must not outlive the sources that it was made of."""

from __future__ import annotations

import contextlib
from pathlib import Path

import numba


def drop_stale(folder: Path, *others: Path) -> None:
    """Remove Numba's cache indexes of a folder that are older than any source in it or in the folders `others`.

    Numba looks only at the file that a function stands in, not at the files of the functions that it calls: after a change
    of the contact law it would go on using loops with the old one. To be called before functions of `folder` are used.
    """
    sources = [path for place in (folder, *others) for path in place.rglob("*.py")]
    newest = max(path.stat().st_mtime_ns for path in sources)
    places = [folder.rglob("__pycache__/*.nbi")]
    if numba.config.CACHE_DIR:  # there, each folder of sources has one that begins with its name
        names = {path.parent.name for path in folder.rglob("*.py")}
        places += [Path(numba.config.CACHE_DIR).glob(f"{name}_*/*.nbi") for name in names]
    for place in places:
        for index in place:
            # another process may be faster, or the folder belong to someone else
            with contextlib.suppress(OSError):
                if index.stat().st_mtime_ns < newest:
                    index.unlink()
