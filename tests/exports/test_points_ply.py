import numpy as np
import pytest
import trimesh
from export_toys import any_cells, random_cells
from hypothesis import given, settings

from hilbertvae.exports.points_ply import write_points_ply


def raw(path):
    return trimesh.load(path).metadata["_ply_raw"]["vertex"]["data"]


@settings(max_examples=20)
@given(cells=any_cells)
def test_trimesh_reads_each_occupied_cell(cells, tmp_path_factory):
    path = write_points_ply(cells, tmp_path_factory.mktemp("map") / "points.ply")
    occupied = cells.select(cells.occupied)
    if not len(occupied):
        assert b"element vertex 0\n" in path.read_bytes()
        return
    found = raw(path)
    places = np.column_stack([occupied.centres, np.zeros((len(occupied), 3 - cells.dimension))])
    for axis, name in enumerate("xyz"):
        np.testing.assert_array_equal(found[name].ravel(), places[:, axis])
        assert found[name].dtype == np.float64
    for name in ("probability", "std", "observed"):
        np.testing.assert_array_equal(found[name].ravel(), getattr(occupied, name))


@pytest.mark.parametrize("dimension", [2, 3])
def test_probable_cells_are_darker(tmp_path, dimension):
    found = raw(write_points_ply(random_cells(dimension), tmp_path / "points.ply"))
    light = sum(found[name].ravel().astype(float) for name in ("red", "green", "blue"))
    p = found["probability"].ravel()
    assert light[p > 0.9].max() < light[p < 0.7].min()
