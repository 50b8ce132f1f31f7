"""Rows of particles to columns of pairs and back: the memory traffic of the pair loop.

The pair loop works on batches of `WIDTH` pairs whose data lie in columns of a scratch array (one column a quantity, one
after the other, `STRIDE` numbers apart), so that the compiler turns it into vector instructions. Particles are held in
rows of four numbers. Moving four rows at a time into four columns is a transposition of a 4 x 4 block in registers, which
the compiler does not find by itself; it is written here in LLVM's terms, beside the plain loops that say what it does.
"""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, overload

WIDTH = 64  # pairs in a batch
STRIDE = WIDTH + 8  # numbers from one column to the next; not a power of two, so that columns do not share cache lines
BLOCK = 4  # pairs in a transposed block

_double, _int32, _int64 = ir.DoubleType(), ir.IntType(32), ir.IntType(64)
_row = ir.VectorType(_double, BLOCK)


def aligned(shape: tuple[int, ...]) -> np.ndarray:
    """Zeros that begin at a cache line."""
    size = int(np.prod(shape))
    memory = np.zeros(size + 8)
    offset = (-memory.ctypes.data % 64) // 8
    return memory[offset : offset + size].reshape(shape)


# ------------------------------------------------------------------------------------------------- what the moves do


def _members(bits: int) -> list[int]:
    """Numbers of the bits that are set."""
    return [k for k in range(4) if bits >> k & 1]


def places_of(index, at):
    """Where the rows index[at], ... of BLOCK pairs begin in flat arrays of rows of four, for `gather` and `scatter`.

    Found once for all arrays: to the compiler any number that is written might be part of the index.
    """
    return tuple(4 * int(row) for row in index[at : at + BLOCK])


def gather(scratch, column, rows, first, second, both, own):
    """Rows of BLOCK pairs to columns: up to four of differences (second minus first), then components of the first.

    Args:
        scratch: (columns * STRIDE,).
        column: place in scratch of the first pair in the first column.
        rows: (n, 4).
        first, second: `places_of` the rows of each pair.
        both, own: of which components differences, and which of the first row, are wanted: numbers with bit 2^k for
            component k, known when the loop is compiled. Difference k goes to column k, the others follow from the fifth on.
    """
    flat = rows.reshape(-1)
    for c, (i, j) in enumerate(zip(first, second)):
        for k in _members(both):
            scratch[column + k * STRIDE + c] = flat[j + k] - flat[i + k]
        for k, component in enumerate(_members(own)):
            scratch[column + (4 + k) * STRIDE + c] = flat[i + component]


def scatter(scratch, column, rows, plus, minus):
    """Add three columns to the first components of the rows at the places `plus` (or None), and take them off at `minus`."""
    flat = rows.reshape(-1)
    for sign, places in ((1.0, plus), (-1.0, minus)):
        for c in range(0 if places is None else BLOCK):
            for k in range(3):
                flat[places[c] + k] += sign * scratch[column + k * STRIDE + c]


def load_column(scratch, column, values, line, at):
    """Copy WIDTH numbers of a line of `values` (lines, pairs) into a column."""
    scratch[column : column + WIDTH] = values[line, at : at + WIDTH]


def store_column(scratch, column, values, line, at):
    """Copy a column into WIDTH numbers of a line of `values` (lines, pairs)."""
    values[line, at : at + WIDTH] = scratch[column : column + WIDTH]


# ------------------------------------------------------------------------------------------- the same in LLVM's terms


class _Code:
    """What is written into the function that is being compiled."""

    def __init__(self, context, builder, signature, arguments):
        self.builder = builder
        self._of = {
            k: context.make_array(kind)(context, builder, value)
            for k, (kind, value) in enumerate(zip(signature.args, arguments))
            if isinstance(kind, types.Array)
        }

    def place(self, array, at):
        """Address of element `at` of a contiguous array among the arguments."""
        return self.builder.gep(self._of[array].data, [at])

    def sum(self, value, constant):
        return self.builder.add(value, ir.Constant(_int64, constant)) if constant else value

    def member(self, places, c):
        return self.builder.extract_value(places, c)

    def load(self, place, kind=_row):
        return self.builder.load(self.builder.bitcast(place, kind.as_pointer()), align=8)

    def store(self, value, place):
        self.builder.store(value, self.builder.bitcast(place, value.type.as_pointer()), align=8)

    def _mixed(self, a, b, *lanes):
        return self.builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(_int32, len(lanes)), list(lanes)))

    def transposed(self, r):
        even = [self._mixed(r[k], r[k + 1], 0, 4, 2, 6) for k in (0, 2)]
        odd = [self._mixed(r[k], r[k + 1], 1, 5, 3, 7) for k in (0, 2)]
        return [self._mixed(*pair, 0, 1, 4, 5) for pair in (even, odd)] + [
            self._mixed(*pair, 2, 3, 6, 7) for pair in (even, odd)
        ]


def _is_rows(kind):
    return isinstance(kind, types.Array) and kind.ndim == 2 and kind.layout == "C" and kind.dtype == types.float64


def _written(build):
    """An intrinsic without result whose code `build(code, *arguments)` writes."""

    def codegen(context, builder, signature, arguments):
        build(_Code(context, builder, signature, arguments), *arguments)
        return context.get_dummy_value()

    return codegen


@intrinsic
def _places_of(typing_context, index, at):
    def codegen(context, builder, signature, arguments):
        code, (_, at) = _Code(context, builder, signature, arguments), arguments
        rows = [builder.sext(builder.load(code.place(0, code.sum(at, c))), _int64) for c in range(BLOCK)]
        return context.make_tuple(
            builder, signature.return_type, [builder.mul(row, ir.Constant(_int64, 4)) for row in rows]
        )

    return types.UniTuple(types.int64, BLOCK)(index, types.int64), codegen


@overload(places_of)
def _compiled_places_of(index, at):
    return lambda index, at: _places_of(index, at)


def _gather(both, own):
    @intrinsic
    def move(typing_context, scratch, column, rows, first, second):
        def build(code, scratch, column, rows, first, second):
            pairs = [[code.load(code.place(2, code.member(places, c))) for places in (first, second)] for c in range(BLOCK)]
            differences = code.transposed([code.builder.fsub(j, i) for i, j in pairs])
            firsts = code.transposed([i for i, _ in pairs])
            columns = [(k, differences[k]) for k in _members(both)]
            columns += [(4 + k, firsts[component]) for k, component in enumerate(_members(own))]
            for k, values in columns:
                code.store(values, code.place(0, code.sum(column, k * STRIDE)))

        return types.void(scratch, types.int64, rows, first, second), _written(build)

    return move


_GATHERS = {(both, own): _gather(both, own) for both in range(16) for own in range(16)}


@overload(gather, prefer_literal=True)
def _compiled_gather(scratch, column, rows, first, second, both, own):
    if _is_rows(rows) and isinstance(both, types.IntegerLiteral) and isinstance(own, types.IntegerLiteral):
        move = _GATHERS[both.literal_value, own.literal_value]
        return lambda scratch, column, rows, first, second, both, own: move(scratch, column, rows, first, second)


@intrinsic
def _scatter(typing_context, scratch, column, rows, plus, minus):
    def build(code, scratch, column, rows, plus, minus):
        columns = [code.load(code.place(0, code.sum(column, k * STRIDE))) for k in range(3)]
        columns.append(ir.Constant(_row, [0.0] * BLOCK))
        addends = code.transposed(columns)
        for kind, places, combine in ((signs[0], plus, code.builder.fadd), (signs[1], minus, code.builder.fsub)):
            if not isinstance(kind, types.NoneType):
                for c, addend in enumerate(addends):
                    place = code.place(2, code.member(places, c))
                    code.store(combine(code.load(place), addend), place)

    signs = plus, minus
    return types.void(scratch, types.int64, rows, plus, minus), _written(build)


@overload(scatter)
def _compiled_scatter(scratch, column, rows, plus, minus):
    if _is_rows(rows):
        return lambda scratch, column, rows, plus, minus: _scatter(scratch, column, rows, plus, minus)


def _copy(inwards):
    lanes = ir.VectorType(_double, 8)

    @intrinsic
    def move(typing_context, scratch, column, values, at):
        def build(code, scratch, column, values, at):
            for c in range(0, WIDTH, 8):
                inside, outside = code.place(0, code.sum(column, c)), code.place(2, code.sum(at, c))
                source, target = (outside, inside) if inwards else (inside, outside)
                code.store(code.load(source, lanes), target)

        return types.void(scratch, types.int64, values, types.int64), _written(build)

    return move


_copy_in, _copy_out = _copy(True), _copy(False)


@overload(load_column)
def _compiled_load_column(scratch, column, values, line, at):
    return lambda scratch, column, values, line, at: _copy_in(scratch, column, values, line * values.shape[1] + at)


@overload(store_column)
def _compiled_store_column(scratch, column, values, line, at):
    return lambda scratch, column, values, line, at: _copy_out(scratch, column, values, line * values.shape[1] + at)
