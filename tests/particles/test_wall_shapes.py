"""Facets, edges and corners: what counts as a contact, histories that go from facet to facet, files, bad input."""

import meshio
import numpy as np
import pytest

from particles import Assembly, Free, LiChu, Servo, Wall, room, shapes

STICKY = LiChu(1e7, 5e6, 1e5, 1e2, sliding_friction=0.5, rolling_friction=0.2, moment_friction=1e-3, normal_damping=1500.0)


def tiled_floor(count, size=2.0):
    """Horizontal square of count x count squares of two triangles, at z = 0."""
    place = np.linspace(-size / 2, size / 2, count + 1)
    x, y = np.meshgrid(place, place, indexing="ij")
    vertices = np.column_stack([x.ravel(), y.ravel(), 0.0 * x.ravel()])
    k = np.arange((count + 1) ** 2).reshape(count + 1, count + 1)
    a, b, c, d = k[:-1, :-1].ravel(), k[1:, :-1].ravel(), k[1:, 1:].ravel(), k[:-1, 1:].ravel()
    return vertices, np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])


def touching(position, *walls, radius=0.05, law=STICKY):
    """Contacts of one particle with walls."""
    soil = Assembly([position], radius, law=law)
    soil.add_wall(*walls)
    return soil.contacts(walls=True)


def test_sphere_crosses_triangle_edges_as_on_one_plane():
    """Sliding, rolling, spinning and bouncing over some twenty edges: the same motion and history as on a plane."""
    results = []
    for shape in (shapes.plane((0, 0, 0), (0, 0, 1)), shapes.mesh(*tiled_floor(21))):
        soil = Assembly([[-0.43, -0.37, 0.0499]], 0.05, law=STICKY)
        soil.add_wall(Wall(shape))
        soil.velocities = [[1.0, 0.9, 0.0, 2.0, 5.0, 3.0]]
        soil.advance(8000, 1e-4, gravity=(0.2, 0.0, -9.81))
        assert soil.rebuilds > 20
        results.append((soil.displacements, soil.velocities, soil.contacts(walls=True).history, soil.energies()))
    (moved, speed, history, energy), others = results[0], results[1]
    assert np.abs(history["sliding"]).max() > 0
    # facets and the plane are the same to rounding, and a sphere on a floor does not amplify it much
    np.testing.assert_allclose(others[0], moved, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(others[1], speed, rtol=1e-8, atol=1e-10)
    for name in history:
        np.testing.assert_allclose(others[2][name], history[name], rtol=1e-6, atol=1e-6)
    assert others[3] == pytest.approx(energy, rel=1e-8, abs=1e-10)


@pytest.mark.parametrize("place", [(0.1, 0.1), (0.1, 0.03), (0.0, 0.0), (0.2, 0.1), (0.1 + 1e-17, 0.1 - 1e-17)])
def test_flat_mesh_counts_one_contact_wherever_the_sphere_is(place):
    """On faces, edges and vertices of squares of 0.1 m with their diagonals."""
    found = touching((*place, 0.049), Wall(shapes.mesh(*tiled_floor(20))))
    assert len(found.first) == 1
    np.testing.assert_allclose(found.normal[0], [0, 0, -1], atol=1e-14)
    assert found.overlap[0] == pytest.approx(1e-3)


@pytest.mark.parametrize(
    "position, normal",
    [
        ((1.03, 0.5, 1.03), (-1, 0, -1)),  # an edge between two faces
        ((1.02, 1.02, 1.02), (-1, -1, -1)),  # a corner of three faces, six triangles
        ((0.5, 0.5, 1.04), (0, 0, -1)),  # the diagonal of a face
    ],
)
def test_convex_edges_and_corners_of_a_box_count_once(position, normal):
    found = touching(position, Wall(shapes.box((0, 0, 0), (1, 1, 1))))
    assert len(found.first) == 1
    np.testing.assert_allclose(found.normal[0], np.array(normal) / np.linalg.norm(normal), atol=1e-12)


def test_concave_corners_count_each_face_once():
    """A corner of three planes, of a triangulated solid with a step, and of a polygon with a notch."""
    assert len(touching((0.049, 0.048, 0.047), *room((0, 0, 0), (1, 1, 1))).first) == 3
    step = shapes.polygon([(0, 0), (1, 0), (1, 0.5), (0.5, 0.5), (0.5, 1), (0, 1)])
    found = touching((0.549, 0.548), Wall(step))
    assert sorted(found.overlap) == pytest.approx([1e-3, 2e-3])
    np.testing.assert_allclose(np.abs(found.normal).sum(axis=0), [1, 1])
    corner = shapes.mesh(
        [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (1, 0, 1), (0, 0, 1)], [(0, 1, 2), (0, 2, 3), (0, 1, 4), (0, 4, 5)]
    )
    assert sorted(touching((0.5, 0.048, 0.049), Wall(corner)).overlap) == pytest.approx([1e-3, 2e-3])


def test_facets_of_a_drum_are_one_smooth_surface_or_not():
    drum = shapes.cylinder((0, 0, -1), (0, 0, 1), 1.0, sides=48, solid=False)
    seam = np.array([1.0, 0.0, 0.1]) - [0.0501, 0.0, 0.0]  # both facets at a depth of about 1e-4 m
    shallow = {smooth: len(touching(seam, Wall(drum, smooth=smooth), radius=0.0504).first) for smooth in (15.0, 0.0)}
    assert shallow == {15.0: 1, 0.0: 2}


def test_thin_and_hollow_shapes():
    """A solid thinner than a radius pushes by its near face only; a polyline is touched from both sides."""
    for height, normal in ((0.045, -1.0), (-0.055, 1.0)):
        found = touching((0.0, height), Wall(shapes.box((-1, -0.01), (1, 0.0))))
        assert len(found.first) == 1 and found.normal[0, 1] == pytest.approx(normal) and found.overlap[0] == pytest.approx(5e-3)
        found = touching((0.0, -0.045 * normal), Wall(shapes.polyline([(-1, 0), (0.0, 0.0), (1, 0)])))
        assert len(found.first) == 1 and found.normal[0, 1] == pytest.approx(normal)


def test_disc_rolls_around_a_tip_and_keeps_its_history():
    """Face, corner and other face of a pick: the sliding force that is stored goes from one to the next."""
    law = LiChu(1e8, 5e7, sliding_friction=1e9)
    tip = np.array([0.0, 0.0])
    pick = Wall(shapes.polygon([tip, (1.0, -1.0), (1.0, 1.0)]))
    direction, normal = np.array([1, 1]) / np.sqrt(2), np.array([-1, 1]) / np.sqrt(2)
    soil = Assembly([0.02 * direction + 0.0495 * normal], 0.05, law=law)
    soil.add_wall(pick)
    soil.hold([0])
    soil.velocities = [[*(-1.0 * direction), 0.0]]
    soil.advance(10, 1e-4)
    stored = soil.contacts(walls=True).history["sliding"][0, 0]
    assert abs(stored) == pytest.approx(5e7 * 1e-3, rel=1e-9)
    # on without sliding: rolling along the face, then about the tip, then along the other face
    h, arm = 1e-4, 0.0495
    places = [soil.positions[0] - k * 1e-3 * direction for k in range(1, 20)]
    angles = np.linspace(0.0, np.pi / 2, 80)[1:]
    places += [arm * np.array([-np.sin(a + np.pi / 4), np.cos(a + np.pi / 4)]) for a in angles]
    other = np.array([1, -1]) / np.sqrt(2)
    places += [places[-1] + k * 1e-3 * other for k in range(1, 20)]
    for place in places:
        shift = place - soil.positions[0]
        soil.velocities = [[*(shift / h), np.linalg.norm(shift) / arm / h]]
        soil.advance(1, h)
    found = soil.contacts(walls=True)
    assert len(found.first) == 1 and found.normal[0] == pytest.approx([1 / np.sqrt(2), 1 / np.sqrt(2)])
    # the step from the face to the corner is taken on the corner: error of a part of one step, 1e-3 m (1 - cos) < 1e-6 m
    assert found.history["sliding"][0, 0] == pytest.approx(stored, abs=5e7 * 2e-6)


def test_stl_and_msh_files_come_back(tmp_path):
    vertices, triangles = tiled_floor(4)
    soup = vertices[triangles].reshape(-1, 3)  # as STL has them: each triangle with its own corners
    for name in ("floor.stl", "floor.msh"):
        file_format = {"file_format": "gmsh22"} if name.endswith("msh") else {}
        meshio.Mesh(soup, [("triangle", np.arange(len(soup)).reshape(-1, 3))]).write(tmp_path / name, **file_format)
        shape = shapes.read(tmp_path / name, scale=2.0)
        assert len(shape.vertices) == len(vertices) and len(shape.corners) == len(triangles)
        assert len(touching((0.0, 0.0, 0.049), Wall(shape)).first) == 1
        np.testing.assert_allclose(np.ptp(shape.vertices, axis=0), [4, 4, 0])


def test_shapes_close_and_have_the_right_size():
    for shape, volume in (
        (shapes.box((0, 0, 0), (1, 2, 3)), 6.0),
        (shapes.cylinder((0, 0, 0), (0, 3, 0), 0.5, sides=400), 0.75 * np.pi),
    ):
        a, b, c = (shape.vertices[shape.corners[:, k]] for k in range(3))
        # the area of a polygon of n corners in a circle falls short by 2 pi^2 / (3 n^2)
        assert np.sum(a * np.cross(b, c)) / 6 == pytest.approx(volume, rel=1e-4)


SQUARE = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: shapes.read("nowhere.stl"), "path='nowhere.stl' cannot be read"),
        (lambda: shapes.mesh(SQUARE, [(0, 1, 1)]), "no area, the first of them number 0"),
        (lambda: shapes.mesh(SQUARE, [(0, 1, 4)]), "rows of the 4 vertices"),
        (lambda: shapes.mesh([(0, 0, 0), (1, 0, np.inf), (0, 1, 0)], [(0, 1, 2)]), "vertices must be finite.*row 1"),
        (lambda: shapes.mesh(SQUARE, [(0, 1, 2)], solid=True), "must close a surface"),
        (lambda: shapes.mesh(shapes.box((0, 0, 0), (1, 1, 1)).vertices, shapes.box((0, 0, 0), (1, 1, 1)).corners[:, ::-1], True),
         "reverse the corners"),
        (lambda: shapes.polygon([(0, 0), (0, 1), (1, 0)]), "counter-clockwise"),
        (lambda: shapes.polyline([(0, 0), (0, 0)]), "points 0 and 1 are the same"),
        (lambda: shapes.plane((0, 0), (0, 0)), "normal=.*must have a length"),
        (lambda: shapes.plane((0, 0), (0, 0, 1)), "normal of shape"),
        (lambda: shapes.box((0, 0), (1, 0)), "lower=.*must be less"),
        (lambda: shapes.cylinder((0, 0, 0), (0, 0, 0), 1), "start=.*two places"),
        (lambda: Wall("floor"), "shape='floor'"),
        (lambda: Wall(shapes.box((0, 0), (1, 1)), spin=(0, 0, 1)), "spin=.*must be a finite number"),
        (lambda: Wall(shapes.box((0, 0), (1, 1)), motion=Servo({"z": 1.0}, 1.0)), "force='z'"),
        (lambda: Wall(shapes.box((0, 0), (1, 1)), motion=Free(1.0, -2.0)), "inertia=-2.0"),
        (lambda: Free(0.0), "mass=0.0 must be positive"),
        (lambda: Free(1.0, free="r"), "give its inertia"),
        (lambda: Servo({"x": 1.0}, 1.0, gain=1.5), "gain=1.5"),
        (lambda: Servo.confining("up", 1e5, 1.0, 1.0), "direction='up'"),
        (lambda: touching((0, 0), Wall(shapes.plane((0, 0, 0), (0, 0, 1)))), "points of 3 components, but .* discs in the plane"),
    ],
)  # fmt: skip
def test_bad_shapes_and_motions_are_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_unreadable_files_are_named(tmp_path):
    (tmp_path / "bad.stl").write_text("solid nothing\nfacet rubbish\n")
    with pytest.raises(ValueError, match="bad.stl"):
        shapes.read(tmp_path / "bad.stl")
