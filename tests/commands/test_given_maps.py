"""Maps of other tools that `hilbertvae-map` is given, in cells larger than a network's."""

import json

import numpy as np
import octomap
import pytest

from hilbertvae.exports.grid_npz import read_grid
from hilbertvae.mappers.given_map import is_given_map
from hilbertvae.mappers.saved_map import load_map
from hilbertvae.mapping import MapSettings, make_map


@pytest.mark.parametrize("cell_m", [0.2, 0.25, 0.3, 0.5])
def test_without_filling_a_given_map_is_what_comes_out(tmp_path, cell_m):
    """No cell leaks into its neighbours, whether a whole number of the network's voxels makes one or not."""
    shape = (12, 10, 6)
    index = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, 3)
    wall = ((index == 0) | (index == np.array(shape) - 1)).any(axis=1)
    tree = octomap.OcTree(cell_m)
    for spot, hit in zip((index + 0.5) * cell_m, wall, strict=True):
        tree.updateNode(spot, bool(hit))
    tree.updateInnerOccupancy()
    path = tmp_path / "hall.bt"
    tree.writeBinary(str(path).encode())
    out = make_map(MapSettings(scans=str(path), output=str(tmp_path / "out"), fill=False, exports=["npz"]))
    found = read_grid(out / "map.npz")
    assert found.resolution_m == pytest.approx(cell_m)
    said = {tuple(place): bool(hit) for place, hit in zip(found.index, found.occupied, strict=True)}
    assert said == {tuple(place): bool(hit) for place, hit in zip(index, wall, strict=True)}
    assert json.loads((out / "summary.json").read_text())["weights"] == "3d"


@pytest.mark.parametrize("cell_m", [0.15, 0.25])
def test_a_ros_map_too(tmp_path, cell_m):
    codes = np.full((9, 14), 205, np.uint8)
    codes[2:7, 3:12] = 254
    codes[[2, 6], 3:12] = codes[2:7, [3, 11]] = 0
    (tmp_path / "map.pgm").write_bytes(b"P5 14 9 255\n" + codes.tobytes())
    header = f"image: map.pgm\nresolution: {cell_m}\norigin: [-1.5, 3.0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    (tmp_path / "map.yaml").write_text(header)
    out = make_map(MapSettings(scans=str(tmp_path / "map.yaml"), output=str(tmp_path / "out"), fill=False, exports=["npz"]))
    found = read_grid(out / "map.npz")
    first = np.round(np.array([-1.5, 3.0]) / cell_m).astype(int)
    row, column = np.nonzero(codes != 205)
    expected = {(int(c + first[0]), int(8 - r + first[1])): codes[r, c] == 0 for r, c in zip(row, column, strict=True)}
    assert {tuple(map(int, place)): bool(hit) for place, hit in zip(found.index, found.occupied, strict=True)} == expected
    assert json.loads((out / "summary.json").read_text())["weights"] == "2d-map"  # a network for maps, where there is one


@pytest.mark.parametrize(("cell_m", "voxel_m"), [(float(np.float32(0.1)), 0.1), (0.101, 0.0505)])
def test_cells_in_single_precision_are_as_large_as_a_network_s(tmp_path, cell_m, voxel_m):
    """Halved they would be asked four times as often, and far more would be filled in."""
    (tmp_path / "map.pgm").write_bytes(b"P5 2 1 255\n" + bytes([0, 254]))
    header = f"image: map.pgm\nresolution: {cell_m!r}\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    (tmp_path / "map.yaml").write_text(header)
    out = make_map(MapSettings(scans=str(tmp_path / "map.yaml"), output=str(tmp_path / "out"), fill=False, exports=[]))
    assert load_map(out).evidence_.resolution_m == pytest.approx(voxel_m, rel=1e-6)


def test_a_folder_of_scans_named_as_a_map_is_none(tmp_path):
    (tmp_path / "monday.yaml").mkdir()
    (tmp_path / "monday.bt").write_bytes(b"")
    assert not is_given_map(tmp_path / "monday.yaml") and is_given_map(tmp_path / "monday.bt")
