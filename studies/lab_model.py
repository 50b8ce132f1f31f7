"""The model of an element test: packing, isotropic compression, and the loading that `bridge.run.run` advances."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from particles import Assembly, LiChu, PeriodicCell
from particles.measures import coordination, moduli
from particles.spread import restore, state_of
from particles.spread import spread as shared
from particles.state import State
from studies import packing_cache
from studies.lab import Parameters
from studies.lab_cell import ServoCell

TOLERANCE = 2e-3  # of the isotropic state
PROBE = 0.1  # strain over which moduli are fitted, in 1 / kappa
SLOWER = 0.1  # rate of that first part, as a share of the rate of the test
LOOSENING = 1.08  # linear expansion of a packing that is shaken loose


class Probe(NamedTuple):
    """Small strains and stresses at the start of the loading (k, axes), along the axes, tension positive."""

    strain: np.ndarray
    stress: np.ndarray  # Pa, change


class ElementTest:
    """An isotropic packing and its loading; `settled` says whether the confining stress was reached.

    Args:
        p: parameters.
        begun: state of a loading that was begun before; without it the packing is made and compressed.
    """

    def __init__(self, p: Parameters, begun: State | None = None) -> None:
        self.parameters = p
        places, radii, size = packing(p)
        if begun is not None:
            self.cell = PeriodicCell(begun["cell"])
            self._make_sheared(begun["particles"]["reference"], radii)
            return
        loose = p.preparation_friction > 0.0
        wider = LOOSENING if loose else 1.0
        cell = PeriodicCell(wider * size)
        first = shared(Assembly(wider * places, radii, p.density, law(p, p.preparation_friction), cell=cell))
        if loose:
            shake(first, p)
        settled = servo(p, first, wider - 1.0).compress(p.pressure, TOLERANCE)
        self.cell = PeriodicCell(cell.matrix.diagonal())
        self._make_sheared(first.positions, radii)
        self.servo = servo(p, self.soil)
        self.settled = self.servo.compress(p.pressure, TOLERANCE) and settled
        self.servo.rest()
        self.step = self.servo.step
        self.start = self.cell.matrix
        self.work_before = self.soil.energies()["cell_work"]
        self._begun = self.soil.time
        self.isotropic = self.sample()  # the state before loading
        self.voigt = voigt(self.soil, self.cell.volume)
        self.probe = self._measure()
        self._load(1.0)
        self.steps = max(math.ceil((p.strain - self.strain) / (p.rate * self.step)), 1)

    def _make_sheared(self, places: np.ndarray, radii: np.ndarray) -> None:
        """The packing with the friction of the test."""
        p = self.parameters
        self.soil = shared(Assembly(places, radii, p.density, law(p, p.friction), cell=self.cell))
        self._solid = self.soil.masses.sum() / p.density  # m3 (m2)

    def state(self) -> State:
        """All that `restore` needs."""
        numbers = {"work_before": self.work_before, "begun": self._begun, "settled": float(self.settled), "steps": self.steps}
        probe = {} if self.probe is None else {"probe": self.probe._asdict()}
        return {
            "particles": state_of(self.soil), "cell": np.diag(self.cell.start), "start": self.start, "servo": self.servo.state(),
            "isotropic": self.isotropic, "voigt": np.array(self.voigt), "numbers": numbers, **probe,
        }  # fmt: skip

    def restore(self, state: State) -> None:
        """Go on from a state."""
        restore(self.soil, state["particles"])
        self.servo = ServoCell.restored(self.soil, state["servo"])
        self.step, self.start = self.servo.step, state["start"]
        self.isotropic = {name: float(value) for name, value in state["isotropic"].items()}
        young, poisson = state["voigt"].tolist()
        self.voigt = young, poisson
        self.probe = Probe(**state["probe"]) if "probe" in state else None
        numbers = {name: float(value) for name, value in state["numbers"].items()}
        self.work_before, self._begun = numbers["work_before"], numbers["begun"]
        self.settled, self.steps = bool(numbers["settled"]), int(numbers["steps"])

    # What `run` needs ---------------------------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """Time since the loading began, s."""
        return self.soil.time - self._begun

    def advance(self, steps: int) -> None:
        """Make steps of the loading."""
        self.servo.advance(steps)

    def sample(self) -> dict[str, float]:
        """State now: strains, stresses (compression positive), and what the packing looks like."""
        soil, p = self.soil, self.parameters
        stress = -soil.cell_stress()
        stress = 0.5 * (stress + stress.T)
        volume = self.cell.volume
        values = np.linalg.eigvalsh(stress)
        row = {"time_s": self.time}
        if p.study == "shear":
            row |= {"shear_strain": self.strain, "volumetric_strain": math.log(volume / np.linalg.det(self.start)),
                    "normal_stress_Pa": stress[1, 1], "shear_stress_Pa": -stress[0, 1], "lateral_stress_Pa": stress[0, 0],
                    "stress_ratio": -stress[0, 1] / stress[1, 1]}  # fmt: skip
        else:
            lateral = np.diag(stress)[:-1]
            row |= {"axial_strain": self.strain, "volumetric_strain": math.log(volume / np.linalg.det(self.start)),
                    "axial_stress_Pa": stress[-1, -1], "lateral_stress_Pa": float(lateral.mean()),
                    "deviator_stress_Pa": stress[-1, -1] - float(lateral.mean()),
                    "stress_ratio": stress[-1, -1] / float(lateral.mean())}  # fmt: skip
        terms = soil.energies()
        elastic = sum(terms[name] for name in terms if name.startswith("elastic_"))
        return row | {
            "friction_angle_deg": math.degrees(math.asin((values[-1] - values[0]) / (values[-1] + values[0]))),
            "porosity": 1.0 - self._solid / volume, "coordination": coordination(soil, rattlers=False),
            "cell_work_J": terms["cell_work"] - self.work_before, "kinetic_J": terms["kinetic"], "elastic_J": elastic,
            "friction_J": terms["friction_sliding"] + terms["friction_rolling"],
        }  # fmt: skip

    def energies(self) -> dict[str, float]:
        """Terms since the cell with friction was made, J; `external_work` is that of the cell's edges."""
        terms = self.soil.energies()
        return terms | {"external_work": terms["cell_work"], "balance": self.soil.energy_balance()}

    # Loading -------------------------------------------------------------------------------------------------------------

    @property
    def strain(self) -> float:
        """Axial strain (compression positive), or shear strain."""
        if self.parameters.study == "shear":
            return self.parameters.rate * self.time
        return math.log(self.start[-1, -1] / self.cell.matrix[-1, -1])

    @property
    def deformation(self) -> np.ndarray:
        """Deformation gradient of the cell (axes, axes) since the loading began."""
        now = self.cell.matrix
        if self.parameters.study == "shear":  # the cell takes whole edges off an edge that leans too far over
            lean = now[0, 1] - self.strain * now[1, 1]
            now[0, 1] -= np.round(lean / now[0, 0]) * now[0, 0]
        return now @ np.linalg.inv(self.start)

    def _load(self, share: float) -> None:
        """Set the loading at a share of the rate."""
        p = self.parameters
        gradient = np.zeros((p.axes, p.axes))
        if p.study == "shear":
            gradient[0, 1] = share * p.rate
            self.servo.impose(gradient, {1: p.pressure})
        else:
            gradient[-1, -1] = -share * p.rate
            self.servo.impose(gradient, dict.fromkeys(range(p.axes - 1), p.pressure))

    def _measure(self) -> Probe | None:
        """The first small strain, slowly; compression tests only."""
        p = self.parameters
        if p.study == "shear":
            return None
        self._load(SLOWER)
        start, before = np.diag(self.start), self.soil.cell_stress().diagonal()
        strains, stresses = [], []
        while self.strain < PROBE / p.stiffness_level:
            self.advance(self.servo.interval)
            strains.append(np.log(np.diag(self.cell.matrix) / start))
            stresses.append(self.soil.cell_stress().diagonal() - before)
        return Probe(np.array(strains), np.array(stresses))


def packing(p: Parameters) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions (n, axes), radii (n,) and size (axes,) of a packing that just touches, m."""
    low = p.radius / p.size_ratio
    # mean square or cube of radii that are uniformly distributed
    if p.axes == 2:
        mean = math.pi * (p.radius**2 + p.radius * low + low**2) / 3.0
    else:
        mean = math.pi / 3.0 * (p.radius + low) * (p.radius**2 + low**2)
    side = (p.particles * mean / (1.0 - packing_cache.JAMMED[p.axes])) ** (1.0 / p.axes)
    bounds = (0.0,) * p.axes, (side,) * p.axes
    places, radii = packing_cache.jammed(bounds, (low, p.radius), p.seed, periodic=True)
    return places, radii, np.full(p.axes, side)


def law(p: Parameters, friction: float) -> LiChu:
    """Contact law with a friction coefficient."""
    normal = p.normal_stiffness
    damper = 2.0 * p.damping * math.sqrt(0.5 * p.mass * normal)
    rolls = p.rolling_friction > 0.0 and friction > 0.0
    return LiChu(
        normal, p.stiffness_ratio * normal if friction else 0.0, p.stiffness_ratio * normal if rolls else 0.0,
        normal_damping=damper, sliding_damping=damper * math.sqrt(p.stiffness_ratio) if friction else 0.0,
        sliding_friction=friction, rolling_friction=p.rolling_friction if rolls else 0.0,
    )  # fmt: skip


def servo(p: Parameters, soil: Assembly, gap: float = 0.0) -> ServoCell:
    """Servo with the step and the modulus of the parameters; `gap` between particles as a share of their distance."""
    # with the pairs that come into contact when the packing is compressed
    step = p.step_ratio * soil.critical_step(sharp=True, contact_range=0.01 + gap)
    return ServoCell(soil, step, p.stiffness_level * p.pressure)


def shake(soil: Assembly, p: Parameters) -> None:
    """Give random velocities, so fast that particles meet others on the way to the confining stress."""
    rng = np.random.default_rng(p.seed)
    motion = np.zeros((soil.count, soil.freedoms))
    motion[:, : p.axes] = rng.standard_normal((soil.count, p.axes))
    motion -= motion.mean(axis=0)
    soil.velocities = motion * 0.3 * math.sqrt(p.pressure / p.density)


def voigt(soil: Assembly, volume: float) -> tuple[float, float]:
    """Young modulus (Pa) and Poisson ratio of the isotropic part of the moduli under affine motion (Voigt bound)."""
    d, _ = moduli(soil, volume, contact_range=0.0)
    along = np.einsum("iiii->", d) / soil.axes
    across = (np.einsum("iijj->", d) - soil.axes * along) / (soil.axes * (soil.axes - 1))
    return elastic_constants(along, across, soil.axes)


def elastic_constants(along: float, across: float, axes: int) -> tuple[float, float]:
    """Young modulus and Poisson ratio of an isotropic body with D_1111 and D_1122, in the plane or in space."""
    ratio = across / (along + (axes - 2) * across)
    return along - (axes - 1) * ratio * across, ratio


def fitted_moduli(probe: Probe) -> tuple[float, float]:
    """Young modulus (Pa) and Poisson ratio that fit eps_i = ((1 + nu) sigma_i - nu tr sigma) / E by least squares."""
    trace = np.broadcast_to(probe.stress.sum(axis=1, keepdims=True), probe.stress.shape)
    columns = np.column_stack([probe.stress.ravel(), trace.ravel()])
    (a, b), *_ = np.linalg.lstsq(columns, probe.strain.ravel(), rcond=None)
    return 1.0 / (a + b), -b / (a + b)
