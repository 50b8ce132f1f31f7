"""One rank leads, the others follow: a script that works as on one rank, while all ranks do the steps together.

Rank 0 runs the script inside `lead`; the other ranks wait there for what is to be done together: things that all ranks have a part of
are placed under a number, and asked to do something by the name of a method. On one rank nothing of this happens.
"""

from __future__ import annotations

import contextlib
import signal
import time
import weakref
from collections.abc import Callable, Iterator
from itertools import count
from typing import Any, TypeVar

from mpi4py import MPI

from particles.driving import NotSettled
from particles.motion import Unstable

Result = TypeVar("Result")
TOLD = (ValueError, OSError, Unstable, NotSettled, KeyboardInterrupt)  # errors that a script ends with on every rank
AWAKE, NAP = 0.02, 0.001  # s that a rank waits for an order without sleeping; of one sleep


class Crew:
    """The ranks, and what they share, by number; one order after the other, the same on all ranks."""

    def __init__(self, comm: Any) -> None:
        self.comm = comm
        self._shared: dict[int, Any] = {}
        self._numbers, self._gone = count(), list[int]()

    def new(self) -> int:
        """A number for something new."""
        return next(self._numbers)

    def forget(self, number: int) -> None:
        """Let the ranks forget something with the next order."""
        self._gone.append(number)

    def _pass_on(self, order: Any) -> Any:
        """The order of rank 0 on every rank; those that wait for long leave the core to others."""
        call, start = self.comm.Ibarrier(), time.monotonic()
        while not call.Test():
            if self.comm.rank > 0 and time.monotonic() - start > AWAKE:
                time.sleep(NAP)
        return self.comm.bcast(order, root=0)

    def order(self, number: int, name: str, *arguments: Any, **options: Any) -> Any:
        """Let all ranks do something with what has this number; the result of rank 0."""
        gone, self._gone = self._gone, []
        self._pass_on((gone, number, name, arguments, options))
        return self._do_first(gone, number, name, arguments, options)

    def place(self, number: int, make: Callable[..., Any], *arguments: Any, **own: Any) -> Any:
        """Put make(comm, *arguments) under a number on every rank, in place of what was there; what rank 0 made.

        Args:
            own: named arguments that rank 0 alone has.
        """
        gone, self._gone = self._gone, []
        self._pass_on((gone, number, "place", (make, arguments), {}))
        self._drop([*gone, number])
        self._shared[number] = make(self.comm, *arguments, **own)
        return self._shared[number]

    def _drop(self, gone: list[int]) -> None:
        for number in gone:
            if number in self._shared:
                self._shared.pop(number).release()

    def _do(self, gone: list[int], number: int, name: str, arguments: Any, options: Any) -> Any:
        self._drop(gone)
        return getattr(self._shared[number], name)(*arguments, **options)

    def _do_first(self, *order: Any) -> Any:
        """The same on rank 0: an error of this rank alone is none that a script may go on from, the others are at work."""
        try:
            return self._do(*order)
        except TOLD as error:
            if getattr(error, "on_all_ranks", False):
                raise
            raise RuntimeError(f"rank 0 failed while all ranks were at work: {error}") from error

    def end(self, result: Any, error: BaseException | None) -> None:
        """Let the others go, with the result or the error of the script."""
        self._pass_on((self._gone, -1, "end", (result, error), {}))
        self._drop(list(self._shared))

    def follow(self) -> Any:
        """Carry out orders until the end; result or error of the script."""
        while True:
            gone, number, name, arguments, options = self._pass_on(None)
            if name == "end":
                self._drop(list(self._shared))
                result, error = arguments
                if error is not None:
                    raise error
                return result
            try:
                if name == "place":
                    self._drop([*gone, number])
                    make, arguments = arguments
                    self._shared[number] = make(self.comm, *arguments)
                else:
                    self._do(gone, number, name, arguments, options)
            except TOLD as error:
                if not getattr(error, "on_all_ranks", False):  # then the script on rank 0 has it, too
                    raise


_crew: Crew | None = None


def crew() -> Crew | None:
    """The ranks that follow the script which runs here; None on one rank and on those that follow."""
    return _crew


@contextlib.contextmanager
def alone() -> Iterator[None]:
    """Inside, a rank works by itself: no others follow."""
    global _crew
    following, _crew = _crew, None
    try:
        yield
    finally:
        _crew = following


def ranks() -> int:
    """How many ranks do the steps of a script that runs here."""
    return 1 if _crew is None else _crew.comm.size


class Placed:
    """Something that all ranks have a part of, which rank 0 asks to do something; without others that follow, rank 0 has it alone.

    Args:
        make: makes a rank's part from its communicator and the arguments; what goes wrong in it does so on all ranks.
        arguments: are sent to all ranks.

    Attributes:
        own: the part of this rank.
    """

    def __init__(self, make: Callable[..., Any], *arguments: Any) -> None:
        self._crew, self._number = crew(), -1
        if self._crew is None:
            self.own = make(MPI.COMM_SELF, *arguments)
            return
        self._number = self._crew.new()
        self.own = self._crew.place(self._number, make, *arguments)
        weakref.finalize(self, self._crew.forget, self._number)

    def ask(self, name: str, *arguments: Any) -> Any:
        """Let all ranks do something, by the name of a method; the result of rank 0."""
        if self._crew is None:
            return getattr(self.own, name)(*arguments)
        return self._crew.order(self._number, name, *arguments)


def lead(work: Callable[[], Result], comm: Any = MPI.COMM_WORLD) -> Result:
    """Result of a script that rank 0 runs while the others follow, on every rank; its errors of the kinds `TOLD`, too (collective).

    Any other error is of rank 0 alone, which has to end the others.
    """
    global _crew
    if comm.size == 1:
        return work()
    following = Crew(comm)
    if comm.rank > 0:
        before = {number: signal.signal(number, signal.SIG_IGN) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            return following.follow()
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
    _crew = following
    try:
        result = work()
    except TOLD as error:
        following.end(None, error)
        raise
    finally:
        _crew = None
    following.end(result, None)
    return result
