import numpy as np
import pytest
from scipy.stats import norm
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import Kernel, Matern

from hilbertvae.checks import InputError
from hilbertvae.mappers.gpom import KERNELS, GpomMapper, _thinned


def cloud(dimension, count=60, seed=0):
    rng = np.random.default_rng(seed)
    points = rng.uniform(0, 3, (count, dimension))
    return points, points[:, 0] < 0.7, rng.integers(1, 60, count).astype(float)


def neural_network_by_the_book(x, other, length_m):
    """Rasmussen & Williams, Eq. 4.29, one pair of points at a time."""
    u, v = np.append(1.0, x), np.append(1.0, other)
    sigma = np.diag(np.append(1.0, np.full(len(x), 1.0 / length_m**2)))
    return 2 / np.pi * np.arcsin(2 * u @ sigma @ v / np.sqrt((1 + 2 * u @ sigma @ u) * (1 + 2 * v @ sigma @ v)))


class NeuralNetwork(Kernel):
    """The same for scikit-learn, with its origin at a point."""

    def __init__(self, length_m, origin):
        self.length_m, self.origin = length_m, origin

    def __call__(self, first, second=None, eval_gradient=False):
        second = first if second is None else second
        return np.array([[neural_network_by_the_book(a - self.origin, b - self.origin, self.length_m) for b in second] for a in first])

    def diag(self, points):
        return np.array([neural_network_by_the_book(x - self.origin, x - self.origin, self.length_m) for x in points])

    def is_stationary(self):
        return False


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("kernel", list(KERNELS))
@pytest.mark.parametrize(("neighbours", "weight_power", "free_spacing_m"), [(17, 0.5, None), (100, 0.0, None), (12, 1.0, 0.5)])
def test_one_process_of_scikit_learn_for_each_query(dimension, kernel, neighbours, weight_power, free_spacing_m):
    points, occupied, weight = cloud(dimension)
    queries = np.concatenate([cloud(dimension, 4, seed=1)[0] * 1.5 - 0.5, points[:1]])
    mapper = GpomMapper(kernel, neighbours, 0.8, free_spacing_m, 0.2, weight_power, 1.7).fit(points, occupied, weight)

    if free_spacing_m is not None:
        free = _thinned(points[~occupied], weight[~occupied], free_spacing_m)
        points, weight = np.concatenate([points[occupied], free[0]]), np.concatenate([weight[occupied], free[1]])
        occupied = np.arange(len(points)) < occupied.sum()
    expected = []
    for query in queries:
        near = np.argsort(np.linalg.norm(points - query, axis=1))[:neighbours]
        twin = Matern(0.8, nu=1.5) if kernel == "matern" else NeuralNetwork(0.8, query)
        process = GaussianProcessRegressor(twin, alpha=0.2 / weight[near] ** weight_power, optimizer=None)
        mean, std = process.fit(points[near], np.where(occupied[near], 1.0, -1.0)).predict(query[None], return_std=True)
        expected.append(norm.cdf(1.7 * mean[0] / np.sqrt(1 + (1.7 * std[0]) ** 2)))
    np.testing.assert_allclose(mapper.predict_proba(queries)[:, 1], expected, atol=1e-9)


@pytest.mark.parametrize("dimension", [1, 2, 3])
@pytest.mark.parametrize("length_m", [0.1, 0.5, 20.0])
def test_neural_network_kernel_by_the_book(dimension, length_m):
    away = np.random.default_rng(2).normal(0, 1, (3, 9, dimension))
    away[0, 0] = 0.0
    found = KERNELS["neural-network"](away, length_m)
    for q in range(3):
        expected = [[neural_network_by_the_book(a, b, length_m) for b in away[q]] for a in away[q]]
        np.testing.assert_allclose(found[q], expected, atol=1e-7)  # the arcsine is steep at 1


@pytest.mark.parametrize("dimension", [2, 3])
def test_free_points_are_thinned_to_their_weighted_mean(dimension):
    points, _, weight = cloud(dimension)
    points -= 1.0  # cells on both sides of zero
    cells = {}
    for point, w in zip(points, weight, strict=True):
        cells.setdefault(tuple(np.floor(point / 0.4)), []).append((point, w))
    expected = {
        cell: (np.average([p for p, _ in some], axis=0, weights=[w for _, w in some]), sum(w for _, w in some))
        for cell, some in cells.items()
    }
    mean, total = _thinned(points, weight, 0.4)
    assert len(mean) == len(expected)
    for place, w in zip(mean, total, strict=True):
        wanted = expected[tuple(np.floor(place / 0.4))]
        np.testing.assert_allclose(place, wanted[0], atol=1e-12)
        assert w == wanted[1]


@pytest.mark.parametrize("kernel", list(KERNELS))
def test_far_from_every_point_it_does_not_know(kernel):
    mapper = GpomMapper(kernel).fit(*cloud(2))
    for far_m in (1e6, 1e12, 1e100):
        np.testing.assert_allclose(mapper.predict_proba(np.full((1, 2), far_m)), 0.5, atol=1e-4)


@pytest.mark.parametrize("kernel", list(KERNELS))
def test_utm_coordinates_give_the_same_map(kernel):
    points, occupied, weight = cloud(2)
    # The offset is of whole cells of 0.4 m, so that free points are thinned to the same places.
    queries, offset = cloud(2, 50, seed=3)[0], np.array([452_000.0, 5_411_000.0])
    here = GpomMapper(kernel).fit(points, occupied, weight).predict_proba(queries)
    there = GpomMapper(kernel).fit(points + offset, occupied, weight).predict_proba(queries + offset)
    np.testing.assert_allclose(there, here, atol=1e-6)


@pytest.mark.parametrize("kernel", list(KERNELS))
def test_points_at_one_place_are_no_singular_matrix(kernel):
    points, occupied = np.zeros((40, 2)), np.arange(40) < 25
    probability = GpomMapper(kernel, free_spacing_m=None, noise=1e-30).fit(points, occupied).predict_proba(points[:1])[0, 1]
    assert 0.5 < probability < 0.8  # their mean label is 0.25


def test_a_point_of_many_samples_outweighs_one_of_few():
    points, occupied = np.array([[0.0, 0.0], [0.0, 0.0]]), np.array([True, False])
    assert GpomMapper().fit(points, occupied, [9.0, 1.0]).predict_proba(points)[0, 1] > 0.55
    assert GpomMapper().fit(points, occupied, [1.0, 9.0]).predict_proba(points)[0, 1] < 0.45
    assert GpomMapper(weight_power=0.0).fit(points, occupied, [1.0, 9.0]).predict_proba(points)[0, 1] == pytest.approx(0.5)


def test_the_order_of_the_cloud_changes_nothing():
    rng = np.random.default_rng(4)
    points = rng.integers(0, 6, (200, 2)).astype(float)  # many are equally near
    occupied, weight, queries = rng.random(200) < 0.4, rng.integers(1, 9, 200).astype(float), rng.integers(0, 12, (60, 2)) / 2
    expected = GpomMapper(neighbours=9).fit(points, occupied, weight).predict_proba(queries)
    for _ in range(3):
        order = rng.permutation(200)
        found = GpomMapper(neighbours=9).fit(points[order], occupied[order], weight[order]).predict_proba(queries)
        np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize(
    "setting",
    [
        {"kernel": "rbf"},
        {"neighbours": 0},
        {"neighbours": 2.5},
        {"length_m": 0.0},
        {"free_spacing_m": -1.0},
        {"noise": 0.0},
        {"weight_power": -0.1},
        {"weight_power": True},
        {"weight_power": "much"},
        {"slope": np.nan},
    ],
)
def test_bad_settings_are_refused(setting):
    with pytest.raises(InputError, match=f"{next(iter(setting))}: expected"):
        GpomMapper(**setting).fit([[0.0, 0.0], [1.0, 0.0]], [False, True])
