import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn import metrics as reference

from hilbertvae.scoring.metrics import ERROR_METRICS, ERRORS, METRICS, calibration_error, error_ranking, precision_recall_curve, score


def answers(seed, count, levels):
    """Labels of both kinds, and probabilities; few levels make many ties."""
    rng = np.random.default_rng(seed)
    occupied = rng.random(count) < 0.4
    occupied[:2] = [True, False]
    probability = np.clip(rng.normal(0.35 + 0.3 * occupied, 0.25), 0, 1)
    return occupied, np.round(probability * levels) / levels if levels else probability


cases = given(seed=st.integers(0, 2**32 - 1), count=st.integers(2, 120), levels=st.sampled_from([0, 2, 5, 10]))


@settings(max_examples=40)
@cases
def test_against_scikit_learn(seed, count, levels):
    occupied, probability = answers(seed, count, levels)
    found = score(occupied, probability)
    called, freed = probability > 0.6, probability <= 0.4 + 1e-6
    expected = {
        "precision": reference.precision_score(occupied, called, zero_division=0),
        "recall": reference.recall_score(occupied, called),
        "f1": reference.f1_score(occupied, called, zero_division=0),
        "iou": reference.jaccard_score(occupied, called, zero_division=0),
        "free_precision": reference.precision_score(~occupied, freed, zero_division=0),
        "free_recall": reference.recall_score(~occupied, freed),
        "auc": reference.roc_auc_score(occupied, probability),
        "brier": reference.brier_score_loss(occupied, probability),
        "nll": reference.log_loss(occupied, np.clip(probability, 1e-6, 1 - 1e-6)),
        "base_rate_nll": reference.log_loss(occupied, np.full(count, occupied.mean())),
    }
    for name, value in expected.items():
        assert found[name] == pytest.approx(value, abs=1e-9), name


@settings(max_examples=40)
@cases
def test_the_rest_by_brute_force(seed, count, levels):
    occupied, probability = answers(seed, count, levels)
    found = score(occupied, probability)
    best = 0.0
    for cut in set(probability.tolist()):
        right = sum(p >= cut and y for p, y in zip(probability, occupied, strict=True))
        called = sum(p >= cut for p in probability)
        best = max(best, 2 * right / (called + occupied.sum()))
    assert found["best_f1"] == pytest.approx(best) and best >= found["f1"] - 1e-12
    error = 0.0
    for b in range(15):
        inside = [k for k in range(count) if min(int(probability[k] * 15), 14) == b]
        if inside:
            error += len(inside) / count * abs(np.mean([probability[k] for k in inside]) - np.mean([occupied[k] for k in inside]))
    assert found["ece"] == pytest.approx(error, abs=1e-12)
    known = sum(p > 0.6 or p <= 0.4 + 1e-6 for p in probability)
    assert (found["known"], found["base_rate"], found["count"]) == (known / count, occupied.sum() / count, count)


@settings(max_examples=25)
@cases
def test_the_curve_cut_by_cut(seed, count, levels):
    occupied, probability = answers(seed, count, levels)
    cut, precision, recall = precision_recall_curve(occupied, probability)
    assert cut.tolist() == sorted(set(probability.tolist()), reverse=True)
    for k, at in enumerate(cut):
        called = probability >= at
        assert precision[k] == (called & occupied).sum() / called.sum()
        assert recall[k] == (called & occupied).sum() / occupied.sum()
    assert recall[-1] == 1.0


def test_the_cuts_of_the_paper():
    """Occupied if p > 0.6, free if p <= 0.4 (OctoMap's single miss, 0.4 in float32, is free), else unknown, which is a miss."""
    probability = np.array([0.6, 0.6000001, 0.4, float(np.float32(0.4)), 0.4001, 0.5])
    occupied = np.array([True, True, False, False, False, True])
    found = score(occupied, probability)
    assert found["precision"] == 1.0 and found["recall"] == pytest.approx(1 / 3)
    assert found["free_precision"] == 1.0 and found["free_recall"] == pytest.approx(2 / 3)
    assert found["known"] == pytest.approx(3 / 6)


def test_worked_by_hand():
    occupied = np.array([True, True, True, False, False])
    probability = np.array([0.9, 0.7, 0.2, 0.8, 0.1])
    found = score(occupied, probability)
    assert found["precision"] == found["recall"] == found["f1"] == pytest.approx(2 / 3)
    assert found["iou"] == pytest.approx(2 / 4)
    assert found["auc"] == pytest.approx(4 / 6)
    assert found["brier"] == pytest.approx((0.01 + 0.09 + 0.64 + 0.64 + 0.01) / 5)
    assert found["nll"] == pytest.approx(-sum(math.log(p) for p in (0.9, 0.7, 0.2, 0.2, 0.9)) / 5)
    assert found["best_f1"] == pytest.approx(6 / 7)  # everything from 0.2 on: 3 of 4 right


@pytest.mark.parametrize("label", [True, False])
@pytest.mark.parametrize("probability", [0.0, 0.5, 1.0])
def test_one_class_only_still_gives_numbers(label, probability):
    found = score(np.full(7, label), np.full(7, probability))
    assert set(found) == set(METRICS) and np.isfinite(list(found.values())).all()
    assert found["auc"] == 0.5 and found["base_rate_nll"] == 0.0 and found["base_rate"] == label


def test_no_queries_at_all():
    found = score(np.zeros(0, bool), np.zeros(0))
    assert set(found) == set(METRICS) and found.pop("auc") == 0.5 and not any(found.values())


@settings(max_examples=40)
@cases
def test_ranks_of_errors_against_scikit_learn(seed, count, levels):
    occupied, probability = answers(seed, count, levels)
    spread = np.round(np.random.default_rng(seed).random(count) * (levels or 100)) / (levels or 100)
    found = error_ranking(occupied, probability, spread)
    wrong = (probability > 0.5) != occupied
    both = 0 < wrong.sum() < count
    for name, doubt in (("error_auc_spread", spread), ("error_auc_doubt", 1 - np.abs(2 * probability - 1))):
        assert found[name] == pytest.approx(reference.roc_auc_score(wrong, doubt) if both else 0.5)
    assert found[ERRORS] == pytest.approx(np.mean(wrong))


def test_errors_of_nothing_are_ranked_by_chance():
    nothing = np.zeros(0)
    assert error_ranking(nothing.astype(bool), nothing, nothing) == dict.fromkeys(ERROR_METRICS, 0.5) | {ERRORS: 0.0}


def test_a_certain_answer_that_is_wrong_costs_a_lot_but_not_everything():
    assert score(np.array([True]), np.array([0.0]))["nll"] == pytest.approx(13.8, abs=0.02)


def test_all_ties_say_nothing():
    occupied = np.arange(10) < 4
    found = score(occupied, np.full(10, 0.7))
    assert found["auc"] == 0.5 and found["best_f1"] == pytest.approx(8 / 14)


def test_calibrated_answers_have_no_calibration_error():
    assert calibration_error(np.array([True, False, False, False, True, True]), np.array([0.25] * 4 + [1.0] * 2)) == pytest.approx(0.0)
    assert calibration_error(np.array([True, True]), np.array([0.0, 0.0])) == 1.0


def test_order_changes_nothing():
    occupied, probability = answers(0, 200, 10)
    order = np.random.default_rng(1).permutation(200)
    expected = score(occupied, probability)
    for name, value in score(occupied[order], probability[order]).items():
        assert value == pytest.approx(expected[name], abs=1e-12)
