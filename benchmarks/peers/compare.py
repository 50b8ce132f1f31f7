"""Our loops against other discrete element programs: the same packing, law, step and number of steps, taken in turns.

Each peer gets the law that its model has, and ours the same one. Speeds are ratios of loop times, medians over pairs of
runs one after the other, on one core. Agreement is the root mean square of the differences between both final states, as
a share of that of our displacements and velocities. A peer that is not installed is left out with a word. Prints a table,
writes JSON.

    python3 -m benchmarks.peers.compare [--quick] [--scene NAME ...] [--output peers.json]
"""

import argparse
import json
import statistics
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from benchmarks import scenes
from benchmarks.peers import esys, lammps, liggghts, ours, yade
from benchmarks.peers.common import Bond, Failed, Peer, Scene
from particles import Assembly, LiChu

PEERS = (lammps.HOOKE, lammps.GRANULAR, liggghts.PEER, yade.PEER, esys.PEER)
BONDED = (lammps.BONDED, yade.BONDED, esys.BONDED)
SPHERES = LiChu(
    normal_stiffness=1e7, sliding_stiffness=4e6, rolling_stiffness=4e6, normal_damping=30.0, sliding_damping=10.0,
    rolling_damping=10.0, sliding_friction=0.5, rolling_friction=0.05,
)  # fmt: skip
SHAKEN = 0.05  # m/s, standard deviation of the initial velocities


def dense_discs(steps: int) -> Scene:
    """About 10,000 discs of 0.02 to 0.05 m, compressed between four smooth planes and shaken."""
    positions, radii, upper = scenes.packing()
    velocities = SHAKEN * np.random.default_rng(0).normal(size=(len(radii), 3)) * [1.0, 1.0, 0.0]
    soil = Assembly(positions, radii, law=scenes.ALL)
    return Scene(
        positions, radii, velocities, scenes.ALL, 0.1 * soil.critical_step(), steps, skin=soil.skin, box=((0.0, 0.0), upper)
    )  # fmt: skip


def dense_spheres(steps: int) -> Scene:
    """About 20,000 spheres of 0.02 to 0.03 m, compressed inside a fixed shell of them and shaken."""
    positions, edge = face_centred_cubic(17, 0.053)
    radii = np.random.default_rng(1).uniform(0.02, 0.03, len(positions))
    for share, relaxation in ((1.0, 1200), (0.997, 600)):  # squeezed until they touch all around, then let out
        radii = radii * share
        soil = Assembly(positions, radii, law=LiChu(normal_stiffness=1e7))
        soil.hold(edge)
        soil.advance(relaxation, 0.5 * soil.critical_step(), local_damping=0.5)
        positions = soil.positions
    velocities = SHAKEN * np.random.default_rng(0).normal(size=(len(radii), 6)) * [1, 1, 1, 0, 0, 0]
    velocities[edge] = 0.0
    step = 0.1 * Assembly(soil.positions, radii, law=SPHERES).critical_step()
    return Scene(soil.positions, radii, velocities, SPHERES, step, steps, skin=soil.skin, held=edge)


def bonded_spheres(steps: int) -> Scene:
    """About 20,000 equal spheres of 0.025 m on a lattice, every contact a bond, shaken."""
    positions, _ = face_centred_cubic(17, 0.05)
    radii = np.full(len(positions), 0.025)
    velocities = SHAKEN * np.random.default_rng(0).normal(size=(len(radii), 6)) * [1, 1, 1, 0, 0, 0]
    bonds = cKDTree(positions).query_pairs(0.051, output_type="ndarray")
    bond = Bond(1e7, 4e6, 2e3, 1e3)
    step = 0.05 * np.sqrt(2600.0 * 4.0 / 3.0 * np.pi * 0.025**3 / bond.normal)
    return Scene(positions, radii, velocities, SPHERES, step, steps, bonds=bonds, bond=bond)


def face_centred_cubic(cells: int, distance: float) -> tuple[np.ndarray, np.ndarray]:
    """Lattice points (4 cells^3, 3) with this distance of neighbours (m), and which are outermost."""
    side = np.sqrt(2.0) * distance
    corners = np.stack(np.meshgrid(*[np.arange(cells)] * 3, indexing="ij"), axis=-1).reshape(-1, 1, 3)
    points = side * (corners + 0.5 * np.array([[0, 0, 0], [1, 1, 0], [1, 0, 1], [0, 1, 1]])).reshape(-1, 3)
    reach = 0.6 * side
    return points, ((points < reach) | (points > points.max() - reach)).any(axis=1)


SCENES = {
    "dense discs": (dense_discs, PEERS),
    "dense spheres": (dense_spheres, PEERS),
    "bonded spheres": (bonded_spheres, BONDED),
}


def race(scene: Scene, peer: Peer, repeats: int) -> dict[str, object]:
    """Million particle-steps per second of both, ratio of times and agreement; or the word why not."""
    if peer.missing():
        return {"skipped": peer.missing()}
    scene = replace(scene, law=peer.like(scene.law))
    work = len(scene.radii) * scene.steps / 1e6
    found: dict[str, object] = {}
    own, theirs = [], []
    for _ in range(repeats):
        mine = ours.run(scene)
        own.append(mine.seconds)
        try:
            other = peer.run(scene)
        except Failed as reason:
            return {"skipped": "failed", "reason": str(reason)}
        theirs.append(other.seconds)
    found["peer"] = work / statistics.median(theirs)
    found["ours"] = work / statistics.median(own)
    found["ratio"] = statistics.median(b / a for a, b in zip(own, theirs))
    travel = mine.positions - scene.positions
    found["positions"] = float(np.linalg.norm(other.positions - mine.positions) / np.linalg.norm(travel))
    found["velocities"] = float(np.linalg.norm(other.velocities - mine.velocities) / np.linalg.norm(mine.velocities))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("out/benchmarks/peers.json"))
    parser.add_argument("--scene", choices=SCENES, nargs="+", default=list(SCENES))
    parser.add_argument("--quick", action="store_true", help="one pair of runs, fewer steps")
    options = parser.parse_args()
    report: dict[str, object] = {}
    for name in options.scene:
        build, peers = SCENES[name]
        scene = build(100 if options.quick else 400)
        print(f"\n{name}: {len(scene.radii)} particles, {scene.steps} steps; million particle-steps/s, differences of states")
        print(f"{'':28s}{'peer':>8s}{'ours':>8s}{'ratio':>8s}{'positions':>12s}{'velocities':>12s}")
        report[name] = results = {}
        for peer in peers:
            results[peer.name] = found = race(scene, peer, 1 if options.quick else 5)
            if "skipped" in found:
                line = f"  {found['skipped']}"
            else:
                line = (
                    f"{found['peer']:8.2f}{found['ours']:8.2f}{found['ratio']:8.2f}{found['positions']:12.1e}"
                    f"{found['velocities']:12.1e}"
                )
            print(f"{peer.name:28s}{line}", flush=True)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    options.output.write_text(json.dumps(report, indent=1) + "\n")


if __name__ == "__main__":
    main()
