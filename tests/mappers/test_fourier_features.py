import numpy as np
import pytest
from sklearn.kernel_approximation import RBFSampler
from sklearn.metrics.pairwise import rbf_kernel

from hilbertvae.checks import InputError
from hilbertvae.mappers.fourier_features import FourierFeatures, FourierMapper


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("gamma_per_m2", [0.5, 4.0])
def test_inner_products_approach_the_kernel(dimension, gamma_per_m2):
    points = np.random.default_rng(0).uniform(0, 2, (60, dimension))
    worst = []
    for components in (100, 10_000):
        features = FourierFeatures(points.mean(axis=0), components, gamma_per_m2, seed=1)(points).astype(float)
        worst.append(np.abs(features @ features.T - rbf_kernel(points, gamma=gamma_per_m2)).max())
    assert worst[1] < 0.06 < worst[0]  # the error falls as one over the root of the count


def test_they_are_scikit_learns():
    points = np.random.default_rng(1).normal(30, 20, (50, 2))
    origin = points.mean(axis=0)
    expected = RBFSampler(gamma=4.0, n_components=64, random_state=3).fit(points).transform(points - origin)
    features = FourierFeatures(origin, 64, 4.0, seed=3)
    np.testing.assert_allclose(features(points), expected, atol=1e-4)
    assert features(points).dtype == np.float32 and features(points[:0]).shape == (0, 64)
    weights = np.random.default_rng(2).normal(size=64)
    np.testing.assert_allclose(features.weighted_sum(points, weights), expected @ weights, atol=1e-3)


def test_utm_coordinates_give_the_same_map():
    rng = np.random.default_rng(3)
    points, queries, offset = rng.uniform(0, 4, (400, 2)), rng.uniform(0, 4, (50, 2)), np.array([452_000.0, 5_411_000.0])
    here = FourierMapper(components=200).fit(points, points[:, 0] < 1).predict_proba(queries)
    there = FourierMapper(components=200).fit(points + offset, points[:, 0] < 1).predict_proba(queries + offset)
    np.testing.assert_allclose(there, here, atol=1e-3)


def test_another_seed_draws_other_waves():
    points = np.random.default_rng(4).uniform(0, 4, (100, 2))
    first, second = (FourierMapper(components=50, seed=seed).fit(points, points[:, 0] < 1) for seed in (0, 1))
    assert not np.isin(first.features_.waves, second.features_.waves).any()


@pytest.mark.parametrize("setting", [{"components": 0}, {"components": 2.5}, {"gamma_per_m2": 0.0}, {"rate": -1.0}, {"l1_share": 2.0}])
def test_bad_settings_are_refused(setting):
    with pytest.raises(InputError, match=f"{next(iter(setting))}: expected"):
        FourierMapper(**setting).fit([[0.0, 0.0], [1.0, 0.0]], [False, True])
