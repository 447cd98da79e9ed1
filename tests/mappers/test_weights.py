import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.sparse import csr_matrix
from sklearn.linear_model import LogisticRegression

from hilbertvae.checks import InputError
from hilbertvae.mappers.weights import (
    NAMES,
    OCCUPIED_WEIGHT,
    RankWeights,
    fit_cluster_weights,
    fit_rank_weights,
    logistic_weights,
    seen_features,
    unit_weights,
)


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


@pytest.mark.parametrize("sparse", [False, True])
def test_a_query_that_counts_for_three_is_there_three_times(sparse):
    x, y = problem()
    offset, counts = np.linspace(-1, 1, len(x)), np.where(y, 3, 1)
    found = logistic_weights(csr_matrix(x) if sparse else x, y, np.array([0, 2]), offset=offset, counts=counts)
    thrice = [np.repeat(each, counts, axis=0) for each in (x, y, offset)]
    np.testing.assert_allclose(found, logistic_weights(*thrice[:2], np.array([0, 2]), offset=thrice[2]), atol=1e-6)


@given(seed=st.integers(0, 10_000), likeness=st.floats(0, 0.999), scale=st.floats(0.01, 100))
@example(seed=0, likeness=0.9921875, scale=2.0)  # a weight just above 0 stood in the way of all the others
@settings(max_examples=30)
def test_no_weight_could_move_for_the_better(seed, likeness, scale):
    """The conditions of an optimum, by a sum over queries, where features say nearly the same and differ in size."""
    rng = np.random.default_rng(seed)
    x, y = problem(seed, features=5)
    x = (likeness * x[:, :1] + (1 - likeness) * x) * np.array([1.0, scale, 1.0, 1.0, 1.0])
    bounded = rng.random(5) < 0.6
    found = logistic_weights(x, y, np.flatnonzero(bounded))
    slope = sum(row * ((1 / (1 + np.exp(-row @ found))) - label) for row, label in zip(x, y, strict=True)) + 2e-3 * found
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


def random_features(seed=0, count=60, ranks=3, kinds=4):
    rng = np.random.default_rng(seed)
    held = rng.integers(0, ranks + 1, count)
    values = np.where(np.arange(ranks) < held[:, None], rng.normal(size=(count, ranks)), 0.0).astype(np.float32)
    seen = rng.random(count) < 0.5
    return values, held, seen, rng.normal(size=(seen.sum(), kinds))


@pytest.mark.parametrize("level", [True, False])
def test_the_logit_query_by_query(level):
    values, held, seen, evidence = random_features()
    rng = np.random.default_rng(1)
    weights = RankWeights(rng.normal(size=4), rng.normal(size=6), rng.normal(size=4), level, beyond=np.array([-1.5, -2.5]))
    away = np.where(rng.random(len(values)) < 0.5, rng.uniform(0, 2.5, len(values)), np.inf)
    found = weights.logit(values, held, seen, evidence, away)
    row = 0
    for q in range(len(values)):
        if seen[q]:
            mean = values[q].sum() / max(held[q], 1)
            expected = sum(w * x for w, x in zip(weights.seen, [*evidence[row], mean, 1.0], strict=True))
            row += 1
        elif held[q]:
            expected = sum(w * k for w, k in zip(weights.unseen[:3], values[q], strict=True))
            expected = expected * (3 / held[q] if level else 1) + weights.unseen[3]
        else:
            expected = -1.5 * away[q] - 2.5 if np.isfinite(away[q]) else 0.0  # nothing is known: p = 0.5
            assert weights.logit(values, held, seen, evidence)[q] == 0
        assert found[q] == pytest.approx(expected, abs=1e-5)


def test_one_box_speaks_as_loudly_as_all_that_say_the_same():
    weights = RankWeights(np.array([1 / 3, 1 / 3, 1 / 3, -0.4]), np.zeros(6), np.array([1.0, 1.0, 1.0, 0.0]))
    held = np.array([1, 2, 3])
    values = np.where(np.arange(3) < held[:, None], 1.7, 0.0)
    nothing = np.zeros(3, bool), np.empty((0, 4))
    np.testing.assert_allclose(weights.logit(values, held, *nothing), 1.7 - 0.4, atol=1e-12)
    # The paper's plain sum is the quieter the fewer hold the query.
    np.testing.assert_allclose(weights.grids_alone().logit(values, held, *nothing), 1.7 * held, atol=1e-12)


def test_a_logit_is_a_querys_own():
    values, held, seen, evidence = random_features(count=200)
    weights = RankWeights(*(np.random.default_rng(1).normal(size=n) for n in (4, 6, 4)))
    whole = weights.logit(values, held, seen, evidence)
    row = np.cumsum(seen) - 1
    for q in range(len(values)):
        alone = slice(q, q + 1)
        one = weights.logit(values[alone], held[alone], seen[alone], evidence[row[q] : row[q] + seen[q]])
        np.testing.assert_array_equal(one, whole[alone])


def test_unit_weights_sum_kernel_values_and_add_the_log_odds():
    values, held, seen, evidence = random_features()
    found = unit_weights(3, 4).logit(values, held, seen, evidence)
    unseen = ~seen
    np.testing.assert_allclose(found[unseen], values[unseen].sum(axis=1), atol=1e-6)
    mean = values[seen].sum(axis=1) / np.maximum(held[seen], 1)
    np.testing.assert_allclose(found[seen], evidence[:, 0] + mean, atol=1e-6)


def test_plain_and_back_through_json():
    beyond = np.array([-1 / 3, 1e-9])
    weights = RankWeights(np.array([1 / 3, 0.1, -0.2]), np.array([2e-17, 1e5]), np.array([0.1]), level=False, beyond=beyond)
    found = RankWeights.from_plain(json.loads(json.dumps(weights.plain())))
    np.testing.assert_array_equal(found.unseen, weights.unseen)
    np.testing.assert_array_equal(found.seen, weights.seen)
    assert found.level is False
    np.testing.assert_array_equal(found.beyond, weights.beyond)


def test_weights_learned_before_there_was_one_beyond_all_boxes():
    plain = unit_weights(3, 4).plain()
    del plain["beyond"]
    assert RankWeights.from_plain(plain).beyond.tolist() == [0.0, 0.0]


def test_rank_weights_are_found_again():
    """Labels drawn from known weights: the fit comes close to them, kernel weights stay non-negative, and nothing else is used."""
    rng = np.random.default_rng(0)
    count, ranks = 20_000, 3
    held = rng.integers(1, ranks + 1, count)
    values = np.where(np.arange(ranks) < held[:, None], rng.normal(size=(count, ranks)), 0.0)
    seen = rng.random(count) < 0.5
    evidence = rng.normal(size=(seen.sum(), 2))
    true = RankWeights(np.array([1.2, 0.6, 0.0, -0.4]), np.array([1.5, -0.7, 0.5, 0.3]), np.zeros(4))
    occupied = rng.random(count) < 1 / (1 + np.exp(-true.logit(values, held, seen, evidence)))
    found = fit_rank_weights(values, held, seen, evidence, np.full(count, np.inf), occupied)
    assert found.beyond.tolist() == [0, 0]  # no query was beyond all boxes
    np.testing.assert_allclose(found.unseen, true.unseen, atol=0.15)
    np.testing.assert_allclose(found.seen, true.seen, atol=0.1)
    assert (found.unseen[:ranks] >= 0).all() and found.seen[0] >= 0 and found.seen[-2] >= 0


def test_occupied_queries_may_count_for_more():
    """Twice the odds, so that the cut of 0.6 lies where 3 of 7 are occupied: with features that say nothing, the constants tell."""
    rng = np.random.default_rng(0)
    seen, occupied = np.arange(8000) % 2 == 0, rng.random(8000) < 0.3
    nothing = np.zeros((8000, 2)), np.full(8000, 2), seen, np.zeros((4000, 1)), np.full(8000, np.inf), occupied
    once, twice = fit_rank_weights(*nothing), fit_rank_weights(*nothing, 2.0)
    for name in ("unseen", "seen"):
        assert getattr(twice, name)[-1] - getattr(once, name)[-1] == pytest.approx(np.log(2), abs=1e-3)


def test_weights_of_grids_alone_are_fitted_on_every_query_in_a_box():
    """Observed or not: a map without evidence has nothing else to answer with. Those in no box teach what is beyond."""
    rng = np.random.default_rng(0)
    count, ranks = 20_000, 3
    held = np.where(rng.random(count) < 0.2, 0, ranks)
    values = np.where(held[:, None] > 0, rng.normal(size=(count, ranks)), 0.0)
    seen = rng.random(count) < 0.5
    in_gaps, observed = np.array([1.0, 0.5, 0.2, 0.3]), np.array([2.0, 1.0, 0.4, -0.5])
    logit = np.where(seen, values @ observed[:3] + observed[3], values @ in_gaps[:3] + in_gaps[3])
    occupied = np.where(held > 0, rng.random(count) < 1 / (1 + np.exp(-logit)), True)
    away = np.where(rng.random(count) < 0.5, rng.uniform(0, 2.5, count), np.inf)
    alone = ~seen & (held == 0) & np.isfinite(away)
    occupied = np.where(alone, rng.random(count) < 1 / (1 + np.exp(1.0 + np.where(alone, away, 0.0))), occupied)
    found = fit_rank_weights(values, held, seen, np.zeros((seen.sum(), 2)), away, occupied)
    np.testing.assert_allclose(found.beyond, [-1, -1], atol=0.4)
    inside = held > 0
    expected = LogisticRegression(C=np.inf, fit_intercept=False, tol=1e-10).fit(values[inside], occupied[inside])
    np.testing.assert_allclose(found.everywhere[:-1], expected.coef_[0], atol=5e-3)
    assert found.everywhere[-1] == 0  # grids that know nothing answer 0, and p must be 0.5 there
    np.testing.assert_allclose(found.unseen, in_gaps, atol=0.12)
    np.testing.assert_array_equal(found.grids_alone().unseen, found.everywhere)
    assert replace(found, occupied_weight=7.0).grids_alone().occupied_weight == 7.0


@pytest.mark.parametrize("missing", ["unseen", "seen", "everywhere", "level"])
def test_weights_of_another_version_are_named(missing):
    plain = unit_weights(3, 4).plain()
    del plain[missing]
    with pytest.raises(InputError, match="expected Hilbert Map's weights unseen, seen, everywhere, beyond, level, got"):
        RankWeights.from_plain(plain)


def test_weights_that_nothing_reads_are_refused():
    with pytest.raises(InputError, match="got .*known; learned by another version"):
        RankWeights.from_plain(unit_weights(3, 4).plain() | {"known": [0.0, 0.0]})


@pytest.mark.parametrize("all_seen", [True, False])
def test_rank_weights_need_gaps_and_observed_voxels(all_seen):
    seen = np.full(5, all_seen)
    with pytest.raises(InputError, match="expected queries both in gaps and in observed voxels"):
        fit_rank_weights(np.ones((5, 2)), np.full(5, 2), seen, np.ones((5 * all_seen, 3)), np.full(5, np.inf), np.arange(5) < 2)


def test_cluster_weights_by_an_explicit_sum():
    """Each query's logit is put together cluster by cluster, and the same optimum is searched."""
    rng = np.random.default_rng(0)
    clusters, ranks, count, ridge = 3, 2, 80, 5.0
    holding = np.array([rng.permutation(clusters)[:ranks] for _ in range(count)])
    holding[rng.random(count) < 0.2, 1] = -1
    values, offset, rank_weights = rng.normal(size=(count, ranks)), rng.normal(size=count), np.array([0.8, 0.4])
    occupied = rng.random(count) < 0.5

    def loss(factor):
        total = ridge * ((factor - 1) ** 2).sum()
        for q in range(count):
            logit = offset[q] + sum(rank_weights[r] * factor[m] * values[q, r] for r, m in enumerate(holding[q]) if m >= 0)
            total += np.log1p(np.exp(-logit if occupied[q] else logit))
        return total

    expected = minimize(loss, np.ones(clusters), method="L-BFGS-B", bounds=[(0, None)] * clusters)
    found = fit_cluster_weights(values, holding, offset, rank_weights, occupied, clusters, ridge)
    np.testing.assert_allclose(found, expected.x, atol=1e-3)


def test_seen_features_of_a_query_in_no_box():
    np.testing.assert_array_equal(seen_features(np.zeros((1, 3)), np.array([0]), np.array([[2.0, 5.0]])), [[2.0, 5.0, 0.0, 1.0]])


def test_what_an_occupied_point_counted_for_goes_with_the_weights():
    plain = unit_weights(3, 4).plain()
    assert RankWeights.from_plain(plain | {"occupied_weight": 1.0}).plain()["occupied_weight"] == 1.0
    del plain["occupied_weight"]  # as those that were learned before it was kept
    assert RankWeights.from_plain(plain).occupied_weight == OCCUPIED_WEIGHT


def test_an_occupied_query_that_counts_for_two_is_there_twice():
    rng = np.random.default_rng(0)
    held = rng.integers(0, 4, 600)
    values = np.where(np.arange(3) < held[:, None], rng.normal(size=(600, 3)), 0.0)
    seen, occupied = rng.random(600) < 0.5, rng.random(600) < 0.4
    evidence, away = rng.normal(size=(600, 2)), np.where(rng.random(600) < 0.5, rng.uniform(0, 2.5, 600), np.inf)
    twice = np.repeat(np.arange(600), np.where(occupied, 2, 1))
    found = fit_rank_weights(values, held, seen, evidence[seen], away, occupied, 2.0)
    other = fit_rank_weights(values[twice], held[twice], seen[twice], evidence[twice][seen[twice]], away[twice], occupied[twice])
    for name in NAMES:
        np.testing.assert_allclose(getattr(found, name), getattr(other, name), rtol=0, atol=1e-5)
    assert (found.everywhere >= 0).all() and (found.everywhere[:3] == 0).any()  # noise: some would be negative if they could
