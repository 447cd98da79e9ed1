import numpy as np
import pytest

from hilbertvae.checks import InputError
from hilbertvae.mappers.fixed_grid import FixedGridMapper
from hilbertvae.mappers.grid_features import SMALLEST, GridFeatures, grid_nodes


@pytest.mark.parametrize("dimension", [1, 2, 3, 4])
@pytest.mark.parametrize(("spacing_m", "gamma_per_m2"), [(0.5, 4.0), (0.3, 16.0), (1.0, 0.7)])
def test_features_by_brute_force(dimension, spacing_m, gamma_per_m2):
    rng = np.random.default_rng(0)
    features = GridFeatures(rng.uniform(-2, 2, (40, dimension)), spacing_m, gamma_per_m2)
    queries = rng.uniform(-4, 4, (60, dimension))
    queries[0] = 100.0
    expected = np.zeros((60, len(features.centres)))
    for q, query in enumerate(queries):
        for m, centre in enumerate(features.centres):
            value = np.exp(-gamma_per_m2 * np.sum((query - centre) ** 2))
            expected[q, m] = value if value > SMALLEST else 0.0
    found = features(queries)
    np.testing.assert_allclose(found.toarray(), expected, rtol=1e-12)
    assert found.has_sorted_indices and found[[0]].nnz == 0


@pytest.mark.parametrize("dimension", [2, 3])
def test_centres_lie_on_the_grid_at_the_data_and_beside_it(dimension):
    points = np.random.default_rng(1).uniform(-3, 3, (20, dimension))
    expected = set()
    for point in points:
        node = np.round(point / 0.5).astype(int)
        for axis in range(dimension):
            for step in (-1, 0, 1):
                beside = node.copy()
                beside[axis] += step
                expected.add(tuple(beside.tolist()))
    centres = GridFeatures(points, 0.5, 4.0).centres
    assert len(centres) == len(expected)
    assert {tuple(node) for node in np.round(centres / 0.5).astype(int).tolist()} == expected
    np.testing.assert_array_equal(grid_nodes(points, 0.5) * 0.5, centres)


def test_with_more_axes_than_three_nodes_are_searched():
    rng = np.random.default_rng(4)
    points, queries = rng.uniform(-2, 2, (40, 4)), rng.uniform(-3, 3, (60, 4))
    searched = FixedGridMapper().fit(points, points[:, 0] > 0).features_
    stepped = GridFeatures(points, 0.5, 4.0)
    assert not isinstance(searched, GridFeatures)
    np.testing.assert_array_equal(searched.centres, stepped.centres)
    np.testing.assert_allclose(searched(queries).toarray(), stepped(queries).toarray(), rtol=1e-12)


def test_points_too_far_apart_are_refused():
    with pytest.raises(InputError, match="points: extent .* is too large for centres every 0.5 m; is there an outlier?"):
        FixedGridMapper().fit([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1e7, 1e7, 1e7]], [False, True, True])


def test_far_from_the_data_only_the_intercept_speaks():
    rng = np.random.default_rng(2)
    points = rng.uniform(0, 3, (500, 2))
    mapper = FixedGridMapper(occupied_share=0.3).fit(points, points[:, 0] < 0.5)
    far = mapper.predict_proba([[50.0, 50.0], [-20.0, 7.0]])[:, 1]
    assert far[0] == far[1] == pytest.approx(1 / (1 + np.exp(-mapper.intercept_)))


def test_utm_coordinates_give_the_same_map():
    rng = np.random.default_rng(3)
    points, queries, offset = rng.uniform(0, 4, (400, 2)), rng.uniform(0, 4, (50, 2)), np.array([452_000.0, 5_411_000.0])
    here = FixedGridMapper().fit(points, points[:, 0] < 1).predict_proba(queries)
    there = FixedGridMapper().fit(points + offset, points[:, 0] < 1).predict_proba(queries + offset)
    np.testing.assert_allclose(there, here, atol=1e-5)


@pytest.mark.parametrize("setting", [{"spacing_m": 0.0}, {"gamma_per_m2": -1.0}])
def test_bad_settings_are_refused(setting):
    with pytest.raises(InputError, match=f"{next(iter(setting))}: expected a positive number"):
        FixedGridMapper(**setting).fit([[0.0, 0.0], [1.0, 0.0]], [False, True])
