"""Assemblies whose particles all ranks move, while one rank leads (`particles.crew`).

An assembly given to `spread` keeps its face: until it is first advanced it is on rank 0 alone, then every rank has a part of it
(`particles.exchange`). Stresses in a periodic cell, energies and balance of forces are summed over the parts; what else is asked
of it, all particles are brought to rank 0 for. On one rank nothing of this happens.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Any

from particles.assembly import Assembly
from particles.cell import checked_gradient
from particles.crew import Crew, crew, ranks
from particles.exchange import SharedAssembly, of_as_many
from particles.parts import sent
from particles.state import State
from particles.state import restore as restore_whole
from particles.state import state_of as state_of_whole

_KNOWN = frozenset((
    "count", "axes", "freedoms", "cell", "plates", "time", "reference", "radii", "masses", "inertias", "laws", "all_laws", "held",
))  # fmt: skip
_CHANGES = frozenset(("hold", "bond", "set_ghosts", "add_wall", "weigh"))


def state_of(soil: Any) -> State:
    """State of an assembly, spread or not, see `particles.state.state_of`; with those of its ranks."""
    if not isinstance(soil, SpreadAssembly):
        return state_of_whole(soil)
    if soil._shared is None:
        return state_of_whole(soil._soil) | ({} if soil._ranks is None else {"ranks": soil._ranks})
    soil._fresh = True
    return soil._order("state")


def restore(soil: Any, state: State) -> None:
    """Put a state of `state_of` into an assembly, spread or not."""
    if isinstance(soil, SpreadAssembly):
        soil._change(lambda whole: restore_whole(whole, state))
        soil._ranks = of_as_many(state, ranks())
    else:
        restore_whole(soil, state)


def parallel(soil: Any) -> dict[str, Any]:
    """How the work on an assembly is shared out, see `SharedAssembly.parallel`; nothing on one rank."""
    return soil.parallel() if isinstance(soil, SpreadAssembly) else {}


def spread(soil: Assembly) -> Any:
    """The same assembly, moved by all ranks from its first step on where a script is led; as it is otherwise."""
    following = crew()
    return soil if following is None else SpreadAssembly(soil, following)


def _parts(comm: Any, whole: Assembly | None = None, ranks: State | None = None) -> SharedAssembly:
    """This rank's part of an assembly that rank 0 has, with the states of ranks to go on from."""
    return SharedAssembly(lambda: sent(comm, whole), comm, whole=whole, ranks=ranks)


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

    def __init__(self, soil: Assembly, crew: Crew) -> None:
        self._soil, self._crew, self._number = soil, crew, crew.new()
        self._shared: SharedAssembly | None = None
        self._ranks: State | None = None  # that they go on from
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
            self._shared, self._ranks = self._crew.place(self._number, _parts, whole=self._soil, ranks=self._ranks), None
        if (news := self._shared.news_of_walls()) is not None:
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
        self._shared = self._ranks = None
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
