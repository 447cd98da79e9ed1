"""Map files that were forged, cut short or changed: refused in one sentence, or still a map."""

import json
import os

import numpy as np
import pytest
from hilbert_map_toys import fit
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from safetensors import safe_open
from safetensors.numpy import load_file, save_file
from saved_map_toys import network

from hilbertvae.checks import InputError
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.packed_array import pack, unpack
from hilbertvae.mappers.saved_map import load_map, save_map

PACKED = {"grids": np.float16, "known": np.uint8}


@pytest.fixture(scope="module")
def saved(tmp_path_factory, room):
    return save_map(fit(HilbertMap(network()), room.fit), tmp_path_factory.mktemp("maps") / "site.map")


def forge(saved, path, change_settings=None, change_arrays=None, metadata=None):
    with safe_open(saved, framework="np") as file:
        header = dict(file.metadata())
    described, arrays = json.loads(header["settings"]), dict(load_file(saved))
    if change_settings:
        change_settings(described)
    if change_arrays:
        shape = (len(arrays["seeds"]), *(described["grid"]["cells"],) * described["dimension"])
        for name, kind in PACKED.items():
            arrays[name] = unpack(arrays[name], kind, shape, name)
        change_arrays(arrays)
        arrays.update({name: pack(arrays[name]) for name in PACKED if name in arrays})
    header = {**header, "settings": json.dumps(described), **(metadata or {})}
    save_file({name: np.ascontiguousarray(array) for name, array in arrays.items()}, path, header)
    return path


def setting(*keys, value):
    def change(described):
        for key in keys[:-1]:
            described = described[key]
        described[keys[-1]] = value

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (setting("dimension", value=3), "expected shape"),
        (setting("dimension", value=4), "dimension: expected 2 or 3"),
        (setting("dimension", value=[2]), "dimension: expected 2 or 3"),
        (setting("resolution_m", value=-1), "resolution_m: expected a positive number"),
        (setting("resolution_m", value=float("nan")), "resolution_m: expected a positive number"),
        (setting("flips", value=3), "flips: expected 1, 2, 4 or 8"),
        (setting("mapper", "neighbours", value=4), "rank_weights.unseen: expected"),
        (setting("mapper", "neighbours", value="five"), "neighbours: expected a whole number"),
        (setting("mapper", "weights", value="best"), "weights: expected unit, rank or cluster"),
        (setting("mapper", "colour", value="red"), "settings: expected weights, calibration"),
        (setting("mapper", value=[]), "don't fit together|settings: expected"),
        (setting("grid", "cells", value=8), "grids: expected float16"),
        (setting("grid", "cells", value=16.0), "grid.cells: expected a whole number"),
        (setting("grid", "cluster_diameter_m", value=0), "cluster_diameter_m: expected a positive number"),
        (setting("grid", "frame", "rotation", value="twisted"), "frame.rotation: expected one of"),
        (setting("grid", "interpolated", value="linear"), "grid.interpolated: expected true, false or one of voxels, points"),
        (setting("grid", "colour", value="red"), "don't fit together"),
        (setting("rank_weights", "seen", value=[1.0]), "rank_weights.seen: expected"),
        (setting("rank_weights", "unseen", value=[float("inf")] * 6), "rank_weights.unseen: expected .* finite"),
        (setting("rank_weights", "seen", value="none"), "don't fit together"),
        (setting("rank_weights", "spread", value=float("nan")), "rank_weights.spread: expected a finite number"),
        (setting("rank_weights", "spread", value=[1.0]), "don't fit together"),
        (setting("rank_weights", value={}), "another version"),
        (setting("classes", value=[1, 0]), "classes: expected two labels in order"),
        (setting("classes", value=[False, True, 2]), "classes: expected two labels in order"),
        (setting("network", value=None), "grids: expected int8"),
    ],
)
def test_forged_settings_are_named(saved, tmp_path, change, message):
    path = forge(saved, tmp_path / "forged.map", change)
    with pytest.raises(InputError, match=rf"forged\.map: .*({message})"):
        load_map(path)


def array(name, change):
    def put(arrays):
        arrays[name] = change(arrays[name].copy())

    return put


def first(value):
    def change(values):
        values.reshape(-1)[0] = value
        return values

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (array("grids", lambda grids: grids[:-1]), "grids: expected float16"),
        (array("grids", lambda grids: grids.astype(np.float32)), "grids: expected float16"),
        (array("grids", first(np.nan)), "grids: expected finite numbers"),
        (array("known", lambda grids: grids[..., :-1]), "known: expected uint8"),
        (array("seeds", lambda seeds: seeds[:, :1]), "seeds: expected float64"),
        (array("seeds", first(1e300)), "seeds: expected places in what was observed"),
        (array("centre", first(-1e9)), "centre: expected places in what was observed"),
        (array("centre", first(np.inf)), "centre: expected finite"),
        (array("scale", first(0.0)), "scale: expected at most"),
        (array("scale", first(1e9)), "scale: expected at most"),
        (array("evidence.hits", lambda votes: votes[1:]), "hits: expected shape"),
        (lambda arrays: arrays.pop("evidence.seen"), "seen: expected an array of that name"),
        (lambda arrays: arrays.pop("grids"), "don't fit together"),
        (lambda arrays: arrays.update(colour=np.zeros(3)), "expected arrays seeds, .* got colour"),
        (lambda arrays: arrays.update(rotation=np.zeros((len(arrays["seeds"]), 2, 2))), "rotation: expected rotations"),
        (lambda arrays: arrays.update(factors=np.zeros(3)), "factors: expected float64"),
    ],
)
def test_forged_arrays_are_named(saved, tmp_path, change, message):
    path = forge(saved, tmp_path / "forged.map", change_arrays=change)
    with pytest.raises(InputError, match=rf"forged\.map: .*({message})"):
        load_map(path)


def test_files_that_are_no_maps(saved, tmp_path, room):
    with pytest.raises(InputError, match="nothing.map: expected a map, found no file"):
        load_map(tmp_path / "nothing.map")
    with pytest.raises(InputError, match="expected a map, found no file"):
        load_map(tmp_path)
    path = tmp_path / "other.map"
    for content in (b"", b"not a map", b"\x80\x04K\x01.", os.urandom(2000), saved.read_bytes()[:-1], saved.read_bytes() + b"x"):
        path.write_bytes(content)
        with pytest.raises(InputError, match="other.map: not a map of hilbertvae, or damaged"):
            load_map(path)
    network().save(path)
    with pytest.raises(InputError, match="other.map: a network, which load_mapper reads"):
        load_map(path)
    save_file({"a": np.zeros(3)}, path)
    with pytest.raises(InputError, match="other.map: a safetensors file, but not a map of hilbertvae"):
        load_map(path)
    forge(saved, path, metadata={"format": "hilbertvae-map-0"})
    with pytest.raises(InputError, match=r"other.map: a map of another version \(hilbertvae-map-0\), expected hilbertvae-map-2"):
        load_map(path)
    for text in ("{", "[]", "[" * 100_000):
        forge(saved, path, metadata={"settings": text})
        with pytest.raises(InputError, match="other.map: the map's settings and arrays don't fit together"):
            load_map(path)


@pytest.mark.parametrize("part", [0.0, 0.001, 0.3, 0.7, 0.999])
def test_truncated_files(saved, tmp_path, part):
    path = tmp_path / "short.map"
    path.write_bytes(saved.read_bytes()[: int(part * saved.stat().st_size)])
    with pytest.raises(InputError, match="short.map: not a map of hilbertvae, or damaged"):
        load_map(path)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_changed_bytes_are_refused_or_answer_probabilities(saved, tmp_path, data):
    content = bytearray(saved.read_bytes())
    header = 8 + int.from_bytes(content[:8], "little")
    for _ in range(data.draw(st.integers(1, 4))):
        end = header if data.draw(st.booleans()) else len(content)
        content[data.draw(st.integers(0, end - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path / "changed.map"
    path.write_bytes(content)
    try:
        found = load_map(path)
    except InputError as error:
        assert "changed.map: " in str(error)
        return
    with np.errstate(over="ignore"):
        answers = found.predict_proba(np.random.default_rng(0).uniform(-5, 5, (50, 2)))
    assert ((answers >= 0) & (answers <= 1)).all()
