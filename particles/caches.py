"""Compiled code on disk must not outlive the sources that it was made of."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from pathlib import Path

import numba
from numba.core.caching import NullCache
from numba.core.dispatcher import Dispatcher


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


@contextlib.contextmanager
def without_cache() -> Iterator[None]:
    """Compile without the disk: for loops with a function of a driver script in them.

    Such a function has no name that means the same in the next process: what would be written could not be found again,
    and the files would grow with every run.
    """
    found = {
        id(value): value
        for name, module in list(sys.modules.items())
        if name.partition(".")[0] in ("particles", "bridge")
        for value in list(vars(module).values())
        if isinstance(value, Dispatcher)
    }
    kept = {key: dispatcher._cache for key, dispatcher in found.items()}
    try:
        for dispatcher in found.values():
            dispatcher._cache = NullCache()
        yield
    finally:
        for key, dispatcher in found.items():
            dispatcher._cache = kept[key]
