"""Calls of compiled functions that take named tuples of arrays, without the look at every type in every call."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import typeof


def _kinds(value: Any) -> Any:
    """Types of a value, down through tuples."""
    return tuple(map(_kinds, value)) if isinstance(value, tuple) else type(value)


class Direct:
    """A jitted function that is called through its compiled entry once the types of a call are known.

    Numba looks up the types of named tuples in Python, which takes longer (0.3 ms) than a step of a small assembly. Here
    the types of the tuples' members are compared (some microseconds), or nothing but the tuples' identity where they are
    those of the last call; the entry itself still checks the arrays that it gets.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function
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
            entry = self._function
            if hasattr(entry, "overloads"):  # not so where compilation is switched off
                # by the types, not by a call: numba's own choice among compiled versions was seen to take one for a
                # law without dashpots where the law had them
                types = tuple(map(typeof, arguments))
                entry.compile(types)
                entry = entry.overloads[types].entry_point
            self._entries[kinds] = entry
        self._last, self._last_key, self._entry = arguments, key, entry
        return entry(*arguments)
