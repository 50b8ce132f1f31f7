"""One bonded specimen between two plates; `bridge.run.run` advances it."""

from __future__ import annotations

import math

import numpy as np

from particles import Assembly, Wall, measures, shapes
from particles.laws.bonded import Bonded
from particles.spread import restore, spread, state_of
from particles.state import State
from studies import packing_cache
from studies.rock import Parameters


def specimen(p: Parameters, seed: int) -> Assembly:
    """Random dense packing in the region of the test, bonded as it lies, without force."""
    places, radii = packing_cache.random_dense(
        p.region, (p.smallest_radius, p.largest_radius), p.porosity, seed, exponent=p.size_exponent, nearest=True
    )
    law = Bonded(p.normal_stiffness, p.shear_stiffness, p.tensile_strength, p.shear_strength, friction=p.friction)
    soil = spread(Assembly(places, radii, p.density, law))
    soil.bond(p.bond_reach)
    return soil


class Specimen:
    """A specimen that two plates press, along y, each at the same speed; discs in id order, centre at the origin.

    Args:
        p: parameters of the test.
        seed: of the packing.
    """

    def __init__(self, p: Parameters, seed: int) -> None:
        self.parameters, self.seed = p, seed
        self.soil = soil = specimen(p, seed)
        self.bonds = soil.bonds
        half = 0.5 * p.inner * np.array(p.size)
        self.box = -half, half
        self.inside = np.flatnonzero((np.abs(soil.reference) < half).all(axis=1))
        if len(self.inside) < 10:
            raise ValueError(f"inner={p.inner:g} must be larger: only {len(self.inside)} discs lie in the inner volume")
        self.affine = measures.moduli(soil, math.prod(2.0 * half), self.inside)[0]  # (2, 2, 2, 2) of the inner volume, Pa
        height = p.size[1]
        law = Bonded(p.normal_stiffness, p.shear_stiffness, p.tensile_strength, p.shear_strength, friction=p.plate_friction)
        self.plates = tuple(
            Wall(shapes.plane((0.0, side * 0.5 * height), (0.0, -side)), velocity=(0.0, -side * p.speed), law=law, name=name)
            for side, name in ((1.0, "top plate"), (-1.0, "bottom plate"))
        )
        soil.add_wall(*self.plates)
        # damping that opposes the motion adds up to its share to the forces that turn a vibration round
        self.critical = soil.critical_step(sharp=True, contact_range=p.bond_reach) / math.sqrt(1.0 + p.damping)
        self.step = p.step_ratio * self.critical
        self.steps = math.ceil(0.5 * p.strain * height / (p.speed * self.step))
        self._places = np.column_stack([np.ones(len(self.inside)), soil.reference[self.inside]])
        self._peak = 0.0

    @property
    def porosity(self) -> float:
        """Of the packing."""
        return 1.0 - math.pi * float((self.soil.radii**2).sum()) / self.parameters.area

    @property
    def radius(self) -> float:
        """Root mean square radius, m: the length of the dimensionless relations."""
        return math.sqrt(float((self.soil.radii**2).mean()))

    def state(self) -> State:
        """All that `restore` needs."""
        return {"particles": state_of(self.soil), "peak": self._peak}

    def restore(self, state: State) -> None:
        """Go on from a state."""
        restore(self.soil, state["particles"])
        self._peak = float(state["peak"])

    # What `run` needs ---------------------------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """Time since the plates set off, s."""
        return self.soil.time

    def advance(self, steps: int) -> None:
        """Make steps."""
        damping = self.parameters.damping
        self.soil.advance(steps, self.step, vector_damping=(damping, damping))

    def sample(self) -> dict[str, float]:
        """Load, stresses, strains, cracks and energies now."""
        p = self.parameters
        top, bottom = float(self.plates[0].force[1]), -float(self.plates[1].force[1])
        stress = measures.region_average(self.soil, self.box)
        strain = self.strain()
        terms = self.soil.energies()
        return {
            "time_s": self.time, "strain": 2.0 * p.speed * self.time / p.size[1], "plate_stress_Pa": p.stress(0.5 * (top + bottom)),
            "top_force_N": top, "bottom_force_N": bottom, "averaged_stress_axial_Pa": -stress[1, 1],
            "averaged_stress_lateral_Pa": -stress[0, 0], "inner_strain_axial": -strain[1, 1],
            "inner_strain_lateral": -strain[0, 0], "cracks": float(len(self.soil.breaks)), "kinetic_J": terms["kinetic"],
            "elastic_J": terms["elastic_normal"] + terms["elastic_sliding"], "breaking_J": terms["breaking"],
        }  # fmt: skip

    def energies(self) -> dict[str, float]:
        """Terms since the start, J; `external_work` is that of the plates."""
        terms = self.soil.energies()
        return terms | {"external_work": terms["wall_work"], "balance": self.soil.energy_balance()}

    # Results -------------------------------------------------------------------------------------------------------------

    def strain(self) -> np.ndarray:
        """Strain (2, 2) of the inner volume, positive in tension: of the linear field nearest to its discs' displacements."""
        gradient = np.linalg.lstsq(self._places, self.soil.displacements[self.inside, :2], rcond=None)[0][1:]
        return 0.5 * (gradient + gradient.T)

    def is_broken(self, row: dict[str, float]) -> bool:
        """Whether the load has fallen from its peak for good: to the share `drop`, with cracks for a way through."""
        self._peak = max(self._peak, row["plate_stress_Pa"])
        through = self.parameters.size[1] / (2.0 * self.radius)  # discs from plate to plate
        return row["cracks"] >= through and row["plate_stress_Pa"] <= self.parameters.drop * self._peak
