import numpy as np
import pytest
import trimesh
from skimage.measure import marching_cubes

from hilbertvae.cloud import Cloud
from hilbertvae.drawing.field import BLOCK, Field
from hilbertvae.drawing.surface import Surface, field_surface, write_ply
from toy_places import in_street, street


def cloud(points, occupied=None):
    occupied = np.ones(len(points), bool) if occupied is None else occupied
    return Cloud(np.asarray(points, float), occupied, np.ones(len(points)))


def ball(radius_m, centre):
    return lambda q: 1 / (1 + np.exp(4 * (np.linalg.norm(q - centre, axis=1) - radius_m)))


def surface_near(predict, shown, resolution_m, **reach):
    return field_surface(Field.near(predict, shown.points, resolution_m, **reach), shown.points[shown.occupied])


def mesh_of(surface):
    return trimesh.Trimesh(surface.vertices, surface.faces, process=False)


@pytest.mark.parametrize("offset", [0.0, 500_000.0])
def test_a_ball_across_blocks_is_closed_and_has_its_volume(offset):
    centre = np.array([0.3, -0.2, 0.1]) + [offset, 10 * offset, 0]
    rng = np.random.default_rng(0)
    direction = rng.standard_normal((20_000, 3))
    points = centre + 4 * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    surface = surface_near(ball(4.0, centre), cloud(points), 0.2)
    mesh = mesh_of(surface)
    mesh.vertices -= centre
    assert mesh.is_watertight and mesh.is_winding_consistent and len(mesh.split()) == 1
    assert len(np.unique(surface.vertices, axis=0)) == len(surface)
    radius = 4.0 - np.log(0.6 / 0.4) / 4
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * radius**3, rel=0.01)
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices, axis=1), radius, atol=0.01)
    assert surface.observed.all()


@pytest.mark.parametrize("seed", range(3))
def test_blocks_give_what_one_array_gives(seed):
    """Random values, some on the cut itself: every ambiguous case of marching cubes, across block sides too."""
    rng = np.random.default_rng(seed)
    whole = rng.choice([0.0, 0.3, 0.6, 0.6004, 0.7, 1.0], (BLOCK + 9, BLOCK + 3, BLOCK)).astype(np.float32)
    padded = np.pad(whole, [(0, -length % BLOCK) for length in whole.shape], constant_values=np.nan)
    blocks = {}
    for key in np.ndindex(*(length // BLOCK for length in padded.shape)):
        blocks[key] = padded[tuple(slice(k * BLOCK, (k + 1) * BLOCK) for k in key)]
    surface = field_surface(Field(blocks, 1.0), np.empty((0, 3)))
    moved = np.where(np.abs(whole - 0.6) < 1e-3, np.where(whole > 0.6, 0.601, 0.599), whole).astype(np.float32)
    vertices, faces, _, _ = marching_cubes(moved, 0.6)
    # A few triangles lie in the side of a cell that ends the lattice, and count as beyond it.
    assert len(surface) == len(vertices) and len(surface.faces) == pytest.approx(len(faces), rel=1e-4)

    def triangles(v, f):
        corners = np.round(v[f], 3)
        return np.unique(np.sort(corners.mean(axis=1).round(2).view([("", float)] * 3).ravel()))

    ours, one = triangles(surface.vertices - 0.5, surface.faces), triangles(vertices.astype(float), faces)
    assert len(np.intersect1d(ours, one)) > 0.97 * len(one)  # the rest is rounding
    edges = np.sort(surface.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    open_edges, count = np.unique(edges, axis=0, return_counts=True)
    ends = surface.vertices[open_edges[count == 1]] - 0.5
    side = np.isclose(ends, 0).any(axis=(1, 2)) | np.isclose(ends, np.array(whole.shape) - 1).any(axis=(1, 2))
    assert side.all()  # no seam inside


def test_surface_ends_where_the_map_was_not_asked():
    points = np.array([[x, y, 0.0] for x in np.arange(0, 4, 0.2) for y in np.arange(0, 4, 0.2)])
    surface = surface_near(lambda q: (q[:, 2] < 0).astype(float), cloud(points), 0.2, reach_m=0.6)
    assert np.ptp(surface.vertices[:, 2]) == pytest.approx(0, abs=1e-6)  # no cap underground
    assert surface.vertices[:, :2].min() > -0.7 and surface.vertices[:, :2].max() < 4.7
    assert (surface.probability == 1).all()


def test_observed_is_near_occupied_points_only():
    site = street()
    hidden = (site.fit.points[:, 0] > 3.6) & (site.fit.points[:, 0] < 6.4) & (site.fit.points[:, 2] > 0.3)
    surface = surface_near(lambda q: in_street(q).astype(float), site.fit.select(~hidden), 0.2)
    x, y, z = surface.vertices.T
    roof = (x > 4.2) & (x < 5.8) & (z > 1.2) & (z < 1.8) & (y < 4)
    street_ground = (x > 8) & (x < 10) & (np.abs(z) < 0.2) & (y > 1) & (y < 3)
    assert roof.any() and not surface.observed[roof].any()
    assert surface.observed[street_ground].mean() > 0.9


def test_nothing_occupied_is_an_empty_surface(tmp_path):
    surface = surface_near(lambda q: np.full(len(q), 0.5), cloud(np.zeros((1, 3))), 0.2)
    assert len(surface) == 0 and surface.faces.shape == (0, 3) and surface.vertices.shape == (0, 3)
    assert write_ply(tmp_path / "empty.ply", surface, np.empty((0, 3), np.uint8)).read_bytes().startswith(b"ply")


def test_ply_is_read_back(tmp_path):
    vertices = np.array([[500_000.001, 4_500_000.002, 10.0], [500_001.001, 4_500_000.002, 10.0], [500_000.001, 4_500_001.002, 10.003]])
    surface = Surface(vertices, np.array([[0, 1, 2]]), np.array([0.7, 0.8, 0.9]), np.array([True, False, True]))
    colours = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 128]], np.uint8)
    path = write_ply(tmp_path / "new" / "map.ply", surface, colours)
    mesh = trimesh.load(path, process=False)
    np.testing.assert_array_equal(mesh.vertices, vertices)
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2]])
    np.testing.assert_array_equal(mesh.visual.vertex_colors[:, :3], colours)
    raw = mesh.metadata["_ply_raw"]["vertex"]["data"]
    np.testing.assert_allclose(np.ravel(raw["probability"]), [0.7, 0.8, 0.9], rtol=1e-6)
    np.testing.assert_array_equal(np.ravel(raw["observed"]), [1, 0, 1])
    assert [file.name for file in path.parent.iterdir()] == ["map.ply"]


def test_fine_cells_far_from_the_origin():
    """In UTM coordinates there are more cells between the origin and a map than 64 bits can number."""
    centre = np.array([500_000.0, 5_400_000.0, 300.0])
    direction = np.random.default_rng(0).standard_normal((2000, 3))
    points = centre + 0.4 * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    surface = surface_near(lambda q: 1 / (1 + np.exp(20 * (np.linalg.norm(q - centre, axis=1) - 0.4))), cloud(points), 0.04, reach_m=0.4)
    mesh = mesh_of(surface)
    mesh.vertices -= centre
    assert mesh.is_watertight and mesh.volume == pytest.approx(4 / 3 * np.pi * (0.4 - np.log(1.5) / 20) ** 3, rel=0.03)
