"""Meshes and materials that the tests of the continuum share."""

import numpy as np
import pytest

from continuum import Body, Cauchy, Cosserat
from meshes import domains

LI_WAN = dict(young_modulus=500e6, poisson_ratio=0.2, density=2042.0)  # Li & Wan (2010), table 1


def material_of(kind: str):
    if kind == "cauchy":
        return Cauchy(**LI_WAN)
    return Cosserat(cosserat_shear=70e6, characteristic_length=0.05, **LI_WAN)


def distorted_domain(cell: str, width=2.0, height=1.5, cells=(4, 3), amount=0.2):
    """Rectangle whose inner nodes are moved by up to `amount` of a cell; angles between 0 and 180 degrees remain."""
    domain = domains.rectangle((0, 0), (width, height), cells, cell)
    x, y = domain.mesh.geometry.x[:, 0].copy(), domain.mesh.geometry.x[:, 1].copy()
    inner = (x > 1e-9) & (x < width - 1e-9) & (y > 1e-9) & (y < height - 1e-9)
    domain.mesh.geometry.x[inner, 0] += amount * width / cells[0] * np.sin(13.0 * x + 7.0 * y)[inner]
    domain.mesh.geometry.x[inner, 1] += amount * height / cells[1] * np.cos(11.0 * x - 5.0 * y)[inner]
    return domain


@pytest.fixture(params=["triangle", "quadrilateral"])
def cell(request):
    return request.param


@pytest.fixture(params=["cauchy", "cosserat"])
def material(request):
    return material_of(request.param)


@pytest.fixture
def distorted(cell, material):
    """A body on a distorted mesh, for both kinds of cells and materials."""
    return Body(distorted_domain(cell), material)


@pytest.fixture
def make_domain():
    return distorted_domain


@pytest.fixture
def make_material():
    return material_of
