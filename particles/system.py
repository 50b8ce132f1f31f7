"""The particle system as the kernels see it: named tuples of arrays, and the places of the energy sums.

Rows are sorted by position (see `particles.neighbours`); `Assembly.rows` maps ids to rows.
"""

from __future__ import annotations

from typing import Any, NamedTuple

# LLVM may contract, use reciprocals and assume finite numbers; checks for blow-up live in functions without it.
FAST = {"contract", "arcp", "nsz", "nnan", "ninf"}

# Columns of `System.state`
X, Y, VX, VY, SPIN, RADIUS, INVERSE_MASS, ANGLE = range(8)

# Entries of `System.sums` (J, power in W)
(
    FRICTION_SLIDING,
    FRICTION_ROLLING,
    FRICTION_MOMENT,
    VISCOUS,
    LOSS,
    MASS_DAMPING,
    LOCAL_DAMPING,
    GRAVITY,
    EXTERNAL,
    WALLS,
    HELD,
    POWER,
) = range(12)

# Entries of `System.clock`
TIME, TRAVEL, TRAVEL_LIMIT, SMALLEST_RADIUS = range(4)

# Columns of `Walls.plates`: displacement, velocity, displacement increment of the last step, reaction on the plate
# (force, moment about the reference point), work done on the particles, reference point
(
    PLATE_UX, PLATE_UY, PLATE_VX, PLATE_VY, PLATE_DX, PLATE_DY, PLATE_FX, PLATE_FY, PLATE_MOMENT, PLATE_WORK,
    PLATE_X, PLATE_Y,
) = range(12)  # fmt: skip


class Walls(NamedTuple):
    """Rigid plates and the discs listed near them."""

    plates: Any  # (plates, 12) float64, columns above
    listed: Any  # (plates, 2) displacement at the last list build
    corner_start: Any  # (plates + 1,) int32
    corners: Any  # (corners, 2) reference positions, counter-clockwise
    laws: Any  # (plates, materials, COLUMNS) constants
    row: Any  # (listed,) int32: disc
    plate: Any  # (listed,) int32: plate
    history: Any  # (listed, channels)
    drive: Any  # None or (steps, plates, 2): velocities of the coming steps
    drive_step: Any  # (1,) int64: row of `drive` for the next step


class Held(NamedTuple):
    """Rows with held components, and room to keep their velocity and force while a loop passes over them."""

    row: Any  # (held,) int32
    free: Any  # (held, 3) float64: 0 where held, 1 where free
    velocity: Any  # (held, 3)
    force: Any  # (held, 3)


class System(NamedTuple):
    """All that the kernels read and write; fetch it anew (`Assembly.system`) after `prepare` and `refresh`."""

    state: Any  # (n, 8): x, y, vx, vy, angular velocity, radius, inverse mass, angle
    acceleration: Any  # (n, 3)
    force: Any  # (n, 3): total of the last evaluation
    start: Any  # (n + 1,) int32: CSR half list, partners j > i of row i
    neighbour: Any  # (pairs,) int32
    history: Any  # (pairs, channels): elastic sliding force, rolling force, rolling moment (those present)
    material: Any  # None or (n,) int32
    external: Any  # None or (n, 3): constant forces of the caller
    walls: Any  # None or Walls
    held: Any  # None or Held
    listed: Any  # (n, 2): positions at the last list build
    sums: Any  # (12,): energy sums
    clock: Any  # (4,): time, travel since the list was built, its limit, smallest radius


class Terms(NamedTuple):
    """What the scene has; None is pruned when the loops are compiled."""

    law: Any  # Law
    table: Any  # None or (materials, materials, COLUMNS)
    gravity: Any  # None or (gx, gy) in m/s2
    mass_damping: Any  # None or c in 1/s
    local_damping: Any  # None or alpha
