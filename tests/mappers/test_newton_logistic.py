import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.sparse import csr_matrix
from sklearn.linear_model import LogisticRegression

from hilbertvae.checks import InputError
from hilbertvae.mappers.newton_logistic import logistic_weights


def problem(seed=0, count=300, features=4):
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(count, features))
    return x, x @ rng.normal(size=features) + rng.normal(0, 2, count) > 0.3


def nobody():
    return np.empty(0, int)


@pytest.mark.parametrize("ridge", [1e-3, 0.5, 20.0])
def test_without_bounds_it_is_scikit_learns_logistic_regression(ridge):
    x, y = problem()
    expected = LogisticRegression(C=1 / (2 * ridge), fit_intercept=False, tol=1e-10, max_iter=10_000).fit(x, y)
    np.testing.assert_allclose(logistic_weights(x, y, nobody(), ridge=ridge), expected.coef_[0], atol=2e-3)


@pytest.mark.parametrize("sparse", [False, True])
def test_the_optimum_by_another_road(sparse):
    """Bounds, offset and a ridge towards a point, against a derivative-free search started elsewhere."""
    x, y = problem(1, features=3)
    rng = np.random.default_rng(2)
    offset, towards, ridge = rng.normal(size=len(x)), np.array([1.0, -0.5, 2.0]), 4.0

    def loss(w):
        total = sum(np.log1p(np.exp(-(1 if label else -1) * (o + row @ w))) for row, label, o in zip(x, y, offset, strict=True))
        return total + ridge * ((w - towards) ** 2).sum()

    expected = minimize(loss, [2.0, 1.0, 1.0], method="Nelder-Mead", bounds=[(0, None), (None, None), (0, None)], tol=1e-10)
    found = logistic_weights(csr_matrix(x) if sparse else x, y, np.array([0, 2]), ridge, towards, offset)
    np.testing.assert_allclose(found, expected.x, atol=1e-3)


def test_a_ridge_may_be_any_quadratic_form():
    """Against a derivative-free search: here features 0 and 1 are held together, and the third is free."""
    x, y = problem(3, features=3)
    ridge = 30.0 * np.array([[0.5, -0.5, 0.0], [-0.5, 0.5, 0.0], [0.0, 0.0, 0.0]]) + 0.1 * np.eye(3)

    def loss(w):
        total = sum(np.log1p(np.exp(-(1 if label else -1) * (row @ w))) for row, label in zip(x, y, strict=True))
        return total + 15.0 * (w[0] - w[1]) ** 2 + 0.1 * (w**2).sum()

    expected = minimize(loss, [0.5, 0.5, 0.5], method="Nelder-Mead", tol=1e-10).x
    np.testing.assert_allclose(logistic_weights(x, y, nobody(), ridge=ridge), expected, atol=1e-3)


@pytest.mark.parametrize("sparse", [False, True])
def test_a_query_that_counts_for_three_is_there_three_times(sparse):
    x, y = problem()
    offset, counts = np.linspace(-1, 1, len(x)), np.where(y, 3, 1)
    found = logistic_weights(csr_matrix(x) if sparse else x, y, np.array([0, 2]), offset=offset, counts=counts)
    thrice = [np.repeat(each, counts, axis=0) for each in (x, y, offset)]
    np.testing.assert_allclose(found, logistic_weights(*thrice[:2], np.array([0, 2]), offset=thrice[2]), atol=1e-6)


@given(seed=st.integers(0, 10_000), likeness=st.floats(0, 0.999), scale=st.floats(0.01, 100), together=st.sampled_from([0.0, 0.5, 20.0]))
@example(seed=0, likeness=0.9921875, scale=2.0, together=0.0)  # a weight just above 0 stood in the way of all the others
@settings(max_examples=30)
def test_no_weight_could_move_for_the_better(seed, likeness, scale, together):
    """The conditions of an optimum, by a sum over queries, where features say nearly the same and differ in size."""
    rng = np.random.default_rng(seed)
    x, y = problem(seed, features=5)
    x = (likeness * x[:, :1] + (1 - likeness) * x) * np.array([1.0, scale, 1.0, 1.0, 1.0])
    bounded = rng.random(5) < 0.6
    ridge = 1e-3 * np.eye(5)
    ridge[:3, :3] += together * (np.eye(3) - 1 / 3)
    found = logistic_weights(x, y, np.flatnonzero(bounded), ridge=ridge if together else 1e-3)
    slope = sum(row * ((1 / (1 + np.exp(-row @ found))) - label) for row, label in zip(x, y, strict=True)) + 2 * ridge @ found
    free = ~bounded | (found > 0)
    assert (found[bounded] >= 0).all()
    assert (np.abs(slope[free]) < 1e-5 * len(x)).all() and (slope[~free] > -1e-5 * len(x)).all()


def test_weights_of_features_that_speak_against_stay_at_zero():
    x, y = problem()
    x[:, 1] = np.where(y, -1.0, 1.0)
    found = logistic_weights(x, y, np.array([1]))
    assert found[1] == 0
    assert logistic_weights(x, y, nobody())[1] < -1


@pytest.mark.parametrize("towards", [0.0, 1.0])
def test_a_strong_ridge_leads_to_its_aim(towards):
    x, y = problem()
    found = logistic_weights(x, y, nobody(), ridge=1e7, towards=np.full(4, towards))
    np.testing.assert_allclose(found, towards, atol=1e-3)


@pytest.mark.parametrize("broken", [np.nan, np.inf])
def test_features_that_are_not_finite_give_no_weights(broken):
    features = np.random.default_rng(0).normal(size=(20, 2))
    features[3, 1] = broken
    with pytest.raises(InputError, match="logistic weights: expected finite features"), np.errstate(invalid="ignore"):
        logistic_weights(features, features[:, 0] > 0, nonnegative=[])
