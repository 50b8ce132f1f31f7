"""One body of free lattice particles, particle-based manifold elements and continuum elements (Zhao et al. 2012, section 3).

The body is the lattice that its particles would form. A regular mesh groups the sites in elements. Some elements are left to
free particles; round them lie layers of manifold elements, whose stiffness comes from their lattice bonds; all others are
ordinary elements (Hex8, in the plane Q4) of the material. Elements can be released: their particles become free while the run goes on.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from bridge.manifold import changes, steps
from bridge.manifold.criterion import Criterion, Probe
from bridge.manifold.grid import Grid
from bridge.manifold.inertia import TURNS, heavier, inertia_of, step_factor
from bridge.manifold.kinds import CONTINUUM, MANIFOLD, PARTICLES
from bridge.manifold.part import ManifoldPart
from bridge.manifold.raster import Raster
from bridge.manifold.recoarsening import Recoarsener, Recoarsening
from bridge.manifold.stiffness import Stiffness
from continuum import bricks
from particles.dispatch import Direct
from particles.lattice import Lattice
from particles.lattice.arrangement import needed, needed_among
from particles.lattice.driving import Driving, History, Where, rows_of
from particles.lattice.lanes import WIDTH
from particles.lattice.lattice import ahead
from particles.lattice.part import Parts
from particles.lattice.state import (
    ABSORBED,
    BREAKING,
    BROKEN_BONDS,
    DAMPING,
    EXCESS,
    EXTERNAL,
    HELD,
    MOVING_RUNS,
    SUMS,
    State,
)

SAFETY = 0.8
LOST = ("release_kinetic", "release_strain", "recoarsen_kinetic", "recoarsen_strain")  # energies that changes of elements lose
CHUNK = 50  # steps between two looks for blow-up

_advance, _elastic, _begin, _settle = Direct(steps.advance), Direct(steps.elastic), Direct(steps.begin), Direct(steps.settle)
_heavier = Direct(heavier)


class Manifold:
    """Particles where they matter, elements elsewhere; a `Lattice` with elements over it: Hex8 in space, Q4 in the plane.

    Args:
        lattice: cubic or, in the plane, hexagonal Lattice that has not moved; it is what the free particles are, its loads and holds act on elements, too.
        per_element: sites along the edge of an element, one number or one an axis (1 along an axis that repeats after one layer). Over
            the hexagonal lattice spacings along a row and double rows, by one number nearly square ones.
        free: where elements are left to particles from the start: a region, or a function of points, of element centres;
            None for nowhere.
        manifold: where elements are manifold elements from the start, beside the layers: a region or a function of element centres.
        layers: of manifold elements between particles and continuum, which stay when elements are released. 0 couples
            particles and continuum directly, for comparison: bonds across the face then count beside the element's own stiffness.
        cut: what becomes of elements that the outline of the body cuts: "particles", or "manifold", which holds together what lies
            on both sides of a slit narrower than an element.
        continuum: False for manifold elements in place of all continuum elements.
        faces: what elements at the outline of the body are: "continuum", or "manifold", which lack the bonds that the lattice lacks
            there and are as soft.
        release: criterion (strains (k, 6) in manifold elements -> bools (k,)) for the release of elements, such as
            `ultimate_strain`; None for none.
        strain_at: where in an element the criterion is asked: at its "centre" or at its "particles", one of which must meet it.
        within: elements that may be released, a region or a function of element centres; all by default.
        margin: elements round one that meets the criterion which are released with it, so that a crack grows inside particles.
        check_every: steps between two looks at the criterion.
        mass: "lumped", or "higher-order" (see `bridge.manifold.inertia`): waves that are a few elements long keep their speed, for
            one product of elements more a step; not with local damping.
        recoarsen: when released particles become elements again, see `Recoarsening`; never by default.
        step: s; by default 0.8 of the critical one, divided by sqrt(1 + alpha) with local damping.
    """

    def __init__(
        self, lattice: Lattice, per_element: int | tuple[int, int, int], free: Where | None = None, manifold: Where | None = None,
        layers: int = 1, cut: str = "particles", continuum: bool = True, faces: str = "continuum", release: Criterion | None = None,
        strain_at: str = "centre", within: Where | None = None, margin: int = 0, check_every: int = 5, recoarsen: Recoarsening | None = None, mass: str = "lumped",
        step: float | None = None,
    ) -> None:  # fmt: skip
        if lattice.time > 0.0:
            raise ValueError(f"lattice.time={lattice.time:g} must be 0: elements are laid over a lattice before it moves")
        if cut not in ("particles", "manifold"):
            raise ValueError(f'cut="{cut}" must be "particles" or "manifold"')
        if faces not in ("continuum", "manifold"):
            raise ValueError(f'faces="{faces}" must be "continuum" or "manifold"')
        if mass not in ("lumped", "higher-order"):
            raise ValueError(f'mass="{mass}" must be "lumped" or "higher-order"')
        if mass != "lumped" and lattice._terms.damping:
            raise ValueError(f'mass="{mass}" is for waves; with local_damping={lattice._terms.damping:g} take mass="lumped"')
        raster = Raster(lattice)
        count, axes = raster.cells(per_element), lattice.axes
        if layers < 0 or check_every < 1 or margin < 0:
            raise ValueError(f"layers={layers} and margin={margin} must be at least 0 and check_every={check_every} at least 1")
        self.lattice, self.layers, self.criterion, self.margin, self.check_every = lattice, layers, release, margin, check_every
        self.grid = Grid(raster, count, lattice.periodic)
        self.size = (count * raster.pitch)[:axes]
        corner = lattice.reference[0] - ((raster.places[0] + 0.5) * raster.pitch)[:axes]
        self.node_reference = corner + self.grid.node_places[:, :axes] * self.size
        self.centres = corner + (self.grid.cells[:, :axes] + 0.5) * self.size
        slots = np.stack(np.meshgrid(*(np.arange(m) for m in count), indexing="ij"), axis=-1).reshape(-1, 3)
        self.slots = ((slots + 0.5) / count)[:, :axes]
        self._shape = bricks.shape_functions(self.slots)
        self._centres, self._probe = (Probe(place, count[:axes], self.size, self.grid.fold) for place in ("centre", strain_at))
        self._within = np.ones(self.grid.count, dtype=bool)
        if within is not None:
            self._within[np.setdiff1d(np.arange(self.grid.count), rows_of(within, self.centres))] = False
        self.kind = self._first_kinds(free, manifold, cut, continuum, faces)
        fold = self.grid.fold
        self._stiffness = Stiffness(lattice, self.grid, raster, self._shape @ fold)
        self._distinct = (  # what steps need of elements' corners
            tuple(range(len(self.grid.distinct))), np.ascontiguousarray(self.grid.nodes[:, self.grid.distinct]), self._shape @ fold,
            np.ascontiguousarray(np.einsum("sca,ck->ska", bricks.shape_gradients(self.slots, self.size), fold)),
        )  # fmt: skip
        self._holds: list[tuple[np.ndarray, str, History]] = []
        self._nodal = Driving(self.node_reference)
        n = len(self.node_reference)
        self._nodes = steps.Nodes(
            np.zeros((3, n)), np.zeros((3, n)), np.zeros((3, n)), np.zeros(n), np.zeros((n, 2), dtype=np.int32),
            np.zeros(8, dtype=np.int64), np.zeros(SUMS), np.zeros((2, 3, n if lattice._state.acting.size else 0)),
        )  # fmt: skip
        self.time, self.released, self.release_log = 0.0, 0, [(0.0, 0)]
        self.first_released: np.ndarray = np.empty(0, dtype=np.int64)  # elements of the first release
        self.unseen = 0  # steps since the last look at the criterion
        self._unchecked = 0  # steps since the last look for blow-up
        self._lost = dict.fromkeys(LOST, 0.0)
        self.node_mass = np.zeros(n)
        whole = np.flatnonzero(self.kind != PARTICLES)
        self._add_mass(whole, 1.0)
        lattice.refresh(self._free_rows(), ~self._free_rows())
        self._inertia = inertia_of(self._shares(np.arange(self.grid.count)), fold, n) if mass == "higher-order" else None
        self._arrange(np.arange(self.grid.count))
        self.critical_step = self._critical_step()
        damped = math.sqrt(1.0 + (lattice._terms.damping or 0.0))
        self.step = SAFETY * self.critical_step / damped if step is None else float(step)
        if not (math.isfinite(self.step) and self.step > 0):
            raise ValueError(f"step={step} must be positive (s)")
        self.recoarsener = None if recoarsen is None else Recoarsener(self, recoarsen, per_element)
        self._ready, self._base = False, 0.0
        self._parts: Parts | None = None
        self._known_shares: dict[int, tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]] = {}

    # construction

    def _first_kinds(self, free: Where | None, manifold: Where | None, cut: str, continuum: bool, faces: str) -> np.ndarray:
        kind = np.full(self.grid.count, CONTINUUM if continuum else MANIFOLD, dtype=np.uint8)
        full, plain = self._plain()
        kind[~plain] = MANIFOLD
        if faces == "manifold":
            kind[self.grid.at_faces(full)] = MANIFOLD
        if manifold is not None:
            kind[rows_of(manifold, self.centres)] = MANIFOLD
        self.coarsest = kind.copy()  # what elements are far from particles
        if free is not None:
            kind[rows_of(free, self.centres)] = PARTICLES
        if cut == "particles":
            kind[~full] = PARTICLES
        self._surround(kind, np.flatnonzero(kind == PARTICLES))
        return kind

    def _plain(self) -> tuple[np.ndarray, np.ndarray]:
        """Elements (n,) bool that are full, and those that are full and of one material, as continuum elements must be."""
        full, (low, high) = self.grid.full(), self.grid.extremes(self.lattice.layer)
        return full, full & (low == high)

    def _surround(self, kind: np.ndarray, elements: np.ndarray) -> np.ndarray:
        """Make the continuum elements near some elements manifold elements; returns those that have changed."""
        near = elements
        for _ in range(self.layers):
            near = self.grid.around(near)
        changed = near[kind[near] == CONTINUUM]
        kind[changed] = MANIFOLD
        return changed

    def _free_rows(self) -> np.ndarray:
        return (self.kind == PARTICLES)[self.grid.element]

    def _shares(self, elements: np.ndarray) -> np.ndarray:
        """Masses (elements, 8) in kg that the particles of elements give to their nodes, sum of m_j N(X_j) (eq 27)."""
        sites = self.grid.sites_of(elements)
        share = self.lattice.mass[sites, None] * self._shape[self.grid.slot[sites]]
        return np.stack([np.bincount(self.grid.element[sites], by, self.grid.count) for by in share.T], axis=1)[elements]

    def _add_mass(self, elements: np.ndarray, sign: float) -> None:
        """Masses of the nodes by those of the particles of elements."""
        np.add.at(self.node_mass, self.grid.nodes[elements], sign * self._shares(elements))

    def _critical_step(self) -> float:
        """The smaller one of the lattice's, where particles are or may come, and the bound of the elements, 2 / max omega_e."""
        stiffest = self._stiffness.stiffest()
        found = 2.0 / math.sqrt(stiffest) if stiffest > 0.0 else math.inf
        found *= step_factor(self.lattice.axes) if self._inertia is not None else 1.0
        needs_particles = self.criterion is not None or bool((self.kind == PARTICLES).any())
        return min(found, self.lattice.critical_step) if needs_particles else found

    def _arrange(self, changed: np.ndarray, around: np.ndarray | None = None) -> None:
        """Everything that depends on which elements are there, after those in `changed` have changed, and bonds of rows `around`."""
        self._stiffness.find(changed[self.kind[changed] != PARTICLES], self.kind)
        if around is None:
            self._needed = needed(self.lattice._state, self.lattice.free)
        else:
            self._needed[around] = needed_among(self.lattice._state, self.lattice.free, around)
        active = np.flatnonzero(self.kind != PARTICLES).astype(np.int32)
        alive = np.zeros(len(self.node_mass), dtype=bool)
        alive[self.grid.nodes[active]] = True
        self.node_mass[~alive] = 0.0
        self.alive = alive
        nodes = self._nodes
        nodes.lightness[:] = np.where(alive, 1.0 / np.where(alive, self.node_mass, 1.0), 0.0)
        nodes.velocity[:, ~alive] = 0.0
        edges = np.flatnonzero(np.diff(np.concatenate(([0], alive.astype(np.int8), [0]))))
        runs = edges.reshape(-1, 2)
        nodes.moving_runs[: len(runs)] = np.column_stack((runs[:, 0], runs[:, 1] - runs[:, 0]))
        nodes.counts[MOVING_RUNS] = len(runs)
        rows = np.flatnonzero(self._needed).astype(np.int32)
        corners, node, shape, gradient = self._distinct
        self._elements = steps.Elements(
            tuple(range(self.lattice.axes)), corners, node, self._stiffness.number, self._stiffness.matrices, active, rows,
            self.grid.element[rows], self.grid.slot[rows], shape, gradient, np.zeros(3 * WIDTH), self._inertia,
        )  # fmt: skip

    def _arrange_driving(self) -> None:
        """Loads and dashpots of particles in elements become those of nodes, by their shape functions."""
        lattice, free = self.lattice, self.lattice.free
        lattice.driving.arrange(free)
        self._nodal = Driving(self.node_reference)
        for rows, force, history in lattice.driving.loads():
            self._nodal.load(*self._given_to_nodes(rows, force), history)
        for rows, coefficient in lattice.driving.dashpots():
            if not free[rows].all():
                self._nodal.absorb(*self._given_to_nodes(rows, coefficient))
        for rows, axes, history in self._holds:
            self._nodal.hold(rows, axes, history)
        self._nodal.arrange(self.alive)

    def _given_to_nodes(self, rows: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What nodes get of values (k, 3) on rows (k,), for those that elements carry; it is known as long as these are the same."""
        inner = ~self.lattice.free[rows]
        known = self._known_shares.get(id(values))  # the driving keeps these arrays
        if known is None or not np.array_equal(known[0], inner):
            known = self._known_shares[id(values)] = inner, self._to_nodes(rows[inner], values[inner])
        return known[1]

    def _to_nodes(self, rows: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        nodes = self.grid.nodes[self.grid.element[rows]]
        shares = self._shape[self.grid.slot[rows]][:, :, None] * values[:, None, :]
        found, where = np.unique(nodes, return_inverse=True)
        if len(found) == 0:
            return np.zeros(1, dtype=np.int32), np.zeros((1, 3))
        return found, np.stack([np.bincount(where.reshape(-1), by) for by in shares.reshape(-1, 3).T], axis=1)

    # state

    @property
    def displacement(self) -> np.ndarray:
        """Of the nodes, (nodes, axes) in m; a view, to be written in place."""
        return self._nodes.displacement[: self.lattice.axes].T

    @property
    def velocity(self) -> np.ndarray:
        """Of the nodes, (nodes, axes) in m/s; a view, to be written in place."""
        return self._nodes.velocity[: self.lattice.axes].T

    def set_motion(self, displacement: Any = None, velocity: Any = None) -> None:
        """Set displacements and velocities of nodes and particles by functions of points (n, axes) that give (n, axes)."""
        axes = self.lattice.axes
        for values, nodal, particle in (
            (displacement, self._nodes.displacement, self.lattice._state.displacement),
            (velocity, self._nodes.velocity, self.lattice._state.velocity),
        ):
            if values is not None:
                nodal[:axes] = np.where(self.alive, np.asarray(values(self.node_reference)).T, 0.0)
                particle[:axes] = np.where(self.lattice.free, np.asarray(values(self.lattice.reference)).T, 0.0)
        self._ready = False

    @property
    def returned(self) -> int:
        """Number of returns of released elements so far."""
        return 0 if self.recoarsener is None else self.recoarsener.returned

    def particle_motion(self, rows: Any = slice(None)) -> tuple[np.ndarray, np.ndarray]:
        """Displacements and velocities (n, axes) of particles, all by default; of those in elements by u = N u_e."""
        found, axes = [], self.lattice.axes
        shape, nodes = self._shape[self.grid.slot[rows]], self.grid.nodes[self.grid.element[rows]]
        for nodal, own in (
            (self._nodes.displacement, self.lattice._state.displacement), (self._nodes.velocity, self.lattice._state.velocity),
        ):  # fmt: skip
            inner = np.einsum("nc,nca->na", shape, nodal[:axes].T[nodes])
            found.append(np.where(self.lattice.free[rows, None], own[:axes].T[rows], inner))
        return found[0], found[1]

    def momentum(self) -> np.ndarray:
        """(axes,) in N s."""
        state = self.lattice._state
        total = self._nodes.velocity @ self.node_mass + (state.velocity * self.lattice.free) @ self.lattice.mass
        return total[: self.lattice.axes]

    def element_strain(self, elements: np.ndarray) -> np.ndarray:
        """Strains (k, 6) at the centres of elements: xx, yy, zz, yz, xz, xy."""
        return self._centres.strains(self._nodes, self._elements, elements)[:, 0]

    def internal_force(self, where: Where) -> np.ndarray:
        """Sum (axes,) of the forces of bonds and elements on the nodes and free particles `where`, N; some of each must be named."""
        _, state, nodes = self._of_bonds()
        total = np.zeros(3)
        for points, force, there in (
            (self.node_reference, nodes.force, self.alive), (self.lattice.reference, state.force, self.lattice.free),
        ):  # fmt: skip
            chosen = np.zeros(len(points), dtype=bool)
            chosen[rows_of(where, points)] = True
            total += force[:, chosen & there].sum(axis=1)
        return total[: self.lattice.axes]

    def hold(self, where: Where, directions: str, velocity: History = 0.0) -> None:
        """Move components of the nodes and of the particles `where` with a velocity (m/s); a later call wins.

        `where` is a region or a function of points; faces are half a spacing outside the outer particles.
        """
        found = 0
        for points, keep in ((self.node_reference, self._hold_nodes), (self.lattice.reference, self.lattice.hold)):
            try:
                rows = rows_of(where, points)
            except ValueError:
                continue
            keep(rows, directions, velocity)
            found += len(rows)
        if not found:
            raise ValueError("where names neither nodes nor particles")
        self._ready = False

    def _hold_nodes(self, rows: np.ndarray, directions: str, velocity: History) -> None:
        self._holds.append((rows, directions, velocity))

    # time

    def advance(self, step_count: int) -> None:
        """Go on by whole steps, with a look at the criterion of release in every `check_every`th of them.

        It is asked at the displacements of the end of a step, before their forces are found: what is released has forces of bonds there.
        """
        if isinstance(step_count, bool) or int(step_count) != step_count or step_count < 0:
            raise ValueError(f"steps={step_count} must be a whole number, 0 or more")
        inside = False  # a step, rather than between two
        while step_count > 0:
            if not inside:
                self.prepare()
                self._begin()
            if self.unseen == self.check_every - 1:
                self._look(self.overstrained())
                self.unseen = -1  # the step that goes on now is the first after the look
            wanted = self.criterion is not None and bool(np.any((self.kind == MANIFOLD) & self._within))
            now = min(step_count, self.check_every - 1 - self.unseen if wanted else CHUNK)
            now = now if self.recoarsener is None else min(now, self.recoarsener.left)
            step_count -= now
            back = self.recoarsener is not None and now == self.recoarsener.left
            inside = step_count > 0 and not back
            self._steps(now, not inside)
            self.unseen = (self.unseen + now) % self.check_every
            if self._parts is not None and not inside:
                self._parts.collect(back)
            self._unchecked += now
            if self._unchecked >= CHUNK or not inside:
                self._unchecked = 0
                self.lattice.check(self.step)
            if self.recoarsener is not None:
                self.recoarsener.went_on(now)

    def _look(self, wanted: np.ndarray) -> None:
        """Release elements in the middle of a step."""
        if len(wanted):
            if self._parts is not None:
                self._parts.collect()
                self._parts = self.lattice._owner = None
            changes.release(self, wanted, inside=True)

    def _begin(self) -> None:
        """Go to the middle of a step, by all ranks where these have the body."""
        if self._parts is None:
            _begin(self.lattice._state, self._nodes, self.step)
        else:
            self._take(self._parts.order("begin_both", self.step))

    def _steps(self, count: int, ends: bool) -> None:
        """Steps by all ranks, where some follow, from the middle of a step; to the end of the last one if it `ends`."""
        lattice, nodes = self.lattice, self._nodes
        following, own = lattice.following(), lattice.driving.drive(self.time, self.step, count)
        nodal = self._nodal.drive(self.time, self.step, count)
        if following is None:
            _advance(lattice._state, lattice._terms, nodes, self._elements, own, nodal, count, self.step, ends)
        else:
            if self._parts is None:
                self._parts = Parts(following, ManifoldPart, lattice, nodes, self._elements)
            self._take(self._parts.order("advance_both", own, nodal, count, self.step, ends))
        self._ready = lattice._ready = True
        self.time += count * self.step
        lattice.time = self.time

    def _take(self, moved: tuple[np.ndarray, ...]) -> None:
        """Motion and energy sums of the nodes from the ranks."""
        nodes = self._nodes
        nodes.displacement[:], nodes.velocity[:], nodes.force[:] = moved[:3]
        nodes.sums[:] += moved[3]

    def parallel(self) -> dict[str, Any]:
        """How the work is shared out among ranks; nothing on one rank."""
        return {} if self._parts is None else self._parts.order("parallel")

    def overstrained(self) -> np.ndarray:
        """Elements that the criterion wants released: manifold elements that meet it, and the margin round them."""
        manifold = np.flatnonzero((self.kind == MANIFOLD) & self._within)
        if self.criterion is None or len(manifold) == 0:
            return manifold[:0]
        found = manifold[self._probe.meets(self.criterion, self._nodes, self._elements, manifold)]
        for _ in range(self.margin if len(found) else 0):
            found = self.grid.around(found)
        return found[(self.kind[found] != PARTICLES) & self._within[found]]

    def release(self, elements: np.ndarray) -> None:
        """Turn elements into free particles, and continuum elements near them into manifold elements.

        Momentum is kept; what the kinetic energy and the strain energy lose is booked as `release_kinetic` and `release_strain`.
        """
        changes.release(self, elements, inside=False)

    def prepare(self) -> None:
        """Forces for the state of now, where something has changed since the last step; energies count from the first time."""
        if self._ready and self.lattice._ready:
            return
        started = self.time > 0.0
        self._settle()
        if not started:
            self._base = self._account()[2]

    def _settle(self) -> None:
        lattice, h = self.lattice, self.step
        self._parts = lattice._owner = None
        self._arrange_driving()
        _settle(
            lattice._state, lattice._terms, self._nodes, self._elements, lattice.driving.drive(self.time - h, h, 1),
            self._nodal.drive(self.time - h, h, 1), h,
        )  # fmt: skip
        self._ready = lattice._ready = True

    # energies

    def _of_bonds(self) -> tuple[float, State, steps.Nodes]:
        """Elastic energy (J) at the displacements of now; particles and nodes with the forces of bonds and elements alone."""
        state, nodes = self.lattice._state, self._nodes
        state, nodes = state._replace(force=np.zeros_like(state.force)), nodes._replace(force=np.zeros_like(nodes.force))
        return float(sum(_elastic(state, self.lattice._terms, nodes, self._elements))), state, nodes

    def _account(self) -> tuple[float, float, float]:
        """Kinetic and elastic energy, and the account as that of `Lattice`, of particles and nodes together (J)."""
        state, nodes = self.lattice._state, self._nodes
        elastic, of_bonds, of_elements = self._of_bonds()
        middle = elastic + ahead(of_bonds, state.force, self.step) + ahead(of_elements, nodes.force, self.step)
        kinetic = 0.5 * float((nodes.velocity**2).sum(axis=0) @ self.node_mass) + self.lattice.kinetic_energy()
        if self._inertia is not None:
            more = self._heavier(self._elements.active)
            kinetic, middle = kinetic + more[0], middle + more[1]
        sums = state.sums + nodes.sums
        lost = sums[DAMPING] + sums[ABSORBED] + sums[BREAKING] + sum(self._lost.values())
        return kinetic, elastic, middle + lost - sums[EXTERNAL] - sums[HELD] - sums[EXCESS]

    def _heavier(self, elements: np.ndarray) -> tuple[float, float]:
        """Kinetic energies of some elements beyond the lumped mass, see `bridge.manifold.inertia.heavier`."""
        nodes, drive = self._nodes, self._nodal.drive(self.time, self.step, 1)
        guess, way, room = nodes.velocity.copy(), np.zeros_like(nodes.velocity), np.zeros_like(nodes.velocity)
        there = self._elements._replace(active=elements)
        return _heavier(nodes, there, self._inertia, drive, self.step, nodes.velocity, guess, way, room)

    def _influencing(self, elements: np.ndarray) -> np.ndarray:
        """All elements that are there on which `_heavier` depends where it depends on some; none with the lumped mass."""
        cells, shape, active = self.grid.cells, self.grid.shape, self._elements.active
        if self._inertia is None:
            return active[:0]
        low, high = cells[elements].min(axis=0) - TURNS - 3, cells[elements].max(axis=0) + TURNS + 3
        apart = np.maximum(low - cells[active], cells[active] - high)
        around = np.maximum(low - cells[active] - shape, cells[active] - shape - high), np.maximum(low - cells[active] + shape, cells[active] + shape - high)
        apart = np.where(self.grid.periodic, np.minimum(apart, np.minimum(*around)), apart)
        return active[np.all(apart <= 0, axis=1)]

    def energies(self) -> dict[str, float]:
        """Energy terms in J; `balance` is the error of the account, without what the integrator's own energy jumps by in a release."""
        self.prepare()
        kinetic, elastic, account = self._account()
        sums = self.lattice._state.sums + self._nodes.sums
        return {
            "kinetic": kinetic, "elastic": elastic, "breaking": float(sums[BREAKING]), "local_damping": float(sums[DAMPING]),
            "absorbed": float(sums[ABSORBED]), "excess_work": float(sums[EXCESS]), "external_work": float(sums[EXTERNAL]), "held_work": float(sums[HELD]),
            "broken_bonds": float(sums[BROKEN_BONDS]), **self._lost, "balance": account - self._base,
        }  # fmt: skip

