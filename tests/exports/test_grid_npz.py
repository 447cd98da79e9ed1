import io
import pickle
import tracemalloc
import zipfile

import numpy as np
import pytest
from export_toys import any_cells, assert_same, random_cells
from hypothesis import given, settings
from hypothesis import strategies as st

from hilbertvae.checks import InputError
from hilbertvae.exports import grid_npz
from hilbertvae.exports.grid_npz import read_grid, write_grid
from hilbertvae.exports.map_cells import MapCells


@settings(max_examples=25)
@given(cells=any_cells, dense=st.sampled_from([True, False, None]))
def test_there_and_back(cells, dense, tmp_path_factory):
    path = tmp_path_factory.mktemp("map") / "map.npz"
    assert_same(read_grid(write_grid(cells, path, dense)), cells)


@settings(max_examples=15)
@given(cells=any_cells)
def test_numpy_alone_finds_each_cell_in_a_dense_grid(cells, tmp_path_factory):
    with np.load(write_grid(cells, tmp_path_factory.mktemp("map") / "map.npz", True), allow_pickle=False) as grid:
        place = np.rint((cells.centres - grid["origin_m"]) / grid["resolution_m"] - 0.5).astype(int)
        for name in ("probability", "std", "observed"):
            np.testing.assert_array_equal(grid[name][tuple(place.T)], getattr(cells, name))
        rest = ~grid["known"]
        assert rest.sum() == rest.size - len(cells) and (grid["probability"][rest] == 0.5).all() and not grid["observed"][rest].any()


@pytest.mark.parametrize("dimension", [2, 3])
def test_numpy_alone_finds_each_cell_in_a_list(dimension, tmp_path):
    cells = random_cells(dimension, offset_m=4.5e6)
    with np.load(write_grid(cells, tmp_path / "map.npz", False), allow_pickle=False) as grid:
        np.testing.assert_array_equal((grid["index"] + 0.5) * grid["resolution_m"] + grid["origin_m"], cells.centres)
        np.testing.assert_array_equal(grid["probability"], cells.probability)


def test_a_large_box_becomes_a_list(tmp_path, monkeypatch):
    far = MapCells(np.array([[0, 0, 0], [10**6, 10**6, 5]]), 0.1, np.ones(2), np.ones(2), np.ones(2, bool))
    assert_same(read_grid(write_grid(far, tmp_path / "far.npz")), far)
    with pytest.raises(InputError, match="outlier"):
        write_grid(far, tmp_path / "dense.npz", True)
    monkeypatch.setattr(grid_npz, "DENSE_BELOW", 10)
    with np.load(write_grid(random_cells(2), tmp_path / "small.npz")) as grid:
        assert "index" in grid
    assert sorted(path.name for path in tmp_path.iterdir()) == ["far.npz", "small.npz"]


def test_free_space_that_packs_a_thousandfold_comes_back(tmp_path):
    index = np.stack(np.unravel_index(np.arange(3 * 10**6), (200, 150, 100)), axis=1)
    cells = MapCells(index, 0.2, np.full(len(index), 0.1), np.full(len(index), np.nan), np.ones(len(index), bool))
    assert len(read_grid(write_grid(cells, tmp_path / "map.npz", False))) == len(index)


def test_what_does_not_fit_is_refused(tmp_path):
    with pytest.raises(InputError, match="ends in .npz"):
        write_grid(random_cells(2), tmp_path / "map.npy")
    with pytest.raises(InputError, match="at least one"):
        write_grid(random_cells(2).select(np.zeros(0, int)), tmp_path / "map.npz")
    assert list(tmp_path.iterdir()) == []


def good(dense=True):
    cells = random_cells(2, count=20)
    low, shape = cells.box()
    arrays = {"version": np.int64(1), "resolution_m": np.float64(0.1), "first": low, "origin_m": low * 0.1}
    if dense:
        arrays |= {name: cells.dense(getattr(cells, name), 0) for name in ("probability", "std", "observed")}
        arrays["known"] = cells.dense(np.ones(len(cells), bool), False)
    else:
        arrays |= {name: getattr(cells, name) for name in ("index", "probability", "std", "observed")}
    return arrays


@pytest.mark.parametrize("dense", [True, False])
@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"probability": None}, "expected the arrays"),
        ({"version": np.int64(2)}, "expected version 1, got 2"),
        ({"version": np.ones(3, int)}, "expected shapes"),
        ({"resolution_m": np.float64(np.nan)}, "resolution_m"),
        ({"resolution_m": np.array("a")}, "resolution_m of numbers"),
        ({"first": np.zeros(5, int)}, "expected shapes"),
        ({"first": np.zeros((2, 2), int)}, "expected shapes"),
        ({"std": np.zeros(3)}, "expected shapes"),
        ({"observed": np.zeros(3)}, "expected observed of numbers"),
        ({"probability": "two"}, "numbers from 0 to 1"),
        ({"probability": np.array([None])}, "expected probability of numbers"),
    ],
)
def test_bad_arrays_are_named(tmp_path, dense, changed, named):
    arrays = good(dense)
    if changed.get("probability") == "two":
        changed = {"probability": np.full_like(arrays["probability"], 2)}
    arrays = {name: value for name, value in {**arrays, **changed}.items() if value is not None}
    np.savez(tmp_path / "map.npz", **arrays)
    with pytest.raises(InputError, match=f"map.npz.*{named}"):
        read_grid(tmp_path / "map.npz")


class Trap:
    def __reduce__(self):
        return (pytest.fail, ("an array was unpickled",))


def test_nothing_is_unpickled_and_foreign_files_are_named(tmp_path):
    arrays = good()
    arrays["probability"] = np.array([Trap()], object)
    np.savez(tmp_path / "map.npz", **arrays)
    with pytest.raises(InputError, match="map.npz: expected probability of numbers"):
        read_grid(tmp_path / "map.npz")
    for name, content in (("a.npz", pickle.dumps(Trap())), ("b.npz", b""), ("c.npz", b"PK\x03\x04" + bytes(40))):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=f"{name}: can't be read"):
            read_grid(tmp_path / name)
    with pytest.raises(InputError, match="none.npz: no such file"):
        read_grid(tmp_path / "none.npz")


def test_forged_shapes_take_no_memory(tmp_path):
    def member(shape, descr, data):
        file = io.BytesIO()
        np.lib.format.write_array_header_1_0(file, {"descr": descr, "fortran_order": False, "shape": shape})
        return file.getvalue() + data

    kinds = {"probability": "<f4", "std": "<f4", "observed": "|b1"}
    for leader, shape, there in (("known", (10**5, 10**5), 0), ("index", (10**9, 3), 0), ("index", (3 * 10**6, 3), 3 * 10**6)):
        columns = shape if leader == "known" else shape[:1]
        head = {"version": np.int64(1), "resolution_m": np.float64(1), "first": np.zeros(len(shape) if leader == "known" else 3, int)}
        with zipfile.ZipFile(tmp_path / "forged.npz", "w", zipfile.ZIP_DEFLATED) as archive:
            for name, value in head.items():
                file = io.BytesIO()
                np.save(file, value)
                archive.writestr(f"{name}.npy", file.getvalue())
            archive.writestr(f"{leader}.npy", member(shape, "|b1" if leader == "known" else "<i8", bytes(24 * there)))
            for name, kind in kinds.items():
                archive.writestr(f"{name}.npy", member(columns, kind, bytes(there * np.dtype(kind).itemsize)))
        tracemalloc.start()
        with pytest.raises(InputError, match="forged.npz: truncated or forged" + (".*the cells claim" if there else "")):
            read_grid(tmp_path / "forged.npz")
        assert tracemalloc.get_traced_memory()[1] < 20e6
        tracemalloc.stop()


def test_a_dense_grid_is_no_larger_than_what_is_written(tmp_path, monkeypatch):
    path = write_grid(random_cells(2), tmp_path / "map.npz", True)
    monkeypatch.setattr(grid_npz, "MOST_DENSE", 100)
    with pytest.raises(InputError, match="at most 100 cells"):
        read_grid(path)


@settings(max_examples=100)
@given(data=st.data())
def test_damaged_files_are_refused_or_read(data, tmp_path_factory):
    path = write_grid(random_cells(data.draw(st.sampled_from([2, 3])), count=30), tmp_path_factory.mktemp("map") / "map.npz")
    content = bytearray(path.read_bytes())
    place = data.draw(st.integers(0, len(content) - 1))
    if data.draw(st.booleans()):
        content[place] = data.draw(st.integers(0, 255))
    else:
        del content[place : place + data.draw(st.integers(1, 60))]
    path.write_bytes(content)
    try:
        cells = read_grid(path)
    except InputError as error:
        assert str(path) in str(error)
        return
    assert np.isfinite(cells.centres).all()
