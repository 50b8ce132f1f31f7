"""What the compiled loops say to other ranks: halo rows, sums of walls, the largest of a number; nothing on one rank.

MPI is called from compiled code by the names of its C functions (`particles.exchange` loads the library that mpi4py uses), so
that a run on several ranks stays in compiled code from list to list. `halo` is None on one rank: all of this is compiled away.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from numba import njit, types

from particles.system import INLINE, INNER, MERGED, STEPS
from particles.walls.rows import ACTION, TOUCHING

_int, _address = types.int32, types.intp
_start_all = types.ExternalFunction("MPI_Startall", _int(_int, _address))
_wait_all = types.ExternalFunction("MPI_Waitall", _int(_int, _address, _address))
_all_reduce = types.ExternalFunction("MPI_Allreduce", _int(_address, _address, _int, _address, _address, _address))
_time = types.ExternalFunction("MPI_Wtime", types.float64())

COMM, DOUBLE, HIGHEST, SUM = range(4)  # entries of `Halo.handles`
WAITED, AGREED = 0, 1  # entries of `Halo.seconds`


class Halo(NamedTuple):
    """Rows that other ranks need of this one, rows of theirs that this one needs, and the way between them."""

    rows: Any  # (sent,) int64: own rows, by receiver
    first: Any  # (1,) int64: row of the first particle received; the others follow, by sender
    out: Any  # (sent, numbers): room for what is sent
    into: Any  # (received, numbers)
    requests: Any  # (messages,) int64: persistent requests of MPI
    handles: Any  # (4,) int64: communicator, kind of number, largest of, sum of
    flag: Any  # (2,): room for a number and the largest of it
    sums: Any  # (2, numbers): room for what is summed, reactions on walls too, and for its sums
    seconds: Any  # (2,): spent in exchanging rows (with the wait for others), in agreeing on numbers


@njit(**INNER)
def highest(halo, value):
    """The largest of a number over all ranks (collective); the number itself on one rank."""
    if halo is None:
        return value
    start = _time()
    halo.flag[0] = value
    _all_reduce(
        halo.flag.ctypes.data, halo.flag.ctypes.data + 8, 1, halo.handles[DOUBLE], halo.handles[HIGHEST], halo.handles[COMM]
    )
    halo.seconds[AGREED] += _time() - start
    return int(halo.flag[1])


@njit(**INNER)
def _pack(out, rows, values, at):
    """Three columns of the rows into the messages; nothing where there are no such values."""
    if values is not None:
        for k in range(rows.size):
            for c in range(3):
                out[k, at + c] = values[rows[k], c]


@njit(**INNER)
def _unpack(into, first, values, at):
    if values is not None:
        for k in range(into.shape[0]):
            for c in range(3):
                values[first + k, c] = into[k, at + c]


@njit(**INLINE)
def _if(wanted, values):
    """Values, or None where something else is None."""
    if wanted is None:
        return None
    return values


@njit(**INLINE)
def _after(values):
    """Columns that the values take in a message."""
    return 0 if values is None else 3


def numbers(space: bool, viscous: bool) -> int:
    """Numbers a particle in a message: places and velocities, spins in space, accelerations where there are dashpots."""
    return (9 if space else 6) + ((6 if space else 3) if viscous else 0)


@njit(**MERGED)
def send(halo, border, viscous):
    """Give the neighbours the rows that they need; theirs are there after `receive`."""
    if halo is not None:
        change, angular = _if(viscous, border.acceleration), _if(viscous, border.angular)
        _send(halo, border.position, border.velocity, border.spin, change, angular)


@njit(**MERGED)
def receive(halo, border, viscous):
    """Take the neighbours' rows, behind the own ones (collective among neighbours, with `send` before)."""
    if halo is not None:
        change, angular = _if(viscous, border.acceleration), _if(viscous, border.angular)
        _receive(halo, border.position, border.velocity, border.spin, change, angular)


@njit(**STEPS)
def renew(halo, border, viscous):
    """Bring the rows of the halo up to date (collective among neighbours)."""
    send(halo, border, viscous)
    receive(halo, border, viscous)


@njit(**INNER)
def exchange_values(halo, values):
    """Give the neighbours the rows of an array (n, 3) that they need, and take theirs (collective among neighbours)."""
    _send(halo, values, None, None, None, None)
    _receive(halo, values, None, None, None, None)


@njit(**INNER)
def _send(halo, position, velocity, spin, change, angular):
    start, rows = _time(), halo.rows
    turning = 6 + _after(spin)
    last = turning + _after(change)
    _pack(halo.out, rows, position, 0)
    _pack(halo.out, rows, velocity, 3)
    _pack(halo.out, rows, spin, 6)
    _pack(halo.out, rows, change, turning)
    _pack(halo.out, rows, angular, last)
    _start_all(halo.requests.size, halo.requests.ctypes.data)
    halo.seconds[WAITED] += _time() - start


@njit(**INNER)
def _receive(halo, position, velocity, spin, change, angular):
    start, first = _time(), halo.first[0]
    turning = 6 + _after(spin)
    last = turning + _after(change)
    _wait_all(halo.requests.size, halo.requests.ctypes.data, 0)
    _unpack(halo.into, first, position, 0)
    _unpack(halo.into, first, velocity, 3)
    _unpack(halo.into, first, spin, 6)
    _unpack(halo.into, first, change, turning)
    _unpack(halo.into, first, angular, last)
    halo.seconds[WAITED] += _time() - start


@njit(**INNER)
def _into(room, at, values, first, columns):
    """Columns of all rows of an array behind the first `at` numbers of the room, if there is one; the numbers there then."""
    if values is not None:
        for k in range(values.shape[0]):
            for c in range(columns):
                room[at + c] = values[k, first + c]
            at += columns
    return at


@njit(**INNER)
def _out_of(room, at, values, first, columns):
    """The way back of `_into`."""
    if values is not None:
        for k in range(values.shape[0]):
            for c in range(columns):
                values[k, first + c] = room[at + c]
            at += columns
    return at


@njit(**INNER)
def _sum(halo, wall, body, values):
    own, total, start = halo.sums[0], halo.sums[1], _time()
    at = _into(own, 0, wall, ACTION, 6)
    at = _into(own, at, body, TOUCHING, 1)
    at = _into(own, at, values, 0, 3)
    _all_reduce(own.ctypes.data, total.ctypes.data, at, halo.handles[DOUBLE], halo.handles[SUM], halo.handles[COMM])
    at = _out_of(total, 0, wall, ACTION, 6)
    at = _out_of(total, at, body, TOUCHING, 1)
    _out_of(total, at, values, 0, 3)
    halo.seconds[AGREED] += _time() - start


@njit(**INNER)
def sum_reactions(halo, walls, values):
    """Reactions on the walls, numbers of contacts and `values` (k, 3), or None, summed over the ranks in one message (collective)."""
    if halo is not None:
        _sum(halo, walls.wall, walls.body, values)


@njit(**INNER)
def sum_together(halo, values):
    """Replace an array (k, 3) by its sum over the ranks (collective), the same to the bit on all; nothing on one rank."""
    if halo is not None:
        _sum(halo, None, None, values)
