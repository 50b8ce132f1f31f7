"""One column: packed, settled between wall and gate, released; `bridge.run.run` advances it."""

from __future__ import annotations

import math

import numpy as np

from particles import Assembly, LiChu, Plate
from particles.driving import settle
from particles.spread import restore, spread, state_of
from particles.state import State
from studies import packing_cache
from studies.column import GRAVITY, Parameters

LASTS = 5.0  # time of fall, spreading and coming to rest, in sqrt(H/g) + sqrt(L0/g)
SETTLED = 1e-2  # unbalanced over contact forces of a settled column
ANGLE_PART = (0.15, 0.85)  # part of the free surface, between wall and front, to which the angle is fitted


class Column:
    """A column at rest that is about to fall; discs in id order, floor at y = 0, wall at x = 0.

    Args:
        p: parameters.
        aspect: height over width before it settles.
        begun: state of a fall that was begun before; without it the column is settled.
    """

    def __init__(self, p: Parameters, aspect: float, begun: State | None = None) -> None:
        self.parameters = p
        low = p.radius / p.size_ratio
        mean = math.pi * (p.radius**2 + p.radius * low + low**2) / 3.0  # area of a disc
        width = math.sqrt(p.particles * mean / ((1.0 - packing_cache.JAMMED[2]) * aspect))
        height = aspect * width
        places, radii = packing_cache.jammed(((0.0, 0.0), (width, height)), (low, p.radius), p.seed)
        stiffness = p.stiffness_level * p.density * GRAVITY * height
        self._mass = p.density * mean
        self.width = width
        settled = self._settled(places, radii, stiffness) if begun is None else begun["particles"]["reference"]
        self.height = float((settled[:, 1] + radii).max())
        self.aspect = self.height / width
        self.soil = spread(Assembly(settled, radii, p.density, self._law(stiffness, p.friction, p.rolling_friction)))
        reach = width * (3.0 + 4.0 * aspect)
        thick = 4.0 * p.radius
        self.soil.add_wall(Plate.rectangle((-thick, -thick), (20.0 * reach, 0.0), name="floor"), self._wall(0.0, -thick))
        self.step = p.step_ratio * self.soil.critical_step(sharp=True, contact_range=0.01)
        lasting = LASTS * (math.sqrt(height / GRAVITY) + math.sqrt(width / GRAVITY))
        self.steps = math.ceil(lasting / self.step)
        self.potential = float((self.soil.masses * settled[:, 1]).sum()) * GRAVITY  # J, above the floor

    def _law(self, stiffness: float, friction: float, rolling: float) -> LiChu:
        p = self.parameters
        damper = 2.0 * p.damping * math.sqrt(0.5 * self._mass * stiffness)
        rough = 0.5 * stiffness if friction else 0.0
        return LiChu(
            stiffness, rough, rough if rolling else 0.0, normal_damping=damper, sliding_damping=0.7 * damper if rough else 0.0,
            sliding_friction=friction, rolling_friction=rolling if rough else 0.0,
        )  # fmt: skip

    def _wall(self, x: float, thickness: float) -> Plate:
        """Smooth wall with its face at x, thick to the left (negative thickness) or right."""
        left, right = sorted((x, x + thickness))
        tall = 3.0 * self.parameters.particles * self.parameters.radius
        return Plate.rectangle((left, -1.0 * abs(thickness)), (right, tall), frictionless=True, name="wall")

    def _settled(self, places: np.ndarray, radii: np.ndarray, stiffness: float) -> np.ndarray:
        """Positions at rest under gravity between wall and gate, without friction (no forces that the release would lose)."""
        p, thick = self.parameters, 4.0 * self.parameters.radius
        soil = spread(Assembly(places, radii, p.density, self._law(stiffness, 0.0, 0.0)))
        floor = Plate.rectangle((-thick, -thick), (self.width + thick, 0.0), name="floor")
        soil.add_wall(floor, self._wall(0.0, -thick), self._wall(self.width, thick))
        step = p.step_ratio * soil.critical_step(sharp=True, contact_range=0.01)
        settle(soil, step, SETTLED, gravity=(0.0, -GRAVITY))
        return soil.positions

    def state(self) -> State:
        """All that `restore` needs."""
        return {"particles": state_of(self.soil)}

    def restore(self, state: State) -> None:
        """Go on from a state."""
        restore(self.soil, state["particles"])

    # What `run` needs ---------------------------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """Time since the release, s."""
        return self.soil.time

    def advance(self, steps: int) -> None:
        """Make steps under gravity."""
        self.soil.advance(steps, self.step, gravity=(0.0, -GRAVITY))

    def sample(self) -> dict[str, float]:
        """Front, height and energies now."""
        terms = self.soil.energies()
        places = self.soil.positions
        moving = self.soil.velocities[:, :2].T * self.soil.masses
        return {
            "time_s": self.time, "front_m": self.front, "runout": self.front / self.width - 1.0,
            "height_m": float((places[:, 1] + self.soil.radii).max()), "kinetic_J": terms["kinetic"],
            "potential_J": self.potential - terms["gravity_work"], "momentum_x_Ns": moving[0].sum(),
            "momentum_y_Ns": moving[1].sum(),
        }  # fmt: skip

    def energies(self) -> dict[str, float]:
        """Terms since the release, J; `external_work` is that of gravity."""
        terms = self.soil.energies()
        return terms | {"external_work": terms["gravity_work"], "balance": self.soil.energy_balance()}

    # Results -------------------------------------------------------------------------------------------------------------

    @property
    def heap(self) -> np.ndarray:
        """Discs (n,) of the heap that hangs together over contacts; single discs that roll on beyond it do not count."""
        from scipy import sparse
        from scipy.sparse.csgraph import connected_components

        count = self.soil.count
        # discs that roll side by side just miss each other at most times
        found = self.soil.contacts(contact_range=0.02)
        links = sparse.coo_matrix((np.ones(len(found.first)), (found.first, found.second)), shape=(count, count))
        _, group = connected_components(links, directed=False)
        return group == np.bincount(group).argmax()

    @property
    def front(self) -> float:
        """Right end of the heap, m."""
        return float((self.soil.positions[:, 0] + self.soil.radii)[self.heap].max())

    @property
    def heap_kinetic(self) -> float:
        """Kinetic energy of the heap, J."""
        weights = np.column_stack([self.soil.masses, self.soil.masses, self.soil.inertias])
        return float(0.5 * (weights * self.soil.velocities**2)[self.heap].sum())

    def surface(self) -> tuple[np.ndarray, np.ndarray]:
        """Profile of the heap: middles of strips two largest discs wide and height of the highest disc in each, m."""
        places, radii = self.soil.positions, self.soil.radii
        strip = 4.0 * self.parameters.radius
        edges = np.arange(0.0, self.front + strip, strip)
        place = np.digitize(places[:, 0], edges) - 1
        middle = 0.5 * (edges[1:] + edges[:-1])
        top = np.array([(places[place == k, 1] + radii[place == k]).max(initial=0.0) for k in range(len(middle))])
        return middle, top

    def heap_angle(self) -> float:
        """Slope (deg) of the free surface between wall and front, by least squares."""
        middle, top = self.surface()
        # a short column keeps a flat top: the slope begins where the surface leaves it
        begin = middle[top > top.max() - 3.0 * self.parameters.radius].max()
        share = (middle - begin) / (self.front - begin)
        part = (share > ANGLE_PART[0]) & (share < ANGLE_PART[1])
        if part.sum() < 3:
            return math.nan
        return math.degrees(math.atan(-np.polyfit(middle[part], top[part], 1)[0]))
