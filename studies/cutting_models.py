"""The block under the pick by each method; `bridge.run.run` advances them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from bridge import Overlap
from bridge.run import Stopwatch, on_root
from particles.crew import Placed
from particles.spread import parallel, restore, spread, state_of
from particles.state import State
from studies import cutting as scene
from studies.cracks import fragments
from studies.cutting import Parameters
from studies.snapshots import ContinuumFields, continuum_fields

COARSE_RATIO = 0.6  # largest step of the continuum as a share of its critical step


def critical_step(p: Parameters, soil: Any, alone: float) -> float:
    """Critical step of the discs, s, from the one without the pick.

    A contact with the pick, far from the zone, adds k / m to the square of the largest frequency at most (Weyl); damping against
    the motion adds up to its share to the forces that turn a vibration round.
    """
    added = p.tool_stiffness / (p.density * math.pi * float(soil.radii.min()) ** 2)
    return 2.0 / math.sqrt(((2.0 / alone) ** 2 + added) * (1.0 + p.damping))


def armed(p: Parameters, soil: Any) -> Any:
    """The pick, which the discs know from now on."""
    pick = scene.pick(p)
    soil.add_wall(pick)
    return pick


class Block:
    """What both methods share.

    Args:
        p: parameters.
    """

    soil: Any
    step: float  # s, of one `advance` step
    steps: int
    counts: dict[str, int]
    step_sizes: dict[str, float]
    pick: Any
    body: Any = None

    def __init__(self, p: Parameters) -> None:
        self.p = p
        self._before = 0.0, 0.0

    def sample(self) -> dict[str, float]:
        """Forces, cracks and energies now; the cutting force is the mean since the last sample.

        It is the work of the pick over the way of its tip, which is conjugate to it and takes in every step; the other forces
        are those of the moment, on the pick.
        """
        p, work = self.p, self.pick.work
        spent = work - self._before[1], self.time - self._before[0]
        self._before = self.time, work
        tip, angle = scene.tip_at(p, self.time), p.rotation * self.time - p.half_angle
        along = p.arm * p.rotation + p.swing * math.cos(angle)  # speed of the tip along the tangent of its arc
        across = p.swing * math.sin(angle)
        force = self.pick.force
        terms = self.energies()
        return {
            "time_s": self.time, "tip_x_m": tip[0], "tip_y_m": tip[1], "work_J": work,
            "cutting_force_N": spent[0] / (math.hypot(along, across) * spent[1]) if spent[1] else 0.0,
            "force_x_N": float(force[0]), "force_y_N": float(force[1]), "cracks": float(len(self.soil.breaks)),
            "kinetic_J": terms["kinetic"], "breaking_J": self.soil.energies()["breaking"],
        }  # fmt: skip

    @property
    def time(self) -> float:
        """Time since the pick set off, s."""
        raise NotImplementedError

    def advance(self, steps: int) -> None:
        """Take steps."""
        raise NotImplementedError

    def energies(self) -> dict[str, float]:
        """Terms since the start, J; `external_work` is that of the pick."""
        raise NotImplementedError

    def state(self) -> State:
        """All that `restore` needs."""
        return {"before": np.array(self._before)} | self._state()

    def restore(self, state: State) -> None:
        """Go on from a state."""
        self._before = tuple(state["before"].tolist())
        self._restore(state)

    def _state(self) -> State:
        return {"particles": state_of(self.soil)}

    def _restore(self, state: State) -> None:
        restore(self.soil, state["particles"])

    def continuum(self) -> ContinuumFields | None:
        """Fields of the continuum, where there is one."""
        return None

    def parallel(self) -> dict[str, Any]:
        """How the work is shared out over the ranks; empty on one."""
        return parallel(self.soil)

    def loose(self) -> np.ndarray:
        """Fragment (n,) of each disc; 0 is the block."""
        return fragments(self.soil)


class ParticleBlock(Block):
    """Discs everywhere; those at the sides and at the bottom are held."""

    def __init__(self, p: Parameters) -> None:
        super().__init__(p)
        self.soil = spread(scene.bonded(p))
        width, height = p.size
        x, y = self.soil.reference.T
        reach = scene.HELD * scene.RADII[1]
        self.soil.hold(np.flatnonzero((np.abs(x) > 0.5 * width - reach) | (y < reach - height)))
        critical = critical_step(p, self.soil, self.soil.critical_step(sharp=True, contact_range=p.bond_reach))
        self.step = p.step_ratio * critical
        self.steps = math.ceil(p.duration / self.step)
        self.pick = armed(p, self.soil)
        self.counts = {
            "particles": self.soil.count, "bonds": len(self.soil.bonds), "elements": 0, "coarse_steps": 0, "fine_steps": self.steps
        }  # fmt: skip
        self.step_sizes = {"fine": self.step, "fine_critical": critical}

    @property
    def time(self) -> float:
        return self.soil.time

    def advance(self, steps: int) -> None:
        self.soil.advance(steps, self.step, vector_damping=(self.p.damping, self.p.damping))

    def energies(self) -> dict[str, float]:
        terms = self.soil.energies()
        return terms | {"external_work": terms["wall_work"], "balance": self.soil.energy_balance()}


class OverlapParts:
    """Discs where the pick cuts and the continuum elsewhere, spread over the ranks; every method is collective.

    Args:
        comm: the ranks; rank 0 makes the discs.
        p: parameters.
    """

    def __init__(self, comm: Any, p: Parameters) -> None:
        try:
            self._make(comm, p)
        except ValueError as failure:
            failure.on_all_ranks = True  # type: ignore[attr-defined]
            raise

    def _make(self, comm: Any, p: Parameters) -> None:
        self.soil = scene.discs(p, np.zeros((0, 2)), np.zeros(0))
        on_root(comm, lambda: self._fill(p))
        zone = scene.zone(p)
        self.body = scene.body(p, zone, comm)
        options: dict[str, Any] = {"vector_damping": (p.damping, p.damping)} if p.damping else {}
        coarse = self.body.critical_step("power")
        alone = Overlap(self.body, self.soil, zone, step=1e-3 * coarse, **options).critical_step(sharp=True)
        critical = on_root(comm, lambda: critical_step(p, self.soil, alone))
        fine = p.step_ratio * critical
        self.substeps = max(1, int(COARSE_RATIO * coarse / fine))
        self.step = self.substeps * fine
        self.step_sizes = {"coarse": self.step, "coarse_critical": coarse, "fine": fine, "fine_critical": critical}
        self.pick = armed(p, self.soil) if comm.rank == 0 else None
        self.coupled = Overlap(self.body, self.soil, zone, step=self.step, substeps=self.substeps, spread=True, **options)
        self._watch = Stopwatch()
        self.coupled.fine.run_loop = self._watch.part("particles", self.coupled.fine.run_loop)
        self.counts = {
            "particles": self.soil.count, "tied": comm.allreduce(len(self.coupled.tie.ids)), "bonds": len(self.soil.bonds),
            "elements": comm.allreduce(len(self.body.cell_nodes)),
        }  # fmt: skip
        self.energies, self.state, self.restore = self.coupled.energies, self.coupled.state, self.coupled.restore
        self.advance, self.collect, self.release = self.coupled.advance, self.coupled.collect, self.coupled.release

    def _fill(self, p: Parameters) -> None:
        centres, _ = scene.sites(p)
        self.soil = scene.bonded(p, scene.region(p).distance(centres) <= 0.0)

    def continuum(self) -> ContinuumFields | None:
        """Fields of the continuum, on rank 0."""
        return continuum_fields(self.body)

    def parallel(self) -> dict[str, Any]:
        """How the work is shared out."""
        return self.coupled.parallel(self._watch.parts.get("particles", 0.0))


class OverlapBlock(Block):
    """Discs where the pick cuts, the continuum elsewhere."""

    def __init__(self, p: Parameters) -> None:
        super().__init__(p)
        self._all = Placed(OverlapParts, p)
        parts = self._all.own
        self._soil, self._fresh = parts.soil, True
        self.body, self.pick, self.step, self.step_sizes = parts.body, parts.pick, parts.step, parts.step_sizes
        self.steps = math.ceil(p.duration / self.step)
        self.counts = parts.counts | {"coarse_steps": self.steps, "fine_steps": parts.substeps * self.steps}

    @property
    def soil(self) -> Any:  # type: ignore[override]
        """The discs as they are now."""
        if not self._fresh:
            self._all.ask("collect")
            self._fresh = True
        return self._soil

    @property
    def time(self) -> float:
        return self._all.own.coupled.time

    def advance(self, steps: int) -> None:
        self._fresh = False
        self._all.ask("advance", steps)

    def energies(self) -> dict[str, float]:
        terms = self._all.ask("energies")
        return terms | {"external_work": terms["external"]}

    def continuum(self) -> ContinuumFields | None:
        return self._all.ask("continuum")

    def parallel(self) -> dict[str, Any]:
        return self._all.ask("parallel")

    def _state(self) -> State:
        return {"coupled": self._all.ask("state")}

    def _restore(self, state: State) -> None:
        self._all.ask("restore", state["coupled"])


MODELS: dict[str, Callable[[Parameters], Block]] = {"dem": ParticleBlock, "overlap": OverlapBlock}
