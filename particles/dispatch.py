"""Calls of compiled functions that take named tuples of arrays, without the look at every type in every call."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import typeof
from numba.core import event
from numba.core.dispatcher import Dispatcher

from particles.caches import without_cache

COMPILING = "numba:compiler_lock"  # event of Numba while it compiles or loads what it has compiled before
_compiling = event.TimingListener()
event.register(COMPILING, _compiling)
_PLAIN = frozenset((np.ndarray, type(None), float, int, bool, np.float64))


def compiled_seconds() -> float:
    """Seconds so far in which Numba compiled, or loaded what it had compiled before."""
    return _compiling.duration if _compiling.done else 0.0


def _kinds(value: Any) -> Any:
    """Types of a value, down through tuples; a compiled function is a type of its own."""
    kind = type(value)
    if kind in _PLAIN:  # nearly all, and quick
        return kind
    if isinstance(value, tuple):
        return tuple([_kinds(member) for member in value])
    return value if isinstance(value, Dispatcher) else kind


def _has_function(kinds: Any) -> bool:
    return any(map(_has_function, kinds)) if isinstance(kinds, tuple) else isinstance(kinds, Dispatcher)


class Direct:
    """A jitted function that is called through its compiled entry once the types of a call are known.

    Numba looks up the types of named tuples in Python, which takes longer (0.3 ms) than a step of a small assembly. Here
    the types of the tuples' members are compared (some microseconds), or nothing but the tuples' identity where they are
    those of the last call; the entry itself still checks the arrays that it gets.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function, self.__doc__ = function, function.__doc__
        self._entries: dict[Any, Callable[..., Any]] = {}
        self._last: tuple[Any, ...] = ()  # keeps the tuples alive, so that their identities stay theirs
        self._last_key: Any = None
        self._entry: Any = None

    def __call__(self, *arguments: Any) -> Any:
        key = [id(value) if isinstance(value, tuple) else type(value) for value in arguments]
        if key == self._last_key:
            return self._entry(*arguments)
        kinds = _kinds(arguments)
        entry: Any = self._entries.get(kinds)
        if entry is None:
            with event.trigger_event(COMPILING):
                entry = self._entries[kinds] = self._compiled(arguments, kinds)
        self._last, self._last_key, self._entry = arguments, key, entry
        return entry(*arguments)

    def _compiled(self, arguments: tuple[Any, ...], kinds: Any) -> Callable[..., Any]:
        entry: Any = self._function
        if not hasattr(entry, "overloads"):
            return entry  # compilation is switched off
        # by the types, not by a call: numba's own choice among compiled versions was seen to take one for a law without
        # dashpots where the law had them
        types = tuple(map(typeof, arguments))
        with without_cache() if _has_function(kinds) else contextlib.nullcontext():
            entry.compile(types)
        return entry.overloads[types].entry_point
