"""Structured and gmsh meshes: names, areas, outlines, user files."""

import subprocess
import sys

import numpy as np
import pytest
from mpi4py import MPI

from continuum import Body, Cauchy, cells
from meshes import Box, domains

REGION = Box((5.5, 5.5), (12.5, 9))


def corners(domain):
    return Body(domain, Cauchy(1e9, 0.2, 1.0)).cell_corners


def lengths(domain, name):
    from meshes._compat import facet_vertices

    ends = facet_vertices(domain.mesh, domain.facets(name))
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum(), ends


def test_structured_rectangle_of_li_and_wan():
    domain = domains.rectangle((0, 0), (18, 9), plate=2.0)
    assert domain.mesh.topology.index_map(2).size_global == 162
    assert domain.mesh.topology.index_map(0).size_global == 190
    for name, length in (("left", 9), ("right", 9), ("bottom", 18), ("top", 18), ("plate", 2)):
        assert lengths(domain, name)[0] == pytest.approx(length, rel=1e-12)
    ends = lengths(domain, "plate")[1]
    assert ends[..., 0].min() == 8 and ends[..., 0].max() == 10 and np.all(ends[..., 1] == 9)
    assert domain.bounds.tolist() == [[0, 0], [18, 9]]
    assert len(domain.cells("soil")) == 162


def test_graded_mesh_has_its_names_areas_and_sizes(cell):
    domain = domains.foundation(region=REGION, cell=cell)
    points = corners(domain)
    area = cells.areas(points)
    assert area.sum() == pytest.approx(162, rel=1e-12)
    assert area[domain.cells("region")].sum() == pytest.approx(REGION.area, rel=1e-12)
    assert len(domain.cells("soil")) == len(area)
    for name, length in (("left", 9), ("right", 9), ("bottom", 18), ("top", 18), ("plate", 2)):
        assert lengths(domain, name)[0] == pytest.approx(length, rel=1e-12)
    # no element crosses the outline: every cell has all corners on one side of it
    distance = REGION.distance(points.reshape(-1, 2)).reshape(points.shape[:2])
    assert np.all((distance.max(axis=1) < 1e-9) | (distance.min(axis=1) > -1e-9))
    # about 0.25 m at the plate, 1 m far away
    middle = points.mean(axis=1)
    size = np.sqrt(area * (2 if cell == "triangle" else 1))
    near = np.abs(middle - [9, 9]).max(axis=1) < 0.6
    far = middle[:, 1] < 3
    assert 0.15 < np.median(size[near]) < 0.4 and 0.7 < np.median(size[far]) < 1.3
    # cut nothing: the region excluded leaves whole cells only
    body = Body(domain, Cauchy(1e9, 0.2, 1.0), excluded=REGION)
    assert set(body.cell_fractions) == {0.0, 1.0}


@pytest.fixture(params=["triangle", "quadrilateral"])
def cell(request):
    return request.param


def test_graded_mesh_without_region():
    domain = domains.foundation(size=2.0, size_near=0.5)
    assert cells.areas(corners(domain)).sum() == pytest.approx(162, rel=1e-12)
    with pytest.raises(ValueError, match='cells "region" are unknown'):
        domain.cells("region")


GEOMETRY = """
SetFactory("OpenCASCADE");
Rectangle(1) = {0, 0, 0, 2, 1};
Rectangle(2) = {2, 0, 0, 1, 1};
BooleanFragments{ Surface{1}; Delete; }{ Surface{2}; Delete; }
MeshSize{:} = 0.3;
"""


BLOCK = """
SetFactory("OpenCASCADE");
Box(9) = {5, 0, 0, 2, 1, 3};
MeshSize{:} = 1;
"""


def write_mesh(path, groups="", option="-2", parts=GEOMETRY):
    """A .msh file of two joined rectangles, or of other parts, by gmsh in a process of its own."""
    geometry = path.with_suffix(".geo")
    geometry.write_text(parts + groups + "\n")
    code = (
        "import gmsh, sys; gmsh.initialize(); gmsh.option.setNumber('General.Terminal', 0); gmsh.open(sys.argv[1]);"
        f"gmsh.model.mesh.generate({option.strip('-')}); gmsh.write(sys.argv[2]); gmsh.finalize()"
    )
    subprocess.run([sys.executable, "-c", code, str(geometry), str(path)], check=True)
    return path


def test_own_mesh_with_names(tmp_path):
    groups = """
    Physical Surface("clay") = {1}; Physical Surface("sand") = {2};
    Physical Curve("footing") = Curve In BoundingBox {-0.1, 0.9, -0.1, 2.1, 1.1, 0.1};
    """
    domain = domains.read(write_mesh(tmp_path / "own.msh", groups), MPI.COMM_WORLD)
    area = cells.areas(corners(domain))
    assert area[domain.cells("clay")].sum() == pytest.approx(2, rel=1e-12)
    assert area[domain.cells("sand")].sum() == pytest.approx(1, rel=1e-12)
    assert area[domain.cells("soil")].sum() == pytest.approx(3, rel=1e-12)
    assert lengths(domain, "footing")[0] == pytest.approx(2, rel=1e-12)
    assert lengths(domain, "bottom")[0] == pytest.approx(3, rel=1e-12)  # named by position


def test_own_mesh_without_names(tmp_path):
    domain = domains.read(write_mesh(tmp_path / "plain.msh"))
    assert cells.areas(corners(domain))[domain.cells("soil")].sum() == pytest.approx(3, rel=1e-12)
    for name, length in (("left", 1), ("right", 1), ("bottom", 3), ("top", 3)):
        assert lengths(domain, name)[0] == pytest.approx(length, rel=1e-12)


@pytest.mark.parametrize("content, words", [(None, "does not exist"), ("rubbish\n", "cannot be read|holds no plane")])
def test_unreadable_files_are_named(tmp_path, content, words):
    path = tmp_path / "bad.msh"
    if content is not None:
        path.write_text(content)
    with pytest.raises(ValueError, match=f"mesh=.*bad.msh .*({words})"):
        domains.read(path)


def test_files_with_other_elements_are_named(tmp_path):
    with pytest.raises(ValueError, match="holds no plane elements nor volumes"):
        domains.read(write_mesh(tmp_path / "lines.msh", option="-1"))
    with pytest.raises(ValueError, match="not Triangle 6"):
        domains.read(write_mesh(tmp_path / "curved.msh", "Mesh.ElementOrder = 2;"))
    with pytest.raises(ValueError, match="4-node tetrahedra or 8-node hexahedra, not Tetrahedron 10"):
        domains.read(write_mesh(tmp_path / "solid.msh", "Mesh.ElementOrder = 2;", "-3", BLOCK))
    with pytest.raises(ValueError, match="nodes outside its volumes"):
        domains.read(write_mesh(tmp_path / "mixed.msh", "Box(9) = {5, 0, 0, 1, 1, 1};", "-3"))


HEXAHEDRA = "Transfinite Curve{:} = 4; Transfinite Surface{:}; Recombine Surface{:}; Transfinite Volume{9};"


@pytest.mark.parametrize("more, corners_a_cell", [("", 4), (HEXAHEDRA, 8)])
def test_own_mesh_of_volumes(more, corners_a_cell, tmp_path):
    """One face is named by the file, the others by position."""
    groups = 'Physical Volume("rock") = {9}; Physical Surface("pick") = Surface In BoundingBox {4.9, -1, 2.9, 8, 2, 3.1};'
    domain = domains.read(write_mesh(tmp_path / "solid.msh", groups + more, "-3", BLOCK))
    body = Body(domain, Cauchy(1e9, 0.2, 1.0))
    assert body.cell_nodes.shape[1] == corners_a_cell
    assert domain.bounds == pytest.approx(np.array([[5, 0, 0], [7, 1, 3]]), abs=1e-12)
    assert cells.measures(body.cell_corners)[domain.cells("rock")].sum() == pytest.approx(6, rel=1e-12)
    for name, area in (("left", 3), ("right", 3), ("front", 6), ("back", 6), ("bottom", 2), ("pick", 2)):
        before = body.external_force()[:, 0].sum()
        body.traction(name, (1.0, 0.0, 0.0))
        assert body.external_force()[:, 0].sum() - before == pytest.approx(area, rel=1e-12)
    with pytest.raises(ValueError, match='facets "top" are unknown'):
        domain.facets("top")


@pytest.mark.parametrize("kind", ["tetrahedron", "hexahedron"])
def test_structured_box(kind):
    domain = domains.box((0, 0, 1), (2, 1, 4), (4, 2, 3), kind)
    points = corners(domain)
    assert len(points) == 24 * (6 if kind == "tetrahedron" else 1)
    assert cells.measures(points) == pytest.approx(np.full(len(points), 6 / len(points)), rel=1e-12)
    assert domain.bounds.tolist() == [[0, 0, 1], [2, 1, 4]]
    from meshes._compat import facet_vertices

    sides = {"left": (0, 0), "right": (0, 2), "front": (1, 0), "back": (1, 1), "bottom": (2, 1), "top": (2, 4)}
    for name, (axis, level) in sides.items():
        assert np.all(facet_vertices(domain.mesh, domain.facets(name))[..., axis] == level)


def test_a_session_of_gmsh_that_is_open_stays_open():
    """The caller's model is still there after a mesh has been made."""
    gmsh = pytest.importorskip("gmsh")
    gmsh.initialize(readConfigFiles=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add("mine")
        gmsh.model.occ.addPoint(0, 0, 0)
        gmsh.model.occ.synchronize()
        gmsh.option.setNumber("Mesh.RecombineAll", 0)
        domains.foundation(size=3.0, size_near=1.0, cell="quadrilateral")
        assert gmsh.option.getNumber("Mesh.RecombineAll") == 0
        assert gmsh.model.getCurrent() == "mine" and len(gmsh.model.getEntities(0)) == 1
    finally:
        gmsh.finalize()


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: domains.rectangle((0, 0), (0, 1)), "must lie below and left of"),
        (lambda: domains.rectangle((0, 0), (1, 1), (0, 3)), r"cells=\(0, 3\) must be"),
        (lambda: domains.rectangle((0, 0), (1, 1), (1.5, 3)), "cells=.* must be"),
        (lambda: domains.rectangle((0, 0), (1, 1), (1, 1), "hexagon"), 'cell="hexagon" must be'),
        (lambda: domains.rectangle((0, 0), (1, 1), (1, 1), plate=3.0), "plate=3.0 must be"),
        (lambda: domains.box((0, 0), (1, 1)), r"both \(x, y, z\)"),
        (lambda: domains.box((0, 0, 0), (1, 1, 1), (3, 3)), "three positive whole numbers"),
        (lambda: domains.box((0, 0, 0), (1, 1, 1), (1, 1, 1), "triangle"), 'cell="triangle" must be "tetrahedron" or'),
        (lambda: domains.foundation(width=-1), "width=-1 must be positive"),
        (lambda: domains.foundation(size=np.nan), "size=nan must be positive"),
        (lambda: domains.foundation(plate=20), "plate=20 must be narrower"),
        (lambda: domains.foundation(region=Box((5, 5), (20, 9))), "region=.* must lie inside the soil"),
        (lambda: domains.rectangle((0, 0), (1, 1), (1, 1)).facets("plate"), 'facets "plate" are unknown'),
    ],
)
def test_bad_input_is_named(make, words):
    with pytest.raises(ValueError, match=words):
        make()


def test_regions_and_packings_need_neither_dolfinx_nor_gmsh():
    code = "import sys; sys.modules.update(dolfinx=None, gmsh=None, mpi4py=None); import meshes; meshes.packings, meshes.Box"
    subprocess.run([sys.executable, "-c", code], check=True)
