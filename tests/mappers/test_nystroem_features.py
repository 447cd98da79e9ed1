import numpy as np
import pytest
from sklearn.kernel_approximation import Nystroem
from sklearn.metrics.pairwise import rbf_kernel

from hilbertvae.checks import InputError
from hilbertvae.mappers.nystroem_features import NystroemFeatures, NystroemMapper


def scikit_learns(points, components, gamma_per_m2, seed):
    return Nystroem(gamma=gamma_per_m2, n_components=components, random_state=seed).fit(points - points.mean(axis=0))


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("components", [40, 1000])
def test_all_points_as_landmarks_give_the_kernel_back(dimension, components):
    points = np.random.default_rng(0).uniform(0, 5, (40, dimension))
    features = NystroemFeatures(points, components, 4.0, seed=0)(points) @ np.eye(40)
    assert features.shape == (40, 40)
    np.testing.assert_allclose(features @ features.T, rbf_kernel(points, gamma=4.0), atol=1e-8)


def test_by_its_formula():
    rng = np.random.default_rng(1)
    points, queries, weights = rng.uniform(0, 5, (200, 2)), rng.uniform(-1, 6, (30, 2)), rng.normal(size=20)
    features = NystroemFeatures(points, 20, 2.0, seed=2)
    landmarks = features.landmarks + features.origin
    assert all(np.isclose(points, landmark).all(axis=1).any() for landmark in landmarks)
    values, vectors = np.linalg.eigh(rbf_kernel(landmarks, gamma=2.0))
    expected = rbf_kernel(queries, landmarks, gamma=2.0) @ vectors @ np.diag(values**-0.5) @ vectors.T
    np.testing.assert_allclose(features(queries) @ np.eye(20), expected, atol=1e-8)
    theirs = scikit_learns(points, 20, 2.0, seed=2).transform(queries - points.mean(axis=0))
    np.testing.assert_allclose(features(queries) @ np.eye(20), theirs, atol=1e-8)
    np.testing.assert_allclose(features.weighted_sum(queries, weights), expected @ weights, atol=1e-8)


def test_far_from_the_data_only_the_intercept_speaks():
    points = np.random.default_rng(2).uniform(0, 3, (300, 2))
    mapper = NystroemMapper(components=50).fit(points, points[:, 0] < 0.5)
    far = mapper.predict_proba([[50.0, 50.0], [-20.0, 7.0]])[:, 1]
    assert far[0] == far[1] == pytest.approx(1 / (1 + np.exp(-mapper.intercept_)))


def test_utm_coordinates_give_the_same_map():
    rng = np.random.default_rng(3)
    points, queries, offset = rng.uniform(0, 4, (400, 2)), rng.uniform(0, 4, (50, 2)), np.array([452_000.0, 5_411_000.0])
    here = NystroemMapper(components=30).fit(points, points[:, 0] < 1).predict_proba(queries)
    there = NystroemMapper(components=30).fit(points + offset, points[:, 0] < 1).predict_proba(queries + offset)
    np.testing.assert_allclose(there, here, atol=1e-4)


def test_another_seed_draws_other_landmarks():
    points = np.random.default_rng(4).uniform(0, 4, (500, 2))
    first, second = (NystroemMapper(components=20, seed=seed).fit(points, points[:, 0] < 1) for seed in (0, 1))
    assert not np.array_equal(first.features_.landmarks, second.features_.landmarks)


@pytest.mark.parametrize("setting", [{"components": 0}, {"components": True}, {"gamma_per_m2": -4.0}, {"epochs": 0}])
def test_bad_settings_are_refused(setting):
    with pytest.raises(InputError, match=f"{next(iter(setting))}: expected"):
        NystroemMapper(**setting).fit([[0.0, 0.0], [1.0, 0.0]], [False, True])


def test_landmarks_that_are_left_out_for_their_distance_change_nothing():
    rng = np.random.default_rng(5)
    points, queries, weights = rng.uniform(0, 40, (2000, 2)), rng.uniform(-5, 45, (300, 2)), rng.normal(size=400)
    features = NystroemFeatures(points, 400, 2.0, seed=0)
    assert features._kernel(queries).nnz < 0.1 * 300 * 400
    theirs = scikit_learns(points, 400, 2.0, seed=0).transform(queries - points.mean(axis=0))
    np.testing.assert_allclose(features.weighted_sum(queries, weights), theirs @ weights, atol=1e-9)
