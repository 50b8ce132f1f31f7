"""The particle system as the kernels see it: named tuples of arrays, and the places of the energy sums.

Rows are sorted by position (see `particles.neighbours`); `Assembly.rows` maps ids to rows. Motion is held in rows of four
numbers, which the pair loop reads as one (see `particles.columns`). In the plane the three generalised coordinates of a
disc, x, y and angle, share a row; in space rotations have rows of their own.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import llvmlite.binding as llvm

# Functions of the pair loop are compiled one by one before they are put together. Vector instructions for neighbouring
# numbers ("SLP") within one of them would keep the loop as a whole from becoming vector code: no gain is large enough.
llvm.set_option("", "-slp-threshold=1000000")

# LLVM may contract, use reciprocals and assume finite numbers; checks for blow-up live in functions without it.
FAST = {"contract", "arcp", "nsz", "nnan", "ninf"}
STEADY = {"contract", "arcp", "nsz"}  # the same where numbers may be infinite
OUTER = {"cache": True, "no_cfunc_wrapper": True, "_nrt": True}  # called from Python
# Functions that make no arrays need not count references to those they are given: each array of a system that is handed on
# costs 5 ns otherwise, more than all else in a step of a few particles.
STEPS = {**OUTER, "_nrt": False}
INNER = {**STEPS, "no_cpython_wrapper": True}  # called from compiled code only: half as long to compile
KERNEL = {**INNER, "fastmath": FAST, "error_model": "numpy"}
INLINE = {**KERNEL, "forceinline": True}  # so that the loop over pairs can be turned into vector instructions
MERGED = {**INNER, "forceinline": True}  # parts of a step that take the whole system, which is some 350 numbers
MERGED_STEPS = {**STEPS, "forceinline": True}

RADIUS = 3  # column of `System.position`
MASS = 3  # column of `System.lightness`

# Arrays of rows of four
ROWS = (
    "position", "velocity", "acceleration", "force", "lightness", "rotation", "spin", "angular", "torque", "nimbleness",
)  # fmt: skip

# Entries of `System.sums` (J, power in W)
(
    FRICTION_SLIDING,
    FRICTION_ROLLING,
    FRICTION_MOMENT,
    POWER,
    LOSS,
    BREAKING,
    VISCOUS,
    MASS_DAMPING,
    LOCAL_DAMPING,
    GRAVITY,
    EXTERNAL,
    WALLS,
    HELD,
    CELL,
    CELL_POWER,
) = range(15)
SPENT = 6  # the first entries are what a contact law books: friction by channel, dashpot power, opened, broken contacts
SUMS = 15

# Entries of `System.clock`
TIME, TRAVEL, TRAVEL_LIMIT, SMALLEST_RADIUS, AGE, SKIN_SCALE, LEAST_SKIN = range(7)


class Walls(NamedTuple):
    """Facets of all walls, the particles listed near them, and the motion of the rigid bodies that carry them.

    Columns of `body`, `wall` and `near` are named in `particles.walls.rows`. Corners of a facet are those of its wall in the
    reference position; in the plane z is zero.
    """

    vertices: Any  # (vertices, 3)
    corners: Any  # (facets, 4) int32: vertices (-1 for one that is not there) and wall
    normals: Any  # (facets, 3)
    laws: Any  # (walls, materials, numbers) constants
    start: Any  # (groups + 1,) int32: first listed pair of each group of one particle and one wall
    row: Any  # (listed,) int32: particle
    facet: Any  # (listed,) int32
    image: Any  # None or (listed, 3): edges of the periodic cell from the particle to its image that is near
    history: Any  # (columns + 1, listed); the last line is 1 where the pair was a contact of its own
    near: Any  # (largest group, columns): room for the geometry of one group
    body: Any  # (bodies, columns)
    wall: Any  # (walls, columns)
    drive: Any  # None or (steps, bodies, 12): velocities in the middle and at the end of the coming steps
    drive_step: Any  # (1,) int64: row of `drive` for the next step


class Held(NamedTuple):
    """Rows with held components, for the work of what holds them."""

    row: Any  # (held,) int32, ascending
    free: Any  # (held, freedoms) float64: 0 where held, 1 where free


class Cell(NamedTuple):
    """A periodic cell; unused axes have length one and do not repeat."""

    matrix: Any  # (3, 3) edges as columns, upper triangular, m
    listed: Any  # (3, 3) the same when the list was built
    gradient: Any  # (3, 3) velocity gradient, 1/s
    rate: Any  # (3, 3) change of the edges in the last step over its length, m/s
    repeats: Any  # (3,) 1 along periodic axes, otherwise 0
    anchor: Any  # (2, 3) a place that goes with the flow of the cell, and its constant velocity, m and m/s


class Breaks(NamedTuple):
    """Bonds that have broken, in the order of time; `count[0]` of them, more than there is room for are counted only."""

    log: Any  # (room, 7): time, row i, row j, contact point (x, y, z), energy
    count: Any  # (1,) int64


class Records(NamedTuple):
    """Walls whose histories are written down in a run, and the room for it (see `particles.walls.history`)."""

    wall: Any  # (recorded,) int64: row of each in `Walls.wall`
    every: Any  # (recorded,) int64: steps from row to row
    left: Any  # (recorded,) int64: steps until the next row
    log: Any  # (recorded, room, columns)
    count: Any  # (recorded,) int64: rows written


class System(NamedTuple):
    """All that the kernels read and write; fetch it anew (`Assembly.system`) after `prepare` and `refresh`.

    In the plane (x, y, angle) are the first three columns of `position`, and so on; in space translations are there and
    rotations in the arrays that are None in the plane.
    """

    position: Any  # (n, 4): x, y, angle or z; radius
    velocity: Any  # (n, 4): of the middle of the step while it runs; 0
    acceleration: Any  # (n, 4); 0
    force: Any  # (n, 4): total of the last evaluation; 0
    lightness: Any  # (n, 4): one over mass or inertia of each component, 0 where it is held; mass
    rotation: Any  # None or (n, 4): sum of the rotation increments; 0
    spin: Any  # None or (n, 4)
    angular: Any  # None or (n, 4): angular acceleration; 0
    torque: Any  # None or (n, 4)
    nimbleness: Any  # None or (n, 4): one over the inertia, 0 where the component is held; inertia
    start: Any  # (n + 1,) int32: CSR half list, partners j > i of row i
    first: Any  # (pairs and some room,) int32: i of each pair
    second: Any  # (pairs and some room,) int32: j of each pair
    history: Any  # (columns, pairs and some room): what the contact law remembers
    scratch: Any  # (room for a batch of pairs,)
    material: Any  # None or (n,) int32
    external: Any  # None or (n, freedoms): constant forces of the caller
    walls: Any  # None or Walls
    records: Any  # None or Records
    held: Any  # None or Held
    breaks: Any  # None or Breaks
    cell: Any  # None or Cell
    flow: Any  # None (no cell) or (n, 4): room for the velocity of the deforming cell at each place; 0
    listed: Any  # (n, 3): positions (in the plane: angles, too) at the last list build
    sums: Any  # (SUMS,): energy sums
    clock: Any  # (7,): time; travel since the list was built, its limit; smallest radius; age of the list in steps; its skin, see
    # `particles.motion.fitting_skin`: scale (0: given by the caller), least
    share: Any = None  # None or (n, 2): shares of contacts and of the mass that the particles carry (`Assembly.weigh`)


class Terms(NamedTuple):
    """What the scene has; None is pruned when the loops are compiled."""

    law: Any  # constants of the contact law, a named tuple
    table: Any  # None or (materials, materials, numbers)
    blank: Any  # tuple of zeros, one for each column of history
    massive: Any  # None, or 1 where the law asks for masses
    viscous: Any  # None, or 1 where the law has dashpots
    gravity: Any  # None or (gx, gy, gz) in m/s2
    mass_damping: Any  # None or c in 1/s
    local_damping: Any  # None or alpha, for each component
    vector_damping: Any  # None or alpha, against the vector of velocity
    spin_damping: Any  # None (without vector_damping) or alpha, against the vector of spin
