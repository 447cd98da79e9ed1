"""ROS maps whose cells do not lie on the lattice that maps are written on: a warning says how far walls move, and it is true."""

import math
import re
import warnings

import numpy as np
import octomap
import pytest
import yaml
from PIL import Image
from scipy.spatial import cKDTree

from hilbertvae.commands import map as map_command
from hilbertvae.exports.grid_npz import read_grid
from hilbertvae.mappers.given_map import read_given_map, warn_of_moved_walls
from hilbertvae.mapping import MapSettings, make_map

FREE, WALL, UNKNOWN = 254, 0, 205


def room_map(folder, cell_m, origin):
    """A ROS map of a room with a pillar and a margin; its pixels from the bottom."""
    pixels = np.full((18, 24), UNKNOWN, np.uint8)
    pixels[3:15, 3:21] = WALL
    pixels[4:14, 4:20] = FREE
    pixels[8, 9] = WALL
    (folder / "map.pgm").write_bytes(b"P5 24 18 255\n" + pixels[::-1].tobytes())
    about = {"image": "map.pgm", "resolution": cell_m, "origin": origin, "negate": 0, "occupied_thresh": 0.65, "free_thresh": 0.196}
    (folder / "map.yaml").write_text(yaml.safe_dump(about))
    return pixels


def made(folder, **changed):
    """The cells of the map that is made of it, unfilled, and how far walls move by the warnings, metres."""
    settings = MapSettings(scans=str(folder / "map.yaml"), output=str(folder / "out"), fill=False, exports=["npz", "ros"], **changed)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        cells = read_grid(make_map(settings) / "map.npz")
    said = [str(warning.message) for warning in caught if "walls move" in str(warning.message)]
    assert all("map.yaml: its cells of" in message for message in said)
    return cells, [float(re.search("up to ([0-9.e-]+) m along each axis", message)[1]) for message in said]


@pytest.mark.parametrize(
    ("origin", "beside"),
    [
        ([-2.02, 3.0, 0.0], 0.4),
        ([-12.34, -7.81, 0.0], 0.2),
        ([0.013, -0.012, 0], 0.26),
        ([5.0, 1.0249, 0.0], 0.498),
        ([0.01, 0.02, math.pi / 2], 0.4),
    ],
)
def test_cells_of_the_network_s_size_move_as_far_as_is_said(tmp_path, origin, beside):
    """Each to the nearest cell that is written, so that all move alike."""
    pixels = room_map(tmp_path, 0.05, origin)
    cells, said = made(tmp_path)
    assert said == [pytest.approx(beside * 0.05, rel=0.03)]
    row, column = np.nonzero(pixels != UNKNOWN)
    x, y, yaw = origin
    turn = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
    centres = np.column_stack([column + 0.5, row + 0.5]) * 0.05 @ turn + [x, y]
    off, nearest = cKDTree(cells.centres).query(centres, p=np.inf)
    np.testing.assert_allclose(off, said[0], rtol=0.03)
    np.testing.assert_array_equal(cells.occupied[nearest], pixels[row, column] == WALL)
    assert len(np.unique(nearest)) == len(cells) == len(centres)
    about = yaml.safe_load((tmp_path / "out" / "map.yaml").read_text())
    assert Image.open(tmp_path / "out" / "map.pgm").size in ((18, 12), (12, 18))  # without the margin
    np.testing.assert_allclose(np.array(about["origin"][:2]) / 0.05, cells.index.min(axis=0))


@pytest.mark.parametrize(
    ("cell_m", "origin", "changed"),
    [
        (0.15, [0.05, 0.0, 0.0], {}),
        (0.05, [0.01, 0.02, 0.0], {"resolution_m": 0.1}),
        (0.05, [-2.0, 3.05, 0.0], {"resolution_m": 0.07}),
        (0.05, [-2.0, 3.05, 0.0], {"resolution_m": 0.1}),
        (0.05, [0.0, 0.0, 0.5], {}),
        (0.25, [0.1, 0.07, 1.0], {}),
    ],
)
def test_in_larger_or_turned_cells_walls_move_no_farther_than_is_said(tmp_path, cell_m, origin, changed):
    """What is written as wall meets the given one, so that it ends at most a cell beyond, and no wall is lost."""
    pixels = room_map(tmp_path, cell_m, origin)
    cells, said = made(tmp_path, **changed)
    assert said == [pytest.approx(cells.resolution_m, rel=0.03)]
    row, column = np.nonzero(pixels == WALL)
    fine = (np.stack(np.meshgrid(*[np.arange(10)] * 2), axis=-1).reshape(-1, 2) + 0.5) / 10
    x, y, yaw = origin
    turn = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
    wall = (np.column_stack([column, row])[:, None] + fine).reshape(-1, 2) * cell_m @ turn + [x, y]
    walls = cells.centres[cells.occupied]
    assert cKDTree(wall).query(walls, p=np.inf)[0].max() <= 0.55 * cells.resolution_m
    assert cKDTree(walls).query(wall, p=np.inf)[0].max() <= 1.5 * cells.resolution_m


@pytest.mark.parametrize(
    ("cell_m", "origin", "changed"),
    [
        (0.05, [-2.0, 3.05, 0.0], {}),
        (0.05, [-2.0, 3.05, 0.0], {"resolution_m": 0.025}),
        (0.05, [-100.0003, 0, 0], {}),
        (0.15, [-1.5, 3.0, 0.0], {}),
        (0.05, [0.05, 0.0, math.pi], {}),
        (float(np.float32(0.1)), [-2.0, 3.0, 0.0], {"resolution_m": 0.1}),
    ],
)
def test_nothing_is_said_where_nothing_moves(tmp_path, cell_m, origin, changed):
    room_map(tmp_path, cell_m, origin)
    assert made(tmp_path, **changed)[1] == []


@pytest.mark.parametrize(("resolution_m", "moves"), [(0.2, False), (0.1, False), (0.3, True), (0.4, True)])
def test_an_octomap_that_is_written_in_other_cells(tmp_path, resolution_m, moves):
    tree = octomap.OcTree(0.2)
    for place in range(5):
        tree.updateNode(np.array([0.1 + 0.2 * place, 0.1, 0.1]), place % 2 == 0)
    tree.writeBinary(str(tmp_path / "map.bt").encode())
    settings = MapSettings(
        scans=str(tmp_path / "map.bt"), output=str(tmp_path / "out"), fill=False, exports=["npz"], resolution_m=resolution_m
    )
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        make_map(settings)
    said = [str(warning.message) for warning in caught if "walls move" in str(warning.message)]
    assert len(said) == moves and all(f"are written in cells of {resolution_m:g} m; " in message for message in said)


def test_our_own_maps_are_on_the_lattice(tmp_path):
    """What came out of a map that was off it can go in again."""
    room_map(tmp_path, 0.05, [0.013, -0.012, 0])
    made(tmp_path)
    settings = MapSettings(scans=str(tmp_path / "out" / "map_observed.yaml"), output=str(tmp_path / "again"), fill=False, exports=["npz"])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        make_map(settings)
    before, after = (read_grid(tmp_path / name / "map.npz") for name in ("out", "again"))
    np.testing.assert_array_equal(before.index, after.index)
    np.testing.assert_array_equal(before.occupied, after.occupied)


def test_the_command_says_it_and_so_does_its_help(tmp_path, capsys):
    room_map(tmp_path, 0.05, [0.02, 0.0, 0.0])
    assert map_command.main([f"scans={tmp_path / 'map.yaml'}", f"output={tmp_path / 'out'}", "fill=off", "exports=[ros]"]) == 0
    assert "walls move by up to 0.02 m along each axis" in " ".join(capsys.readouterr().err.split())
    assert map_command.main(["--help"]) == 0
    assert "its walls move by up to half a cell" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(("typed", "quarters"), [("1.5708", 1), ("3.14159", 2), ("-1.5708", -1), ("6.28319", 4)])
def test_quarter_turns_as_people_type_them_move_nothing(tmp_path, typed, quarters):
    image = np.random.default_rng(0).choice(np.array([0, 254], np.uint8), (40, 60))
    Image.fromarray(image).save(tmp_path / "map.pgm")
    said = "image: map.pgm\nresolution: 0.1\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\norigin: [1.0, 2.0, "
    (tmp_path / "typed.yaml").write_text(f"{said}{typed}]\n")
    (tmp_path / "exact.yaml").write_text(f"{said}{quarters * math.pi / 2!r}]\n")
    given = read_given_map(tmp_path / "typed.yaml")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_of_moved_walls("typed.yaml", given, 0.1, 0.1)
    np.testing.assert_array_equal(given.cloud(0.1).points, read_given_map(tmp_path / "exact.yaml").cloud(0.1).points)
