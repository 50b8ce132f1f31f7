"""Small scenes that several tests of the particles share."""

from dataclasses import replace

import numpy as np

from particles import Assembly, LiChu, PeriodicCell
from particles.laws import Bonded

PAPER = LiChu(
    normal_stiffness=2.5e8, sliding_stiffness=5e7, rolling_stiffness=1e6, moment_stiffness=7e2,
    normal_damping=0.4, sliding_damping=0.4, rolling_damping=0.4, moment_damping=0.01,
    sliding_friction=0.5, rolling_friction=0.05, moment_friction=0.5e-3,
)  # fmt: skip
# the same with dashpots and limits that matter
ALL = LiChu(
    normal_stiffness=2.5e8, sliding_stiffness=5e7, rolling_stiffness=1e6, moment_stiffness=7e2,
    normal_damping=4e3, sliding_damping=2e3, rolling_damping=1e3, moment_damping=1.0,
    sliding_friction=0.5, rolling_friction=0.05, moment_friction=0.5e-3,
)  # fmt: skip
WEAK = 1e-12  # a dashpot that takes no energy, N s/m
BONDED = Bonded(1e7, 5e6, 1e9, 1e9, friction=0.5, normal_damping=500.0, shear_damping=300.0)
BEAM = replace(BONDED, bending_stiffness=3e3, torsion_stiffness=2e3, bending_strength=1e9, torsion_strength=1e9)


def square_lattice(columns, lines, radius=0.05):
    """Centres of a square lattice of touching discs."""
    x, y = np.meshgrid(2 * radius * np.arange(columns), 2 * radius * np.arange(lines))
    return np.column_stack([x.ravel(), y.ravel()])


def hexagonal_lattice(columns, lines, radius=0.05):
    """Centres of a hexagonal lattice of touching discs."""
    line, column = np.divmod(np.arange(columns * lines), columns)
    return radius * np.column_stack([2 * column + line % 2, np.sqrt(3) * line])


def cloud(count=60, seed=3, law=ALL, **options):
    """Unequal discs, nearly touching, that rush together and spin: all channels stick and slip, contacts open and close."""
    rng = np.random.default_rng(seed)
    side = int(np.ceil(np.sqrt(count)))
    positions = hexagonal_lattice(side, side, 0.046)[:count] + rng.uniform(-4e-4, 4e-4, (count, 2))
    soil = Assembly(positions, rng.uniform(0.044, 0.0465, count), law=law, **options)
    inwards = -10.0 * (positions - positions.mean(axis=0))
    soil.velocities = np.column_stack([inwards, np.zeros(count)]) + rng.normal(size=(count, 3)) * [0.4, 0.4, 10.0]
    return soil


def packed(shift=(0.0, 0.0), seed=1):
    """64 unequal discs that fill a cell without walls, shaken."""
    rng = np.random.default_rng(seed)
    places = hexagonal_lattice(8, 8, 0.0499) + rng.uniform(-2e-4, 2e-4, (64, 2))
    size = 16 * 0.0499, 8 * np.sqrt(3) * 0.0499
    soil = Assembly(places + shift, rng.uniform(0.0492, 0.0505, 64), law=ALL, cell=PeriodicCell(size))
    soil.velocities = rng.normal(size=(64, 3)) * [0.2, 0.2, 5.0]
    return soil


def stacked():
    """125 unequal spheres in a cell, shaken."""
    rng = np.random.default_rng(2)
    grid = np.stack(np.meshgrid(*[np.arange(5)] * 3, indexing="ij"), axis=-1).reshape(-1, 3) * 0.0998
    soil = Assembly(grid, rng.uniform(0.0492, 0.0505, 125), law=ALL, cell=PeriodicCell([5 * 0.0998] * 3))
    soil.velocities = rng.normal(size=(125, 6)) * [0.2, 0.2, 0.2, 5.0, 5.0, 5.0]
    return soil


def trial(soil, increment):
    """Forces (n, freedoms) in id order after a step by `increment` that ends at rest (dashpots without effect)."""
    rows = soil.rows
    by_row = np.empty_like(increment)
    by_row[rows] = increment
    return soil.trial_forces(by_row, np.zeros_like(increment))[rows]
