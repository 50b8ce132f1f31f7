"""Random packings kept on disk: they take longer to make than the run that uses them."""

from __future__ import annotations

import hashlib
import inspect
import os
import warnings
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

JAMMED = {2: 0.16, 3: 0.36}  # porosity at which random discs and spheres jam without friction, about


def cache_folder() -> Path:
    """Folder of the kept packings, under the user's cache directory ($XDG_CACHE_HOME or ~/.cache)."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(base) if os.path.isabs(base) else Path.home() / ".cache") / "grainbridge" / "packings"


def random_dense(
    bounds: Any, radii: tuple[float, float], porosity: float, seed: int, **options: Any
) -> tuple[np.ndarray, np.ndarray]:
    """`particles.packing.random_dense` in a box, made once for each set of arguments and version of the generator.

    Args:
        options: further arguments of it.

    Returns:
        Positions (n, 2) and radii (n,), m.
    """
    from particles import outline, packing, relaxation

    recipe = repr((bounds, radii, porosity, seed, *sorted(options.items()))) + "".join(map(inspect.getsource, (outline, packing, relaxation)))
    file = cache_folder() / f"{hashlib.sha256(recipe.encode()).hexdigest()[:24]}.npz"
    try:
        with np.load(file) as kept:
            return kept["positions"], kept["radii"]
    except (OSError, ValueError, KeyError, zipfile.BadZipFile):
        pass  # not there, or cut off: make it
    made = packing.random_dense(bounds, radii, porosity, seed, **options)
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        temporary = file.with_name(f"{file.stem}.{os.getpid()}.npz")
        np.savez(temporary, positions=made[0], radii=made[1])
        os.replace(temporary, file)
    except OSError as failure:
        warnings.warn(f"the packing could not be kept in {file.parent} ({failure.strerror})", stacklevel=2)
    return made


def jammed(
    bounds: Any, radii: tuple[float, float], seed: int, periodic: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Packing that just touches, as dense as uniformly distributed radii jam without friction; its porosity is found.

    Returns:
        Positions (n, axes) and radii (n,), m.
    """
    return random_dense(bounds, radii, JAMMED[len(bounds[0])], seed, exponent=0.0, periodic=periodic, nearest=True)
