"""The state of all discs: positions, motion, histories, neighbour list, plates; and the run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from particles import energies, motion, neighbours, network, stability, walls
from particles.dispatch import Direct
from particles.laws.li_chu import COLUMNS, LiChu, compile_law
from particles.motion import Unstable
from particles.system import (
    ANGLE,
    INVERSE_MASS,
    RADIUS,
    SMALLEST_RADIUS,
    SPIN,
    TIME,
    TRAVEL,
    TRAVEL_LIMIT,
    VX,
    VY,
    Held,
    System,
    Terms,
    Walls,
    X,
    Y,
)  # fmt: skip
from particles.walls import Plate

_advance, _stale, _runaway = Direct(motion.advance), Direct(motion.stale), Direct(motion.runaway)
_hold_plates = Direct(walls.hold_plates)

SKIN = 0.12  # default skin as a share of the mean radius
_PLACES = np.array([X, Y, ANGLE])
_RATES = np.array([VX, VY, SPIN])


def _finite(name: str, values: Any, shape: tuple[int, ...]) -> np.ndarray:
    array = np.array(values, dtype=float)
    if array.size == 0 and shape[0] == 0:
        array = array.reshape(shape)
    if array.shape != shape:
        raise ValueError(f"{name} of shape {array.shape} must have shape {shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite numbers (first bad one: index {np.argwhere(~np.isfinite(array))[0]})")
    return array


class Assembly:
    """Discs with translation and rotation, per metre of thickness.

    Arrays of this class are copies in the caller's order ("id order"), shape (n, 3) = (x, y, rotation), SI units.

    Args:
        positions: (n, 2) centres, m; the reference of displacements.
        radii: (n,) or a number, m.
        density: of the solid, kg/m3; (n,) allowed.
        law: contact law, or a mapping {(a, b): LiChu} for all pairs of material ids a <= b.
        skin: reach of the neighbour list beyond contact, m (default 0.12 mean radii).
        materials: (n,) material ids 0, 1, ... (with a mapping of laws).

    Raises:
        ValueError: shapes, signs or numbers that make no sense, or a pair of materials without a law.
    """

    def __init__(
        self,
        positions: Any,
        radii: Any,
        density: Any = 2600.0,
        law: LiChu | Mapping[tuple[int, int], LiChu] | None = None,
        skin: float | None = None,
        materials: Any = None,
    ) -> None:
        count = len(positions)
        self._reference = _finite("positions", positions, (count, 2))
        self._radii = _finite("radii", np.broadcast_to(radii, (count,)) if np.ndim(radii) == 0 else radii, (count,))
        if not (self._radii > 0.0).all():
            raise ValueError(f"radii={self._radii.min():g} must be positive (m)")
        density = _finite("density", np.broadcast_to(density, (count,)) if np.ndim(density) == 0 else density, (count,))
        if not (density > 0.0).all():
            raise ValueError(f"density={density.min():g} must be positive (kg/m3)")
        self._set_laws(law, materials)
        mean = float(self._radii.mean()) if count else 1.0
        self.skin = SKIN * mean if skin is None else float(skin)
        if not (np.isfinite(self.skin) and self.skin > 0.0):
            raise ValueError(f"skin={skin} must be positive (m)")
        self.count = count
        self.generation = 0
        self.plates: list[Plate] = []
        self.rebuilds = 0
        self._held: dict[int, np.ndarray] = {}
        self._ids = np.arange(count, dtype=np.int32)  # id of each row
        self._rows = np.arange(count, dtype=np.int32)  # row of each id
        self._ghost = np.zeros(count, dtype=bool)
        self._external: np.ndarray | None = None
        self._plate_rows: np.ndarray = np.zeros((0, 12))
        self._primed: tuple | None = None
        self._loads: tuple[dict[str, Any], Terms] | None = None  # of the last run
        self._step = 0.0
        self._imposed = 0.0
        self._sorted_at: np.ndarray | None = None

        masses = density * np.pi * self._radii**2
        state = np.zeros((count, 8))
        state[:, :2] = self._reference
        state[:, RADIUS] = self._radii
        state[:, INVERSE_MASS] = 1.0 / masses
        channels = self._columns_that_turn.size
        none = np.zeros(0, dtype=np.int32)
        clock = np.zeros(4)
        clock[TRAVEL_LIMIT] = 0.5 * self.skin
        clock[SMALLEST_RADIUS] = self._radii.min() if count else 1.0
        self._system = System(
            state=state, acceleration=np.zeros((count, 3)), force=np.zeros((count, 3)),
            start=np.zeros(count + 1, dtype=np.int32), neighbour=none, history=np.zeros((0, channels)),
            material=self._materials, external=None, walls=None, held=None, listed=state[:, :2].copy(),
            sums=np.zeros(12), clock=clock,
        )  # fmt: skip
        self._rebuild()
        self._refuse_coincident()
        self._imposed = self._mechanical()

    def _refuse_coincident(self) -> None:
        """Two discs in one place have no contact normal."""
        system = self._system
        first = np.repeat(np.arange(self.count), np.diff(system.start))
        same = np.flatnonzero((system.state[first, :2] == system.state[system.neighbour, :2]).all(axis=1))
        if same.size:
            a, b = self._ids[first[same[0]]], self._ids[system.neighbour[same[0]]]
            raise ValueError(f"positions of discs {min(a, b)} and {max(a, b)} are the same; move one of them")

    def _set_laws(self, law: Any, materials: Any) -> None:
        count = len(self._radii)
        if isinstance(law, LiChu):
            self.laws = {(0, 0): law}
        elif isinstance(law, Mapping) and law:
            self.laws = {(min(pair), max(pair)): value for pair, value in law.items()}
        else:
            raise ValueError("law must be a LiChu or a mapping {(material, material): LiChu}")
        self._materials: np.ndarray | None = None
        self._table: np.ndarray | None = None
        self._material_count = 1
        if len(self.laws) > 1 or materials is not None:
            ids = np.zeros(count, dtype=np.int32) if materials is None else np.array(materials, dtype=np.int32)
            if ids.shape != (count,) or (ids < 0).any():
                raise ValueError(f"materials must be {count} ids from 0 upwards, one for each disc")
            kinds = 1 + max(max(max(pair) for pair in self.laws), int(ids.max(initial=0)))
            table = np.zeros((kinds, kinds, COLUMNS))
            present = np.unique(ids)
            for a in present:
                for b in present[present >= a]:
                    if (a, b) not in self.laws:
                        raise ValueError(f"law has no entry for materials ({a}, {b})")
                    table[a, b] = table[b, a] = self.laws[a, b].row()
            if len(self.laws) > 1:
                self._materials, self._table, self._material_count = ids, table, kinds
        self._law = compile_law(list(self.laws.values()))
        turns = [(self._law.sliding, 1.0), (self._law.rolling, -1.0), (self._law.moment, -1.0)]
        self._columns_that_turn = np.array([turn for channel, turn in turns if channel is not None])

    # Properties of the discs -------------------------------------------------------------------------------------------

    @property
    def reference(self) -> np.ndarray:
        """Reference positions (n, 2), m."""
        return self._reference.copy()

    @property
    def radii(self) -> np.ndarray:
        """Radii (n,), m."""
        return self._radii.copy()

    @property
    def masses(self) -> np.ndarray:
        """Masses (n,), kg per metre of thickness."""
        return 1.0 / self._system.state[self._rows, INVERSE_MASS]

    @property
    def inertias(self) -> np.ndarray:
        """Moments of inertia m r^2 / 2 (n,), kg m2 per metre of thickness."""
        return 0.5 * self.masses * self._radii**2

    @property
    def rows(self) -> np.ndarray:
        """Row of each id in the row-ordered arrays of `system` (n,); valid for one `generation`."""
        return self._rows.copy()

    @property
    def ids(self) -> np.ndarray:
        """Id of each row (n,); valid for one `generation`."""
        return self._ids.copy()

    @property
    def time(self) -> float:
        """Time since the start, s."""
        return float(self._system.clock[TIME])

    @property
    def positions(self) -> np.ndarray:
        """Present centres (n, 2), m."""
        return self._system.state[self._rows, :2]

    @property
    def displacements(self) -> np.ndarray:
        """Displacements and rotation since the reference (n, 3), m and rad.

        Assigning makes a new initial state: contact histories are cleared (the tangential forces start at zero) and the
        neighbour list is rebuilt.
        """
        values = self._system.state[self._rows][:, _PLACES]
        values[:, :2] -= self._reference
        return values

    @displacements.setter
    def displacements(self, values: Any) -> None:
        values = _finite("displacements", values, (self.count, 3))
        before = self._mechanical()
        places = values.copy()
        places[:, :2] += self._reference
        self._system.state[np.ix_(self._rows, _PLACES)] = places
        self._system.history[:] = 0.0
        if self._system.walls is not None:
            self._system.walls.history[:] = 0.0
        self._rebuild()
        self._primed = None
        self._imposed += self._mechanical() - before

    @property
    def velocities(self) -> np.ndarray:
        """Velocities and spin (n, 3), m/s and rad/s; may be assigned (the energy change counts as imposed)."""
        return self._system.state[self._rows][:, _RATES]

    @velocities.setter
    def velocities(self, values: Any) -> None:
        values = _finite("velocities", values, (self.count, 3))
        before = energies.kinetic(self._system.state)
        self._system.state[np.ix_(self._rows, _RATES)] = values
        self._primed = None
        self._imposed += energies.kinetic(self._system.state) - before

    @property
    def accelerations(self) -> np.ndarray:
        """Accelerations of the last step (n, 3), m/s2 and rad/s2."""
        return self._system.acceleration[self._rows]

    @property
    def forces(self) -> np.ndarray:
        """Total forces and moments of the last evaluation (n, 3), without damping and holding forces, N and N m."""
        return self._system.force[self._rows]

    @property
    def external_forces(self) -> np.ndarray:
        """Forces and moments of the caller (n, 3), N and N m; may be assigned, constant until assigned again."""
        return np.zeros((self.count, 3)) if self._external is None else self._external.copy()

    @external_forces.setter
    def external_forces(self, values: Any) -> None:
        self._external = _finite("external_forces", values, (self.count, 3))
        self._system = self._system._replace(external=np.ascontiguousarray(self._external[self._ids]))
        self._primed = None

    # Constraints -------------------------------------------------------------------------------------------------------

    def _checked_ids(self, ids: Any) -> np.ndarray:
        array = np.arange(self.count)[ids] if isinstance(ids, slice) else np.atleast_1d(np.asarray(ids))
        if array.dtype == bool and array.shape == (self.count,):
            array = np.flatnonzero(array)
        if array.size and (array.dtype.kind not in "iu" or array.min() < 0 or array.max() >= self.count):
            raise ValueError(f"ids must be whole numbers from 0 to {self.count - 1}")
        return array.astype(np.int64)

    def hold(self, ids: Any, components: str = "xyr") -> None:
        """Keep the velocity of these components, whatever the force ("x", "y", "r" = rotation; "" lets them go).

        The velocity is the one that the disc has, set it by `velocities`; the work of the holder is booked.
        """
        if set(components) - set("xyr"):
            raise ValueError(f"components={components!r} must be made of the letters x, y, r")
        free = np.array([0.0 if letter in components else 1.0 for letter in "xyr"])
        for one in self._checked_ids(ids):
            self._held.pop(int(one), None)
            if components:
                self._held[int(one)] = free
        self._primed = None
        self._compose_held()

    def _compose_held(self) -> None:
        if not self._held:
            self._system = self._system._replace(held=None)
            return
        rows = self._rows[list(self._held)]
        free = np.array(list(self._held.values()))
        held = Held(rows, free, np.zeros_like(free), np.zeros_like(free))
        self._system.acceleration[rows] *= free
        self._system = self._system._replace(held=held)

    def set_ghosts(self, ids: Any) -> None:
        """Discs that the caller moves (see `particles.motion`): pairs of two of them are no longer listed."""
        self._ghost[:] = False
        self._ghost[self._checked_ids(ids)] = True
        self._rebuild()
        self._primed = None

    def add_wall(self, *plates: Plate) -> None:
        """Add rigid plates; from now on they belong to this assembly."""
        for plate in plates:
            if not isinstance(plate, Plate):
                raise ValueError(f"plate={plate!r} must be a Plate")
            if plate.taken:
                raise ValueError(f"{plate.name} belongs to an assembly already: make one plate for each")
        for plate in plates:
            plate.taken = True
            self.plates.append(plate)
            self._plate_rows = np.vstack([self._plate_rows, plate._row])
        for row, plate in zip(self._plate_rows, self.plates):
            plate._row = row
        before = self._mechanical()
        corners = np.concatenate([plate.corners for plate in self.plates])
        ends = np.cumsum([0] + [len(plate.corners) for plate in self.plates]).astype(np.int32)
        constants = np.array([plate.constants(self.laws, self._material_count) for plate in self.plates])
        known = np.atleast_1d(np.array([law.row() for law in self.laws.values()]).any(axis=0))
        wanted = np.atleast_1d(constants.any(axis=(0, 1)))
        if (wanted & ~known)[[1, 2, 4, 5, 7, 8, 10]].any():
            raise ValueError("law of a plate has a channel or dashpot that no law of the discs has; add a small one there")
        none = np.zeros(0, dtype=np.int32)
        old = self._system.walls
        room = Walls(
            self._plate_rows, self._plate_rows[:, :2].copy(), ends, corners, constants,
            none if old is None else old.row, none if old is None else old.plate,
            np.zeros((0, self._columns_that_turn.size)) if old is None else old.history,
            None, np.zeros(1, dtype=np.int64),
        )  # fmt: skip
        self._system = self._system._replace(walls=room)
        self._rebuild()
        self._primed = None
        self._imposed += self._mechanical() - before

    # Neighbour list ----------------------------------------------------------------------------------------------------

    def _rebuild(self) -> None:
        """Build the list anew; sort the rows when discs have moved by about a cell since the last sort."""
        system = self._system
        if not np.isfinite(system.state).all():
            row = int(np.argwhere(~np.isfinite(system.state))[0, 0])
            raise Unstable(f"particle {self._ids[row]} has no finite position or velocity at t={self.time:g} s")
        state = system.state
        width = 2.0 * self._radii.max(initial=0.0) + self.skin
        old_row_of = np.arange(self.count, dtype=np.int32)
        changed: dict[str, Any] = {}
        if self.count and (
            self._sorted_at is None or neighbours.largest_distance(state, self._sorted_at[self._ids]) > width
        ):
            cell, _, cells = neighbours.cell_grid(state, width)
            order, _ = neighbours.sort_by_cell(cell, cells)
            old_row_of = order
            for name in ("state", "acceleration", "force", "material", "external"):
                array = getattr(system, name)
                if array is not None:
                    changed[name] = np.ascontiguousarray(array[order])
            state = changed["state"]
            self._ids = self._ids[order]
            self._rows = np.empty_like(self._ids)
            self._rows[self._ids] = np.arange(self.count, dtype=np.int32)
            self._sorted_at = np.ascontiguousarray(state[self._rows, :2])
            self.generation += 1
        capacity = int(1.1 * system.neighbour.size) + 3 * self.count + 16
        start, neighbour = neighbours.list_pairs(state, self._ghost[self._ids], width, self.skin, capacity)
        history = np.zeros((neighbour.size, self._columns_that_turn.size))
        neighbours.carry_history(
            start, neighbour, history, system.start, system.neighbour, system.history, old_row_of, self._columns_that_turn
        )
        changed.update(start=start, neighbour=neighbour, history=history, listed=state[:, :2].copy())
        if system.walls is not None:
            changed["walls"] = self._list_walls(state, system.walls, old_row_of)
        system.clock[TRAVEL] = 0.0
        self._system = system._replace(**changed)
        self.rebuilds += 1
        if self._held:
            self._compose_held()

    def _list_walls(self, state: np.ndarray, old: Walls, old_row_of: np.ndarray) -> Walls:
        row, plate = walls.list_walls(state, old.plates, old.corner_start, old.corners, self.skin)
        history = np.zeros((row.size, self._columns_that_turn.size))
        new_row_of = np.empty_like(old_row_of)
        new_row_of[old_row_of] = np.arange(self.count, dtype=np.int32)
        walls.carry_wall_history(row, plate, history, old.row, old.plate, old.history, new_row_of)
        return old._replace(row=row, plate=plate, history=history, listed=old.plates[:, :2].copy())

    def refresh(self) -> System:
        """Rebuild the neighbour list if it is stale; returns the system (fetch it anew: arrays and rows may change).

        Allowed between steps and after `drift` or `kick_drift`, before `evaluate`.

        Raises:
            Unstable: a disc moves by more than a radius per step, or is not finite.
        """
        if _stale(self._system):
            self._raise_runaway(self._step, "")
            self._rebuild()
        return self._system

    # Stepping ----------------------------------------------------------------------------------------------------------

    @property
    def system(self) -> System:
        """Row-ordered arrays for jitted loops; valid until the next call of a method that changes the assembly."""
        return self._system

    def terms(self, mass_damping: float = 0.0, local_damping: float = 0.0, gravity: Any = (0.0, 0.0)) -> Terms:
        """What the scene has, for jitted loops; zeros become None and are compiled away.

        Args:
            mass_damping: c in 1/s: force -c m v, also on rotations.
            local_damping: alpha, 0 to below 1: force -alpha |F| sgn(v) for each component.
            gravity: (gx, gy), m/s2.
        """
        gravity = _finite("gravity", gravity, (2,))
        if not (np.isfinite(mass_damping) and mass_damping >= 0.0):
            raise ValueError(f"mass_damping={mass_damping} must be zero or positive (1/s)")
        if not 0.0 <= local_damping < 1.0:
            raise ValueError(f"local_damping={local_damping} must lie in [0, 1)")
        return Terms(
            self._law, self._table, (float(gravity[0]), float(gravity[1])) if gravity.any() else None,
            float(mass_damping) or None, float(local_damping) or None,
        )  # fmt: skip

    def prepare(self, step: float, steps: int = 1, **loads: Any) -> tuple[System, Terms]:
        """Make ready for `steps` steps of size `step` (s) in a jitted loop of the caller.

        Afterwards the list is valid at the present positions, the accelerations belong to the present state (computed
        anew only after a change of loads, velocities, plates, ...) and the velocities of driven plates are known for the
        coming steps. The list may become stale on the way: see `particles.motion`.

        Args:
            loads: keywords of `terms`.
        """
        if not (np.isfinite(step) and step > 0.0):
            raise ValueError(f"step={step} must be positive (s)")
        if self._loads is None or self._loads[0] != loads:
            self._loads = loads, self.terms(**loads)
        terms = self._loads[1]
        self._step = step
        if _stale(self._system):
            self._rebuild()
        if self._primed != (terms[2:],):
            _hold_plates(self._system.walls)
            network.evaluate(self._system, terms, 0.0)
            network.kick(self._system, terms, 0.0)
            self._primed = (terms[2:],)
        if any(plate.is_driven for plate in self.plates):
            times = self.time + step * (np.arange(steps) + 0.5)
            drive = np.array([[plate.velocity_at(time) for plate in self.plates] for time in times])
            self._system.walls.drive_step[0] = 0
            self._system = self._system._replace(walls=self._system.walls._replace(drive=drive))
        elif self._system.walls is not None and self._system.walls.drive is not None:
            self._system = self._system._replace(walls=self._system.walls._replace(drive=None))
        return self._system, terms

    def advance(self, steps: int, step: float, **loads: Any) -> None:
        """Make `steps` steps of size `step` (s) by explicit central difference (Li & Wan 2010, eqs 27-30).

        Args:
            loads: `mass_damping`, `local_damping`, `gravity`, as in `terms`.

        Raises:
            Unstable: the particles blow up.
        """
        if int(steps) != steps or steps < 0:
            raise ValueError(f"steps={steps} must be a whole number, zero or positive")
        if steps == 0:
            return
        system, terms = self.prepare(step, steps, **loads)
        left, resume = int(steps), False
        while True:
            done, code = _advance(system, terms, left, step, resume)
            left -= done
            if code != motion.FINISHED:
                self._raise_runaway(step, f" in step {steps - left}")
            if code == motion.FINISHED:
                return
            self._rebuild()
            system, resume = self._system, True

    def _raise_runaway(self, step: float, where: str) -> None:
        row = _runaway(self._system, step)
        if row >= 0:
            vx, vy, spin = self._system.state[row, VX : SPIN + 1]
            raise Unstable(
                f"particle {self._ids[row]} runs away{where} at t={self.time:g} s with {np.hypot(vx, vy):.3g} m/s and "
                f"{spin:.3g} rad/s: more than the smallest radius in a step of {step:g} s; take a smaller step"
            )

    def trial_forces(self, increment: np.ndarray, velocity: np.ndarray, **loads: Any) -> np.ndarray:
        """Forces (n, 3) in ROW order at positions displaced by `increment`, on copies that are discarded.

        Contacts (histories advanced by the increment), plates (where they are now) and loads; dashpots see `velocity`.

        Args:
            increment: (n, 3) in row order, from the present state, m and rad; within the skin of the list.
            velocity: (n, 3) in row order, m/s and rad/s.
            loads: keywords of `terms`; only gravity has an effect.
        """
        return network.trial_forces(self._system, self.terms(**loads), increment, velocity)

    # Results -----------------------------------------------------------------------------------------------------------

    def _mechanical(self) -> float:
        return float(sum(energies.stored(self).values()))

    def energies(self) -> dict[str, float]:
        """Energies by term, J: stored ones now, dissipated ones and works since the start."""
        return energies.table(self)

    def energy_balance(self) -> float:
        """Absolute imbalance (J): stored + dissipated - work put in; falls with the square of the step."""
        return energies.balance(self)

    def contacts(self, walls: bool = False, contact_range: float = 0.0) -> network.Contacts:
        """Pairs with overlap > -contact_range (r_i + r_j), with their forces; see `particles.network.Contacts`."""
        return network.contacts(self, walls, contact_range)

    def stiffness_matrix(self, contact_range: float = 0.0, walls: bool = False) -> Any:
        """Linearised sticking contacts as a sparse matrix; see `particles.stability.stiffness_matrix`."""
        return stability.stiffness_matrix(self, contact_range, walls)

    def critical_step(self, sharp: bool = False, contact_range: float = 1e-6) -> float:
        """Critical time step, s; see `particles.stability.critical_step`."""
        return stability.critical_step(self, sharp, contact_range)
