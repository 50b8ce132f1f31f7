"""The same script gives the same bits in every process on one machine."""

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent.parent


def digest():
    """Hash of a packing, and of all that a run over many list rebuilds and sorts of rows leaves behind."""
    from particles import random_dense
    from particles.walls import Plate
    from tests.particles.scenes import cloud

    positions, radii = random_dense(((0.0, 0.0), (1.0, 1.0)), seed=1, porosity=0.185)
    soil = cloud(60)
    soil.add_wall(Plate.rectangle((-1.0, -0.3), (2.0, -0.15)))
    generation = soil.generation
    soil.advance(6000, 1e-5, gravity=(0.0, -9.81), mass_damping=1.0)
    assert soil.rebuilds > 5 and soil.generation > generation
    found = hashlib.sha256()
    for values in (positions, radii, soil.positions, soil.velocities, soil.forces, *soil.contacts().history.values()):
        found.update(np.ascontiguousarray(values).tobytes())
    for name, energy in sorted(soil.energies().items()):
        found.update(f"{name}={energy!r}".encode())
    return found.hexdigest()


def test_two_processes_give_the_same_bits():
    """One of them with another seed of Python's hashes, so that no order of a set or mapping is behind the result."""
    command = [sys.executable, "-c", "from tests.particles.test_reproducible import digest; print(digest())"]
    found = []
    for seed in ("0", "1"):
        environment = {**os.environ, "PYTHONHASHSEED": seed}
        made = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=True)
        found.append(made.stdout.strip())
    assert found[0] == found[1] and len(found[0]) == 64
