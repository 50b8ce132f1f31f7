"""Small vectors as tuples: one component in the plane (along the tangent, or the axis), three in space.

Written out for the number of components when the loops are compiled, so that a contact law is written once.
"""

from __future__ import annotations

from numba import types
from numba.extending import overload


def _written(name, arguments, body):
    """A function from its text, for the number of components that its arguments have."""
    scope: dict = {}
    exec(f"def {name}({arguments}):\n    return {body}", scope)  # noqa: S102  # only our own text
    return scope[name]


def _tuple(parts):
    return "(" + "".join(f"{part}, " for part in parts) + ")"


def present(value):
    """None, or 1 where the value is something: a flag that costs nothing to hand on, unlike an array."""
    return None if value is None else 1


@overload(present)
def _present(value):
    if isinstance(value, types.NoneType):
        return lambda value: None
    return lambda value: 1


def in_plane(spin):
    """None in space, 1 in the plane (where there are no rows of spins)."""
    return 1 if spin is None else None


@overload(in_plane)
def _in_plane(spin):
    if isinstance(spin, types.NoneType):
        return lambda spin: 1
    return lambda spin: None


def plus(a, b):
    """a + b."""
    return tuple(x + y for x, y in zip(a, b))


@overload(plus)
def _plus(a, b):
    return _written("plus", "a, b", _tuple(f"a[{k}] + b[{k}]" for k in range(len(a))))


def minus(a, b):
    """a - b."""
    return tuple(x - y for x, y in zip(a, b))


@overload(minus)
def _minus(a, b):
    return _written("minus", "a, b", _tuple(f"a[{k}] - b[{k}]" for k in range(len(a))))


def scaled(s, a):
    """s a."""
    return tuple(s * x for x in a)


@overload(scaled)
def _scaled(s, a):
    return _written("scaled", "s, a", _tuple(f"s * a[{k}]" for k in range(len(a))))


def moved(a, s, b):
    """a + s b."""
    return tuple(x + s * y for x, y in zip(a, b))


@overload(moved)
def _moved(a, s, b):
    return _written("moved", "a, s, b", _tuple(f"a[{k}] + s * b[{k}]" for k in range(len(a))))


def dot(a, b):
    """a . b."""
    return sum(x * y for x, y in zip(a, b))


@overload(dot)
def _dot(a, b):
    return _written("dot", "a, b", " + ".join(f"a[{k}] * b[{k}]" for k in range(len(a))))


def head(values, pattern):
    """As many of the first values as `pattern` has."""
    return values[: len(pattern)]


@overload(head)
def _head(values, pattern):
    return _written("head", "values, pattern", _tuple(f"values[{k}]" for k in range(len(pattern))))


def tail(values, pattern):
    """The values after the first len(pattern)."""
    return values[len(pattern) :]


@overload(tail)
def _tail(values, pattern):
    return _written("tail", "values, pattern", _tuple(f"values[{k}]" for k in range(len(pattern), len(values))))


def cross(a, b):
    """a x b, three components."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@overload(cross)
def _cross(a, b):
    return cross


def load(values, place, stride, pattern):
    """Tuple of values[place], values[place + stride], ..., as many as `pattern` has."""
    return tuple(values[place + k * stride] for k in range(len(pattern)))


@overload(load)
def _load(values, place, stride, pattern):
    return _written("load", "values, place, stride, pattern", _tuple(f"values[place + {k} * stride]" for k in range(len(pattern))))


def store(values, place, stride, numbers):
    """values[place], values[place + stride], ... = numbers."""
    for k, number in enumerate(numbers):
        values[place + k * stride] = number


@overload(store)
def _store(values, place, stride, numbers):
    lines = [f"values[place + {k} * stride] = numbers[{k}]" for k in range(len(numbers))]
    scope: dict = {}
    exec("def store(values, place, stride, numbers):\n    " + "\n    ".join(lines or ["pass"]), scope)  # noqa: S102
    return scope["store"]
