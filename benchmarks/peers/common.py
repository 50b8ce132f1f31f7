"""What all peers share: a scene, what a run returns, and the packing in the format that LAMMPS and LIGGGHTS read.

Where a peer knows spheres only, discs are spheres with densities that give the discs' masses. All values SI; in the plane per metre of
thickness.
"""

import os
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from particles import LiChu

# One thread; and Open MPI, where a peer starts it: root, more ranks than cores, shared memory only.
ENVIRONMENT = {
    "OMP_NUM_THREADS": "1", "OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_rmaps_base_oversubscribe": "1", "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
    "OMPI_MCA_btl": "^tcp",
}  # fmt: skip

# Without what MPI leaves behind in a process that uses it, or in one started by such a process: mpirun would take itself for its part.
_LEFT = ("OMPI_COMM", "OMPI_APP", "OMPI_MCA_orte", "OMPI_MCA_ess", "OMPI_MCA_pmix", "PMIX", "PMI_")
PLAIN = {name: value for name, value in os.environ.items() if not name.startswith(_LEFT)}

PATIENCE = 900.0  # s, longest run of a peer


class Bond(NamedTuple):
    """Unbreakable elastic bond between two spheres, without stress at the start."""

    normal: float  # N/m
    shear: float  # N/m
    bending: float  # N m/rad
    torsion: float  # N m/rad


@dataclass(frozen=True)
class Scene:
    """A packing, its law and a number of steps, for ours and for every peer."""

    positions: np.ndarray  # (n, 2) or (n, 3), m
    radii: np.ndarray  # (n,), m
    velocities: np.ndarray  # (n, 3): x, y, spin, or (n, 6): x, y, z, spins about them; m/s and rad/s
    law: LiChu
    step: float  # s
    steps: int
    density: float = 2600.0  # of the solid, kg/m3
    skin: float = 0.005  # reach of neighbour lists beyond contact, m
    held: np.ndarray | None = None  # (n,) bool: keep their velocity
    box: tuple[Any, Any] | None = None  # lower and upper corner of four smooth planes (in the plane only), m
    bonds: np.ndarray | None = None  # (b, 2) numbers of the bonded
    bond: Bond | None = None

    @property
    def axes(self) -> int:
        """2 or 3."""
        return self.positions.shape[1]

    @property
    def masses(self) -> np.ndarray:
        """Masses (n,), kg."""
        volumes = np.pi * self.radii**2 if self.axes == 2 else 4.0 / 3.0 * np.pi * self.radii**3
        return self.density * volumes

    @property
    def free(self) -> np.ndarray:
        """Which move freely (n,)."""
        return np.ones(len(self.radii), dtype=bool) if self.held is None else ~self.held

    def in_space(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Positions (n, 3), velocities (n, 3) and spins (n, 3)."""
        if self.axes == 3:
            return self.positions, self.velocities[:, :3], self.velocities[:, 3:]
        zero = np.zeros(len(self.radii))
        return (
            np.column_stack([self.positions, zero]),
            np.column_stack([self.velocities[:, :2], zero]),
            np.column_stack([zero, zero, self.velocities[:, 2]]),
        )


class Outcome(NamedTuple):
    """What a run returns: the program's own loop time (s) and the state after the last step, arrays as in `Scene`."""

    seconds: float
    positions: np.ndarray
    velocities: np.ndarray


class Peer(NamedTuple):
    """A program and a model of it."""

    name: str
    missing: Callable[[], str]  # why it cannot run here, in a word; empty when it can
    like: Callable[[LiChu], LiChu]  # our law with no more than the peer's model has
    run: Callable[[Scene], Outcome]


class Failed(RuntimeError):
    """A peer ended without a result."""


def outcome(scene: Scene, seconds: float, table: np.ndarray) -> Outcome:
    """Outcome of a table (n, 9) of positions, velocities and spins in space."""
    if scene.axes == 3:
        return Outcome(seconds, table[:, :3], table[:, 3:])
    return Outcome(seconds, table[:, :2], table[:, [3, 4, 8]])


def arrays(scene: Scene) -> dict[str, Any]:
    """Everything of a scene by name, for programs that are driven by a Python script; planes as (axis, sense, place)."""
    places, velocities, spins = scene.in_space()
    law, flat = scene.law, scene.axes == 2
    bounds = []
    if scene.box is not None:
        for sense, corner in zip((1, -1), scene.box):
            bounds += [(axis, sense, place) for axis, place in enumerate(corner)]
    return {
        "places": places, "velocities": velocities, "spins": spins, "radii": scene.radii, "masses": scene.masses,
        "inertias": (0.5 if flat else 0.4) * scene.masses * scene.radii**2, "free": scene.free, "flat": flat,
        "law": (law.normal_stiffness, law.sliding_stiffness, law.sliding_friction), "bounds": np.reshape(bounds, (-1, 3)),
        "pairs": np.zeros((0, 2), dtype=int) if scene.bonds is None else scene.bonds,
        "bond": () if scene.bond is None else scene.bond, "skin": scene.skin, "step": scene.step, "steps": scene.steps,
    }  # fmt: skip


def launch(command: list[str], folder: Path | str, **environment: str) -> str:
    """Output of a program.

    Raises:
        Failed: with the end of what it printed.
    """
    try:
        run = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, timeout=PATIENCE,
            env={**PLAIN, **ENVIRONMENT, **environment},
        )  # fmt: skip
    except subprocess.TimeoutExpired as late:
        raise Failed(f"{command[0]}: no result in {PATIENCE:g} s") from late
    if run.returncode:
        raise Failed(f"{command[0]}: {run.stdout[-800:]}{run.stderr[-800:]}")
    return run.stdout


def numbering(scene: Scene) -> np.ndarray:
    """Numbers (n,) from 1 for the peers, those that move freely first."""
    order = np.argsort(~scene.free, kind="stable")
    numbers = np.empty_like(order)
    numbers[order] = 1 + np.arange(len(order))
    return numbers


def write_atoms(scene: Scene, path: Path, margin: float, molecule: bool = False, discs: bool = False) -> None:
    """Data file of LAMMPS and LIGGGHTS for spheres; with a column of molecules, and then the bonds, for bonded ones.

    Args:
        margin: of the simulation box beyond the outermost centres, m.
        discs: the program takes densities for those of discs in the plane.
    """
    places, velocities, spins = scene.in_space()
    numbers = numbering(scene)
    densities = scene.masses / (np.pi * scene.radii**2 if discs else 4.0 / 3.0 * np.pi * scene.radii**3)
    low, high = places.min(axis=0) - margin, places.max(axis=0) + margin
    lines = ["packing", "", f"{len(numbers)} atoms", "1 atom types"]
    if scene.bonds is not None:
        per_atom = np.bincount(scene.bonds.ravel()).max()
        lines += [f"{len(scene.bonds)} bonds", "1 bond types", f"{per_atom} extra bond per atom"]
    lines += ["", *(f"{a:.17g} {b:.17g} {c}lo {c}hi" for a, b, c in zip(low, high, "xyz")), "", "Atoms", ""]
    between = "1 1" if molecule else "1"
    lines += [
        f"{k} {between} {2 * r:.17g} {d:.17g} {x:.17g} {y:.17g} {z:.17g}"
        for k, r, d, (x, y, z) in zip(numbers, scene.radii, densities, places)
    ]
    lines += ["", "Velocities", ""]
    lines += [
        f"{k} {' '.join(f'{v:.17g}' for v in row)}" for k, row in zip(numbers, np.column_stack([velocities, spins]))
    ]
    if scene.bonds is not None:
        lines += ["", "Bonds", ""]
        lines += [f"{k} 1 {a} {b}" for k, (a, b) in enumerate(numbers[scene.bonds], start=1)]
    path.write_text("\n".join(lines) + "\n")


def read_dump(scene: Scene, path: Path) -> np.ndarray:
    """Table (n, 9) of positions, velocities and spins from a dump with the columns id, x, ..., omegaz."""
    table = np.loadtxt(path, skiprows=9, ndmin=2)
    table = table[np.argsort(table[:, 0])]
    return table[numbering(scene) - 1, 1:]
