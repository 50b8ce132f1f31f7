"""The lattice as the compiled loops see it: named tuples of arrays, flags of bonds and rows, places of the energy sums."""

from __future__ import annotations

from typing import Any, NamedTuple

# Bits of `State.bonds`: in the clusters of the least squares, with a force of its own, broken (compression only)
JOINED, EXPLICIT, BROKEN = 1, 2, 4
# Values of `State.strain_kind` and `State.force_kind`: REGULAR are rows of the hexagonal lattice alone
NONE, REGULAR, SPECIAL = 0, 1, 2
# First bits of `State.mask`, each followed by those of further directions: of bonds in the clusters; with a force, intact and broken
JOINED_BIT, INTACT_BIT, BROKEN_BIT = 0, 18, 36
# Lists of rows: entries of `State.counts`
STRAIN_RUNS, STRAIN_BLOCKS, STRAIN_SPECIAL, FORCE_RUNS, FORCE_BLOCKS, FORCE_SPECIAL, MOVING_RUNS, AWAKE = range(8)
# A limit of bonds that do not break, m
UNLIMITED = 1e100
# Entries of `State.sums` (J), the last a number of bonds
EXTERNAL, HELD, ABSORBED, DAMPING, BREAKING, EXCESS, BROKEN_BONDS = range(7)
SUMS = 7


class State(NamedTuple):
    """Rows are sorted by `geometry.order`; `near` and `bonds` have a column for each direction of the lattice."""

    displacement: Any  # (3, n), m
    velocity: Any  # (3, n), m/s; of the middle of the step while it runs
    force: Any  # (3, n) total of the last evaluation, N
    lightness: Any  # (n,) 1 / mass, 1/kg
    strain: Any  # (6, n) xx, yy, zz, yz, xz, xy
    moment: Any  # None (pairwise) or (6, n): shear energy's derivative by the strain, J
    rotation: Any  # None (small rotations) or (9, n): rotation of the neighbourhood, by rows
    acting: Any  # (3, n) to book excess work, else (3, 0): forces of the bonds at the last evaluation, N
    stored: Any  # (1,) their energy, J
    near: Any  # (n, directions) int32, -1 where there is no neighbour
    bonds: Any  # (n, directions) uint8
    mask: Any  # (n,) int64: the same as bits
    follows: Any  # (n,) uint8: neighbours are the rows after those of the row before
    material: Any  # (n,) uint8
    alike: Any  # (n,) uint8: class of stiffness (see `particles.lattice.groups`)
    group: Any  # (n,) uint16: of rows of one class with the same smallest limits around them
    strain_kind: Any  # (n,) uint8: how its strain is found
    force_kind: Any  # (n,) uint8: how the force of its bonds is found
    moving: Any  # (n,) uint8: 1 where the row moves by its force, 0 where its motion is given or it sleeps
    cluster: Any  # (9, n): inverse moments (xx, yy, zz, yz, xz, xy) in 1/m2 and mean arm
    stretch_of: Any  # (n,) int32: stretch that a row is in, -1 for none (see `particles.lattice.blocks`)
    stretch: Any  # (stretches, 2) int32: first row, and the one after the last
    onward: Any  # (stretches, directions) int32: how many rows on the neighbours lie
    stray: Any  # (n,) int32: a bit for each neighbour that lies elsewhere than those of the stretch
    strays: Any  # (k,) int64: rows that have any
    springs: Any  # (stretches, 2, directions): stiffnesses of their bonds (see `particles.lattice.blocks.springs`)
    strain_runs: Any  # (n, 2) int32: first row and number of rows
    strain_blocks: Any  # (room, 2) int64: first row and stretch
    strain_special: Any  # (n,) int64: special rows in no block
    force_runs: Any  # (n, 2) int32
    force_blocks: Any  # (room, 2) int64
    force_special: Any  # (n,) int64
    moving_runs: Any  # (n, 2) int32
    awake: Any  # (n, 2) int64: first row and the one after the last, of all that have strains or forces
    reached: Any  # (room,) uint8: a bit for each row of a force block whose bonds had come to their limits at the last evaluation
    counts: Any  # (8,) int64: how many of them there are
    sums: Any  # (SUMS,)


class Terms(NamedTuple):
    """Constants of a lattice; None is pruned when the loops are compiled."""

    spacing: float
    vectors: Any  # (directions, 3) reference bond vectors, m
    units: Any  # (directions, 3) their directions
    normal: Any  # (materials,) N/m
    shear: Any  # (materials,) N/m
    limits: Any  # None or (materials, 2): normal and shear deformation at which bonds break, m
    smallest: Any  # None or (groups, 2): the smallest of them of a row of the group and its neighbours, m
    whole: Any  # (9, 8) `State.cluster` of eight rows of the cubic lattice that all neighbours are joined to
    plane: Any  # None (18 neighbours) or 1 (hexagonal)
    damping: Any  # None or alpha, against each component of velocity


class Drive(NamedTuple):
    """What acts on rows from outside during some steps."""

    loaded: Any  # (loads,) int32 row
    load: Any  # (loads, 3) N
    load_group: Any  # (loads,) int32 column of `load_factor`
    load_factor: Any  # (steps, groups) at the time of each evaluation
    held: Any  # (held,) int32 row
    held_axis: Any  # (held,) int32
    held_group: Any  # (held,) int32 column of `held_velocity`
    held_velocity: Any  # (steps, groups) m/s, half a step after each evaluation
    absorbing: Any  # (dashpots,) int32 row
    dashpot: Any  # (dashpots, 3) N s/m
