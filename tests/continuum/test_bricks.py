"""One brick for all elements of a regular mesh: the same as the assembled body."""

import numpy as np
import pytest

from continuum import Body, Cauchy, bricks
from meshes import domains

SIZE, E, NU = np.array([1.0, 2.0, 0.5]), 12.5e9, 0.3


def test_its_stiffness_is_that_of_dolfinx():
    body = Body(domains.box((0, 0, 0), SIZE, (1, 1, 1)), Cauchy(E, NU, 2650.0))
    matrix = bricks.stiffness(SIZE, E, NU)
    corners = np.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]) * SIZE
    place = [int(np.abs(body.coordinates - corner).sum(axis=1).argmin()) for corner in corners]
    motion = np.random.default_rng(1).standard_normal((8, 3))
    nodal = np.empty_like(motion)
    nodal[place] = motion
    wanted = body.internal_force(nodal)[place]
    assert (matrix @ motion.ravel()).reshape(8, 3) == pytest.approx(wanted, rel=1e-10, abs=1e-10 * np.abs(wanted).max())


def test_it_has_six_zero_modes_and_the_strain_of_a_linear_field():
    values = np.linalg.eigvalsh(bricks.stiffness(SIZE, E, NU))
    assert np.sum(np.abs(values) < 1e-10 * values[-1]) == 6
    corners = np.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]) * SIZE
    gradient = np.arange(9.0).reshape(3, 3)
    strain = bricks.strain_matrix(np.array([(0.3, 0.9, 0.1)]), SIZE)[0] @ (corners @ gradient.T).ravel()
    tensor = 0.5 * (gradient + gradient.T)
    assert strain == pytest.approx([*np.diag(tensor), tensor[1, 2], tensor[0, 2], tensor[0, 1]])
