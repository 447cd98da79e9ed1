import os
from dataclasses import replace

import numpy as np
import pytest
from hilbert_map_toys import fit
from saved_map_toys import network

import hilbertvae
from hilbertvae.checks import InputError
from hilbertvae.cloud import fit_cloud
from hilbertvae.grids.frame import FrameSettings
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.nearest import NearestMapper
from hilbertvae.mappers.packed_array import pack
from hilbertvae.mappers.saved_map import load_map, save_map
from hilbertvae.reconstruction.reconstructor import Reconstructor
from toy_rooms import tiny_grid, tiny_reconstructor


def turned_grid(dimension):
    grid = tiny_grid(dimension)
    grid.frame = FrameSettings("median", "full", "extent")
    return grid


def between_cells(dimension, interpolated=True):
    made = network(dimension)
    made.grid = replace(made.grid, interpolated=interpolated)
    return made


MAPPERS = {
    "network": lambda dimension: HilbertMap(network(dimension)),
    "cluster": lambda dimension: HilbertMap(network(dimension), weights="cluster"),
    "no evidence": lambda dimension: HilbertMap(network(dimension), evidence=False, calibration="voxels", seed=np.int64(3)),
    "between cells": lambda dimension: HilbertMap(between_cells(dimension)),
    "between cells for voxels": lambda dimension: HilbertMap(between_cells(dimension, "voxels")),
    "raw": lambda dimension: HilbertMap(grid=tiny_grid(dimension), weights="unit", neighbours=3),
    "turned": lambda dimension: HilbertMap(grid=turned_grid(dimension), weights="unit", resolution_m=0.15),
}


def queries_of(place, count=500):
    low, high = place.fit.points.min(axis=0) - 1, place.fit.points.max(axis=0) + 1
    return np.random.default_rng(0).uniform(low, high, (count, place.dimension))


def assert_same(ours, theirs, queries):
    for ask in ("predict_proba", "predict_map", "predict_std", "known", "observed", "predict"):
        np.testing.assert_array_equal(getattr(ours, ask)(queries), getattr(theirs, ask)(queries), err_msg=ask)


@pytest.mark.parametrize("kind", MAPPERS)
def test_a_loaded_map_answers_to_the_bit_and_without_a_network(place, kind, tmp_path, monkeypatch):
    mapper = fit(MAPPERS[kind](place.dimension), place.fit)
    path = save_map(mapper, tmp_path / "deep" / "site.map")
    monkeypatch.setattr(Reconstructor, "load", None)
    found = load_map(path)
    assert_same(found, mapper, queries_of(place))
    assert_same(found, mapper, place.fit.points)
    assert found.cluster_count() == mapper.cluster_count()
    for name in ("weights", "calibration", "neighbours", "evidence", "seed", "resolution_m", "grid", "grid_", "flips_"):
        assert getattr(found, name) == getattr(mapper, name)
    again = save_map(found, tmp_path / "again.map")
    assert_same(load_map(again), mapper, queries_of(place))


def test_a_folder_stands_for_the_map_in_it(tmp_path, room):
    mapper = fit(HilbertMap(grid=tiny_grid()), room.fit)
    save_map(mapper, tmp_path / "map.safetensors")
    assert_same(load_map(tmp_path), mapper, room.fit.points)
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="empty/map.safetensors: expected a map, found no file"):
        load_map(str(tmp_path / "empty"))


def test_large_coordinates_survive(tmp_path, room):
    """UTM, to the bit: what is kept is exact."""
    cloud = room.fit
    shift = np.array([412_345.6, 5_654_321.9])
    mapper = HilbertMap(network()).fit(cloud.points + shift, cloud.occupied, cloud.weight)
    assert_same(load_map(save_map(mapper, tmp_path / "utm.map")), mapper, queries_of(room) + shift)


def test_labels_come_back(tmp_path, room):
    for negative, positive in ((-1, 1), ("free", "occupied"), (0.0, 1.0)):
        mapper = HilbertMap(grid=tiny_grid()).fit(room.fit.points, np.where(room.fit.occupied, positive, negative))
        found = load_map(save_map(mapper, tmp_path / "site.map"))
        assert found.classes_.tolist() == [negative, positive]
        assert_same(found, mapper, room.fit.points)


def test_a_map_without_clusters(tmp_path, room):
    few = np.append(np.flatnonzero(room.fit.occupied)[:2], np.flatnonzero(~room.fit.occupied))
    mapper = fit(HilbertMap(network()), room.fit.select(few))
    assert mapper.cluster_count() == 0
    assert_same(load_map(save_map(mapper, tmp_path / "site.map")), mapper, queries_of(room))


def test_the_file_is_small(tmp_path, box):
    """Cells of grids packed, and what was seen in about 16 bytes a voxel."""
    mapper = fit(HilbertMap(network(3)), box.fit)
    size = os.path.getsize(save_map(mapper, tmp_path / "site.map"))
    packed = sum(len(pack(array)) for array in (mapper.grids_, mapper.known_))
    assert packed < 0.9 * (mapper.grids_.nbytes + mapper.known_.nbytes)
    assert size < packed + 20 * len(mapper.evidence_) + 100 * len(mapper.frames_) + 10_000


def scans_of(place):
    scans = place.scans
    return [fit_cloud(scans.select(scans.scan == k), place.resolution_m) for k in np.unique(scans.scan)]


@pytest.mark.parametrize("waiting", [False, True])
def test_a_loaded_map_grows_as_the_saved_one(tmp_path, place, waiting):
    """Given the checkpoint; what waited for its reconstruction when the map was saved is not lost."""
    made, parts = network(place.dimension), scans_of(place)
    checkpoint = made.save(tmp_path / "model.safetensors")
    mapper = hilbertvae.load_mapper(checkpoint)
    for part in parts[:4]:
        mapper.partial_fit(part.points, part.occupied, part.weight, reconstruct=not waiting)
    found = load_map(save_map(mapper, tmp_path / "site.map"), checkpoint=checkpoint)
    np.testing.assert_array_equal(found.small_seeds_, mapper.small_seeds_)
    assert_same(found, mapper, queries_of(place))
    for part in parts[4:7]:
        for each in (found, mapper):
            each.partial_fit(part.points, part.occupied, part.weight)
    assert_same(found, mapper, queries_of(place))
    again = found.fit(place.fit.points, place.fit.occupied, place.fit.weight)
    assert_same(again, fit(hilbertvae.load_mapper(checkpoint), place.fit), queries_of(place))


def test_a_shipped_network_is_found_when_a_map_grows(tmp_path):
    mapper = hilbertvae.load_mapper("2d-sim", flips=1)
    wall = np.column_stack([np.linspace(0, 1, 21), np.zeros(21)])
    mapper.fit(np.concatenate([wall, wall + [0, 0.5]]), np.arange(42) < 21)
    found = load_map(save_map(mapper, tmp_path / "site.map"))
    for each in (found, mapper):
        each.partial_fit(wall + [1, 0], np.ones(21, bool))
    assert_same(found, mapper, np.random.default_rng(0).uniform(-2, 3, (200, 2)))


def test_growing_without_the_network_says_how_to_give_it(tmp_path, room):
    mapper = fit(HilbertMap(network()), room.fit)
    path = save_map(mapper, tmp_path / "site.map")
    with pytest.raises(
        InputError, match=r"does not come with this version .*, and is not in .*adapted.safetensors; .*load_map\(path, checkpoint=...\)"
    ):
        load_map(path).partial_fit([[0.0, 0.0]], [True])
    other = tiny_reconstructor(seed=1).save(tmp_path / "other.safetensors")
    found = load_map(path, checkpoint=other)
    assert_same(found, mapper, queries_of(room))
    with pytest.raises(InputError, match="other.safetensors: expected the network that the map was made with"):
        found.partial_fit([[0.0, 0.0]], [True])


def test_a_checkpoint_that_is_not_there_is_told_of_at_once(tmp_path, room):
    """And not when the map first grows."""
    path = save_map(fit(HilbertMap(network()), room.fit), tmp_path / "site.map")
    with pytest.raises(InputError, match="checkpoint: expected a model.safetensors, or one of 2d, .*, got nowhere.safetensors"):
        load_map(path, checkpoint="nowhere.safetensors")


def test_what_cannot_be_saved(tmp_path, room):
    with pytest.raises(InputError, match="site.map: expected a HilbertMap to save, got NearestMapper"):
        save_map(fit(NearestMapper(), room.fit), tmp_path / "site.map")
    with pytest.raises(ValueError, match="not fitted"):
        save_map(HilbertMap(), tmp_path / "site.map")
    for name in ("site.ot", "site.BT"):  # load_map would take it for an OctoMap's
        with pytest.raises(InputError, match=f"{name}: expected a name that does not end in .ot or .bt"):
            save_map(fit(HilbertMap(), room.fit), tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_names_of_columns_are_kept(room, tmp_path):
    """As scikit-learn leaves them in a mapper that was fitted on a data frame."""
    mapper = fit(HilbertMap(network(2)), room.fit)
    assert not hasattr(load_map(save_map(mapper, tmp_path / "site.map")), "feature_names_in_")
    mapper.feature_names_in_ = np.array(["x", "y"], dtype=object)
    loaded = load_map(save_map(mapper, tmp_path / "site.map"))
    assert loaded.feature_names_in_.dtype == object and loaded.feature_names_in_.tolist() == ["x", "y"]


def test_a_setting_that_was_changed_after_the_fit(room, tmp_path):
    mapper = fit(HilbertMap(network(2)), room.fit)
    queries = room.voxels.points[:200]
    before = mapper.predict_proba(queries), mapper.known(queries), mapper.predict_std(queries)
    for change in ({"neighbours": mapper.neighbours - 2}, {"calibration": "bogus"}, {"weights": "best"}):
        kept = {name: getattr(mapper, name) for name in change}
        mapper.set_params(**change)
        for found, expected in zip(
            (mapper.predict_proba(queries), mapper.known(queries), mapper.predict_std(queries)), before, strict=True
        ):
            np.testing.assert_array_equal(found, expected)
        named = "unseen" if "neighbours" in change else next(iter(change))
        with pytest.raises(InputError, match=f"site.map: a setting was changed after the map was made.*{named}"):
            save_map(mapper, tmp_path / "site.map")
        assert not list(tmp_path.iterdir())
        mapper.set_params(**kept)
    np.testing.assert_array_equal(load_map(save_map(mapper, tmp_path / "site.map")).predict_proba(queries), before[0])


def test_a_map_that_may_not_be_read_is_told_as_that(tmp_path, room, monkeypatch):
    path = save_map(fit(HilbertMap(grid=tiny_grid()), room.fit), tmp_path / "site.map")

    def forbidden(self, *_):
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr("pathlib.Path.open", forbidden)
    with pytest.raises(InputError, match="site.map: can't be read \\(Permission denied\\)$"):
        load_map(path)
