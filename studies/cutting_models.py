"""The block under the pick by each method; `bridge.run.run` advances them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from bridge import Overlap, kept
from particles.spread import restore, spread
from particles.state import State, state_of
from studies import cutting as scene
from studies.cracks import fragments
from studies.cutting import Parameters

COARSE_RATIO = 0.6  # largest step of the continuum as a share of its critical step


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
    body: Any = None

    def __init__(self, p: Parameters) -> None:
        self.p = p
        self._before = 0.0, 0.0

    def _fine(self, critical: float) -> float:
        """Step of the discs, s, from the critical one without the pick.

        A contact with the pick, far from the zone, adds k / m to the square of the largest frequency at most (Weyl); damping against
        the motion adds up to its share to the forces that turn a vibration round.
        """
        added = self.p.tool_stiffness / (self.p.density * math.pi * float(self.soil.radii.min()) ** 2)
        self.critical = 2.0 / math.sqrt(((2.0 / critical) ** 2 + added) * (1.0 + self.p.damping))
        return self.p.step_ratio * self.critical

    def _arm(self) -> None:
        self.pick = scene.pick(self.p)
        self.soil.add_wall(self.pick)

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
        self.step = self._fine(self.soil.critical_step(sharp=True, contact_range=p.bond_reach))
        self.steps = math.ceil(p.duration / self.step)
        self._arm()
        self.counts = {
            "particles": self.soil.count, "bonds": len(self.soil.bonds), "elements": 0, "coarse_steps": 0, "fine_steps": self.steps
        }  # fmt: skip
        self.step_sizes = {"fine": self.step, "fine_critical": self.critical}

    @property
    def time(self) -> float:
        return self.soil.time

    def advance(self, steps: int) -> None:
        self.soil.advance(steps, self.step, vector_damping=(self.p.damping, self.p.damping))

    def energies(self) -> dict[str, float]:
        terms = self.soil.energies()
        return terms | {"external_work": terms["wall_work"], "balance": self.soil.energy_balance()}


class OverlapBlock(Block):
    """Discs where the pick cuts, the continuum elsewhere."""

    def __init__(self, p: Parameters) -> None:
        super().__init__(p)
        centres, _ = scene.sites(p)
        self.soil = scene.bonded(p, scene.region(p).distance(centres) <= 0.0)
        zone = scene.zone(p)
        self.body = scene.body(p, zone)
        options: dict[str, Any] = {"vector_damping": (p.damping, p.damping)} if p.damping else {}
        coarse = self.body.critical_step("power")
        trial = Overlap(self.body, self.soil, zone, step=1e-3 * coarse, **options)
        fine = self._fine(trial.critical_step(sharp=True))
        substeps = max(1, int(COARSE_RATIO * coarse / fine))
        self.step = substeps * fine
        self.steps = math.ceil(p.duration / self.step)
        self._arm()
        self.coupled = Overlap(self.body, self.soil, zone, step=self.step, substeps=substeps, **options)
        self.counts = {
            "particles": self.soil.count, "tied": len(self.coupled.tie.ids), "bonds": len(self.soil.bonds),
            "elements": len(self.body.cell_nodes), "coarse_steps": self.steps, "fine_steps": substeps * self.steps,
        }  # fmt: skip
        self.step_sizes = {"coarse": self.step, "coarse_critical": coarse, "fine": fine, "fine_critical": self.critical}

    @property
    def time(self) -> float:
        return self.coupled.time

    def advance(self, steps: int) -> None:
        self.coupled.advance(steps)

    def energies(self) -> dict[str, float]:
        terms = self.coupled.energies()
        return terms | {"external_work": terms["external"]}

    def _state(self) -> State:
        return {"coupled": kept.coupled_state(self.coupled)}

    def _restore(self, state: State) -> None:
        kept.restore_coupled(self.coupled, state["coupled"])


MODELS: dict[str, Callable[[Parameters], Block]] = {"dem": ParticleBlock, "overlap": OverlapBlock}
