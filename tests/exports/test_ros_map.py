"""What `write_ros_map` writes, read by Pillow, PyYAML and map_server's arithmetic alone, and by our own reader."""

import warnings

import numpy as np
import pytest
import yaml
from export_toys import cells_2d, random_cells
from hypothesis import given, settings
from PIL import Image

from hilbertvae.checks import InputError
from hilbertvae.exports.map_cells import MapCells
from hilbertvae.exports.ros_map import write_ros_map
from hilbertvae.mappers.given_map import read_given_map
from hilbertvae.observed_map import read_ros_map


def loaded(path):
    """{(x, y) of the lower left corner of a cell, in whole cells: occupancy in percent, -1 unknown}, and the YAML's keys.

    As Nav2's map_io.cpp has it for an image without colours: the pixel in row r from the top stands for row height - 1 - r of the map.
    """
    content = yaml.safe_load(path.read_text())
    with Image.open(path.parent / content["image"]) as image:
        assert image.mode == "L"
        width, height = image.size
        pixels = list(image.tobytes())
    found = {}
    for place, pixel in enumerate(pixels):
        occupancy = (255 - pixel) / 255
        value = 100 if occupancy > content["occupied_thresh"] else 0 if occupancy < content["free_thresh"] else -1
        column, row = place % width, height - 1 - place // width
        corner = [content["origin"][axis] / content["resolution"] + (column, row)[axis] for axis in (0, 1)]
        assert corner == pytest.approx(np.round(corner), abs=1e-4)
        found[tuple(round(c) for c in corner)] = value
    assert content["negate"] == 0 and content["origin"][2] == 0 and content["mode"] == "trinary"
    return found, content


@settings(max_examples=25)
@given(cells=cells_2d)
def test_map_server_reads_each_cell_in_its_place(cells, tmp_path_factory):
    folder = tmp_path_factory.mktemp("map")
    written = write_ros_map(cells, folder / "map.yaml")
    assert sorted(path.name for path in folder.iterdir()) == sorted(path.name for path in written)
    for name, part in (("map", np.ones(len(cells), bool)), ("map_observed", cells.observed)):
        found, content = loaded(folder / f"{name}.yaml")
        assert content["resolution"] == cells.resolution_m
        assert content["hilbertvae_cells"] == ("observed" if name == "map_observed" or cells.observed.all() else "all")
        expected = {}
        for index, p in zip(cells.index[part].tolist(), cells.probability[part].astype(float), strict=True):
            expected[tuple(index)] = 100 if p > 0.6 + 1e-6 else 0 if p < 0.4 + 1e-5 else -1
        assert {corner: value for corner, value in found.items() if value != -1} == {
            corner: value for corner, value in expected.items() if value != -1
        }
        low, high = cells.index.min(axis=0), cells.index.max(axis=0)
        assert len(found) == np.prod(high - low + 1)


@settings(max_examples=25)
@given(cells=cells_2d)
def test_our_reader_has_the_cells_again(cells, tmp_path_factory):
    folder = tmp_path_factory.mktemp("map")
    write_ros_map(cells, folder / "map")
    for name, part in (("map", np.ones(len(cells), bool)), ("map_observed", cells.observed)):
        told = part & (cells.occupied | cells.free)
        expected = dict(zip(map(tuple, cells.index[told].tolist()), cells.occupied[told].tolist(), strict=True))
        if not expected:
            with pytest.raises(InputError, match="unknown ones only"):
                read_ros_map(folder / f"{name}.yaml")
            continue
        cloud = read_ros_map(folder / f"{name}.pgm")
        index = np.floor(cloud.points / cells.resolution_m).astype(int)
        assert dict(zip(map(tuple, index.tolist()), cloud.occupied.tolist(), strict=True)) == expected
        np.testing.assert_allclose(cloud.points, (index + 0.5) * cells.resolution_m, atol=1e-6)


def test_what_was_filled_is_told_once_when_it_is_read_and_what_was_not_is_not(tmp_path):
    index, observed = np.array([[0, 0], [1, 0], [2, 0]]), np.array([True, True, False])
    cells = MapCells(index, 0.1, np.array([0.1, 0.9, 0.9]), np.zeros(3), observed)
    for name, part, filled in (("filled", cells, 1), ("filled_observed", cells, 0), ("seen", cells.select(observed), 0)):
        write_ros_map(part, tmp_path / name.removesuffix("_observed"))
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            cloud = read_given_map(tmp_path / f"{name}.yaml").cloud(0.1)
        assert len(np.unique(np.floor(cloud.points / 0.1), axis=0)) == 2 + filled
        assert [f"{name}_observed.yaml has what was" in str(warning.message) for warning in told] == [True] * filled
    for name, other in (("seen", "seen_observed"), ("seen_observed", "seen")):
        assert f"observed cells alone, as {other}.yaml" in (tmp_path / f"{name}.yaml").read_text().splitlines()[0]


def test_rows_are_not_upside_down(tmp_path):
    """A wall's cell at (3.25, 7.05) m, free space from there down to (3.25, -2.95)."""
    index = np.array([[32, y] for y in range(-30, 71)] + [[40, 0]])
    probability = np.where(index[:, 1] == 70, 0.9, 0.1)
    cells = MapCells(index, 0.1, probability, np.zeros(len(index)), np.ones(len(index), bool))
    write_ros_map(cells, tmp_path / "tower.yaml")
    with Image.open(tmp_path / "tower.pgm") as image:
        assert image.size == (9, 101)
        assert image.getpixel((0, 0)) == 0 and image.getpixel((0, 1)) == 254 and image.getpixel((0, 100)) == 254
        assert image.getpixel((8, 100 - 30)) == 254 and image.getpixel((8, 0)) == 205
    origin = yaml.safe_load((tmp_path / "tower.yaml").read_text())["origin"]
    assert origin == pytest.approx([3.2, -3.0, 0.0])
    wall = read_ros_map(tmp_path / "tower.yaml")
    np.testing.assert_allclose(wall.points[wall.occupied], [[3.25, 7.05]])


def test_names_with_dots_and_spaces(tmp_path):
    cells = random_cells(2)
    write_ros_map(cells, tmp_path / "floor 2.5: küche.yaml")
    assert len(list(tmp_path.iterdir())) == 4
    assert len(read_ros_map(tmp_path / "floor 2.5: küche_observed.yaml"))


def test_what_does_not_fit_is_refused_and_leaves_nothing(tmp_path):
    far = MapCells(np.array([[0, 0], [10**6, 10**6]]), 0.1, np.ones(2), np.ones(2), np.ones(2, bool))
    empty = random_cells(2).select(np.zeros(0, int))
    for cells, named in ((random_cells(3), "2D"), (far, "outlier"), (empty, "at least one")):
        with pytest.raises(InputError, match=named):
            write_ros_map(cells, tmp_path / "map.yaml")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("number", [np.float64, np.float32, int])
def test_a_resolution_of_any_kind_of_number(tmp_path, number):
    side = number(2)
    cells = MapCells(np.array([[0, 0], [1, 2]]), side, np.array([0.1, 0.9]), np.zeros(2), np.ones(2, bool))
    write_ros_map(cells, tmp_path / "map.yaml")
    assert yaml.safe_load((tmp_path / "map.yaml").read_text())["resolution"] == 2
