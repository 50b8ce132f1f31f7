import numpy as np
import pytest
from scipy.spatial import cKDTree

from meshes import Box, Cylinder, Disc, Sphere, packings

REGION, DOMAIN = Box((5.5, 5.5), (12.5, 9)), Box((0, 0), (18, 9))
LAYOUTS = [packings.square_45, packings.square, packings.hexagonal]


@pytest.mark.parametrize("radius, count, longer, rows", [(0.05, 2426, 50, 49), (0.03, 6765, 83, 82)])
def test_assemblies_of_li_and_wan(radius, count, longer, rows):
    """Li & Wan (2010), section 3: 2426 = 25 x 50 + 24 x 49 and 6765 = 41 x 83 + 41 x 82 discs, outer width 7.03 m."""
    centres = packings.square_45(REGION, radius)
    assert len(centres) == count
    assert centres[:, 1].max() + radius == pytest.approx(9.0, abs=1e-12)  # tangent to the surface
    levels, numbers = np.unique(np.round(centres[:, 1], 9), return_counts=True)
    assert len(levels) == rows and numbers[-1] == longer and set(numbers) == {longer, longer - 1}
    mirrored = np.column_stack((18.0 - centres[:, 0], centres[:, 1]))
    assert cKDTree(centres).query(mirrored)[0].max() < 1e-12


@pytest.mark.parametrize("layout", LAYOUTS)
def test_neighbours_just_touch(layout):
    """Every inner site has its 4 (6) neighbours at 2 r, none closer; normals at +-45 degrees for square_45."""
    centres = layout(((0, 0), (2, 2)), 0.05)
    pairs = cKDTree(centres).query_pairs(0.1 * (1 + 1e-9), output_type="ndarray")
    branch = centres[pairs[:, 1]] - centres[pairs[:, 0]]
    assert np.linalg.norm(branch, axis=1) == pytest.approx(np.full(len(pairs), 0.1), rel=1e-12)
    inner = np.all(np.abs(centres - 1.0) < 0.7, axis=1)
    degree = np.bincount(pairs.ravel(), minlength=len(centres))[inner]
    assert set(degree) == {6 if layout is packings.hexagonal else 4}
    if layout is packings.square_45:
        assert np.abs(np.abs(branch) - 0.1 / np.sqrt(2)).max() < 1e-12


@pytest.mark.parametrize("layout", LAYOUTS)
def test_same_lattice_in_region_and_domain(layout):
    """With a site of the region as anchor the domain's sites inside the region are the region's, and no other."""
    centres = layout(REGION, 0.05)
    for site in (0, len(centres) // 3, -1):
        everywhere = layout(DOMAIN, 0.05, anchor=centres[site])
        there = everywhere[REGION.contains(everywhere)]
        assert len(there) == len(centres)
        assert np.abs(there - centres).max() < 1e-11


@pytest.mark.parametrize(
    "layout, contacts, solid",
    [(packings.simple_cubic, 6, np.pi / 6), (packings.face_centred_cubic, 12, np.pi / np.sqrt(18))],
)
def test_lattices_of_spheres(layout, contacts, solid):
    """Contacts at 2 r, none closer; counts and solid fraction of whole cells in closed form (Kittel, table 1.2)."""
    radius, cells = 0.05, 6
    edge = radius * (2 if contacts == 6 else 2 * np.sqrt(2))
    side = edge * cells
    centres = layout(((0, 0, 0), (side, side, side)), radius, anchor=(0.1 * edge,) * 3)
    assert len(centres) == cells**3 * (1 if contacts == 6 else 4)  # no site on a face: whole cells
    assert len(centres) * 4 / 3 * np.pi * radius**3 / side**3 == pytest.approx(solid, rel=1e-12)
    pairs = cKDTree(centres).query_pairs(2 * radius * (1 + 1e-9), output_type="ndarray")
    branch = np.linalg.norm(centres[pairs[:, 1]] - centres[pairs[:, 0]], axis=1)
    assert branch == pytest.approx(np.full(len(pairs), 2 * radius), rel=1e-12)
    inner = np.all(np.abs(centres - 0.5 * side) < 0.5 * side - 2.1 * radius - 0.1 * edge, axis=1)
    assert inner.any() and set(np.bincount(pairs.ravel(), minlength=len(centres))[inner]) == {contacts}
    assert (np.diff(centres[:, 2]) < 1e-12).all()  # from the top


@pytest.mark.parametrize("layout", [packings.simple_cubic, packings.face_centred_cubic])
def test_lattices_of_spheres_in_other_regions(layout):
    region = Cylinder((0, 0, 0), (0, 0, 2), 1.0)
    centres = layout(region, 0.03)
    assert region.contains(centres).all() and centres[:, 2].max() == 2 - 0.03
    site = 0.06**3 if layout is packings.simple_cubic else (0.06 * np.sqrt(2)) ** 3 / 4  # volume of a site
    assert len(centres) * site == pytest.approx(region.measure, rel=0.03)  # the surface holds half a layer: 1 %
    inside = layout(Sphere((0, 0, 1), 0.5), 0.03, anchor=centres[100])
    assert cKDTree(centres).query(inside)[0].max() < 1e-12


def test_top_row_on_the_surface_and_other_regions():
    assert packings.square_45(REGION, 0.05, surface="centres")[:, 1].max() == 9.0
    disc = Disc((1, 1), 0.5)
    inside = packings.hexagonal(disc, 0.02)
    assert disc.contains(inside).all()
    assert len(inside) * 2 * np.sqrt(3) * 0.02**2 == pytest.approx(disc.area, rel=0.03)  # cell of a hexagonal site
    assert len(packings.square(((0, 0), (0.1, 0.05)), 0.2)) == 0


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: packings.square_45(REGION, -0.05), "radius=-0.05 must be positive"),
        (lambda: packings.square_45(REGION, np.nan), "radius=nan must be positive"),
        (lambda: packings.simple_cubic(REGION, 0.05), "region=.* must be .*z_min"),
        (
            lambda: packings.face_centred_cubic(((0, 0, 0), (1, 1, 1)), 0.1, anchor=(0, 0)),
            "anchor=.* must be three finite",
        ),
        (lambda: packings.square(((0, 0), (1, np.inf)), 0.1), "region=.* must be a finite region"),
        (lambda: packings.hexagonal(REGION, 0.1, surface="above"), 'surface="above" must be'),
        (lambda: packings.hexagonal(REGION, 0.1, anchor=(0, np.nan)), "anchor=.* must be two finite numbers"),
    ],
)
def test_bad_layouts_are_named(make, words):
    with pytest.raises(ValueError, match=words):
        make()
