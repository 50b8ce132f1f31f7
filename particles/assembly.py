"""The state of all particles: positions, motion, histories, neighbour list, walls; and the run."""

from __future__ import annotations

from typing import Any

import numpy as np

from particles import bonds, driving, energies, holding, listing, network, pruning, stability, stepping
from particles.cell import PeriodicCell, checked_gradient, nearest_image
from particles.columns import aligned
from particles.contacts import SCRATCH
from particles.laws.several import Laws
from particles.network import rows_of
from particles.system import (
    LEAST_SKIN,
    RADIUS,
    SKIN_SCALE,
    SMALLEST_RADIUS,
    SUMS,
    TIME,
    TRAVEL_LIMIT,
    System,
    Terms,
)
from particles.walls.history import recorded, recording
from particles.walls.joining import check_joining
from particles.walls.listing import arranged
from particles.walls.periodic import check_deformation
from particles.walls.wall import Wall

WHOLE = 1e6  # share of contacts that makes those with any other particle count in full
SKIN, THINNEST = 0.12, 0.002  # skin that is not given, as a share of the mean radius: at first, and later at least


def _numbers(name: str, values: Any) -> np.ndarray:
    try:
        return np.array(values, dtype=float)
    except (TypeError, ValueError):
        raise ValueError(f"{name} of kind {type(values).__name__} must be an array of numbers") from None


def _finite(name: str, values: Any, shape: tuple[int, ...]) -> np.ndarray:
    array = _numbers(name, values)
    if array.size == 0 and shape[0] == 0:
        array = array.reshape(shape)
    if array.shape != shape:
        raise ValueError(f"{name} of shape {array.shape} must have shape {shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite numbers (first bad one: index {np.argwhere(~np.isfinite(array))[0]})")
    return array


class Assembly:
    """Discs in the plane or spheres in space, with translation and rotation; in the plane per metre of thickness.

    Arrays of this class are copies in the caller's order ("id order"). Generalised motion has shape (n, 3) = (x, y,
    rotation) in the plane and (n, 6) = (x, y, z, rotations about x, y, z) in space; SI units.

    Args:
        positions: (n, 2) or (n, 3) centres, m; the reference of displacements.
        radii: (n,) or a number, m.
        density: of the solid, kg/m3; (n,) allowed.
        law: contact law, or a mapping {(a, b): law} for all pairs of material ids a <= b.
        skin: reach of the neighbour list beyond contact, m; by default as the particles' speed asks for, anew with each list.
        materials: (n,) material ids 0, 1, ... (with a mapping of laws).
        cell: periodic cell; it belongs to this assembly from now on.

    Raises:
        ValueError: shapes, signs or numbers that make no sense, or a pair of materials without a law.
    """

    def __init__(
        self, positions: Any, radii: Any, density: Any = 2600.0, law: Any = None, skin: float | None = None,
        materials: Any = None, cell: PeriodicCell | None = None,
    ) -> None:  # fmt: skip
        positions = _numbers("positions", positions)
        count, shape = positions.shape[0] if positions.ndim else 1, positions.shape
        self.axes = shape[1] if len(shape) == 2 and shape[1] in (2, 3) else 2
        self.freedoms = 3 * (self.axes - 1)
        if cell is not None and cell.axes != self.axes:
            raise ValueError(f"cell has {cell.axes} axes, the positions have {self.axes}: they must be the same")
        self.cell = cell
        self._reference = _finite("positions", positions, (count, self.axes))
        self._radii = _finite("radii", np.broadcast_to(radii, (count,)) if np.ndim(radii) == 0 else radii, (count,))
        if not (self._radii > 0.0).all():
            raise ValueError(f"radii={self._radii.min():g} must be positive (m)")
        density = _finite("density", np.broadcast_to(density, (count,)) if np.ndim(density) == 0 else density, (count,))
        if not (density > 0.0).all():
            raise ValueError(f"density={density.min():g} must be positive (kg/m3)")
        self._laws = Laws(law, materials, count, space=self.axes == 3)
        self.all_laws: list[Any] = list(self._laws.all)
        self._numbers = self._laws.rows(self.all_laws)
        self._plate_laws: np.ndarray = np.zeros((0, self._laws.kinds), dtype=np.int64)  # places in `all_laws`
        self._largest_radius = float(self._radii.max(initial=0.0))
        mean = float(self._radii.mean()) if count else 1.0
        self.skin = SKIN * mean if skin is None else float(skin)
        if not (np.isfinite(self.skin) and self.skin > 0.0):
            raise ValueError(f"skin={skin} must be positive (m)")
        self.count = count
        self.generation = 0
        self.plates: list[Wall] = []
        self.rebuilds = 0
        self._held: dict[int, np.ndarray] = {}
        self._held_ids: np.ndarray = np.zeros(0, dtype=np.int64)  # the same as arrays, see `holding`
        self._held_free: np.ndarray = np.zeros((0, self.freedoms))
        self._ids = np.arange(count, dtype=np.int32)  # id of each row
        self._rows = np.arange(count, dtype=np.int32)  # row of each id
        self._ghost = np.zeros(count, dtype=bool)
        self._labels: np.ndarray | None = None  # numbers of the ids in a larger scene, for messages
        self._external: np.ndarray | None = None
        self._primed: tuple | None = None
        self._loads: tuple[dict[str, Any], Terms] | None = None  # of the last run
        self._step = 0.0
        self._imposed = 0.0
        self._sorted_at: np.ndarray | None = None
        self._outer: pruning.OuterList | None = None
        self._calling = listing.CALLING  # what a list costs beside the particles, see `listing.skin_scale`
        self._mean_radius = float(mean)  # of the whole scene where this is a part
        self._breaks: list[np.ndarray] = []
        usual = listing.skin_scale(max(count, 1), listing.GAPS[self.axes] * max(count, 1) / mean)
        self._system = self._first_system(density, usual if skin is None else 0.0)
        self._mean_mass = float(self._masses.mean()) if count else 1.0
        listing.rebuild(self)
        self._refuse_coincident()
        self._imposed = self._mechanical()

    def _first_system(self, density: np.ndarray, skin_scale: float) -> System:
        """Arrays at rest in the reference state, without a list."""
        count, space = self.count, self.axes == 3
        if space:
            self._masses = density * 4.0 / 3.0 * np.pi * self._radii**3
            self._inertias = 0.4 * self._masses * self._radii**2
        else:
            self._masses = density * np.pi * self._radii**2
            self._inertias = 0.5 * self._masses * self._radii**2

        def rows(wanted: bool = True) -> Any:
            return aligned((count, 4)) if wanted else None

        position, lightness, nimbleness = rows(), rows(), rows(space)
        position[:, : self.axes], position[:, RADIUS] = self._reference, self._radii
        holding.set_lightness(self, lightness, nimbleness, np.arange(count))
        clock = np.zeros(7)
        clock[TRAVEL_LIMIT] = 0.5 * self.skin
        clock[SKIN_SCALE] = skin_scale
        clock[LEAST_SKIN] = THINNEST / SKIN * self.skin
        clock[SMALLEST_RADIUS] = self._radii.min() if count else 1.0
        none = np.zeros(0, dtype=np.int32)
        return System(
            position=position, velocity=rows(), acceleration=rows(), force=rows(),
            lightness=lightness, rotation=rows(space), spin=rows(space),
            angular=rows(space), torque=rows(space), nimbleness=nimbleness, start=np.zeros(count + 1, dtype=np.int32),
            first=none, second=none, history=np.zeros((len(self._laws.columns), 0)), scratch=aligned((SCRATCH,)),
            material=self._laws.materials, external=None, walls=None, records=None, held=None, breaks=None,
            cell=None if self.cell is None else self.cell.arrays, flow=rows(self.cell is not None),
            listed=position[:, : self.axes].copy(), sums=np.zeros(SUMS), clock=clock,
        )  # fmt: skip

    def _refuse_coincident(self) -> None:
        """Two particles in one place have no contact normal."""
        system = self._system
        first, second = system.first[: system.start[-1]], system.second[: system.start[-1]]
        axes = self.axes
        branch = nearest_image(self.cell, system.position[second, :axes] - system.position[first, :axes])
        same = np.flatnonzero((branch == 0.0).all(axis=1))
        if same.size:
            a, b = self._ids[first[same[0]]], self._ids[second[same[0]]]
            raise ValueError(f"positions of particles {min(a, b)} and {max(a, b)} are the same; move one of them")

    # Properties of the particles ---------------------------------------------------------------------------------------

    @property
    def reference(self) -> np.ndarray:
        """Reference positions (n, 2), m."""
        return self._reference.copy()

    @property
    def radii(self) -> np.ndarray:
        """Radii (n,), m."""
        return self._radii.copy()

    @property
    def laws(self) -> dict[tuple[int, int], Any]:
        """Contact laws by pair of material ids."""
        return dict(self._laws.pairs)

    @property
    def masses(self) -> np.ndarray:
        """Masses (n,), kg (in the plane per metre of thickness); the shares carried, after `weigh`."""
        return self._masses.copy()

    @property
    def inertias(self) -> np.ndarray:
        """Moments of inertia (n,), kg m2 (in the plane m r^2 / 2 per metre of thickness, in space 2 m r^2 / 5)."""
        return self._inertias.copy()

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

    def _of_rows(self, translations: str, rotations: str) -> np.ndarray:
        """Generalised components (n, freedoms) in id order."""
        return rows_of(getattr(self._system, translations), getattr(self._system, rotations))[self._rows]

    def _set_rows(self, translations: str, rotations: str, values: np.ndarray) -> None:
        for k, name in enumerate((translations, rotations)):
            rows = getattr(self._system, name)
            if rows is not None and 3 * k < self.freedoms:
                rows[self._rows, :3] = values[:, 3 * k : 3 * k + 3]

    @property
    def positions(self) -> np.ndarray:
        """Present centres (n, 2) or (n, 3), m."""
        return self._system.position[self._rows, : self.axes]

    @property
    def displacements(self) -> np.ndarray:
        """Displacements and rotations since the reference (n, freedoms), m and rad; in space the rotations are the sums of
        the steps' increments about the three axes.

        Assigning makes a new initial state: contact histories are cleared (the tangential forces start at zero; bonds stay
        and are strained) and the neighbour list is rebuilt.
        """
        values = self._of_rows("position", "rotation")
        values[:, : self.axes] -= self._reference
        return values

    @displacements.setter
    def displacements(self, values: Any) -> None:
        values = _finite("displacements", values, (self.count, self.freedoms))
        before = self._mechanical()
        places = values.copy()
        places[:, : self.axes] += self._reference
        self._set_rows("position", "rotation", places)
        for (name, _), column in zip(self._laws.columns, self._system.history):
            if name not in ("bond", "offset"):
                column[:] = 0.0
        if self._system.walls is not None:
            self._system.walls.history[:] = 0.0
        listing.rebuild(self)
        self._primed = None
        self._imposed += self._mechanical() - before

    @property
    def velocities(self) -> np.ndarray:
        """Velocities and spins (n, freedoms), m/s and rad/s; may be assigned (the energy change counts as imposed)."""
        return self._of_rows("velocity", "spin")

    @velocities.setter
    def velocities(self, values: Any) -> None:
        values = _finite("velocities", values, (self.count, self.freedoms))
        before = energies.kinetic(self)
        self._set_rows("velocity", "spin", values)
        self._primed = None
        self._imposed += energies.kinetic(self) - before

    @property
    def accelerations(self) -> np.ndarray:
        """Accelerations of the last step (n, freedoms), m/s2 and rad/s2."""
        return self._of_rows("acceleration", "angular")

    @property
    def forces(self) -> np.ndarray:
        """Total forces and moments of the last evaluation (n, freedoms), without damping and holding forces, N and N m."""
        return self._of_rows("force", "torque")

    @property
    def external_forces(self) -> np.ndarray:
        """Forces and moments of the caller (n, freedoms), N and N m; may be assigned, constant until assigned again."""
        return np.zeros((self.count, self.freedoms)) if self._external is None else self._external.copy()

    @external_forces.setter
    def external_forces(self, values: Any) -> None:
        self._external = _finite("external_forces", values, (self.count, self.freedoms))
        self._compose_external()

    def _compose_external(self) -> None:
        """Row-ordered external forces, with the share of each particle."""
        if self._external is not None:
            external = np.ascontiguousarray(self._external[self._ids])
            if self._system.share is not None:
                external *= np.minimum(self._system.share[:, :1], 1.0)
            self._system = self._system._replace(external=external)
        self._primed = None

    def weigh(self, contacts: Any, masses: Any, whole: Any = False) -> None:
        """Let the particles carry only a share of the body, where a continuum carries the rest.

        From now on forces, torques, energies and losses of a contact between two particles count by the share of its two
        particles, interpolated to the contact point, and external forces by the particle's; `masses` and `inertias` are
        those carried. Histories, limits and strengths stay those of the whole contact; contacts with walls count in full.
        The change of energy counts as imposed.

        Args:
            contacts: (n,) share of contacts and external forces at each particle, 0 to 1.
            masses: (n,) share of mass and inertia, above 0 up to 1.
            whole: (n,) True for particles all of whose contacts count in full.

        Raises:
            ValueError: shares out of range.
        """
        shares = np.column_stack([_finite("contacts", contacts, (self.count,)), _finite("masses", masses, (self.count,))])
        if self.count and not (shares.min() >= 0.0 and shares.max() <= 1.0 and shares[:, 1].min() > 0.0):
            raise ValueError(f"shares from {shares.min():g} to {shares.max():g} must lie in [0, 1], those of masses above 0")
        before = self._mechanical()
        shares[:, 0] += np.where(whole, WHOLE, 0.0)
        shares = np.ascontiguousarray(shares[self._ids])
        old = 1.0 if self._system.share is None else self._system.share[self._rows, 1]
        change = shares[self._rows, 1] / old
        self._masses, self._inertias = self._masses * change, self._inertias * change
        self._mean_mass = float(self._masses.mean()) if self.count else 1.0
        self._system = self._system._replace(share=shares)
        holding.compose(self)
        self._compose_external()
        self._imposed += self._mechanical() - before

    # Constraints -------------------------------------------------------------------------------------------------------

    def _checked_ids(self, ids: Any) -> np.ndarray:
        array = np.arange(self.count)[ids] if isinstance(ids, slice) else np.atleast_1d(np.asarray(ids))
        if array.dtype == bool and array.shape == (self.count,):
            array = np.flatnonzero(array)
        if array.size and (array.dtype.kind not in "iu" or array.min() < 0 or array.max() >= self.count):
            raise ValueError(f"ids must be whole numbers from 0 to {self.count - 1}")
        return array.astype(np.int64)

    def hold(self, ids: Any, components: str | None = None) -> None:
        """Keep the velocity of these components, whatever the force ("x", "y", "z", "r" = all rotations; "" lets them go).

        The velocity is the one that the particle has, set it by `velocities`; the work of the holder is booked. By default
        all components are held.
        """
        letters = "xyz"[: self.axes] + "r" * (self.freedoms - self.axes)
        components = letters if components is None else components
        if set(components) - set(letters):
            raise ValueError(f"components={components!r} must be made of the letters {', '.join(dict.fromkeys(letters))}")
        free = np.array([0.0 if letter in components else 1.0 for letter in letters])
        for one in self._checked_ids(ids):
            self._held.pop(int(one), None)
            if components:
                self._held[int(one)] = free
        self._primed = None
        holding.compose(self)

    @property
    def held(self) -> np.ndarray:
        """Ids of the particles with components that are held."""
        return np.array(sorted(self._held), dtype=np.int64)

    def deform(self, velocity_gradient: Any) -> None:
        """Deform the periodic cell at a constant velocity gradient L (axes, axes), 1/s, from now on.

        The particles get the change of the field L x on top of their velocities, so that the deformation is homogeneous
        from the start (and the field that damping spares, see `terms`, changes by as much); its kinetic energy counts as imposed. The edges' work is `cell_work` among the energies, with the work
        of damping forces along L x: what damps moves with the cell.

        Raises:
            ValueError: there is no cell, L does not keep the form of its edges (upper triangular) or changes axes that do not
                repeat, or a wall is no frictionless plane: other walls are rigid, and would have to stretch with the cell.
        """
        if self.cell is None:
            raise ValueError("velocity_gradient needs a periodic cell: give the assembly one")
        self._deform(velocity_gradient, self.masses @ self.positions / self.masses.sum() if self.count else np.zeros(self.axes))

    def _deform(self, velocity_gradient: Any, centre: np.ndarray) -> None:
        """The same with the mass centre of the whole packing (axes,), m."""
        assert self.cell is not None
        gradient = checked_gradient(self.cell, velocity_gradient)
        if gradient.any():
            check_deformation(self.plates)
        change = gradient - self.cell.velocity_gradient
        velocities = self.velocities
        velocities[:, : self.axes] += self.positions @ change.T
        self.velocities = velocities
        self.cell.set_gradient(gradient, centre)

    def cell_stress(self) -> np.ndarray:
        """Mean stress (axes, axes) in the periodic cell, Pa, tension positive; see `particles.network.cell_stress`.

        Raises:
            ValueError: there is no cell.
        """
        if self.cell is None:
            raise ValueError("cell_stress needs a periodic cell: give the assembly one")
        return network.cell_stress(self, self.cell)

    def bond(self, reach: float = 0.02, pairs: Any = None) -> int:
        """Bond pairs as they are now, without force (`Bonded` law; Rojek & Onate 2007, section 3.3).

        Args:
            reach: pairs with a distance up to (1 + reach) (r_i + r_j) are bonded.
            pairs: (k, 2) ids, if only these are wanted (those of them that are in reach).

        Returns:
            Number of bonds made.

        Raises:
            ValueError: the law has no bonds, or a reach that is no share of the radii.
        """
        return bonds.make(self, reach, pairs)

    def _widen(self, skin: float) -> None:
        """Make the list reach at least as far as `skin` (m) beyond contact from now on."""
        self._system.clock[LEAST_SKIN] = max(skin, self._system.clock[LEAST_SKIN])
        self._set_skin(max(skin, self.skin))

    def _set_skin(self, skin: float) -> None:
        self.skin = skin
        self._system.clock[TRAVEL_LIMIT] = 0.5 * skin

    def _file_breaks(self) -> None:
        """Keep the logged breaks with ids instead of rows (before the rows change their order)."""
        breaks = self._system.breaks
        if breaks is not None and breaks.count[0]:
            log = breaks.log[: breaks.count[0]].copy()
            log[:, 1:3] = self._ids[log[:, 1:3].astype(np.int64)]
            self._breaks.append(log)
            breaks.count[0] = 0

    @property
    def breaks(self) -> np.ndarray:
        """Bonds that have broken, in the order of time (k, 7): time (s), ids i and j, place (x, y, z) in m, energy (J)."""
        self._file_breaks()
        return np.concatenate([np.zeros((0, 7)), *self._breaks])

    @property
    def bonds(self) -> np.ndarray:
        """Ids (k, 2) of the pairs whose bonds hold."""
        return bonds.held(self)

    def set_ghosts(self, ids: Any) -> None:
        """Discs that the caller moves (see `particles.motion`): pairs of two of them are no longer listed."""
        self._ghost[:] = False
        self._outer = None
        self._ghost[self._checked_ids(ids)] = True
        listing.rebuild(self)
        self._primed = None

    def add_wall(self, *walls: Wall) -> None:
        """Add rigid walls; from now on they belong to this assembly. In a periodic cell they repeat with it.

        Raises:
            ValueError: a plane that is not parallel to the edges of a periodic cell or turns, a wall that does not go with a
                deforming cell (see `deform`), no wall, one of the wrong dimension or of another assembly, or one that is fixed to such a wall.
        """
        check_joining(walls, self.plates, self.axes, self.cell)
        every = [*self.plates, *walls]
        of_walls = [wall.laws(self._laws.pairs, self._laws.kinds) for wall in every]
        numbers = np.array([self._laws.rows(laws) for laws in of_walls])
        before = self._mechanical()
        first = len(self._laws.all)
        self.plates = every
        self.all_laws[first:] = [law for laws in of_walls for law in laws]
        self._plate_laws = first + np.arange(numbers.shape[0] * numbers.shape[1]).reshape(numbers.shape[:2])
        self._numbers = np.concatenate([self._laws.rows(self._laws.all), numbers.reshape(-1, numbers.shape[2])])
        room = arranged(self.plates, numbers, len(self._laws.columns), self._system.walls)
        self._system = self._system._replace(walls=room)
        listing.rebuild(self)
        self._primed = None
        self._imposed += self._mechanical() - before

    def refresh(self) -> System:
        """Rebuild the neighbour list if it is stale; returns the system (fetch it anew: arrays and rows may change).

        Allowed between steps and after `drift` or `kick_drift`, before `evaluate`.

        Raises:
            Unstable: a disc moves by more than a radius per step, or is not finite.
        """
        stepping.refresh(self)
        return self._system

    # Stepping ----------------------------------------------------------------------------------------------------------

    @property
    def system(self) -> System:
        """Row-ordered arrays for jitted loops; valid until the next call of a method that changes the assembly."""
        return self._system

    def terms(
        self, mass_damping: float = 0.0, local_damping: float = 0.0, gravity: Any = None, vector_damping: Any = None
    ) -> Terms:
        """What the scene has, for jitted loops; zeros become None and are compiled away.

        Args:
            mass_damping: c in 1/s: force -c m v, also on rotations. In a deforming periodic cell all kinds of damping act on
                the velocity beyond that of the cell, v - L x (see `PeriodicCell.set_gradient`), and on the spins as they are.
            local_damping: alpha, 0 to below 1: force -alpha |F| sgn(v) for each component.
            gravity: (gx, gy) or (gx, gy, gz), m/s2.
            vector_damping: (alpha, alpha_r), 0 to below 1, for translations and rotations: force -alpha |F| v / |v| and
                moment -alpha_r |T| w / |w| (Rojek & Onate 2007, eqs 25-26), which do not depend on the axes.
        """
        gravity = np.zeros(self.axes) if gravity is None else _finite("gravity", gravity, (self.axes,))
        if not (np.isfinite(mass_damping) and mass_damping >= 0.0):
            raise ValueError(f"mass_damping={mass_damping} must be zero or positive (1/s)")
        if not 0.0 <= local_damping < 1.0:
            raise ValueError(f"local_damping={local_damping} must lie in [0, 1)")
        factors: Any = (0.0, 0.0) if vector_damping is None else tuple(np.ravel(vector_damping).tolist())
        if len(factors) != 2 or not all(0.0 <= factor < 1.0 for factor in factors):
            raise ValueError(f"vector_damping={vector_damping} must be two numbers in [0, 1)")
        return Terms(
            self._laws.template, self._laws.table, self._laws.blank, self._laws.massive, self._laws.viscous,
            (*map(float, gravity), 0.0)[:3] if gravity.any() else None, float(mass_damping) or None,
            float(local_damping) or None, *(factors if any(factors) else (None, None)),
        )  # fmt: skip

    def prepare(self, step: float, steps: int = 1, **loads: Any) -> tuple[System, Terms]:
        """Make ready for `steps` steps of size `step` (s) in a jitted loop of the caller.

        Afterwards the list is valid at the present positions, the accelerations belong to the present state (computed
        anew only after a change of loads, velocities, walls, ...) and the velocities of driven walls are known for the
        coming steps. The list may become stale on the way: see `particles.motion`.

        Args:
            loads: keywords of `terms`.
        """
        terms = stepping.prepare(self, step, steps, loads)
        return self._system, terms

    def advance(self, steps: int, step: float, **loads: Any) -> None:
        """Make `steps` steps of size `step` (s) by explicit central difference (Li & Wan 2010, eqs 27-30).

        Walls with `record` write their histories meanwhile.

        Args:
            loads: `mass_damping`, `local_damping`, `vector_damping`, `gravity`, as in `terms`.

        Raises:
            Unstable: the particles blow up.
        """
        if int(steps) != steps or steps < 0:
            raise ValueError(f"steps={steps} must be a whole number, zero or positive")
        if steps == 0:
            return
        _, terms = self.prepare(step, steps, **loads)
        self._system = recording(self.plates, self._system, int(steps))
        try:
            stepping.run(self, terms, int(steps), step)
        finally:
            self._system = recorded(self.plates, self._system)

    def _label(self, row: int) -> int:
        """Number of a row's particle as the user knows it."""
        one = int(self._ids[row])
        return one if self._labels is None else int(self._labels[one])

    def trial_forces(self, increment: np.ndarray, velocity: np.ndarray, **loads: Any) -> np.ndarray:
        """Forces (n, freedoms) in ROW order at positions displaced by `increment`, on copies that are discarded.

        Contacts (histories advanced by the increment), walls (where they are now) and loads; dashpots see `velocity`.

        Args:
            increment: (n, freedoms) in row order, from the present state, m and rad; within the skin of the list.
            velocity: (n, freedoms) in row order, m/s and rad/s.
            loads: keywords of `terms`; only gravity has an effect.
        """
        return network.trial_forces(self._system, self.terms(**loads), increment, velocity)

    # Results -----------------------------------------------------------------------------------------------------------

    def _mechanical(self) -> float:
        return float(sum(energies.stored(self).values()))

    def energies(self) -> dict[str, float]:
        """Energies by term, J: stored ones now, dissipated ones and works since the start."""
        return energies.table(self)

    def force_sums(self) -> np.ndarray:
        """What says how far from equilibrium all is (5,): largest resultant on a free particle (N), sum of all, number of free
        particles; sum of the sizes of the contact forces (N), number of those that are not zero."""
        return driving.sums_of(self)

    def energy_balance(self) -> float:
        """Absolute imbalance (J): stored + dissipated - work put in; falls with the square of the step."""
        return energies.balance(self)

    def contacts(self, walls: bool = False, contact_range: float = 0.0) -> network.Contacts:
        """Pairs with overlap > -contact_range (r_i + r_j) and bonds, with their forces; see `particles.network.Contacts`."""
        return network.contacts(self, walls, contact_range)

    def stiffness_matrix(self, contact_range: float = 0.0, walls: bool = False) -> Any:
        """Linearised sticking contacts as a sparse matrix; see `particles.stability.stiffness_matrix`."""
        return stability.stiffness_matrix(self, contact_range, walls)

    def critical_step(self, sharp: bool = False, contact_range: float = 1e-6) -> float:
        """Critical time step, s; see `particles.stability.critical_step`."""
        return stability.critical_step(self, sharp, contact_range)
