"""Reading ROS maps: map_server's rules, and files that are damaged or forged."""

import math
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from hilbertvae import observed_map
from hilbertvae.checks import InputError
from hilbertvae.mappers.given_map import read_given_map
from hilbertvae.observed_map import CELL_WEIGHT, cloud_of_cells, read_ros_map

HEADER = {"image": "map.pgm", "resolution": "0.5", "origin": "[0, 0, 0]", "negate": "0", "occupied_thresh": "0.65", "free_thresh": "0.196"}


def write_map(folder, rows, plain=False, content=None, **changed):
    """A map of pixels `rows`, from the top, at folder/map.yaml."""
    rows = np.array(rows, dtype=np.uint16)
    size = f"{rows.shape[1]} {rows.shape[0]}"
    if content is not None:
        (folder / "map.pgm").write_bytes(content)
    elif plain:
        lines = [" ".join(map(str, row)) for row in rows.tolist()]
        (folder / "map.pgm").write_text("\n".join(["P2", "# by hand", size, "255", *lines, ""]))
    else:
        (folder / "map.pgm").write_bytes(f"P5 {size} 255\n".encode() + rows.astype(np.uint8).tobytes())
    lines = [f"{key}: {value}\n" for key, value in {**HEADER, **changed}.items() if value is not None]
    (folder / "map.yaml").write_text("".join(lines))
    return folder / "map.yaml"


def labels(cloud):
    return {tuple(point): bool(occupied) for point, occupied in zip(np.round(cloud.points, 6).tolist(), cloud.occupied, strict=True)}


@pytest.mark.parametrize("plain", [False, True])
def test_the_lower_left_pixel_is_at_the_origin(tmp_path, plain):
    path = write_map(tmp_path, [[254, 205, 0], [0, 205, 254]], plain, origin="[10.0, -20, 0.0]")
    cloud = read_ros_map(path)
    assert labels(cloud) == {(10.25, -19.25): False, (11.25, -19.25): True, (10.25, -19.75): True, (11.25, -19.75): False}
    assert (cloud.weight == CELL_WEIGHT).all()


@pytest.mark.parametrize("yaw", [0.3, -2.0, math.pi / 2])
def test_the_origins_yaw_turns_the_map_about_its_corner(tmp_path, yaw):
    cloud = read_ros_map(write_map(tmp_path, [[205, 0], [254, 205]], origin=f"[456789.1, 5428345.2, {yaw}]"))
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    for occupied, place in ((False, [0.25, 0.25]), (True, [0.75, 0.75])):
        np.testing.assert_allclose(cloud.points[cloud.occupied == occupied], [turn @ place + [456789.1, 5428345.2]], atol=2e-3)


@pytest.mark.parametrize(
    ("pixels", "changed", "expected"),
    [
        ([0, 89, 90, 205, 206, 254], {}, [1, 1, 0, 0, -1, -1]),
        ([0, 89, 90, 205, 206, 254], {"free_thresh": "0.25"}, [1, 1, 0, 0, -1, -1]),
        ([0, 150, 191, 192, 204, 205], {"free_thresh": "0.25"}, [1, 0, 0, -1, -1, 0]),
        ([255, 166, 165, 50, 49, 0], {"negate": "1"}, [1, 1, 0, 0, -1, -1]),
        ([255, 205, 0], {"negate": "true", "mode": "trinary"}, [1, 1, -1]),
        # 61 percent is an occupancy of 0.196 + 0.605 * 0.454 = 0.4707 and more, pixel 134; 40 percent 0.196 + 0.405 * 0.454 = 0.3799, 159.
        ([0, 134, 135, 155, 158, 159, 205, 254], {"mode": "Scale"}, [1, 1, 0, 0, 0, -1, -1, -1]),
        ([0, 40, 41, 60, 61, 100, 101, 255], {"mode": "raw"}, [-1, -1, 0, 0, 1, 1, 0, 0]),
    ],
)
def test_modes_and_thresholds(tmp_path, pixels, changed, expected):
    cloud = read_ros_map(write_map(tmp_path, [pixels], **changed))
    found = dict(zip(np.floor(cloud.points[:, 0] / 0.5).astype(int).tolist(), np.where(cloud.occupied, 1, -1).tolist(), strict=True))
    assert [found.get(column, 0) for column in range(len(pixels))] == expected


def test_other_images_that_map_servers_take(tmp_path):
    """16 bits, colours, and what is transparent, which is unknown in mode scale."""
    grey = np.array([[0, 205, 254]], np.uint8)
    Image.fromarray(grey.astype(np.uint16) * 257).save(tmp_path / "deep.png")
    (tmp_path / "deep.pgm").write_bytes(b"P5 3 1 65535\n" + (grey.astype(">u2") * 257).tobytes())
    Image.fromarray(np.repeat(grey[..., None], 3, axis=2)).save(tmp_path / "colour.bmp")
    for name in ("deep.png", "deep.pgm", "colour.bmp"):
        (tmp_path / "map.yaml").write_text("".join(f"{k}: {v}\n" for k, v in {**HEADER, "image": name, "free_thresh": "0.25"}.items()))
        cloud = read_ros_map(tmp_path / "map.yaml")
        assert labels(cloud) == {(0.25, 0.25): True, (1.25, 0.25): False}, name
    clear = np.array([[[0, 0, 0, 255], [0, 0, 0, 10], [254, 254, 254, 255]]], np.uint8)
    Image.fromarray(clear).save(tmp_path / "clear.png")
    (tmp_path / "map.yaml").write_text("".join(f"{k}: {v}\n" for k, v in {**HEADER, "image": "clear.png", "mode": "scale"}.items()))
    assert labels(read_ros_map(tmp_path / "map.yaml")) == {(0.25, 0.25): True, (1.25, 0.25): False}


@settings(max_examples=40)
@given(
    cell_m=st.sampled_from([0.05, 0.1, 0.2, 0.25, 0.5]),
    origin=st.tuples(*[st.sampled_from([0.0, -12.025, 0.05, 3.1, 456_789.15, 0.123])] * 2),
    yaw=st.sampled_from([0.0, math.pi / 2, 0.4, 1.0]),
)
def test_no_voxel_within_a_map_is_left_without_a_point(cell_m, origin, yaw, tmp_path_factory):
    side, voxel_m = 20, 0.1
    path = write_map(
        tmp_path_factory.mktemp("map"), np.zeros((side, side)), resolution=str(cell_m), origin=f"[{origin[0]}, {origin[1]}, {yaw}]"
    )
    cloud = read_ros_map(path, voxel_m)
    middle = np.array(origin) + np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]]) @ np.full(2, side * cell_m / 2)
    reach = side * cell_m / 2 / math.sqrt(2) - 2 * voxel_m
    if reach <= 0:
        return
    low, high = np.ceil((middle - reach) / voxel_m).astype(int), np.floor((middle + reach) / voxel_m).astype(int)
    voxels = {(x, y) for x in range(low[0], high[0]) for y in range(low[1], high[1])}
    assert voxels <= set(map(tuple, np.floor(cloud.points / voxel_m).astype(int).tolist()))


def test_cells_smaller_than_a_voxel_are_one_point_each():
    centres = (np.array([[3, 4, 5], [-1, 0, 7]]) + 0.5) * 0.05
    cloud = cloud_of_cells(centres, np.array([True, False]), 0.05, 0.2)
    np.testing.assert_allclose(cloud.points, centres, atol=1e-3)
    assert cloud.occupied.tolist() == [True, False]
    split = cloud_of_cells(centres, np.array([True, False]), 0.05, 0.025)
    assert len(split) == 16 and split.occupied.sum() == 8
    assert (np.abs(split.points[:8] - centres[0]) < 0.0127).all()
    with pytest.raises(InputError, match="resolution_m.*more than"):
        cloud_of_cells(centres, np.array([True, False]), 0.05, 1e-6)


@pytest.mark.parametrize(("cell_m", "points"), [(0.2, 4), (0.1, 4), (0.05, 4), (0.025, 16)])
def test_a_voxel_counts_the_same_however_fine_a_map_is(cell_m, points):
    side = round(1 / cell_m)
    centres = np.stack(np.meshgrid(*[(np.arange(side) + 0.5) * cell_m] * 2), axis=-1).reshape(-1, 2)
    cloud = cloud_of_cells(centres, np.zeros(len(centres), bool), cell_m, 0.1)
    _, voxel, count = np.unique(np.floor(cloud.points / 0.1), axis=0, return_inverse=True, return_counts=True)
    assert len(count) == 100 and (count == points).all()
    np.testing.assert_allclose(np.bincount(voxel.ravel(), cloud.weight), CELL_WEIGHT)


@settings(max_examples=30)
@given(yaw=st.floats(0, math.pi), turned=st.floats(0, math.pi), cell_m=st.sampled_from([0.05, 0.1, 0.25]), shift=st.floats(0, 0.1))
def test_no_cell_of_a_turned_box_within_a_map_is_left_without_a_point(yaw, turned, cell_m, shift):
    side = round(3 / cell_m)
    sides = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
    centres = np.stack(np.meshgrid(*[(np.arange(side) + 0.5) * cell_m - 1.5] * 2), axis=-1).reshape(-1, 2) @ sides
    cloud = cloud_of_cells(centres, np.zeros(len(centres), bool), cell_m, 0.1, sides)
    turn = np.array([[math.cos(turned), math.sin(turned)], [-math.sin(turned), math.cos(turned)]])
    cells = np.floor((cloud.points @ turn + shift) / 0.1).astype(int)
    within = cells[(np.abs(cells) < 9).all(axis=1)]  # 0.9 m, of a map that reaches 1.5 m on all sides
    assert len(np.unique(within, axis=0)) == 17 * 17


@settings(max_examples=30)
@given(cell_m=st.sampled_from([0.05, 0.1, 0.15, 0.2]), shift=st.floats(0, 0.2), yaw=st.sampled_from([0.0, 0.0, 0.7]))
def test_a_split_voxel_gives_no_label_to_another(cell_m, shift, yaw):
    """Else a wall in cells that lie between voxels would be twice as thick."""
    side = round(2 / cell_m)
    sides = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
    index = np.stack(np.meshgrid(*[np.arange(side)] * 2), axis=-1).reshape(-1, 2)
    cells = ((index + 0.5) * cell_m + shift) @ sides, index[:, 0] == side // 2, cell_m, 0.1, sides
    split = cloud_of_cells(*cells)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(observed_map, "PIECES", {2: 1})
        whole = cloud_of_cells(*cells)
    of_split, of_whole = ({(*np.floor(p / 0.1), label) for p, label in zip(c.points, c.occupied, strict=True)} for c in (split, whole))
    assert of_split == of_whole
    np.testing.assert_allclose(split.weight.sum(), whole.weight.sum())


def test_a_map_too_large_to_be_split_stays_whole(monkeypatch):
    monkeypatch.setattr(observed_map, "MOST_PIECES", 7)
    centres = (np.array([[3, 4], [-1, 0]]) + 0.5) * 0.1
    cloud = cloud_of_cells(centres, np.array([True, False]), 0.1, 0.1)
    assert len(cloud) == 2 and (cloud.weight == CELL_WEIGHT).all()


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"image": None}, "expected the key image"),
        ({"resolution": None, "origin": None}, "expected the keys resolution, origin"),
        ({"resolution": ".nan"}, "resolution: expected a finite number"),
        ({"resolution": "0"}, "resolution: expected a positive"),
        ({"resolution": "1.0e+308"}, "resolution: expected from 0.0001 to 10000 metres"),
        ({"resolution": "1.0e-300"}, "resolution: expected from 0.0001 to 10000 metres"),
        ({"image": "[3]"}, "image: expected the name of a file, got a list"),
        ({"resolution": "true"}, "resolution: expected a finite"),
        ({"resolution": "[1]"}, "resolution: expected a finite"),
        ({"resolution": "1" + "0" * 400}, "resolution: expected a finite"),
        ({"origin": "[0, 0]"}, "origin: expected"),
        ({"origin": "[0, .inf, 0]"}, "origin: expected a finite"),
        ({"origin": "here"}, "origin: expected"),
        ({"negate": "2"}, "negate: expected 0 or 1"),
        ({"negate": "{}"}, "negate: expected 0 or 1"),
        ({"mode": "ternary"}, "mode: expected one of trinary"),
        ({"mode": "[raw]"}, "mode: expected one of trinary"),
        ({"free_thresh": "0.7"}, "free_thresh < occupied_thresh"),
        ({"occupied_thresh": "65"}, "free_thresh < occupied_thresh"),
        ({"image": "none.pgm"}, "none.pgm: no such file"),
        ({"image": "."}, "can't be read"),
        ({"image": "3"}, "image: expected the name"),
        ({"image": "map.yaml"}, "can't be read as a PGM"),
        ({"image": "!!python/object/apply:os.system [ls]"}, "can't be read as a map_server YAML"),
        ({"image": "[" * 5000}, "can't be read as a map_server YAML"),
        ({"comment": "x" * 70_000}, "of YAML"),
    ],
)
def test_bad_headers_are_named(tmp_path, changed, named):
    with pytest.raises(InputError, match=f"{named}"):
        read_ros_map(write_map(tmp_path, [[0, 254]], **changed))


def test_numbers_as_yaml_1_1_does_not_know_them(tmp_path):
    assert labels(read_ros_map(write_map(tmp_path, [[0]], resolution="5e-1"))) == {(0.25, 0.25): True}


@pytest.mark.parametrize(
    ("content", "named"),
    [
        (b"", "can't be read"),
        (b"P5 100000 100000 255\n" + bytes(100), "can't be read|at most"),
        (b"P5 11000 11000 255\n" + bytes(100), "truncated or forged"),
        (b"P2 11000 11000 255\n" + b"0 " * 100, "truncated or forged"),
        (b"P5 2 2 255\n" + bytes(3), "truncated"),
        (b"P5 2 2 65535\n" + bytes(4), "truncated"),
        (b"P2 2 2 255\n0 0 0      ", "can't be read"),
        (b"P2 2 2 255\n0 0 0 999", "can't be read"),
        (b"P5 2 2 0\n" + bytes(4), "can't be read"),
        (b"P5 2 2 70000\n" + bytes(8), "can't be read"),
        (b"P5 -2 2 255\n" + bytes(4), "can't be read"),
        (b"P6 2 2 255\n" + bytes(12), "expected a PGM image"),
        (b"P5 2 2 255\n" + bytes([205] * 4), "unknown ones only"),
        (b"GIF89a" + bytes(30), "can't be read"),
    ],
)
def test_bad_images_are_named_and_take_no_memory(tmp_path, content, named):
    path = write_map(tmp_path, [[0]], content=content)
    tracemalloc.start()
    with pytest.raises(InputError, match=f"map.pgm: .*({named})"):
        read_ros_map(path)
    assert tracemalloc.get_traced_memory()[1] < 20e6
    tracemalloc.stop()


def test_an_image_finds_its_yaml_by_either_ending(tmp_path):
    path = write_map(tmp_path, [[254, 0]])
    known = labels(read_ros_map(tmp_path / "map.pgm"))
    path.rename(tmp_path / "map.yml")
    assert labels(read_ros_map(tmp_path / "map.pgm")) == known
    (tmp_path / "map.yml").unlink()
    with pytest.raises(InputError, match="map.yaml: no such file"):
        read_ros_map(tmp_path / "map.pgm")


def test_missing_and_foreign_files(tmp_path):
    with pytest.raises(InputError, match="none.yaml: no such file"):
        read_ros_map(tmp_path / "none.pgm")
    (tmp_path / "list.yaml").write_text("- 1\n")
    with pytest.raises(InputError, match="list.yaml: expected keys"):
        read_ros_map(tmp_path / "list.yaml")
    (tmp_path / "bytes.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="bytes.yaml"):
        read_ros_map(tmp_path / "bytes.yaml")
    with pytest.raises(InputError, match="can't be read as a map_server YAML file"):
        read_ros_map(".")


@settings(max_examples=150)
@given(data=st.data())
def test_damaged_files_are_refused_or_read(data, tmp_path_factory):
    folder = tmp_path_factory.mktemp("map")
    path = write_map(folder, np.arange(60).reshape(6, 10) * 4, data.draw(st.booleans()))
    damaged = folder / data.draw(st.sampled_from(["map.yaml", "map.pgm"]))
    content = bytearray(damaged.read_bytes())
    place = data.draw(st.integers(0, len(content) - 1))
    if data.draw(st.booleans()):
        content[place] = data.draw(st.integers(0, 255))
    else:
        del content[place : place + data.draw(st.integers(1, 40))]
    damaged.write_bytes(content)
    try:
        cloud = read_ros_map(path)
    except InputError as error:
        assert "map." in str(error) or str(folder) in str(error)
        return
    assert np.isfinite(cloud.points).all() and len(cloud) == len(cloud.occupied) == len(cloud.weight) > 0


def test_cells_of_fifty_metres_are_doubted(tmp_path):
    path = write_map(tmp_path, [[0, 254]], resolution="50")
    with pytest.warns(UserWarning, match="has cells of 50 m; are they in millimetres"):
        assert read_given_map(path).cell_m == 50


def test_yaml_that_would_grow_beyond_all_memory_is_refused(tmp_path):
    lines = ["a0: &a0 {x: 1}"] + [f"a{k}: &a{k} {{<<: [{', '.join([f'*a{k - 1}'] * 9)}]}}" for k in range(1, 30)]
    (tmp_path / "map.yaml").write_text("\n".join(lines))
    with pytest.raises(InputError, match="map.yaml: expected YAML without aliases"):
        read_ros_map(tmp_path / "map.yaml")
    path = write_map(tmp_path, [[0, 254], [254, 0]], resolution=":".join(["59"] * 5000))
    with pytest.raises(InputError, match="resolution: expected"):
        read_ros_map(path)
