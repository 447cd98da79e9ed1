import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.sparse import csr_array
from scipy.special import expit
from sklearn.linear_model import LogisticRegression

from hilbertvae.checks import InputError
from hilbertvae.mappers.fixed_grid import FixedGridMapper
from hilbertvae.mappers.lard import LardMapper
from hilbertvae.mappers.logistic import INTERCEPT_PACE, balanced_weight, fit_logistic

USUAL = {"penalty": 0.0, "l1_share": 0.15, "epochs": 10, "batch_size": 1024, "rate": 5.0, "seed": 0}


def fitted(features, occupied, weight, **changed):
    """`fit_logistic`, with usual settings but for those given."""
    return fit_logistic(features, occupied, weight, **(USUAL | changed))


def problem(count=400, columns=6, seed=0):
    """Sparse features, noisy labels and weights with one optimum."""
    rng = np.random.default_rng(seed)
    features = rng.random((count, columns)) * (rng.random((count, columns)) < 0.6)
    occupied = rng.random(count) < expit(features @ rng.normal(0, 2, columns) - 0.3)
    return features, occupied, rng.integers(1, 5, count).astype(float)


def loss(features, occupied, weight, weights, intercept, penalty, l1_share):
    """Eq. 15 in dense loops, without its misprint."""
    total = 0.0
    for row, hit, share in zip(features, occupied, weight / weight.sum(), strict=True):
        total += share * np.log1p(np.exp(-(1 if hit else -1) * (row @ weights + intercept)))
    return total + penalty * (l1_share * np.abs(weights).sum() + (1 - l1_share) / 2 * weights @ weights)


@pytest.mark.parametrize(("batch_size", "epochs"), [(16, 300), (1000, 5000)])
def test_reaches_the_optimum_without_a_regulariser(batch_size, epochs):
    features, occupied, weight = problem()
    weights, intercept = fitted(csr_array(features), occupied, weight, epochs=epochs, batch_size=batch_size)
    best = minimize(lambda v: loss(features, occupied, weight, v[:-1], v[-1], 0.0, 0.0), np.zeros(7), method="BFGS")
    assert loss(features, occupied, weight, weights, intercept, 0.0, 0.0) < best.fun + 2e-3
    np.testing.assert_allclose(weights, best.x[:-1], atol=0.4)


@pytest.mark.parametrize("l1_share", [0.0, 0.5, 1.0])
def test_reaches_the_optimum_of_the_elastic_net(l1_share):
    features, occupied, weight = problem()
    penalty = 0.02
    weights, intercept = fitted(csr_array(features), occupied, weight, penalty=penalty, l1_share=l1_share, epochs=300, batch_size=16)
    scaled = LogisticRegression(l1_ratio=l1_share, C=1 / (penalty * weight.sum()), solver="saga", max_iter=5000, tol=1e-8)
    if scaled.penalty == "l2":  # scikit-learn before 1.8, where l1_ratio alone says nothing
        scaled.set_params(penalty="elasticnet")
    scaled.fit(features, occupied, weight)
    reference = loss(features, occupied, weight, scaled.coef_[0], scaled.intercept_[0], penalty, l1_share)
    assert loss(features, occupied, weight, weights, intercept, penalty, l1_share) < reference + 2e-3
    np.testing.assert_allclose(weights, scaled.coef_[0], atol=0.15)


def step_by_step(features, occupied, weight, penalty, l1_share, epochs, batch_size, rate=5.0):
    """`fit_logistic`, written out."""
    random, count, weight = np.random.default_rng(0), len(occupied), weight / weight.mean()
    share = np.average(occupied, weights=weight)
    value, squared, kept = np.append(np.zeros(features.shape[1]), np.log(share / (1 - share))), np.zeros(features.shape[1] + 1), []
    for _ in range(epochs):
        order = random.permutation(count)
        for start in range(0, count, batch_size):
            rows = order[start : start + batch_size]
            wrong = weight[rows] * (expit(features[rows] @ value[:-1] + value[-1]) - occupied[rows]) / len(rows)
            gradient = np.append(features[rows].T @ wrong, wrong.sum())
            squared += gradient**2
            pace = rate / np.sqrt(np.maximum(squared, np.finfo(float).tiny))
            pace[-1] *= INTERCEPT_PACE
            value -= pace * gradient
            amount = pace[:-1] * penalty
            value[:-1] = np.sign(value[:-1]) * np.maximum(np.abs(value[:-1]) - amount * l1_share, 0) / (1 + amount * (1 - l1_share))
            kept.append(value.copy())
    mean = np.mean(kept[len(kept) // 2 :], axis=0)
    return mean[:-1], mean[-1]


@pytest.mark.parametrize(("penalty", "l1_share"), [(0.0, 0.0), (1e-6, 0.15), (1e-3, 0.15), (1e-2, 1.0), (1e-2, 0.0), (0.3, 0.5)])
@pytest.mark.parametrize("dense", [False, True])
def test_takes_the_steps_that_it_says(penalty, l1_share, dense):
    rng = np.random.default_rng(5)
    features = np.where(rng.random((300, 80)) < 0.03, rng.random((300, 80)), 0.0)
    occupied, weight = features @ rng.normal(0, 2, 80) + rng.normal(0, 0.3, 300) > 0, rng.integers(1, 5, 300).astype(float)
    how = {"penalty": penalty, "l1_share": l1_share, "epochs": 3, "batch_size": 10}
    weights, intercept = fitted(features if dense else csr_array(features), occupied, weight, **how)
    expected = step_by_step(features, occupied, weight, **how)
    np.testing.assert_allclose(weights, expected[0], rtol=1e-10, atol=1e-12)
    assert intercept == pytest.approx(expected[1], rel=1e-12)


def test_a_lasso_has_exact_zeros_and_an_untouched_column_stays_zero():
    features, occupied, weight = problem()
    features[:, 2] = 0
    weights, _ = fitted(csr_array(features), occupied, weight)
    assert weights[2] == 0.0
    weights, _ = fitted(csr_array(features), occupied, weight, penalty=1.0, l1_share=1.0)
    assert (weights == 0.0).all()


def test_without_features_the_answer_is_the_base_rate():
    _, occupied, weight = problem()
    weights, intercept = fitted(csr_array((400, 0)), occupied, weight)
    assert weights.shape == (0,)
    assert expit(intercept) == pytest.approx(np.average(occupied, weights=weight), abs=0.02)


def test_weights_count_relative_to_their_mean():
    features, occupied, weight = problem()
    first = fitted(csr_array(features), occupied, weight)[0]
    np.testing.assert_allclose(fitted(csr_array(features), occupied, weight * 1024)[0], first, rtol=1e-9)
    assert np.abs(fitted(csr_array(features), occupied, np.ones(400))[0] - first).max() > 0.01


def test_balanced_weight():
    weight, occupied = np.array([1.0, 4.0, 9.0, 16.0]), np.array([True, False, False, True])
    np.testing.assert_array_equal(balanced_weight(weight, occupied, 0.0, None), 1.0)
    np.testing.assert_array_equal(balanced_weight(weight, occupied, 0.5, None), [1, 2, 3, 4])
    np.testing.assert_allclose(balanced_weight(weight, occupied, 0.5, 0.4), [0.08, 0.24, 0.36, 0.32])


@pytest.mark.parametrize(
    "setting",
    [
        {"rate": 0.0},
        {"epochs": 0},
        {"epochs": 1.5},
        {"batch_size": 0},
        {"penalty": -1.0},
        {"l1_share": 2.0},
        {"occupied_share": 1.0},
        {"occupied_share": "x"},
        {"penalty": "x"},
        {"weight_power": -1.0},
    ],
)
def test_bad_settings_are_refused(setting):
    with pytest.raises(InputError, match=f"{next(iter(setting))}: expected"):
        FixedGridMapper(**setting).fit([[0.0, 0.0], [1.0, 0.0]], [False, True])


@pytest.mark.parametrize("mapper", [LardMapper(), FixedGridMapper(penalty=1e-3, l1_share=0.5, weight_power=0.3)], ids=["lard", "hm"])
def test_weights_are_those_of_the_descent_that_the_settings_describe(mapper):
    """LARD-HM has no regulariser (METHOD 6)."""
    rng = np.random.default_rng(0)
    points, weight = rng.uniform(0, 5, (400, 2)), rng.integers(1, 50, 400).astype(float)
    occupied, chosen = points[:, 0] < 1, mapper.get_params()
    mapper.fit(points, occupied, weight)
    how = {name: chosen.get(name, 0.0) for name in USUAL}
    balanced = balanced_weight(weight, occupied, chosen["weight_power"], chosen["occupied_share"])
    weights, intercept = fit_logistic(mapper.features_(points), occupied, balanced, **how)
    np.testing.assert_array_equal(mapper.weights_, weights)
    assert mapper.intercept_ == intercept
