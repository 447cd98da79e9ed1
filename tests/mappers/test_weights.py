import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from sklearn.linear_model import LogisticRegression

import hilbertvae.mappers.weights as weights_module
from hilbertvae.checks import InputError
from hilbertvae.mappers.weights import (
    NAMES,
    RankWeights,
    disagreement,
    fit_rank_weights,
    seen_features,
    unit_weights,
)


def random_features(seed=0, count=60, ranks=3, kinds=4):
    rng = np.random.default_rng(seed)
    held = rng.integers(0, ranks + 1, count)
    values = np.where(np.arange(ranks) < held[:, None], rng.normal(size=(count, ranks)), 0.0).astype(np.float32)
    seen = rng.random(count) < 0.5
    return values, held, seen, rng.normal(size=(seen.sum(), kinds))


@pytest.mark.parametrize("spread", [0.0, -1.4])
@pytest.mark.parametrize("level", [True, False])
def test_the_logit_query_by_query(level, spread):
    values, held, seen, evidence = random_features()
    rng = np.random.default_rng(1)
    weights = RankWeights(rng.normal(size=4), rng.normal(size=6), rng.normal(size=4), level, beyond=np.array([-1.5, -2.5]), spread=spread)
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
            expected = expected * (3 / held[q] if level else 1) + weights.unseen[3] + spread * values[q][: held[q]].std()
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


@pytest.mark.parametrize("level", [True, False])
def test_what_boxes_would_say_alone_is_what_they_would_if_all_said_the_same(level):
    values, held, seen, evidence = random_features()
    rng = np.random.default_rng(1)
    weights = RankWeights(*(rng.normal(size=n) for n in (4, 6, 4)), level=level, spread=-0.7)
    found = weights.logits_alone(values, held, seen, evidence)
    for q, rank in np.argwhere(np.arange(3) < held[:, None]):
        same = np.where(np.arange(3) < held[:, None], values[q, rank], 0.0)
        # The spread of numbers that are all the same is 0, so its weight has no say.
        assert found[q, rank] == pytest.approx(weights.logit(same, held, seen, evidence)[q], abs=1e-6)


def test_a_logit_is_a_querys_own():
    values, held, seen, evidence = random_features(count=200)
    weights = RankWeights(*(np.random.default_rng(1).normal(size=n) for n in (4, 6, 4)), spread=-0.7)
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
    weights = RankWeights(np.array([1 / 3, 0.1, -0.2]), np.array([2e-17, 1e5]), np.array([0.1]), level=False, beyond=beyond, spread=-1 / 7)
    found = RankWeights.from_plain(json.loads(json.dumps(weights.plain())))
    np.testing.assert_array_equal(found.unseen, weights.unseen)
    np.testing.assert_array_equal(found.seen, weights.seen)
    assert (found.level, found.spread) == (False, -1 / 7)
    np.testing.assert_array_equal(found.beyond, weights.beyond)


@pytest.fixture
def ranks_apart(monkeypatch):
    """Without the ridge that holds the weights of ranks together."""
    monkeypatch.setattr(weights_module, "RANKS_ALIKE", 0.0)


@pytest.mark.parametrize("spread", [True, False])
def test_rank_weights_are_found_again(ranks_apart, spread):
    """Labels drawn from known weights: the fit comes close to them, kernel weights stay non-negative, and nothing else is used."""
    rng = np.random.default_rng(0)
    count, ranks = 20_000, 3
    held = rng.integers(1, ranks + 1, count)
    values = np.where(np.arange(ranks) < held[:, None], rng.normal(size=(count, ranks)), 0.0)
    seen = rng.random(count) < 0.5
    evidence = rng.normal(size=(seen.sum(), 2))
    true = RankWeights(np.array([1.2, 0.6, 0.0, -0.4]), np.array([1.5, -0.7, 0.5, 0.3]), np.zeros(4), spread=-0.8 * spread)
    occupied = rng.random(count) < 1 / (1 + np.exp(-true.logit(values, held, seen, evidence)))
    found = fit_rank_weights(values, held, seen, evidence, np.full(count, np.inf), occupied, spread=spread)
    assert found.beyond.tolist() == [0, 0]  # no query was beyond all boxes
    np.testing.assert_allclose(found.unseen, true.unseen, atol=0.15)
    np.testing.assert_allclose(found.seen, true.seen, atol=0.1)
    assert found.spread == pytest.approx(true.spread, abs=0.15 * spread)
    assert (found.unseen[:ranks] >= 0).all() and found.seen[0] >= 0 and found.seen[-2] >= 0


def test_the_weights_of_ranks_are_held_together(monkeypatch):
    """Boxes that say the same but for noise: their sum is what a fit without ridge has, and each counts for as much, near enough."""
    rng = np.random.default_rng(0)
    count, ranks = 3000, 3
    said = rng.normal(0, 3, (count, 1))
    values, held, seen = said + rng.normal(0, 0.1, (count, ranks)), np.full(count, ranks), np.arange(count) % 2 == 0
    occupied = rng.random(count) < 1 / (1 + np.exp(-(0.9 * said[:, 0] - 0.5)))
    asked = values, held, seen, np.zeros((count // 2, 1)), np.full(count, np.inf), occupied
    together = fit_rank_weights(*asked, spread=True)
    monkeypatch.setattr(weights_module, "RANKS_ALIKE", 0.0)
    apart = fit_rank_weights(*asked, spread=True)
    assert together.spread == pytest.approx(apart.spread, abs=0.1)  # it has no part in the ridge
    for name in ("unseen", "everywhere"):
        one, other = getattr(together, name), getattr(apart, name)
        assert one[:3].sum() == pytest.approx(other[:3].sum(), abs=0.02)
        assert np.ptp(one[:3]) < 0.05 < 0.2 < np.ptp(other[:3])


def test_weights_in_observed_voxels_stay_sober():
    """The optimum of Eq. 15 with a ridge per query, by another road: evidence that says nearly the same twice."""
    rng = np.random.default_rng(0)
    count = 3000
    evidence = rng.normal(size=(count // 2, 1)) + rng.normal(0, 0.01, (count // 2, 2))
    seen, held, values = np.arange(count) % 2 == 0, np.full(count, 2), rng.normal(size=(count, 2))
    occupied = rng.random(count) < 0.4
    occupied[seen] = rng.random(count // 2) < 1 / (1 + np.exp(-evidence[:, 0]))
    found = fit_rank_weights(values, held, seen, evidence, np.full(count, np.inf), occupied, 2.0).seen
    features = np.column_stack([evidence, values[seen].mean(axis=1), np.ones(count // 2)])
    counts = np.where(occupied[seen], 2.0, 1.0)
    sign = np.where(occupied[seen], 1.0, -1.0)

    def loss(w):
        return (counts * np.logaddexp(0, -sign * (features @ w))).sum() + 1e-5 * counts.sum() * (w**2).sum()

    expected = minimize(loss, [0.5, 0.5, 0.1, 0.0], method="L-BFGS-B", bounds=[(0, None), (None, None), (0, None), (None, None)])
    assert loss(found) <= expected.fun + 1e-6
    np.testing.assert_allclose(found[:2].sum(), expected.x[:2].sum(), atol=0.02)


def test_how_far_boxes_disagree_query_by_query():
    values, held, *_ = random_features(count=40, ranks=4)
    found = disagreement(values, held)
    for query, count in enumerate(held):
        assert found[query] == pytest.approx(values[query][:count].std() if count else 0.0, abs=1e-6)
    assert (found[held == 1] == 0).all()


def test_occupied_queries_may_count_for_more():
    """Twice the odds, so that the cut of 0.6 lies where 3 of 7 are occupied: with features that say nothing, the constants tell."""
    rng = np.random.default_rng(0)
    seen, occupied = np.arange(8000) % 2 == 0, rng.random(8000) < 0.3
    nothing = np.zeros((8000, 2)), np.full(8000, 2), seen, np.zeros((4000, 1)), np.full(8000, np.inf), occupied
    once, twice = fit_rank_weights(*nothing), fit_rank_weights(*nothing, 2.0)
    for name in ("unseen", "seen"):
        assert getattr(twice, name)[-1] - getattr(once, name)[-1] == pytest.approx(np.log(2), abs=1e-3)


def test_weights_of_grids_alone_are_fitted_on_every_query_in_a_box(ranks_apart):
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


@pytest.mark.parametrize("missing", ["unseen", "seen", "everywhere", "beyond", "level", "spread", "occupied_weight"])
def test_weights_of_another_version_are_named(missing):
    plain = unit_weights(3, 4).plain()
    del plain[missing]
    with pytest.raises(InputError, match="expected Hilbert Map's weights unseen, .*, beyond, level, spread, occupied_weight, got"):
        RankWeights.from_plain(plain)


def test_weights_that_nothing_reads_are_refused():
    with pytest.raises(InputError, match="got .*known; learned by another version"):
        RankWeights.from_plain(unit_weights(3, 4).plain() | {"known": [0.0, 0.0]})


@pytest.mark.parametrize("all_seen", [True, False])
def test_rank_weights_need_gaps_and_observed_voxels(all_seen):
    seen = np.full(5, all_seen)
    with pytest.raises(InputError, match="expected queries both in gaps and in observed voxels"):
        fit_rank_weights(np.ones((5, 2)), np.full(5, 2), seen, np.ones((5 * all_seen, 3)), np.full(5, np.inf), np.arange(5) < 2)


def test_seen_features_of_a_query_in_no_box():
    np.testing.assert_array_equal(seen_features(np.zeros((1, 3)), np.array([0]), np.array([[2.0, 5.0]])), [[2.0, 5.0, 0.0, 1.0]])


def test_what_an_occupied_point_counted_for_goes_with_the_weights():
    plain = unit_weights(3, 4).plain()
    assert RankWeights.from_plain(plain | {"occupied_weight": 1.0}).plain()["occupied_weight"] == 1.0


@pytest.mark.parametrize("alike", [0.0, 0.05])
def test_an_occupied_query_that_counts_for_two_is_there_twice(monkeypatch, alike):
    monkeypatch.setattr(weights_module, "RANKS_ALIKE", alike)
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
    assert (found.everywhere >= 0).all() and (alike or (found.everywhere[:3] == 0).any())  # noise: some would be negative if they could
