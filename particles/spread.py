"""One rank leads, the others follow: a script that works with assemblies as on one rank, while all ranks move the particles.

Rank 0 runs the script inside `lead`; the other ranks wait there for what is to be done together. An assembly given to `spread`
keeps its face: until it is first advanced it is on rank 0 alone, then every rank has a part of it (`particles.exchange`). Stresses
in a periodic cell, energies and balance of forces are summed over the parts; what else is asked of it, all particles are brought
to rank 0 for. On one rank nothing of this happens.
"""

from __future__ import annotations

import signal
import time
import weakref
from collections.abc import Callable
from itertools import count
from typing import Any, TypeVar

from mpi4py import MPI

from particles.assembly import Assembly
from particles.cell import checked_gradient
from particles.driving import NotSettled
from particles.exchange import SharedAssembly
from particles.motion import Unstable
from particles.parts import sent
from particles.state import State
from particles.state import restore as restore_whole

Result = TypeVar("Result")
TOLD = (ValueError, OSError, Unstable, NotSettled, KeyboardInterrupt)  # errors that a script ends with on every rank
AWAKE, NAP = 0.02, 0.001  # s that a rank waits for an order without sleeping; of one sleep

_KNOWN = frozenset((
    "count", "axes", "freedoms", "cell", "plates", "time", "reference", "radii", "masses", "inertias", "laws", "all_laws", "held",
))  # fmt: skip
_CHANGES = frozenset(("hold", "bond", "set_ghosts", "add_wall", "weigh"))


class _Crew:
    """The ranks, and the assemblies that they share, by number; one order after the other, the same on all ranks."""

    def __init__(self, comm: Any) -> None:
        self.comm = comm
        self._shared: dict[int, SharedAssembly] = {}
        self._numbers, self._gone = count(), list[int]()

    def new(self) -> int:
        return next(self._numbers)

    def forget(self, number: int) -> None:
        """Let the ranks forget an assembly with the next order."""
        self._gone.append(number)

    def _pass_on(self, order: Any) -> Any:
        """The order of rank 0 on every rank; those that wait for long leave the core to others."""
        call, start = self.comm.Ibarrier(), time.monotonic()
        while not call.Test():
            if self.comm.rank > 0 and time.monotonic() - start > AWAKE:
                time.sleep(NAP)
        return self.comm.bcast(order, root=0)

    def order(self, number: int, name: str, *arguments: Any, **options: Any) -> Any:
        """Let all ranks do something with an assembly; the result of rank 0."""
        gone, self._gone = self._gone, []
        self._pass_on((gone, number, name, arguments, options))
        return self._do_first(gone, number, name, arguments, options)

    def take(self, number: int, soil: Assembly) -> SharedAssembly:
        """Spread an assembly that rank 0 has."""
        gone, self._gone = self._gone, []
        self._pass_on((gone, number, "take", (), {}))
        self._drop([*gone, number])
        shared = self._shared[number] = SharedAssembly(lambda: sent(self.comm, soil), self.comm, whole=soil)
        return shared

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
                if name == "take":
                    self._drop([*gone, number])
                    self._shared[number] = SharedAssembly(lambda: sent(self.comm, None), self.comm)
                else:
                    self._do(gone, number, name, arguments, options)
            except TOLD as error:
                if not getattr(error, "on_all_ranks", False):  # then the script on rank 0 has it, too
                    raise


_crew: _Crew | None = None


def ranks() -> int:
    """How many ranks an assembly that is spread here is on."""
    return 1 if _crew is None else _crew.comm.size


def restore(soil: Any, state: State) -> None:
    """Put a state of `particles.state.state_of` into an assembly, spread or not."""
    if isinstance(soil, SpreadAssembly):
        soil._change(lambda whole: restore_whole(whole, state))
    else:
        restore_whole(soil, state)


def parallel(soil: Any) -> dict[str, Any]:
    """How the work on an assembly is shared out, see `SharedAssembly.parallel`; nothing on one rank."""
    return soil.parallel() if isinstance(soil, SpreadAssembly) else {}


def lead(work: Callable[[], Result], comm: Any = MPI.COMM_WORLD) -> Result:
    """Result of a script that rank 0 runs while the others follow, on every rank; its errors of the kinds `TOLD`, too (collective).

    Any other error is of rank 0 alone, which has to end the others.
    """
    global _crew
    if comm.size == 1:
        return work()
    crew = _Crew(comm)
    if comm.rank > 0:
        before = {number: signal.signal(number, signal.SIG_IGN) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            return crew.follow()
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
    _crew = crew
    try:
        result = work()
    except TOLD as error:
        crew.end(None, error)
        raise
    finally:
        _crew = None
    crew.end(result, None)
    return result


def spread(soil: Assembly) -> Any:
    """The same assembly, moved by all ranks from its first step on where a script is led; as it is otherwise."""
    return soil if _crew is None else SpreadAssembly(soil, _crew)


def _of_whole(name: str) -> Any:
    """Property of an assembly that may be assigned: of the whole, and the ranks get their parts of it anew."""

    def get(face: SpreadAssembly) -> Any:
        return getattr(face._now(), name)

    def assign(face: SpreadAssembly, values: Any) -> None:
        face._change(lambda soil: setattr(soil, name, values))

    return property(get, assign, doc=f"See `Assembly.{name}`.")


def _summed(name: str) -> Any:
    """Method of an assembly that its parts answer together, where it would have to be brought together."""

    def ask(face: SpreadAssembly) -> Any:
        return getattr(face._soil, name)() if face._fresh else face._order(name)

    ask.__doc__ = f"See `Assembly.{name}`."
    return ask


class SpreadAssembly:
    """The face of an `Assembly` whose particles are spread over ranks that follow; used on rank 0."""

    def __init__(self, soil: Assembly, crew: _Crew) -> None:
        self._soil, self._crew, self._number = soil, crew, crew.new()
        self._shared: SharedAssembly | None = None
        self._fresh = True  # what rank 0 has is what the ranks have
        weakref.finalize(self, crew.forget, self._number)

    def _now(self) -> Assembly:
        """The whole assembly on rank 0, as it is now."""
        if not self._fresh:
            self._order("collect")
            self._fresh = True
        return self._soil

    def _order(self, name: str, *arguments: Any, **options: Any) -> Any:
        return self._crew.order(self._number, name, *arguments, **options)

    def _placed(self) -> SharedAssembly:
        """The parts, which know what the script has done to the walls."""
        if self._shared is None:
            self._shared = self._crew.take(self._number, self._soil)
        elif (news := self._shared.news_of_walls()) is not None:
            self._order("hear_of_walls", news)
        return self._shared

    def _act(self, name: str, *arguments: Any, **options: Any) -> None:
        shared = self._placed()
        self._fresh = False
        try:
            self._order(name, *arguments, **options)
        finally:
            shared.tell_whole()

    def __getattr__(self, name: str) -> Any:
        if name in _CHANGES:
            return lambda *arguments, **options: self._change(lambda soil: getattr(soil, name)(*arguments, **options))
        return getattr(self._soil if name in _KNOWN else self._now(), name)

    def _change(self, change: Callable[[Assembly], Any]) -> Any:
        """Do something to the whole; the ranks get their parts of it anew before the next step."""
        result = change(self._now())
        self._shared = None
        return result

    # What differs from an assembly ---------------------------------------------------------------------------------------

    def advance(self, steps: int, step: float, **loads: Any) -> None:
        """See `Assembly.advance`."""
        if int(steps) != steps or steps < 0:
            raise ValueError(f"steps={steps} must be a whole number, zero or positive")
        self._soil.terms(**loads)  # refused here, before all ranks are at work
        if steps > 0:
            self._act("advance", int(steps), step, **loads)

    def prepare(self, step: float, steps: int = 1, **loads: Any) -> None:
        """Compute forces and accelerations of the present state; see `Assembly.prepare`."""
        self._act("prepare", step, steps, **loads)

    def deform(self, velocity_gradient: Any) -> None:
        """See `Assembly.deform`."""
        if self._shared is None or self._soil.cell is None:
            self._soil.deform(velocity_gradient)
        else:
            checked_gradient(self._soil.cell, velocity_gradient)
            self._act("deform", velocity_gradient)

    cell_stress, force_sums = _summed("cell_stress"), _summed("force_sums")
    energies, energy_balance = _summed("energies"), _summed("energy_balance")
    displacements, velocities, external_forces = _of_whole("displacements"), _of_whole("velocities"), _of_whole("external_forces")

    def parallel(self) -> dict[str, Any]:
        """How the work is shared out; see `SharedAssembly.parallel`."""
        return {} if self._shared is None else self._order("parallel")
