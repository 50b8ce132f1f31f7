"""Eight rows at a time: vectors of numbers that compiled loops add and multiply like single ones.

A number type of Numba's whose values are vector registers, so that stencils with gaps become vector code whatever the compiler knows
of the arrays. Without compilation a vector is an array of eight numbers, which the functions below say what to do with.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, lower_builtin, models, overload, register_model, type_callable

WIDTH = 8
_double, _int32, _int64 = ir.DoubleType(), ir.IntType(32), ir.IntType(64)
_numbers, _words = ir.VectorType(_double, WIDTH), ir.VectorType(_int64, WIDTH)


class _Vector(types.Type):
    """Eight float64, or eight int64 with a bit for each thing that may be there or not."""


NUMBERS, WORDS = _Vector("lanes of numbers"), _Vector("lanes of words")


@register_model(_Vector)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _numbers if kind == NUMBERS else _words)


# ---------------------------------------------------------------------------------------------- what the functions do


def load(values, at):
    """Numbers, or words, of the rows from `at` on of a line (n,)."""
    return values[at : at + WIDTH].copy()


def store(values, at, numbers):
    """Put numbers in the rows from `at` on of a line (n,)."""
    values[at : at + WIDTH] = numbers


def kept(words, bit, numbers):
    """Numbers where the bit is set, elsewhere zero."""
    return np.where(words >> bit & 1, numbers, 0.0)


def least(a, b):
    """The smaller ones of two vectors."""
    return np.minimum(a, b)


def most(a, b):
    """The larger ones of two vectors."""
    return np.maximum(a, b)


def even(number):
    """The same number in all lanes."""
    return np.full(WIDTH, number)


def above(numbers, limit):
    """A bit for each lane whose number is above a limit."""
    return int(((numbers > limit) << np.arange(WIDTH)).sum())


def all_have(words, bits):
    """Whether the words of all lanes have all of some bits."""
    return bool(np.all(words & bits == bits))


def sum_of(numbers):
    """The sum of all."""
    return float(numbers.sum())


# --------------------------------------------------------------------------------------------- the same in LLVM's terms


def _wide(builder: Any, value: Any, kind: Any) -> Any:
    """A vector with a value in all lanes."""
    first = builder.insert_element(ir.Constant(kind, ir.Undefined), value, ir.Constant(_int32, 0))
    return builder.shuffle_vector(first, ir.Constant(kind, ir.Undefined), ir.Constant(ir.VectorType(_int32, WIDTH), [0] * WIDTH))


def _arithmetic(function: Callable[..., Any], name: str) -> None:
    """Let an operator work on vectors, and on a vector and a number."""

    @type_callable(function)
    def _type(context: Any) -> Any:
        def kind(a: Any, b: Any) -> Any:
            if (a == NUMBERS and b in (NUMBERS, types.float64)) or (b == NUMBERS and a == types.float64):
                return NUMBERS
            return None

        return kind

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return getattr(builder, name)(
            *(value if kind == NUMBERS else _wide(builder, value, _numbers) for kind, value in zip(signature.args, values))
        )

    for kinds in ((NUMBERS, NUMBERS), (NUMBERS, types.float64), (types.float64, NUMBERS)):
        lower_builtin(function, *kinds)(code)


for _function, _name in ((operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul")):
    _arithmetic(_function, _name)


def _address(context: Any, builder: Any, kind: Any, array: Any, at: Any, wide: Any) -> Any:
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [at]), wide.as_pointer())


@intrinsic
def _load(typing_context, values, at):
    result = NUMBERS if values.dtype == types.float64 else WORDS

    def code(context, builder, signature, arguments):
        wide = _numbers if result == NUMBERS else _words
        return builder.load(_address(context, builder, signature.args[0], *arguments, wide), align=8)

    return result(values, types.int64), code


@overload(load)
def _compiled_load(values, at):
    return lambda values, at: _load(values, at)


@intrinsic
def _store(typing_context, values, at, numbers):
    def code(context, builder, signature, arguments):
        place = _address(context, builder, signature.args[0], *arguments[:2], _numbers)
        builder.store(arguments[2], place, align=8)
        return context.get_dummy_value()

    return types.void(values, types.int64, numbers), code


@overload(store)
def _compiled_store(values, at, numbers):
    return lambda values, at, numbers: _store(values, at, numbers)


@intrinsic
def _kept(typing_context, words, bit, numbers):
    def code(context, builder, signature, arguments):
        words, bit, numbers = arguments
        asked = _wide(builder, builder.shl(ir.Constant(_int64, 1), bit), _words)
        there = builder.icmp_unsigned("!=", builder.and_(words, asked), ir.Constant(_words, [0] * WIDTH))
        return builder.select(there, numbers, ir.Constant(_numbers, [0.0] * WIDTH))

    return NUMBERS(words, types.int64, numbers), code


@overload(kept)
def _compiled_kept(words, bit, numbers):
    return lambda words, bit, numbers: _kept(words, bit, numbers)


def _chosen(comparison: str) -> Any:
    @intrinsic
    def choose(typing_context, a, b):
        def code(context, builder, signature, arguments):
            a, b = arguments
            return builder.select(builder.fcmp_ordered(comparison, a, b), a, b)

        return NUMBERS(a, b), code

    return choose


_least, _most = _chosen("<"), _chosen(">")


@overload(least)
def _compiled_least(a, b):
    return lambda a, b: _least(a, b)


@overload(most)
def _compiled_most(a, b):
    return lambda a, b: _most(a, b)


@intrinsic
def _even(typing_context, number):
    def code(context, builder, signature, arguments):
        return _wide(builder, arguments[0], _numbers)

    return NUMBERS(types.float64), code


@overload(even)
def _compiled_even(number):
    return lambda number: _even(number)


@intrinsic
def _above(typing_context, numbers, limit):
    def code(context, builder, signature, arguments):
        numbers, limit = arguments
        beyond = builder.fcmp_ordered(">", numbers, _wide(builder, limit, _numbers))
        return builder.zext(builder.bitcast(beyond, ir.IntType(WIDTH)), _int64)

    return types.int64(numbers, limit), code


@overload(above)
def _compiled_above(numbers, limit):
    return lambda numbers, limit: _above(numbers, limit)


@intrinsic
def _all_have(typing_context, words, bits):
    def code(context, builder, signature, arguments):
        words, bits = arguments
        asked = _wide(builder, bits, _words)
        there = builder.icmp_unsigned("==", builder.and_(words, asked), asked)
        lanes = builder.bitcast(there, ir.IntType(WIDTH))
        return builder.icmp_unsigned("==", lanes, ir.Constant(ir.IntType(WIDTH), (1 << WIDTH) - 1))

    return types.boolean(words, types.int64), code


@overload(all_have)
def _compiled_all_have(words, bits):
    return lambda words, bits: _all_have(words, bits)


@intrinsic
def _sum_of(typing_context, numbers):
    def code(context, builder, signature, arguments):
        lanes = [builder.extract_element(arguments[0], ir.Constant(_int32, c)) for c in range(WIDTH)]
        while len(lanes) > 1:
            lanes = [builder.fadd(a, b) for a, b in zip(lanes[::2], lanes[1::2])]
        return lanes[0]

    return types.float64(numbers), code


@overload(sum_of)
def _compiled_sum_of(numbers):
    return lambda numbers: _sum_of(numbers)
