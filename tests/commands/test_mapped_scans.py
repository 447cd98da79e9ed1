"""What `hilbertvae-map` is given: logs, bags, clouds, near and far."""

import json
from pathlib import Path

import numpy as np
import octomap
import pytest
import trimesh
import yaml
from map_command_toys import npz_of
from PIL import Image

from hilbertvae.commands import map as map_command
from hilbertvae.exports.grid_npz import read_grid
from hilbertvae.mapping import MapSettings, make_map
from hilbertvae.scans.formats import read_scans_path
from toy_rooms import carmen_line, tiny_reconstructor, write_log


def test_far_coordinates_change_nothing(room, tmp_path):
    """A room at UTM coordinates is the same map, that far away, to the cell and in its files."""
    far_m = np.array([412_345.0, 5_432_109.0])
    maps = []
    for shift in (0.0 * far_m, far_m):
        folder = tmp_path / str(bool(shift.any()))
        folder.mkdir()
        np.savez(folder / "room.npz", points=room.scans.points + shift, origins=room.scans.origins + shift, scan=room.scans.scan)
        settings = MapSettings(
            scans=str(folder / "room.npz"), output=str(folder / "out"), fill=False, exports=["npz", "ros", "points", "bt"]
        )
        maps.append(make_map(settings))
    near, far = (read_grid(folder / "map.npz") for folder in maps)
    cells = np.rint(far_m / near.resolution_m).astype(int)
    moved = {tuple(index + cells): hit for index, hit in zip(near.index, near.occupied, strict=True)}
    agree = [moved.get(tuple(index)) == hit for index, hit in zip(far.index, far.occupied, strict=True)]
    assert len(far) == pytest.approx(len(near), rel=0.01) and np.mean(agree) > 0.98  # points on a cell's side may fall to either
    about = yaml.safe_load((maps[1] / "map.yaml").read_text())
    np.testing.assert_allclose(about["origin"][:2], far.index.min(axis=0) * 0.1, atol=1e-6)
    told, tree = json.loads((maps[1] / "summary.json").read_text()), octomap.OcTree(str(maps[1] / "map.bt").encode())
    np.testing.assert_allclose(tree.getMetricMin()[:2] + told["octomap_shift_m"], far.index.min(axis=0) * 0.1, atol=1e-3)
    assert "octomap_shift_m" not in json.loads((maps[0] / "summary.json").read_text())
    corner = trimesh.load(maps[1] / "points.ply").vertices.min(axis=0)[:2]
    np.testing.assert_allclose(corner, far.centres[far.occupied].min(axis=0), atol=0.005)


def test_a_log_needs_nothing_but_its_path(tmp_path, monkeypatch):
    """The shipped network, chosen by the dimension; output below outputs/maps."""
    monkeypatch.chdir(tmp_path)
    write_log(tmp_path / "drive.log", [carmen_line(np.full(180, 3.0), (x, 0, 0)) for x in (0.0, 0.5)])
    assert map_command.main(["scans=drive.log", "exports=[ros]"]) == 0
    assert (tmp_path / "outputs/maps/drive.log/map.pgm").exists()


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_a_bag_is_mapped(kind, tmp_path, monkeypatch):
    """The scene of the readers' tests: planar lasers with transforms; the walls of the map are where the returns are."""
    pytest.importorskip("rosbags")
    monkeypatch.syspath_prepend(Path(__file__).parents[1] / "scans")
    from bag_scene import write_scene

    bag = tmp_path / ("drive.bag" if kind == "ros1" else "drive")
    write_scene(bag, kind, clouds=0)
    output = make_map(MapSettings(scans=str(bag), output=str(tmp_path / "out"), fill=False, exports=["npz", "ros", "bt"]))
    cells = read_grid(output / "map.npz")
    pixels, header = np.asarray(Image.open(output / "map.pgm")), yaml.safe_load((output / "map.yaml").read_text())
    rows, columns = np.nonzero(pixels < 255 * (1 - header["occupied_thresh"]))
    places = np.stack([columns, pixels.shape[0] - 1 - rows], axis=1) + np.rint(np.array(header["origin"][:2]) / header["resolution"])
    assert set(map(tuple, places.astype(int).tolist())) == set(map(tuple, cells.index[cells.occupied].tolist()))
    hits = np.unique(np.floor(read_scans_path(bag).points / 0.1).astype(int), axis=0)
    occupied = cells.index[cells.occupied]
    away = np.abs(occupied[:, None] - hits[None]).max(axis=2)
    assert away.min(axis=1).max() <= 1  # a beam's end may lie on the side of the next cell
    assert np.mean(away.min(axis=0) == 0) > 0.9


def test_planar_scans_in_a_cloud_are_mapped_in_2d(room, tmp_path):
    points, origins = (np.column_stack([part, np.full(len(part), 0.3)]) for part in (room.scans.points, room.scans.origins))
    np.savez(tmp_path / "room.npz", points=points, origins=origins, scan=room.scans.scan)
    with pytest.warns(
        UserWarning, match="room.npz: each scan is planar, at heights that differ by 0 m, and leans by up to 0 degrees, so that"
    ):
        output = make_map(MapSettings(scans=str(tmp_path / "room.npz"), output=str(tmp_path / "out"), fill=False))
    flat = make_map(MapSettings(scans=str(npz_of(room, tmp_path / "flat.npz")), output=str(tmp_path / "flat"), fill=False))
    assert (output / "map.pgm").read_bytes() == (flat / "map.pgm").read_bytes()


def test_a_laz_is_mapped(box, tmp_path):
    """One scan at UTM coordinates, with its sensor's place given; read back by trimesh to the centimetre."""
    laspy = pytest.importorskip("laspy")
    far_m = np.array([412_345.0, 5_432_109.0, 100.0])
    scan = box.scans.select(box.scans.scan == 0)
    header = laspy.LasHeader(point_format=3, version="1.2")
    header.offsets, header.scales = far_m, np.full(3, 0.001)
    cloud = laspy.LasData(header)
    cloud.xyz = scan.points + far_m
    cloud.write(str(tmp_path / "room.laz"))
    weights = tiny_reconstructor(3).save(tmp_path / "tiny.safetensors")
    origin = (scan.origins[0] + far_m).tolist()
    settings = MapSettings(scans=str(tmp_path / "room.laz"), output=str(tmp_path / "out"), weights=str(weights), sensor_origin_m=origin)
    output = make_map(settings)
    cells, points = read_grid(output / "map.npz"), trimesh.load(output / "points.ply").vertices
    np.testing.assert_allclose(np.sort(points, axis=0), np.sort(cells.centres[cells.occupied], axis=0), atol=0.005)
    seen = cells.centres[cells.occupied & cells.observed]
    nearest = np.abs(seen[:, None] - (scan.points + far_m)[None]).max(axis=2).min(axis=1)
    assert nearest.max() < 0.1 + 0.005  # each has a return in it


def test_one_return_in_space_and_fine_cells(tmp_path):
    """The smallest map there is, at cells so fine that the usual reach would be too many of them."""
    np.savez(tmp_path / "one.npz", points=[[0.0, 0.0, 2.0]], origins=np.zeros(3))
    for resolution_m in (None, 0.03):
        settings = MapSettings(scans=str(tmp_path / "one.npz"), output=str(tmp_path / "out"), resolution_m=resolution_m, fill=False)
        assert (make_map(settings) / "map.png").exists()


def test_returns_that_ranges_left_out_are_told(room, tmp_path, capsys):
    """In the summary, on the page and in the report; and nothing where there are none."""
    lengths = np.linalg.norm(room.scans.points - room.scans.origins, axis=1)
    near_m, far_m = np.quantile(lengths, [0.05, 0.9]).tolist()
    words = [f"scans={npz_of(room, tmp_path / 'room.npz')}", "fill=off", "exports=[ros]"]
    assert map_command.main([*words, f"output={tmp_path / 'cut'}", f"min_range_m={near_m}", f"max_range_m={far_m}"]) == 0
    told, near, far = capsys.readouterr().out, np.count_nonzero(lengths <= near_m), np.count_nonzero(lengths >= far_m)
    points = json.loads((tmp_path / "cut" / "summary.json").read_text())["points"]
    assert (points["near_left_out"], points["far_left_out"]) == (near, far) and points["returns"] + near + far == len(room.scans)
    assert f"returns left out: {near:,} as near as min_range_m or nearer, {far:,} as far as max_range_m or farther" in told
    assert "near left out" in (tmp_path / "cut" / "summary.html").read_text()
    assert map_command.main([*words, f"output={tmp_path / 'whole'}"]) == 0
    assert "left out" not in capsys.readouterr().out
    assert set(json.loads((tmp_path / "whole" / "summary.json").read_text())["points"]) == {"returns", "scans", "occupied", "free"}


@pytest.mark.parametrize("words", [["scans=loop1"], ["scans=drive.log", "output=loop1/maps"]])
def test_a_loop_of_links_is_refused_in_a_line(tmp_path, monkeypatch, capsys, words):
    monkeypatch.chdir(tmp_path)
    write_log(tmp_path / "drive.log", [carmen_line(np.full(180, 3.0), (x, 0, 0)) for x in (0.0, 0.5)])
    (tmp_path / "loop1").symlink_to("loop2")
    (tmp_path / "loop2").symlink_to("loop1")
    assert map_command.main([*words, "exports=[ros]"]) == 2
    assert "loop1" in capsys.readouterr().err
