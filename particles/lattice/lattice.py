"""A body of distinct lattice springs: particles on a lattice that carry translations only (Zhao et al. 2012, section 2.2)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from particles.crew import Crew, crew
from particles.dispatch import Direct
from particles.lattice import blocks, geometry, motion
from particles.lattice.arrangement import arrange
from particles.lattice.driving import Driving, History, Where, face_area, lysmer, rows_of
from particles.lattice.groups import groups
from particles.lattice.material import LatticeMaterial
from particles.lattice.part import Part, Parts
from particles.lattice.state import (
    ABSORBED,
    BREAKING,
    BROKEN,
    BROKEN_BONDS,
    DAMPING,
    EXCESS,
    EXTERNAL,
    HELD,
    SUMS,
    UNLIMITED,
    Drive,
    State,
    Terms,
)  # fmt: skip
from particles.motion import Unstable

_advance = Direct(motion.advance)
_elastic, _fastest = Direct(motion.elastic), Direct(motion.fastest)
ahead = Direct(motion.ahead)
CHUNK = 50  # steps between two looks for blow-up
SAFETY = 0.8  # of the critical step, which local damping makes shorter: forces against the motion are 1 + alpha times larger


class Lattice:
    """Particles on the 18-neighbour cubic or, in the plane, the hexagonal lattice, all bonds intact and without force.

    Rows are sorted so that loops over them are fast; `reference` gives their places. A particle fills its part of the body (d^3, in the
    plane d^2 sqrt(3)/2 per metre), so that faces lie half a spacing outside the centres.

    Args:
        sites: (n, 3) or (n, 2) in m, such as `meshes.packings.simple_cubic(region, spacing / 2)` or `hexagonal`.
        spacing: d between neighbours, m.
        material: LatticeMaterial, or a list of them, which `layer` chooses from.
        layer: function of points (n, axes) that gives the number of each one's material; all are the first by default.
        force: "pairwise" (as published: the shear of a bond acts on its two ends) or "variational" (the gradient of the energy,
            spread over the clusters: no net torque, symmetric stiffness; four times slower).
        plane: "strain" or "stress", in the plane.
        corotational: strains and forces turn with the body, for rotations that are not small (pairwise force; four times slower).
        periodic: axes along which the sites repeat, such as "z": one layer with u_z held is plane strain.
        local_damping: alpha of the damping against each velocity component: 0.8 to find equilibria, 0 for waves.
        step: s; by default 0.8 of the critical step, divided by sqrt(1 + alpha).
        first: sites that shall lie together in memory, such as those that elements will leave to particles, a region or a function of
            points; by default where bonds can break. Steps are up to twice as fast where others are not looked at.
        audit: book the work that bonds do beyond the loss of their energy (`excess_work`), which closes the balance; on one rank.
    """

    def __init__(
        self, sites: Any, spacing: float, material: LatticeMaterial | Sequence[LatticeMaterial],
        layer: Callable[[np.ndarray], Any] | None = None, force: str = "pairwise", plane: str = "strain", periodic: str = "",
        local_damping: float = 0.0, step: float | None = None, corotational: bool = False, first: Where | None = None,
        audit: bool = False,
    ) -> None:  # fmt: skip
        sites = np.asarray(sites, dtype=float)
        if sites.ndim != 2 or sites.shape[1] not in (2, 3) or len(sites) == 0 or not np.all(np.isfinite(sites)):
            raise ValueError(f"sites of shape {sites.shape} must be finite with the shape (n, 2) or (n, 3), n at least 1")
        if not (math.isfinite(spacing) and spacing > 0):
            raise ValueError(f"spacing={spacing} must be positive (m)")
        for name, value, allowed in (("force", force, ("pairwise", "variational")), ("plane", plane, ("strain", "stress"))):
            if value not in allowed:
                raise ValueError(f'{name}="{value}" must be "{allowed[0]}" or "{allowed[1]}"')
        if corotational and force != "pairwise":
            raise ValueError(f'corotational={corotational} needs force="pairwise", not "{force}"')
        if not 0 <= local_damping < 1:
            raise ValueError(f"local_damping={local_damping} must lie in [0, 1)")
        if set(periodic) - set("xyz"[: sites.shape[1]]):
            raise ValueError(f'periodic="{periodic}" must name axes of "{"xyz"[: sites.shape[1]]}"')
        self.axes, self.spacing, self.plane = sites.shape[1], float(spacing), plane
        self.materials = [material] if isinstance(material, LatticeMaterial) else list(material)
        self.periodic = tuple(axis in periodic for axis in "xyz")
        found = geometry.places(sites, spacing)
        layers, near = self._layers(layer, sites), geometry.neighbours(found, geometry.directions(self.axes), self.periodic)
        together = np.array([np.isfinite(one.limits).any() for one in self.materials])[layers]
        if first is not None:
            together = np.isin(np.arange(len(sites)), rows_of(first, sites))
        later = ~(together | np.any(together[near] & (near >= 0), axis=1))
        self.order = geometry.order(found, later)
        self.reference, self.places, layers, later = sites[self.order], found[self.order], layers[self.order], later[self.order]
        near = geometry.renumbered(near, self.order)
        volume = self.spacing**3 if self.axes == 3 else 0.5 * math.sqrt(3.0) * self.spacing**2
        self._masses = np.array([one.density * volume for one in self.materials])
        self._mass = self._masses[layers]
        alike, group, self._terms = self._constants(plane, local_damping, near, layers)
        self._state = self._make_state(near, layers, alike, group, later, force == "variational", corotational, audit)
        self.time = 0.0
        self.critical_step = self._critical_step()
        self.step = SAFETY * self.critical_step / math.sqrt(1.0 + local_damping) if step is None else float(step)
        if not (math.isfinite(self.step) and 0 < self.step):
            raise ValueError(f"step={step} must be positive (s)")
        self.driving = Driving(self.reference)
        self.refresh(np.ones(self.count, dtype=bool), np.zeros(self.count, dtype=bool))
        self._ready = False
        self._base = 0.0
        self._parts: Parts | None = None
        self._owner: tuple[np.ndarray, int] | None = None  # rank (n,) of each row in the parts of so many ranks

    # construction

    def _constants(self, plane: str, damping: float, near: np.ndarray, material: np.ndarray) -> tuple[np.ndarray, np.ndarray, Terms]:
        """Classes and groups of the rows, and the constants."""
        springs = np.array([one.springs(self.spacing, self.axes, plane) for one in self.materials])
        given = np.array([one.limits for one in self.materials])
        limits = np.minimum(given, UNLIMITED) if np.isfinite(given).any() else None
        alike, group, smallest = groups(near, material, springs, limits)
        arms = geometry.vectors(self.axes, self.spacing)
        return alike, group, Terms(
            self.spacing, arms, arms / np.linalg.norm(arms, axis=1, keepdims=True), springs[:, 0].copy(), springs[:, 1].copy(), limits, smallest,
            geometry.whole_cluster(self.spacing), None if self.axes == 3 else 1, damping if damping > 0 else None,
        )  # fmt: skip

    def _layers(self, layer: Callable[[np.ndarray], Any] | None, sites: np.ndarray) -> np.ndarray:
        if layer is None:
            return np.zeros(len(sites), dtype=np.uint8)
        number = np.broadcast_to(np.asarray(layer(sites)), len(sites)).astype(np.int64)
        if number.min() < 0 or number.max() >= len(self.materials):
            raise ValueError(f"layer gives {number.min()} to {number.max()}; it must give numbers from 0 to {len(self.materials) - 1}")
        return number.astype(np.uint8)

    def _make_state(
        self, near: np.ndarray, material: np.ndarray, alike: np.ndarray, group: np.ndarray, later: np.ndarray, variational: bool,
        corotational: bool, audit: bool,
    ) -> State:  # fmt: skip
        n = len(near)
        plain = self.axes == 3 and not variational and not corotational
        found = blocks.stretches(near, material, alike, group, later, plain)
        springs = blocks.springs(np.column_stack((self._terms.normal, self._terms.shear)), found.pairs, self.spacing)
        room = n // blocks.WIDTH + len(found.rows)
        return State(
            displacement=np.zeros((3, n)), velocity=np.zeros((3, n)), force=np.zeros((3, n)), lightness=1.0 / self._masses[material], strain=np.zeros((6, n)),
            moment=np.zeros((6, n)) if variational else None,
            rotation=np.repeat(np.eye(3).reshape(9, 1), n, axis=1) if corotational else None,
            acting=np.zeros((3, n if audit else 0)), stored=np.zeros(1), near=near, bonds=np.zeros(near.shape, dtype=np.uint8),
            mask=np.zeros(n, dtype=np.int64), follows=geometry.follows(near), material=material, alike=alike, group=group,
            strain_kind=np.zeros(n, dtype=np.uint8),
            force_kind=np.zeros(n, dtype=np.uint8), moving=np.zeros(n, dtype=np.uint8), cluster=np.zeros((9, n)),
            stretch_of=found.number, stretch=found.rows, onward=found.on, stray=found.stray, strays=np.flatnonzero(found.stray), springs=springs,
            strain_runs=np.zeros((n, 2), dtype=np.int32), strain_blocks=np.zeros((room, 2), dtype=np.int64),
            strain_special=np.zeros(n, dtype=np.int64), force_runs=np.zeros((n, 2), dtype=np.int32),
            force_blocks=np.zeros((room, 2), dtype=np.int64), force_special=np.zeros(n, dtype=np.int64),
            moving_runs=np.zeros((n, 2), dtype=np.int32), awake=np.zeros((n, 2), dtype=np.int64), reached=np.zeros(room, dtype=np.uint8),
            counts=np.zeros(8, dtype=np.int64), sums=np.zeros(SUMS),
        )  # fmt: skip

    def _critical_step(self) -> float:
        """2 / omega_max of the infinite lattice: omega_max^2 = 12 k_n / m (18 neighbours) or 6 k_n / m (hexagonal)."""
        normal, mass = self._terms.normal, self._masses
        square = 12.0 * normal.max() if self.axes == 3 else 6.0 * normal.max()
        return 2.0 / math.sqrt(square / mass.min())

    # rows

    @property
    def count(self) -> int:
        """Number of particles."""
        return len(self.reference)

    def refresh(self, free: np.ndarray, carried: np.ndarray, rows: np.ndarray | None = None) -> None:
        """Set which rows move by their forces and which are carried along by something else; all others sleep.

        A bond has a force of its own where one end at least is free and the other free or carried; carried rows keep all of
        their neighbours in their clusters, whose displacements must be given, too.

        Args:
            free: (n,) bool.
            carried: (n,) bool, none of them free.
            rows: those whose bonds may differ from before, all by default.
        """
        arrange(self._state, self._terms, free, carried, np.arange(self.count) if rows is None else rows)
        self.free, self.carried = free, carried
        self._ready = False

    @property
    def displacement(self) -> np.ndarray:
        """(n, axes) in m; a view, to be written in place."""
        return self._state.displacement[: self.axes].T

    @displacement.setter
    def displacement(self, values: Any) -> None:
        self._state.displacement[: self.axes] = np.asarray(values, dtype=float).T
        self._ready = False

    @property
    def velocity(self) -> np.ndarray:
        """(n, axes) in m/s; a view, to be written in place."""
        return self._state.velocity[: self.axes].T

    @velocity.setter
    def velocity(self, values: Any) -> None:
        self._state.velocity[: self.axes] = np.asarray(values, dtype=float).T
        self._ready = False

    @property
    def mass(self) -> np.ndarray:
        """(n,) in kg."""
        return self._mass

    @property
    def layer(self) -> np.ndarray:
        """Number (n,) of each particle's material."""
        return self._state.material

    def internal_force(self) -> np.ndarray:
        """Forces (n, axes) of the bonds at the displacements of now, N."""
        return self._of_bonds()[1].force[: self.axes].T

    def _of_bonds(self) -> tuple[float, State]:
        """Elastic energy (J) at the displacements of now, with strains found anew; the state with the forces of the bonds alone."""
        state = self._state._replace(force=np.zeros_like(self._state.force))
        return float(_elastic(state, self._terms)), state

    def strain(self) -> np.ndarray:
        """Least-squares strain (n, 6): xx, yy, zz, yz, xz, xy (tensor shear)."""
        self._of_bonds()
        return self._state.strain.T

    def stress(self) -> np.ndarray:
        """Stress (n, 6) in Pa of the isotropic body at the least-squares strain, in the order of `strain`; 3D and plane strain."""
        strain = self.strain()
        e = np.array([m.young_modulus for m in self.materials])[self._state.material]
        nu = np.array([m.poisson_ratio for m in self.materials])[self._state.material]
        twice_shear = e / (1.0 + nu)
        found = twice_shear[:, None] * strain
        found[:, :3] += (twice_shear * nu / (1.0 - 2.0 * nu) * strain[:, :3].sum(axis=1))[:, None]
        return found

    def broken(self) -> np.ndarray:
        """Broken bonds of each particle (n,)."""
        return ((self._state.bonds & BROKEN) > 0).sum(axis=1)

    def broken_bonds(self) -> np.ndarray:
        """Ends (k, 2) of the bonds that have broken, as row numbers."""
        rows, ways = np.nonzero(self._state.bonds[:, ::2] & BROKEN)
        return np.column_stack((rows, self._state.near[rows, 2 * ways]))

    # what acts on it

    def rows(self, where: Where) -> np.ndarray:
        """Row numbers of a region, a function of points, a mask or numbers."""
        return rows_of(where, self.reference)

    def hold(self, where: Where, directions: str, velocity: History = 0.0) -> None:
        """Move components ("x", "yz", ...) of particles with a velocity (m/s), a number or a function of time; a later call wins."""
        self.driving.hold(where, directions, velocity)
        self._ready = False

    def load(self, where: Where, force: Any, history: History = 1.0) -> None:
        """Add a force (axes,) or (rows, axes) in N, times a number or a function of time, on each particle."""
        self.driving.load(where, force, history)
        self._ready = False

    def traction(self, where: Where, traction: Any, history: History = 1.0) -> None:
        """Add a traction (axes,) in Pa on the face that the outermost particles `where` form, across an axis."""
        self.load(where, np.asarray(traction, dtype=float) * face_area(self), history)

    def pressure(self, where: Where, pressure: float, history: History = 1.0) -> None:
        """Push (Pa) on all faces of the particles `where` that look into the open, along the axes; cubic lattice."""
        if self.axes != 3:
            raise ValueError("pressure needs the cubic lattice, whose particles have faces across the axes")
        rows = self.rows(where)
        for way in range(6):
            open_rows = rows[self._state.near[rows, way] < 0]
            if len(open_rows):
                outward = self._terms.vectors[way] / self.spacing
                self.load(open_rows, -pressure * self.spacing**2 * outward, history)

    def absorb(self, where: Where, normal: str) -> None:
        """Let waves leave through the face of the particles `where`, whose normal is the axis "x", "y" or "z"."""
        if normal not in tuple("xyz"[: self.axes]):
            raise ValueError(f'normal="{normal}" must be one of {", ".join("xyz"[: self.axes])}')
        rows = self.rows(where)
        for kind in np.unique(self.layer[rows]):
            mine = rows[self.layer[rows] == kind]
            self.driving.absorb(mine, lysmer(self.materials[kind], face_area(self), "xyz".index(normal)))
        self._ready = False

    # time

    def advance(self, steps: int) -> None:
        """Go on by whole steps.

        Raises:
            Unstable: a particle moves by more than half a spacing in a step, or is not finite.
        """
        if isinstance(steps, bool) or int(steps) != steps or steps < 0:
            raise ValueError(f"steps={steps} must be a whole number, 0 or more")
        self.prepare()
        while steps > 0:
            now = min(steps, CHUNK)
            fastest = self._steps(self.driving.drive(self.time, self.step, now), now)
            self.time += now * self.step
            steps -= now
            if self._parts is not None and (steps == 0 or self._runs_away(fastest, self.step)):
                self._parts.collect()
            self.check(fastest=fastest)

    def _steps(self, drive: Drive, steps: int) -> float:
        """Steps by all ranks, where some follow; the largest velocity component then (m/s)."""
        following = self.following()
        if following is None:
            _advance(self._state, self._terms, drive, steps, self.step)
            return float(_fastest(self._state))
        if self._parts is None:
            self._parts = Parts(following, Part, self)
        return float(self._parts.order("advance", drive, steps, self.step))

    def _runs_away(self, fastest: float, step: float) -> bool:
        return not fastest * step <= 0.5 * self.spacing

    def following(self) -> Crew | None:
        """Ranks that help with the steps, if any: the variational force, which reaches a neighbour farther, and the audit are for one."""
        return crew() if self._state.moment is None and not self._state.acting.size else None

    def parallel(self) -> dict[str, Any]:
        """How the work is shared out among ranks; nothing on one rank."""
        return {} if self._parts is None else self._parts.order("parallel")

    def check(self, step: float | None = None, fastest: float | None = None) -> None:
        """Raise Unstable where the lattice has blown up, with steps (s) of its own and the largest velocity (m/s) of now by default."""
        fastest, step = _fastest(self._state) if fastest is None else fastest, self.step if step is None else step
        if self._runs_away(fastest, step):
            row = int(np.argmax(np.nan_to_num(np.abs(self._state.velocity).max(axis=0), nan=np.inf)))
            raise Unstable(
                f"the particle at {np.array2string(self.reference[row], precision=4)} m moves by more than half a spacing in a step at "
                f"t = {self.time:.6g} s; the step is {step / self.critical_step:.2f} of the critical one"
            )

    def prepare(self) -> None:
        """Forces for the state of now, where something has changed since the last step; energies count from there."""
        if self._ready:
            return
        self._parts = self._owner = None
        self.driving.arrange(self.free)
        before = None if self.time == 0.0 else self._account()[1]
        _advance(self._state, self._terms, self.driving.drive(self.time - self.step, self.step, 1), 0, self.step)
        self._ready = True
        self._base = self._account()[1] - (0.0 if before is None else before - self._base)

    # energies

    def kinetic_energy(self) -> float:
        """1/2 m v^2 in J."""
        return float(ahead(self._state, self._state.force, 0.0))

    def _account(self) -> tuple[float, float]:
        """Elastic energy, and the energy in the middle of the coming step with what has been lost, less what was put in (J)."""
        elastic, of_bonds = self._of_bonds()
        middle, sums = elastic + ahead(of_bonds, self._state.force, self.step), self._state.sums
        return elastic, middle + sums[DAMPING] + sums[ABSORBED] + sums[BREAKING] - sums[EXTERNAL] - sums[HELD] - sums[EXCESS]

    def energies(self) -> dict[str, float]:
        """Energy terms in J; `balance` is the error of the account (see `particles.lattice.motion`)."""
        self.prepare()
        state = self._state
        elastic, account = self._account()
        return {
            "kinetic": self.kinetic_energy(), "elastic": elastic, "breaking": float(state.sums[BREAKING]),
            "local_damping": float(state.sums[DAMPING]), "absorbed": float(state.sums[ABSORBED]),
            "excess_work": float(state.sums[EXCESS]), "external_work": float(state.sums[EXTERNAL]), "held_work": float(state.sums[HELD]),
            "broken_bonds": float(state.sums[BROKEN_BONDS]), "balance": account - self._base,
        }  # fmt: skip
