"""The particle side of any coupling: loops of fine steps, linearised contacts, energies; empty on ranks without particles."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray

from bridge.substeps import Linear

Array = NDArray[np.float64]


class ParticleSide:
    """Particles of a coupling, some of which are led by the mesh.

    Args:
        soil: Assembly.
        step: Particle time step, s.
        mass_damping: c_m, 1/s.
        gravity: m/s2.
        vector_damping: (alpha, alpha_r) against the motion of the particles, as in `Assembly.terms`, or None.
    """

    def __init__(self, soil, step: float, mass_damping: float, gravity, vector_damping=None):
        self.soil, self.step, self.mass_damping, self._gravity = soil, step, mass_damping, gravity
        self._loads = {"mass_damping": mass_damping, "gravity": gravity, "vector_damping": vector_damping}
        self.linear: Linear | None = None
        self._led: Any = None  # the led particles as the loops see them, in the present row order
        self._generation = -1

    def _arrange(self) -> None:
        """Bring everything into the present row order."""
        if self.soil.generation == self._generation:
            return
        self._generation = self.soil.generation
        rows, self._row_ids = np.asarray(self.soil.rows), np.asarray(self.soil.ids)
        places = self.soil.reference
        turning = np.zeros((len(places), 3 - self.soil.axes))
        self._reference = np.ascontiguousarray(np.hstack([places, turning])[self._row_ids])
        self._order(rows, self._row_ids)

    def rearrange(self) -> None:
        """Bring everything into the row order of particles whose state was restored."""
        self._generation = -1
        self._arrange()

    def _order(self, rows, order) -> None:
        """Operators in the row order; `rows` of the ids, `order`: ids of the rows."""
        raise NotImplementedError

    def linearise(self, stiffness: sparse.spmatrix | None) -> None:
        """Replace the contact law by -K q (K (3n, 3n) in id order), or bring the law back with None."""
        if stiffness is None:
            self.linear = None
        elif self.soil.count:
            self._arrange()
            places = (3 * self._row_ids[:, None] + np.arange(3)).ravel()
            matrix = sparse.csr_matrix(stiffness)[places][:, places].tocsr()
            self.linear = Linear(
                matrix.indptr.astype(np.int64), matrix.indices.astype(np.int64), matrix.data, self._reference
            )

    def _prepare(self, steps: int) -> None:
        if self.linear is None:
            self._terms = self.soil.prepare(self.step, steps, **self._loads)[1]
            self._arrange()

    def run_loop(
        self, kernel, steps: int, before: Any, after: tuple, first: int = -1, until: int | None = None
    ) -> int:
        """Call a loop until `until` (default all) substeps are done, with new lists on the way; the list is valid then.

        `before` are arguments of the loop, or a function that gives them anew for each list.
        """
        until = steps if until is None else until
        while True:
            system = self.soil.system
            given = before() if callable(before) else before
            first = kernel(system, self._terms, self.linear, self._led, *given, self.step, steps, first, *after)
            if first < steps:
                self.soil.refresh()
                self._arrange()
            if first >= until:
                return first

    def reference(self) -> Array:
        """Reference positions and, in the plane, angle zero (n, 3), row order."""
        return self._reference

    def _sums(self) -> dict[str, float]:
        """Energies of the assembly (J), the terms of one kind together."""
        sums = self.soil.energies()
        together = {
            kind: sum(value for name, value in sums.items() if name.startswith(kind)) for kind in ("elastic", "friction")
        }
        works = ("gravity_work", "external_work", "wall_work", "held_work")
        return together | {
            "kinetic": sums["kinetic"], "viscous": sums["viscous"], "contact_loss": sums["contact_loss"] + sums["breaking"],
            "mass_damping": sums["mass_damping"], "local_damping": sums["local_damping"],
            "external": sum(sums[name] for name in works),
        }  # fmt: skip
