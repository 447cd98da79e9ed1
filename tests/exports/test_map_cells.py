import tracemalloc

import numpy as np
import pytest
from export_toys import by_index, random_cells
from hypothesis import given, settings
from hypothesis import strategies as st

from hilbertvae.checks import InputError
from hilbertvae.exports import map_cells
from hilbertvae.exports.map_cells import MapCells
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.mapper import Mapper
from hilbertvae.mappers.nearest import NearestMapper
from hilbertvae.mappers.octomap_mapper import OctoMapMapper
from toy_rooms import tiny_reconstructor


class Waves(Mapper):
    """A mapper by formula: unknown in every other half metre along x, all of it observed where y < 0."""

    def __init__(self):
        self.asked = []

    def predict_map(self, queries):
        self.asked.append(len(queries))
        return np.where(np.floor(queries[:, 0] * 2) % 2 == 0, 0.51, 0.5 + 0.5 * np.sin(queries.sum(axis=1)))

    def predict_std(self, queries):
        return 0.1 + 0.05 * np.cos(queries[:, 1])

    def observed(self, queries):
        return queries[:, 1] < 0


@settings(max_examples=15)
@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 3]), st.integers(1, 5), st.sampled_from([5, 10**6]))
def test_the_sample_is_that_of_a_loop_over_voxels(seed, dimension, reach, at_once):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1, 1, (4, dimension)) + rng.choice([0.0, 6.4, 25.6], dimension)
    mapper, told = Waves(), []
    patch = pytest.MonkeyPatch()
    with patch.context() as context:
        context.setattr(map_cells, "QUERIES_AT_ONCE", at_once)
        cells = MapCells.sample(mapper, points, 0.2, reach * 0.2, lambda done, of: told.append((done, of)))
    steps = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * dimension), axis=-1).reshape(-1, dimension)
    voxels = {tuple(index) for voxel in np.floor(points / 0.2).astype(int) for index in (voxel + steps).tolist()}
    expected = {}
    for voxel in voxels:
        centre = (np.array([voxel]) + 0.5) * 0.2
        p, seen = Waves().predict_map(centre)[0], bool(centre[0, 1] < 0)
        if seen or abs(p - 0.5) > 0.02:
            expected[voxel] = np.float32(p), np.float32(0.1 + 0.05 * np.cos(centre[0, 1])), seen
    found = by_index(cells)
    assert found.keys() == expected.keys() and sum(mapper.asked) == len(voxels)
    for voxel, (p, std, seen) in expected.items():
        assert found[voxel] == (pytest.approx(p, abs=1e-6), pytest.approx(std, abs=1e-6), seen)
    assert told == sorted(told) and all(0 < done <= of for done, of in told)


def test_mappers_that_tell_less(place):
    fit, cell_m = place.fit, {2: 0.1, 3: 0.2}[place.dimension]
    octomap = OctoMapMapper().fit(fit.points, fit.occupied, fit.weight)
    cells = MapCells.sample(octomap, fit.points, cell_m)
    assert np.isnan(cells.std).all() and cells.observed.all()
    assert cells.occupied.any() and cells.free.any() and not (cells.occupied & cells.free).any()
    np.testing.assert_array_equal(octomap.predict_proba(cells.centres)[:, 1].astype(np.float32), cells.probability)
    nearest = MapCells.sample(NearestMapper().fit(fit.points, fit.occupied), fit.points, cell_m, 0.4)
    seen = {tuple(index) for index in np.floor(fit.points / cell_m).astype(int).tolist()}
    assert {index for index, (_, _, observed) in by_index(nearest).items() if observed} == seen
    assert not nearest.observed.all()


def test_a_hilbert_map_is_asked_for_all_it_knows(place):
    fit, cell_m = place.fit, {2: 0.1, 3: 0.2}[place.dimension]
    mapper = HilbertMap(tiny_reconstructor(place.dimension)).fit(fit.points, fit.occupied, fit.weight)
    cells = MapCells.sample(mapper, fit.points, cell_m)
    np.testing.assert_array_equal(cells.observed, mapper.observed(cells.centres))
    np.testing.assert_allclose(cells.probability, mapper.predict_map(cells.centres), atol=1e-6)
    np.testing.assert_allclose(cells.std, mapper.predict_std(cells.centres), atol=1e-6)
    assert cells.observed.sum() == len(np.unique(np.floor(fit.points / cell_m), axis=0))


@pytest.mark.parametrize("at_once", [5, 10**6])
def test_without_a_reach_the_points_voxels_alone_are_asked(place, at_once, monkeypatch):
    """A map without grids knows no others, so that the cells are those of a wide reach, in their order."""
    fit, cell_m = place.fit, {2: 0.1, 3: 0.2}[place.dimension]
    mapper = HilbertMap(tiny_reconstructor(place.dimension), fill=False).fit(fit.points, fit.occupied, fit.weight)
    wide = MapCells.sample(mapper, fit.points, cell_m)
    monkeypatch.setattr(map_cells, "QUERIES_AT_ONCE", at_once)
    alone = MapCells.sample(mapper, fit.points, cell_m, None)
    for name in ("index", "probability", "std", "observed"):
        np.testing.assert_array_equal(getattr(alone, name), getattr(wide, name))
    waves = Waves()
    MapCells.sample(waves, fit.points, cell_m, None)
    assert sum(waves.asked) == len(alone) == len(np.unique(np.floor(fit.points / cell_m), axis=0))


def test_memory_follows_the_cells_that_are_kept(monkeypatch):
    class Silent(Mapper):
        asked = 0

        def predict_map(self, queries):
            self.asked += len(queries)
            return np.where((np.floor(queries) == 0).all(axis=1), 1.0, 0.5)

    monkeypatch.setattr(map_cells, "QUERIES_AT_ONCE", 50_000)
    points, mapper = np.random.default_rng(0).uniform(-50, 50, (600, 3)), Silent()
    tracemalloc.start()
    cells = MapCells.sample(mapper, points, 0.2)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert mapper.asked > 2_000_000 and len(cells) < 2_000
    assert most < 60e6  # what was asked would be 66 MB as a list of cells, 16 GB as one array


def test_a_map_that_says_nothing_is_empty(tmp_path):
    class Unknown(Mapper):
        def predict_map(self, queries):
            return np.full(len(queries), 0.5)

        def observed(self, queries):
            return np.zeros(len(queries), bool)

    cells = MapCells.sample(Unknown(), np.zeros((1, 2)), 0.1)
    assert len(cells) == 0 and cells.dimension == 2 and cells.centres.shape == (0, 2)
    with pytest.raises(InputError, match="a map that says nothing"):
        cells.box()


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_dense_array_has_each_cell_in_its_place(dimension):
    cells = random_cells(dimension, offset_m=-3.0)
    low, shape = cells.box()
    array = cells.dense(cells.probability, -1.0)
    assert array.shape == shape and array.dtype == np.float32
    for index, p in zip(cells.index, cells.probability, strict=True):
        assert array[tuple(index - low)] == p
    assert np.count_nonzero(array == -1) == array.size - len(cells)


def test_cuts_are_the_houses():
    cells = MapCells(np.arange(14).reshape(7, 2), 0.1, np.array([0, 0.4, 0.41, 0.5, 0.6, 0.61, 1]), np.zeros(7), np.ones(7, bool))
    assert cells.occupied.tolist() == [False] * 5 + [True] * 2 and cells.free.tolist() == [True] * 2 + [False] * 5


def test_an_outlier_does_not_take_the_memory():
    cells = MapCells(np.array([[0, 0], [10**9, 10**9]]), 0.1, np.ones(2), np.ones(2), np.ones(2, bool))
    with pytest.raises(InputError, match="at most .* got 1000000001 x 1000000001 of 0.1 m"):
        cells.dense(cells.observed, False)


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"index": np.zeros((2, 4), int)}, "index"),
        ({"index": np.zeros((2, 2))}, "index"),
        ({"resolution_m": 0.0}, "resolution_m"),
        ({"probability": np.array([0.5, 1.5])}, "probability"),
        ({"probability": np.array([0.5, np.nan])}, "probability"),
        ({"probability": np.zeros(3)}, "probability"),
        ({"std": np.zeros((2, 1))}, "std"),
        ({"std": np.array(["a", "b"])}, "std"),
        ({"observed": np.zeros(2)}, "observed"),
    ],
)
def test_bad_cells_are_refused(changed, named):
    good = {"index": np.zeros((2, 2), int), "resolution_m": 0.1, "probability": np.zeros(2), "std": np.zeros(2)}
    good["observed"] = np.ones(2, bool)
    with pytest.raises(InputError, match=named):
        MapCells(**{**good, **changed})


@pytest.mark.parametrize(("points", "reach_m", "named"), [(np.zeros((2, 4)), 1.5, "points"), (np.zeros((0, 2)), 1.5, "points"),
                                                          (np.zeros((1, 3)), 26.0, "reach_m")])  # fmt: skip
def test_bad_requests_are_named(points, reach_m, named):
    with pytest.raises(InputError, match=named):
        MapCells.sample(Waves(), points, 0.2, reach_m)


def test_an_answer_of_another_shape_is_refused():
    mapper = Waves()
    mapper.predict_map = lambda queries: np.zeros((len(queries), 2))
    with pytest.raises(InputError, match="one per query"):
        MapCells.sample(mapper, np.zeros((1, 2)), 0.1)
