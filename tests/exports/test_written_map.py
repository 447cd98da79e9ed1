"""Files of a map that was made in Python."""

import errno
import json

import numpy as np
import pytest

import hilbertvae
from hilbertvae.checks import InputError
from hilbertvae.exports import formats
from hilbertvae.exports.grid_npz import read_grid
from hilbertvae.exports.map_cells import MapCells
from hilbertvae.files import write_json
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.nearest import NearestMapper
from hilbertvae.mappers.octomap_mapper import OctoMapMapper
from toy_rooms import tiny_reconstructor


@pytest.fixture
def mapper(room):
    cloud = room.fit
    return HilbertMap(tiny_reconstructor(), weights="unit").fit(cloud.points, cloud.occupied, cloud.weight)


def test_a_map_that_was_loaded_and_has_grown_is_written(room, mapper, tmp_path):
    loaded = hilbertvae.load_map(hilbertvae.save_map(mapper, tmp_path / "room.map"))
    (asked,) = hilbertvae.write_map(loaded, tmp_path / "npz", exports=["npz"])
    cells = read_grid(asked)
    assert cells.resolution_m == loaded.evidence_.resolution_m and not cells.observed.all() and cells.observed.any()
    np.testing.assert_allclose(cells.probability, loaded.predict_map(cells.centres), atol=1e-6)
    np.testing.assert_array_equal(cells.observed, loaded.observed(cells.centres))
    whole = MapCells.sample(mapper, room.fit.points, 0.1)  # as `hilbertvae-map` has it, which asks around the very points
    assert {tuple(index) for index in whole.index.tolist()} == {tuple(index) for index in cells.index.tolist()}

    files = hilbertvae.write_map(loaded, tmp_path / "all")
    assert {file.name for file in files} == {"map.yaml", "map.pgm", "map_observed.yaml", "map_observed.pgm", "map.ot", "map_observed.ot",
                                             "map.bt", "map_observed.bt", "points.ply", "map.npz"}  # fmt: skip
    assert all(file.exists() for file in files)
    summary = json.loads((tmp_path / "all" / "summary.json").read_text())
    assert summary["files"] == sorted(file.name for file in files) and summary["resolution_m"] == 0.1
    assert summary["cells"]["before"]["occupied"] == read_grid(tmp_path / "all" / "map.npz").select(cells.observed).occupied.sum()
    mapper.partial_fit([[30.05, 0.05], [30.05, 0.25]], [False, True])
    (asked,) = hilbertvae.write_map(mapper, tmp_path / "npz", exports=["npz"])  # in the earlier one's place
    assert read_grid(asked).centres.max() > 30
    (coarse,) = hilbertvae.write_map(mapper, tmp_path / "coarse", exports=["npz"], resolution_m=0.2)
    assert read_grid(coarse).resolution_m == 0.2 and read_grid(coarse).observed.sum() < cells.observed.sum()


def test_a_map_without_grids_is_what_was_observed(room, tmp_path):
    cloud = room.fit
    bare = HilbertMap(tiny_reconstructor(), weights="unit", fill=False).fit(cloud.points, cloud.occupied, cloud.weight)
    assert read_grid(hilbertvae.write_map(bare, tmp_path, exports=["npz"])[0]).observed.all()


def test_what_can_not_be_written(room, mapper, tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    for wrong, named in (
        ({"mapper": NearestMapper().fit(room.fit.points, room.fit.occupied)}, "mapper: expected a fitted map"),
        ({"mapper": HilbertMap(tiny_reconstructor())}, "mapper: expected a fitted map"),
        ({"exports": ["mesh"]}, "exports: mesh is for 3D maps"),
        ({"exports": ["pgm"]}, "exports: expected some of ros"),
        ({"exports": "ros"}, "exports: expected a list, some of ros, .*, got 'ros'"),
        ({"exports": 3}, "exports: expected a list, some of ros, .*, got 3"),
        ({"exports": [["ros"]]}, "exports: expected some of ros"),
        ({"exports": []}, "exports: expected at least one format"),
        ({"folder": ""}, "folder: expected a path, got ''"),
        ({"folder": None}, "folder: expected a path, got None"),
        ({"folder": tmp_path / "file"}, "folder: expected a folder, .*file is a file"),
        ({"resolution_m": 0.05}, "resolution_m: expected at least the map's own 0.1 m, got 0.05"),
    ):
        with pytest.raises(InputError, match=named):
            hilbertvae.write_map(**{"mapper": mapper, "folder": tmp_path / "new"} | wrong)
    (tmp_path / "of_the_command").mkdir()
    (tmp_path / "of_the_command" / "map.safetensors").touch()
    write_json(tmp_path / "of_the_command" / "summary.json", {"files": ["map.safetensors"]})
    with pytest.raises(InputError, match="has a map of hilbertvae-map"):
        hilbertvae.write_map(mapper, tmp_path / "of_the_command")

    def full(cells, path):
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    monkeypatch.setitem(formats.EXPORTS, "npz", formats.Export(full, ("map.npz",)))
    with pytest.raises(OSError, match="No space left"):
        hilbertvae.write_map(mapper, tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_what_another_has_left_is_not_replaced(mapper, tmp_path):
    """A file, a folder or a link of such a name, and nothing is written beside it."""
    (tmp_path / "points.ply").write_text("mine")
    (tmp_path / "map.yaml").mkdir()
    (tmp_path / "map.npz").symlink_to("nowhere")
    (tmp_path / "mesh.ply").write_text("of no plan")
    for name, exports in (("points.ply", ["points"]), ("map.yaml", ["ot", "ros"]), ("map.npz", ["bt", "npz"])):
        with pytest.raises(InputError, match=f"folder: .*{name} was not left by an earlier map"):
            hilbertvae.write_map(mapper, tmp_path, exports=exports)
    assert {path.name for path in tmp_path.iterdir()} == {"points.ply", "map.yaml", "map.npz", "mesh.ply"}
    (tmp_path / "summary.json").write_text('{"files": ["data.csv"]}')
    with pytest.raises(InputError, match="summary.json was not left by an earlier map"):
        hilbertvae.write_map(mapper, tmp_path, exports=["ot"])
    (tmp_path / "summary.json").write_text('{"files": ["map.ot", "map.yaml"]}')  # an earlier map's, that a folder has taken the place of
    with pytest.raises(InputError, match="map.yaml was not left by an earlier map"):
        hilbertvae.write_map(mapper, tmp_path, exports=["ros"])
    assert len(hilbertvae.write_map(mapper, tmp_path, exports=["ot"])) == 2
    assert (tmp_path / "map.yaml").is_dir() and (tmp_path / "points.ply").read_text() == "mine"


def test_no_file_of_an_earlier_map_stays(mapper, tmp_path):
    """Beside a later one's it would pass for its own."""
    (tmp_path / "notes.txt").write_text("mine")
    hilbertvae.write_map(mapper, tmp_path, exports=["ros", "npz"])
    hilbertvae.write_map(mapper, tmp_path, exports=["npz"], resolution_m=0.2)
    assert {path.name for path in tmp_path.iterdir()} == {"notes.txt", "map.npz", "summary.json"}
    assert read_grid(tmp_path / "map.npz").resolution_m == 0.2


def test_an_octomap_is_told_how_it_is_written(tmp_path):
    with pytest.raises(InputError, match="expected a HilbertMap, got an OctoMap; hilbertvae-map scans=<its .ot or .bt> fill=off writes it"):
        hilbertvae.write_map(OctoMapMapper(0.5).fit(np.zeros((2, 2)) + [[0], [1]], [0, 1]), tmp_path)
