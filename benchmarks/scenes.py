"""Scenes that the benchmarks of the particles share: a dense random packing, slightly compressed and shaken."""

import numpy as np

from particles import Assembly, LiChu, Plate
from particles.packing import random_dense

BLOCK = 6.0, 6.17  # m, holds about 10,000 discs of 0.02 to 0.05 m
SQUEEZE = 1.0005  # radii grow by this, so that all contacts of the packing carry load

ALL = LiChu(
    normal_stiffness=2.5e8, sliding_stiffness=5e7, rolling_stiffness=1e6, moment_stiffness=7e2,
    normal_damping=400.0, sliding_damping=400.0, rolling_damping=400.0, moment_damping=0.01,
    sliding_friction=0.5, rolling_friction=0.05, moment_friction=0.5e-3,
)  # fmt: skip


def packing(blocks=1, seed=1):
    """Positions, radii and upper corner of `blocks` x `blocks` equal packings side by side."""
    positions, radii = random_dense(((0.0, 0.0), BLOCK), seed=seed)
    shifts = np.array([(i, j) for j in range(blocks) for i in range(blocks)]) * BLOCK
    places = (positions[None] + shifts[:, None]).reshape(-1, 2)
    return places, np.tile(radii, blocks**2) * SQUEEZE, blocks * np.array(BLOCK)


def assembly(positions, radii, upper, law=ALL, walls=True):
    """Assembly with random velocities (0.05 m/s), kept together by smooth plates or by holding the outermost discs."""
    soil = Assembly(positions, radii, law=law)
    velocities = 0.05 * np.random.default_rng(0).normal(size=(soil.count, 3)) * [1.0, 1.0, 0.0]
    if walls:
        soil.add_wall(*Plate.box((0.0, 0.0), tuple(upper), 1.0, frictionless=True))
    else:
        edge = ((positions - radii[:, None] < 1e-3) | (positions + radii[:, None] > upper - 1e-3)).any(axis=1)
        velocities[edge] = 0.0
        soil.hold(edge, "xyr")
    soil.velocities = velocities
    return soil
