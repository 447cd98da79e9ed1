import numpy as np
import pytest

from hilbertvae.checks import InputError
from hilbertvae.clusters.quick_means import quick_means
from hilbertvae.mappers.lard import ClusterFeatures, LardMapper


def returns(dimension, count=150, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform(0, 5, (count, dimension)), rng.integers(1, 50, count).astype(float)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("outer_radius_m", [0.9, 4.0])
def test_features_by_brute_force(dimension, outer_radius_m):
    points, weight = returns(dimension, 500)
    clusters = quick_means(points, outer_radius_m, 0.5 * outer_radius_m, minimum_points=4)
    thickness_m = 0.05
    features = ClusterFeatures(points, weight, clusters, thickness_m)
    queries = np.random.default_rng(1).uniform(-1, 6, (80, dimension))

    means, covariances = [], []
    for m in range(len(clusters)):
        members = clusters.members[clusters.offsets[m] : clusters.offsets[m + 1]]
        means.append(np.average(points[members], axis=0, weights=weight[members]))
        covariances.append(np.cov(points[members].T, aweights=weight[members], ddof=0) + thickness_m**2 * np.eye(dimension))
    expected = np.zeros((80, len(clusters)))
    for q, query in enumerate(queries):
        for m in np.argsort([np.linalg.norm(query - mean) for mean in means])[:5]:
            away = query - means[m]
            expected[q, m] = np.exp(-away @ np.linalg.inv(5 * covariances[m]) @ away)
    assert len(np.unique(means, axis=0)) == len(clusters)  # no two tie, so the 5 nearest are certain
    np.testing.assert_allclose(features.means, means, atol=1e-12)
    np.testing.assert_allclose(features(queries).toarray(), expected, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("dimension", [2, 3])
def test_degenerate_clusters_have_a_thickness(dimension):
    wall = np.zeros((60, dimension))
    wall[:, 0] = np.linspace(0, 3, 60)
    points = np.concatenate([wall, np.full((1, dimension), 9.0), wall + [[0, 1, 0][:dimension]]])
    occupied = np.arange(len(points)) < 61
    mapper = LardMapper(minimum_points=0).fit(points, occupied)
    assert np.isfinite(mapper.features_.precisions).all()
    probability = mapper.predict_proba(points)[:, 1]
    assert probability[:60].min() > 0.6 and probability[61:].max() < 0.4


def test_without_any_cluster_the_intercept_answers():
    points, _ = returns(2, 20)
    mapper = LardMapper(minimum_points=1000, occupied_share=0.4).fit(points, np.arange(20) < 7)
    np.testing.assert_allclose(mapper.predict_proba(points)[:, 1], 0.4, atol=0.05)


def test_utm_coordinates_give_the_same_map():
    points, weight = returns(2, 400)
    queries, offset = returns(2, 50, seed=4)[0], np.array([452_000.0, 5_411_000.0])
    here = LardMapper().fit(points, points[:, 0] < 1, weight).predict_proba(queries)
    there = LardMapper().fit(points + offset, points[:, 0] < 1, weight).predict_proba(queries + offset)
    np.testing.assert_allclose(there, here, atol=1e-4)


@pytest.mark.parametrize("setting", [{"outer_radius_m": 0.0}, {"inner_radius_m": -1.0}, {"thickness_m": 0.0}])
def test_bad_settings_are_refused(setting):
    with pytest.raises(InputError, match=f"{next(iter(setting))}: expected"):
        LardMapper(**setting).fit([[0.0, 0.0], [1.0, 0.0]], [False, True])
