import numpy as np
import pytest
import trimesh
from export_toys import any_cells, random_cells
from hypothesis import given, settings

from hilbertvae.checks import InputError
from hilbertvae.exports.cell_colours import cell_colours
from hilbertvae.exports.points_ply import write_points_ply


def raw(path):
    return trimesh.load(path).metadata["_ply_raw"]["vertex"]["data"]


@settings(max_examples=20)
@given(cells=any_cells)
def test_trimesh_reads_each_cell(cells, tmp_path_factory):
    path = write_points_ply(cells, tmp_path_factory.mktemp("map") / "points.ply", above=-1)
    found = raw(path)
    places = np.column_stack([cells.centres, np.zeros((len(cells), 3 - cells.dimension))])
    for axis, name in enumerate("xyz"):
        np.testing.assert_array_equal(found[name].ravel(), places[:, axis])
        assert found[name].dtype == np.float64
    for name in ("probability", "std", "observed"):
        np.testing.assert_array_equal(found[name].ravel(), getattr(cells, name))


def test_occupied_cells_alone_unless_told(tmp_path):
    cells = random_cells(3)
    found = raw(write_points_ply(cells, tmp_path / "points.ply"))
    np.testing.assert_array_equal(np.sort(found["probability"].ravel()), np.sort(cells.probability[cells.occupied]))


@pytest.mark.parametrize("dimension", [2, 3])
def test_probable_cells_are_darker(tmp_path, dimension):
    cells = random_cells(dimension)
    found = raw(write_points_ply(cells, tmp_path / "points.ply", above=-1))
    light = sum(found[name].ravel().astype(float) for name in ("red", "green", "blue"))
    p = found["probability"].ravel()
    assert light[p > 0.9].max() < light[p < 0.1].min()


def test_height_colours_tell_predicted_cells(tmp_path):
    cells = random_cells(3)
    colours = cell_colours(cells, "height").astype(int)
    for z in np.unique(cells.index[:, 2]):
        level = cells.index[:, 2] == z
        seen, predicted = (np.unique(colours[level & part], axis=0) for part in (cells.observed, ~cells.observed))
        assert len(seen) <= 1 and len(predicted) <= 1
        if len(seen) and len(predicted):
            tint = np.array([0x17, 0xC7, 0x95])
            np.testing.assert_allclose(predicted[0], (seen[0] + tint) / 2, atol=1.5)
    assert write_points_ply(cells.select(np.zeros(0, int)), tmp_path / "none.ply", "height").read_bytes().startswith(b"ply")


@pytest.mark.parametrize(("dimension", "colour"), [(2, "height"), (3, "red")])
def test_unknown_colours_are_refused(tmp_path, dimension, colour):
    with pytest.raises(InputError, match=f"colour: .*got '{colour}'"):
        write_points_ply(random_cells(dimension), tmp_path / "points.ply", colour)
    assert list(tmp_path.iterdir()) == []
