"""What a Hilbert Map refuses, and in which words."""

import numpy as np
import pytest
import torch
from hilbert_map_toys import fit, gapped, reconstructor
from sklearn.base import clone
from sklearn.exceptions import NotFittedError

from hilbertvae.checks import InputError
from hilbertvae.grids.cluster_grids import GridSettings
from hilbertvae.mappers.hilbert_map import HilbertMap
from toy_rooms import tiny_grid, tiny_reconstructor


def test_weights_learned_by_another_version_are_named(room):
    made = reconstructor()
    made.map_weights["voxels"]["seen"].pop()
    with pytest.raises(InputError, match="checkpoint: the Hilbert Map's weights were learned by another version"):
        fit(HilbertMap(made), gapped(room))


def test_an_extent_that_no_map_can_have_is_named(room):
    outlier = np.vstack([room.fit.points, [[1e12, 1e12]]])
    with pytest.raises(InputError, match=r"points: extent \[.*\] m is too large for voxels of 0.1 m"):
        HilbertMap().fit(outlier, np.append(room.fit.occupied, True))


def test_a_name_is_no_network(room):
    with pytest.raises(InputError, match="reconstructor: expected a Reconstructor or None, got '2d'; load_mapper takes a name"):
        HilbertMap("2d").fit(room.fit.points, room.fit.occupied)


def test_a_map_without_anything_that_answers_is_refused(room):
    with pytest.raises(InputError, match="evidence: expected True without fill, where nothing else answers"):
        fit(HilbertMap(grid=tiny_grid(), fill=False, evidence=False), room.fit)


def test_masked_values_are_refused(room):
    """Behind their masks they would count as any other."""
    mapper, points, occupied = fit(HilbertMap(grid=tiny_grid()), room.fit), room.fit.points, room.fit.occupied
    for name, given in (
        ("points", (np.ma.masked_greater(points, 5.0), occupied)),
        ("y", (points, np.ma.masked_array(occupied, ~occupied))),
        ("sample_weight", (points, occupied, np.ma.masked_array(np.ones(len(points)), occupied))),
    ):
        for learn in (clone(mapper).fit, mapper.partial_fit):
            with pytest.raises(InputError, match=f"^{name}: expected no masked values, got [0-9]+"):
                learn(*given)
    with pytest.raises(InputError, match=r"^queries: expected no masked values, got"):
        mapper.predict_proba(np.ma.masked_greater(points, 5.0))
    mapper.predict_proba(np.ma.masked_array(points[:5]))  # of which none is masked


def test_answers_before_a_fit():
    with pytest.raises(NotFittedError):
        HilbertMap().predict_proba([[0.0, 0.0]])
    with pytest.raises(NotFittedError):
        clone(HilbertMap()).predict([[0.0, 0.0]])


def bad_clouds():
    rng = np.random.default_rng(0)
    points, occupied = rng.uniform(0, 3, (60, 2)), rng.random(60) < 0.5
    broken = points.copy()
    broken[7, 0] = np.nan
    return [
        ((points[:0], occupied[:0]), "0 sample"),
        ((broken, occupied), "NaN"),
        ((np.where(np.isnan(broken), np.inf, broken), occupied), "infinity"),
        ((points.ravel(), occupied), "2D array"),
        ((points, occupied[:-1]), "inconsistent"),
        ((points, np.ones(60, bool)), "one class only"),
        ((points, np.zeros(60, bool)), "one class only"),
        ((points, np.arange(60) % 3), "binary"),
        ((np.ones((60, 4)), occupied), "expected 2 or 3 coordinates, got 4"),
        ((np.column_stack([points, points[:, 0]]), occupied), "the network is for 2D, got 3D"),
        ((points, occupied, -np.ones(60)), "[Nn]egative"),
        ((points, occupied, np.zeros(60)), "positive weights|non-zero"),
    ]


@pytest.mark.parametrize(("cloud", "message"), bad_clouds())
def test_bad_clouds_are_named(cloud, message):
    with pytest.raises(InputError, match=message):
        HilbertMap(reconstructor()).fit(*cloud)


def test_points_with_a_gradient_are_refused_as_torch_says():
    points, occupied = torch.rand(60, 2, requires_grad=True), np.arange(60) % 2 == 0
    with pytest.raises(InputError, match=r"points, y, sample_weight: Can't call numpy"):
        HilbertMap(grid=tiny_grid()).fit(points, occupied)
    mapper = HilbertMap(grid=tiny_grid()).fit(points.detach(), occupied)
    for ask in (mapper.predict_proba, mapper.observed):
        with pytest.raises(InputError, match="queries: Can't call numpy"):
            ask(points)


def test_arrays_with_named_fields_are_refused():
    """As readers of ROS clouds and of PCD files give them."""
    points, occupied = np.random.default_rng(0).random((60, 2)), np.arange(60) % 2 == 0
    fields = np.zeros(60, [("x", "f4"), ("y", "f4")])
    with pytest.raises(InputError, match="points: expected plain numbers, got an array with the fields x, y; stack"):
        HilbertMap(grid=tiny_grid()).fit(fields, occupied)
    mapper = HilbertMap(grid=tiny_grid()).fit(points, occupied)
    for ask in (mapper.predict_proba, mapper.observed):
        with pytest.raises(InputError, match="queries: expected plain numbers, got an array with the fields x, y; stack"):
            ask(fields)


@pytest.mark.parametrize(
    ("queries", "message"),
    [([[0.0, np.nan]], "queries: .*NaN"), ([[0.0, 1.0, 2.0]], "queries: .*features"), ([0.0, 1.0], "queries: .*2D array")],
)
def test_bad_queries_are_named(room, queries, message):
    mapper = fit(HilbertMap(grid=tiny_grid()), gapped(room))
    for ask in (mapper.predict_proba, mapper.observed):
        with pytest.raises(InputError, match=message):
            ask(queries)
    assert mapper.predict_proba(np.empty((0, 2))).shape == (0, 2)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"weights": "best"}, "weights: expected unit, rank or cluster, got 'best'"),
        ({"calibration": "pixels"}, "calibration: expected voxels or points, got 'pixels'"),
        ({"neighbours": 3}, "neighbours: the weights were learned for 5, got 3"),
        ({"neighbours": 0, "weights": "unit"}, "neighbours: expected a whole number of at least 1, got 0"),
        ({"flips": 3}, "flips: expected 1, 2, 4 or 8, got 3"),
        ({"flips": 0}, "flips: expected 1, 2, 4 or 8, got 0"),
        ({"fill": "off"}, "fill: expected True or False, got 'off'"),
        ({"evidence": "no"}, "evidence: expected True or False, got 'no'"),
        ({"ridge": -1.0, "weights": "cluster"}, "ridge: expected a number from 0 on, got -1.0"),
        ({"ridge": 0.0, "weights": "cluster"}, "ridge: expected a positive number, got 0.0"),
        ({"grid": GridSettings(occupied_share=-3.0)}, "grid.occupied_share: expected a share"),
        ({"grid": GridSettings(interpolated="no")}, "grid.interpolated: expected true, false or one of voxels, points"),
        ({"ridge": "a"}, "ridge: expected a number from 0 on, got 'a'"),
        ({"resolution_m": -1}, "resolution_m: expected a positive number, got -1"),
        ({"resolution_m": "a"}, "resolution_m: expected a positive number, got 'a'"),
        ({"device": "gpu"}, "device: expected cpu, or cuda where there is one, got 'gpu'"),
        ({"device": None}, "device: expected cpu, or cuda where there is one, got None"),
        ({"device": "meta"}, "device: expected cpu, or cuda where there is one, got 'meta'"),
        ({"device": 0}, "device: expected cpu, or cuda where there is one, got 0"),
    ],
)
def test_bad_parameters_are_named(room, parameters, message):
    with pytest.raises(InputError, match=message):
        fit(HilbertMap(reconstructor(), **parameters), gapped(room))


class Stopped(KeyboardInterrupt):
    pass


@pytest.mark.parametrize("begin", ["fit", "partial_fit"])
def test_what_is_refused_or_stopped_leaves_the_map_as_it_was(room, monkeypatch, begin):
    fitted = fit(HilbertMap(reconstructor()), room.fit)
    queries = room.fit.points[::7]
    before = fitted.predict_proba(queries)
    with pytest.raises(InputError, match="2D"):
        fitted.fit(np.zeros((4, 3)) + np.arange(4)[:, None], [0, 1, 0, 1])
    np.testing.assert_array_equal(fitted.predict_proba(queries), before)

    def stop(*_):
        raise Stopped

    part = room.fit.select(slice(0, None, 2))
    fresh = HilbertMap(reconstructor())
    with monkeypatch.context() as patched:
        patched.setattr(HilbertMap, "_complete", stop)
        for mapper, method in ((fitted, "fit"), (fresh, begin)):
            with pytest.raises(Stopped):
                getattr(mapper, method)(part.points, part.occupied, part.weight)
    np.testing.assert_array_equal(fitted.predict_proba(queries), before)
    with pytest.raises(NotFittedError):
        fresh.predict_proba(queries)
    with pytest.raises(InputError, match="is there an outlier"):
        fresh.partial_fit([[0.0, 0.0], [1e12, 0.0]], [True, False])
    with pytest.raises(NotFittedError):
        fresh.predict_proba(queries)


@pytest.mark.parametrize("seed", [-1, 1.5, "x", None, True, np.random.RandomState(0)])
def test_a_seed_that_is_no_whole_number(room, seed):
    with pytest.raises(InputError, match="seed: expected a whole number of at least 0, got"):
        fit(HilbertMap(reconstructor(), seed=seed), gapped(room))


def test_a_grid_that_is_none(room):
    with pytest.raises(InputError, match="grid: expected GridSettings or None, got 3"):
        fit(HilbertMap(grid=3), gapped(room))


def test_a_grid_that_the_network_cannot_complete(room):
    made = tiny_reconstructor(bottom="flat", skips=False)
    for network, cells, expected in (
        (reconstructor(), 18, "a multiple of 4"),
        (made, 18, "a multiple of 4"),
        (made, 20, "16, as the network"),
    ):
        with pytest.raises(InputError, match=f"grid.cells: expected {expected}.*, got {cells}"):
            fit(HilbertMap(network, grid=tiny_grid(cells=cells)), gapped(room))
    assert fit(HilbertMap(reconstructor(), grid=tiny_grid(cells=20)), gapped(room)).grids_.shape[1:] == (20, 20)


@pytest.mark.parametrize("setting", ["evidence", "fill"])
def test_a_choice_that_is_none_is_named_in_a_map_that_grows_too(room, setting):
    cloud = gapped(room)
    mapper = fit(HilbertMap(reconstructor()), cloud).set_params(**{setting: "off"})
    with pytest.raises(InputError, match=f"{setting}: expected True or False, got 'off'"):
        mapper.partial_fit(cloud.points, cloud.occupied)


def test_features_are_of_a_fitted_map(room):
    with pytest.raises(NotFittedError):
        HilbertMap(reconstructor()).features(np.zeros((1, 2)))
    with pytest.raises(InputError, match="queries: .*NaN"):
        fit(HilbertMap(grid=tiny_grid()), gapped(room)).features([[0.0, np.nan]])


def test_labels_that_came_as_objects_are_what_they_are(room):
    """As a column of a data frame has them."""
    cloud, labels = gapped(room), gapped(room).occupied
    queries = cloud.points[:50]
    told = fit(HilbertMap(grid=tiny_grid()), cloud)
    for given in (labels.astype(object), np.array([np.bool_(label) for label in labels], dtype=object), list(map(bool, labels))):
        mapper = HilbertMap(grid=tiny_grid()).fit(cloud.points, given, cloud.weight)
        assert mapper.classes_.tolist() == [False, True] and mapper.classes_.dtype == bool
        np.testing.assert_array_equal(mapper.predict_proba(queries), told.predict_proba(queries))
    words = np.where(labels, "wall", "air").astype(object)
    with pytest.warns(UserWarning, match="'wall', the later of the two") as warned:
        assert HilbertMap(grid=tiny_grid()).fit(cloud.points, words, cloud.weight).classes_.tolist() == ["air", "wall"]
        HilbertMap(grid=tiny_grid()).partial_fit(cloud.points, words, cloud.weight)
        HilbertMap(grid=tiny_grid()).partial_fit(cloud.points, words, cloud.weight, classes=["air", "wall"])
    assert [warning.filename for warning in warned] == [__file__] * 3  # where it was called
    words[0] = 1
    with pytest.raises(InputError, match="y: expected labels of one kind, got int and str"):
        HilbertMap(grid=tiny_grid()).fit(cloud.points, words)
