import numpy as np
import pytest
import trimesh
from export_toys import UTM, random_cells

from hilbertvae.checks import InputError
from hilbertvae.drawing.field import BLOCK
from hilbertvae.drawing.lit_colours import height_colours
from hilbertvae.exports.map_cells import MapCells
from hilbertvae.exports.mesh_ply import cells_surface, write_mesh_ply


def house(offset=(0, 0, 0)):
    """A hollow box of cells over block sides, its roof predicted; free inside, nothing said outside."""
    index = np.stack(np.meshgrid(*[np.arange(-5, BLOCK + 3)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    wall = ((index == -5) | (index == BLOCK + 2)).any(axis=1)
    seen = index[:, 2] < BLOCK + 2
    return MapCells(index + np.array(offset), 0.2, np.where(wall, 0.9, 0.05), np.zeros(len(index)), seen), wall


@pytest.mark.parametrize("seed", range(3))
def test_the_mesh_holds_the_occupied_cells_and_no_others(tmp_path, seed):
    cells = random_cells(3, seed, count=400, span=12, offset_m=-0.6)
    mesh = trimesh.load(write_mesh_ply(cells, tmp_path / "map.ply"), process=False)
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    inside = mesh.contains(cells.centres)
    off_the_cut = np.abs(cells.probability - 0.6) > 0.01
    np.testing.assert_array_equal(inside[off_the_cut], cells.occupied[off_the_cut])


def test_a_house_is_closed_and_its_roof_predicted(tmp_path):
    cells, _ = house(np.floor(UTM / 0.2).astype(int))
    mesh = trimesh.load(write_mesh_ply(cells, tmp_path / "map.ply"), process=False)
    corner = cells.centres.min(axis=0)
    mesh.vertices -= corner
    assert mesh.is_watertight and len(mesh.split(only_watertight=True)) == 2
    side = (BLOCK + 7) * 0.2
    # Unknown outside is 0.5 and free inside 0.05: the cut lies 3/4 and 6/17 of a cell from the walls' centres.
    outer, inner = side + 2 * 0.2 * 0.75, side - 2 * 0.2 * 6 / 17
    np.testing.assert_allclose(mesh.bounds, [[-0.15] * 3, [side + 0.15] * 3], atol=1e-6)
    assert mesh.volume == pytest.approx(outer**3 - inner**3, rel=0.01)
    raw = trimesh.load(tmp_path / "map.ply", process=False).metadata["_ply_raw"]["vertex"]["data"]
    x, y, z = (raw[axis].ravel() - low for axis, low in zip("xyz", corner, strict=True))
    off_the_edges = (np.minimum(x, y) > 0.5) & (np.maximum(x, y) < side - 0.5)
    np.testing.assert_array_equal(raw["observed"].ravel()[off_the_edges & (z > side - 0.1)], 0)
    np.testing.assert_array_equal(raw["observed"].ravel()[(z > 1) & (z < side - 1)], 1)


def test_what_is_predicted_beside_what_was_seen_is_predicted():
    """As the occupied cell next to it was, not as any that is near."""
    cells, _ = house()
    cells = MapCells(cells.index, 0.2, cells.probability, cells.std, cells.index.sum(axis=1) % 4 != 0)
    surface = cells_surface(cells)
    walls = cells.select(cells.occupied)
    for vertex, observed in zip(surface.vertices[::97], surface.observed[::97], strict=True):
        distance = np.abs(walls.centres - vertex).max(axis=1)
        assert observed in walls.observed[np.isclose(distance, distance.min())]
    # Most vertices lie right before one cell each, of which three in four were seen.
    assert 0.65 < surface.observed.mean() < 0.8


def test_colours_tell_the_height_above_the_ground_also_where_it_rises(tmp_path):
    """A street that climbs 9 m in 60 m, and a wall of 3 m along one side of it."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(300), np.arange(40)))
    road = np.column_stack([x, y, (0.15 * x).astype(int)])
    wall = np.concatenate([road[y == 39] + [0, 0, up] for up in range(1, 16)])
    index = np.concatenate([road, wall])
    cells = MapCells(index, 0.2, np.full(len(index), 0.9), np.zeros(len(index)), np.ones(len(index), bool))
    mesh = trimesh.load(write_mesh_ply(cells, tmp_path / "map.ply"), process=False)
    above_m = mesh.vertices[:, 2] - 0.15 * mesh.vertices[:, 0]
    wanted = height_colours(above_m, np.zeros(len(above_m), bool)).astype(int)
    off = np.abs(mesh.visual.vertex_colors[:, :3] - wanted).max(axis=1)
    assert np.quantile(off, 0.9) < 40  # as far as 0.3 m of height changes a colour


def test_nothing_occupied_is_an_empty_mesh(tmp_path):
    cells, wall = house()
    surface = cells_surface(cells.select(~wall))
    assert len(surface) == 0
    assert write_mesh_ply(cells.select(~wall), tmp_path / "map.ply").exists()


def test_a_2d_map_is_refused(tmp_path):
    with pytest.raises(InputError, match="3D"):
        write_mesh_ply(random_cells(2), tmp_path / "map.ply")
