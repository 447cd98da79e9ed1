"""What a growing map takes for labels, what it refuses, and what stops it: it stays as it was."""

import os
import pickle
import signal

import numpy as np
import pytest
from growing_toys import add, answers, clouds, network, queries_of, streamed
from sklearn.base import clone

from hilbertvae.checks import InputError
from hilbertvae.cloud import fit_cloud
from hilbertvae.mappers.growing_clusters import GrowingClusters
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.saved_map import load_map, save_map
from toy_rooms import tiny_grid, tiny_reconstructor


def test_the_first_scan_may_have_one_class():
    wall = np.column_stack([np.linspace(0, 2, 60), np.zeros(60)])
    mapper = HilbertMap(weights="unit", grid=tiny_grid())
    mapper.partial_fit(wall + [0, 1], np.zeros(60, bool))
    assert mapper.cluster_count() == 0 and (mapper.predict_proba(wall + [0, 1])[:, 1] < 0.5).all()
    mapper.partial_fit(wall, np.ones(60, bool))
    assert mapper.cluster_count() > 0 and (mapper.predict_proba(wall)[:, 1] > 0.5).all()
    np.testing.assert_array_equal(mapper.predict(wall), True)
    with pytest.raises(InputError, match=r"y: expected both free and occupied points, got one class only: \[1\]"):
        HilbertMap().partial_fit(wall, np.ones(60, int))


def test_classes_are_taken_as_scikit_learn_has_them():
    wall = np.column_stack([np.linspace(0, 2, 60), np.zeros(60)])
    mapper = HilbertMap(weights="unit", grid=tiny_grid()).partial_fit(wall, np.full(60, 2), classes=[1, 2])
    mapper.partial_fit(wall + [0, 1], np.full(60, 1), classes=[2, 1])
    assert mapper.classes_.tolist() == [1, 2] and mapper.predict(wall).tolist() == [2] * 60
    with pytest.raises(InputError, match=r"classes: expected \[1, 2\], as before, got \[0, 1\]"):
        mapper.partial_fit(wall, np.full(60, 1), classes=[0, 1])
    with pytest.raises(InputError, match=r"y: expected labels \[0, 1\], as before, got \[2\]"):
        HilbertMap().partial_fit(wall, np.full(60, 2), classes=[0, 1])


@pytest.mark.parametrize(("classes", "label"), [([1, 0], 1), (["void", "obstacle"], "void")])
def test_a_free_label_that_is_the_greater_is_refused(classes, label):
    """What is called free would be walls."""
    wall = np.column_stack([np.linspace(0, 2, 60), np.zeros(60)])
    mapper = HilbertMap(weights="unit", grid=tiny_grid())
    with pytest.raises(InputError, match="classes: expected the lesser label first, which is free; the greater means occupied; got"):
        mapper.partial_fit(wall, np.full(60, label), classes=classes)
    assert not hasattr(mapper, "grids_")


def test_whether_a_map_grows_is_decided_by_the_weights_that_it_was_fitted_with(room, tmp_path):
    cloud, part = fit_cloud(room.scans, 0.1), clouds(room)[0]
    fitted = HilbertMap(weights="cluster", grid=tiny_grid()).fit(cloud.points, cloud.occupied, cloud.weight).set_params(weights="rank")
    answers = fitted.predict_proba(cloud.points)
    for mapper in (fitted, load_map(save_map(fitted, tmp_path / "site.map")).set_params(weights="rank")):
        with pytest.raises(InputError, match="weights: expected unit or rank for partial_fit, got 'cluster', .*; fit the map anew"):
            add(mapper, part)
        np.testing.assert_array_equal(mapper.predict_proba(cloud.points), answers)
    growing = HilbertMap(grid=tiny_grid()).fit(cloud.points, cloud.occupied, cloud.weight).set_params(weights="cluster")
    add(growing, part)


def test_labels_of_any_kind_stay_what_they_are(room):
    parts = clouds(room)
    signed, plain = HilbertMap(grid=tiny_grid()), HilbertMap(grid=tiny_grid())
    for part in parts[:3]:
        signed.partial_fit(part.points, np.where(part.occupied, 1, -1), part.weight)
        add(plain, part)
    signed.partial_fit([[0.0, 0.0]], [1])
    plain.partial_fit([[0.0, 0.0]], [True])
    np.testing.assert_array_equal(signed.predict_proba(queries_of(room)), plain.predict_proba(queries_of(room)))
    with pytest.raises(InputError, match=r"y: expected labels \[-1, 1\], as before, got \[0\]"):
        signed.partial_fit([[0.0, 0.0]], [0])


@pytest.mark.parametrize(
    ("cloud", "message"),
    [
        (([[0.0, np.nan]], [True]), "NaN"),
        ((np.empty((0, 2)), []), "0 sample"),
        (([[0.0, 0.0, 0.0]], [True]), "features"),
        (([[0.0, 0.0]], [True, False]), "inconsistent"),
        (([[0.0, 0.0]], [True], [-1.0]), "[Nn]egative"),
        (([[0.0, 0.0]], [True], [0.0]), "positive weights|non-zero"),
        (([[1e12, 0.0]], [True]), "is there an outlier"),
    ],
)
def test_a_bad_scan_is_named_and_changes_nothing(room, cloud, message):
    mapper = streamed(HilbertMap(weights="unit", grid=tiny_grid()), clouds(room)[:4])
    before = answers(mapper, queries_of(room))
    with pytest.raises(InputError, match=message):
        mapper.partial_fit(*cloud)
    for ours, theirs in zip(answers(mapper, queries_of(room)), before, strict=True):
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("step", ["_touched", "_draw_seeds", "_promote", "_find_frames"])
def test_ctrl_c_waits_until_a_scan_is_whole(room, monkeypatch, step):
    """Half of a scan's votes could not be taken back, and the scan would count twice when it is given again."""
    parts, original = clouds(room)[:4], getattr(GrowingClusters, step)
    mapper, whole = (streamed(HilbertMap(weights="unit", grid=tiny_grid()), parts[:2]) for _ in range(2))
    pressed = []

    def stopped(self, *arguments):
        if not pressed:
            pressed.append(os.kill(os.getpid(), signal.SIGINT))
        return original(self, *arguments)

    monkeypatch.setattr(GrowingClusters, step, stopped)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            add(mapper, parts[2])
    finally:
        signal.signal(signal.SIGINT, before)
    assert pressed
    for ours, theirs in zip(
        answers(add(mapper, parts[3]), queries_of(room)), answers(streamed(whole, parts[2:]), queries_of(room)), strict=True
    ):
        np.testing.assert_array_equal(ours, theirs)


def test_a_map_with_half_a_scan_says_so(room, monkeypatch, tmp_path):
    parts = clouds(room)[:4]
    mapper = streamed(HilbertMap(weights="unit", grid=tiny_grid()), parts[:2])
    monkeypatch.setattr(GrowingClusters, "_promote", lambda *arguments: np.empty(10**18))
    with pytest.raises(MemoryError):
        add(mapper, parts[2])
    for use in (
        lambda: add(mapper, parts[2]),
        lambda: mapper.predict_proba([[0.0, 0.0]]),
        lambda: save_map(mapper, tmp_path / "a.safetensors"),
    ):
        with pytest.raises(InputError, match="partial_fit: a scan was added in part, and the map is damaged"):
            use()
    assert not (tmp_path / "a.safetensors").exists()
    monkeypatch.undo()
    mapper.fit(parts[0].points, parts[0].occupied).predict_proba([[0.0, 0.0]])


def test_settings_that_cannot_grow(room):
    part = clouds(room)[0]
    with pytest.raises(InputError, match="weights: expected unit or rank for partial_fit, got 'cluster'"):
        add(HilbertMap(network(2), weights="cluster"), part)
    with pytest.raises(InputError, match="the network is for 3D, got 2D"):
        add(HilbertMap(tiny_reconstructor(3)), part)
    unfitted = HilbertMap(network(2), neighbours=3)
    with pytest.raises(InputError, match="neighbours: the weights were learned for 5, got 3"):
        add(unfitted, part)
    assert not hasattr(clone(unfitted), "grids_") and not hasattr(unfitted, "grids_")


def test_another_network_than_the_map_s_is_refused_before_anything_is_altered(place):
    first, other = network(place.dimension), network(place.dimension, seed=1)
    mapper, queries = HilbertMap(first), queries_of(place)
    start, scan, *_ = clouds(place)
    add(mapper, start)
    add(mapper, scan, reconstruct=False)
    twin = pickle.loads(pickle.dumps(mapper))
    for changed in (other, None):
        mapper.set_params(reconstructor=changed)
        with pytest.raises(InputError, match="reconstructor: expected the one that the map's grids are of for partial_fit"):
            add(mapper, scan)
    # What was still to be reconstructed is so by the map's own network.
    for ours, theirs in zip(answers(mapper, queries), answers(twin, queries), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    add(mapper.set_params(reconstructor=first), scan)
    for ours, theirs in zip(answers(mapper, queries), answers(add(twin, scan), queries), strict=True):
        np.testing.assert_array_equal(ours, theirs)
