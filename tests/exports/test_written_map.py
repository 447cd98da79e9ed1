"""Files of a map that was made in Python."""

import errno

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
    for wrong, named in (
        ({"mapper": NearestMapper().fit(room.fit.points, room.fit.occupied)}, "mapper: expected a fitted map"),
        ({"mapper": HilbertMap(tiny_reconstructor())}, "mapper: expected a fitted map"),
        ({"exports": ["mesh"]}, "exports: mesh is for 3D maps"),
        ({"exports": ["pgm"]}, "exports: expected some of ros"),
        ({"resolution_m": 0.05}, "resolution_m: expected at least the map's own 0.1 m, got 0.05"),
    ):
        with pytest.raises(InputError, match=named):
            hilbertvae.write_map(**{"mapper": mapper, "folder": tmp_path / "new"} | wrong)
    (tmp_path / "of_the_command").mkdir()
    write_json(tmp_path / "of_the_command" / "summary.json", {})
    with pytest.raises(InputError, match="has a map of hilbertvae-map"):
        hilbertvae.write_map(mapper, tmp_path / "of_the_command")

    def full(cells, path):
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    monkeypatch.setitem(formats.EXPORTS, "npz", formats.Export(full, ("map.npz",)))
    with pytest.raises(OSError, match="No space left"):
        hilbertvae.write_map(mapper, tmp_path / "new")
    assert not (tmp_path / "new").exists()
