"""Does the coupled scheme grow? The spectral radius of one coarse step of the linearised system, before a run."""

from __future__ import annotations

import warnings
from typing import NamedTuple

import numpy as np
import scipy.sparse as sparse
import scipy.sparse.linalg as sparse_linalg
from mpi4py import MPI

from bridge.linear import LinearSystem

RESOLUTION = 1.0  # 1/s: slower growth is not told from none (a run of 0.06 s then grows by 6 %)
GROUND = 1e-4  # of the largest stiffness: springs that tie each particle to its place in the growth test


class Growth(NamedTuple):
    """Result of the growth test."""

    spectral_radius: float  # of one coarse step
    rate: float  # 1/s, of the amplitude
    step: float  # coarse step, s

    @property
    def grows(self) -> bool:
        """Whether the scheme grows faster than the test can tell from no growth."""
        return self.rate > RESOLUTION

    def over(self, time: float) -> float:
        """Factor by which the worst mode grows in `time` (s)."""
        return float(self.spectral_radius ** (time / self.step))

    def warn(self, time: float, setting: str) -> str | None:
        """Warn in plain words where the scheme grows; returns the words."""
        if not self.grows:
            return None
        words = (
            f"{setting} grows by {self.rate:.3g} 1/s, a factor {self.over(time):.3g} in this run: take another variant, "
            "more mass damping or a smaller step"
        )
        warnings.warn(words, stacklevel=2)
        return words


def growth(coupled, *, contact_range: float = 1e-6, vectors: int = 24, seed: int = 1) -> Growth:
    """Spectral radius of one coarse step with all contacts sticking and elastic (collective).

    The steps are those of the run itself (same code, same mass damping), with the contact law replaced by the stiffness
    matrix of the network as it stands; the present state is kept. Eigenvalues of many steps at once are found by Arnoldi
    iterations, so that moduli near one are told apart (see `RESOLUTION`).

    Args:
        coupled: A `BridgingScale` or an `Overlap`.
        contact_range: Gap, in sums of radii, up to which pairs count as contacts.
        vectors: Size of the Krylov space.
        seed: Of the start vector.
    """
    if coupled.body.axes == 3:
        raise ValueError("the growth test is plane: take steps below `critical_step` in space")
    soil = coupled.soil
    stiffness = soil.stiffness_matrix(contact_range=contact_range) if soil.count else None
    scale = coupled.step
    if (
        stiffness is not None
    ):  # mechanisms without stiffness would drift: defective unit eigenvalues, which look like growth
        ground = GROUND * abs(stiffness).max()
        scale = float(np.sqrt(np.median(soil.masses) / ground))
        turning = soil.inertias / soil.masses  # no faster than the translations
        stiffness = stiffness + ground * sparse.diags(np.column_stack([np.ones((soil.count, 2)), turning]).ravel())
    scale = coupled.body.comm.allreduce(scale, op=MPI.MAX)
    stride = max(20, int(np.ceil(0.5 * scale / coupled.step)))  # coarse steps per Arnoldi step
    with LinearSystem(coupled, stiffness, scale) as linear:
        size = len(linear.read())

        def steps(vector):
            linear.write(np.real(vector))
            for _ in range(stride):
                linear.step()
            return linear.read()

        start = np.random.default_rng(seed).standard_normal(size)
        start = steps(start)  # removes what the boundary conditions do not allow
        start /= np.linalg.norm(start)
        operator = sparse_linalg.LinearOperator((size, size), matvec=steps, dtype=np.float64)
        try:
            values = sparse_linalg.eigs(
                operator, k=4, ncv=vectors, v0=start, tol=1e-2, maxiter=4, return_eigenvectors=False
            )
        except sparse_linalg.ArpackNoConvergence as partial:
            values = partial.eigenvalues
        largest = float(np.abs(values).max()) if len(values) else _power(steps, start)
    radius = max(largest, 1e-300) ** (1.0 / stride)
    return Growth(radius, float(np.log(radius) / coupled.step), coupled.step)


def _power(steps, vector, rounds: int = 40) -> float:
    """Mean growth of the norm over the second half of `rounds` applications (where Arnoldi did not converge)."""
    logs = []
    for _ in range(rounds):
        vector = steps(vector)
        norm = np.linalg.norm(vector)
        logs.append(np.log(norm))
        vector = vector / norm
    return float(np.exp(np.mean(logs[rounds // 2 :])))
