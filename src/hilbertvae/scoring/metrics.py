"""Scores of probabilities against labels (METHOD 7)."""

from __future__ import annotations

import numpy as np

from hilbertvae.mappers.mapper import FREE_BELOW, OCCUPIED_ABOVE
from hilbertvae.scoring.result import ERROR_METRICS, ERRORS

SMALLEST_PROBABILITY = 1e-6
"""For NLL alone: a certain answer that is wrong costs 13.8 nats, not infinitely many."""
CALIBRATION_BINS = 15
METRICS = (
    "precision", "recall", "f1", "best_f1", "iou", "auc", "nll", "brier", "ece", "known", "base_rate", "count",
    "free_precision", "free_recall", "base_rate_nll",
)  # fmt: skip


def score(occupied: np.ndarray, probability: np.ndarray) -> dict[str, float]:
    """All of `METRICS` for labels `occupied (Q,)` bool and `probability (Q,)` of being occupied.

    Precision: of the points called occupied (p > 0.6), how many are. Recall: of all occupied points, how many were called so; unknown
    (0.4 < p <= 0.6) is a miss. A ratio with nothing below the line is 0, and AUC with one class only, or none, is 0.5: every score is a
    number, and `count` tells where it means nothing.
    """
    count = len(occupied)
    if not count:
        return dict.fromkeys(METRICS, 0.0) | {"auc": 0.5}
    called, freed = probability > OCCUPIED_ABOVE, probability <= FREE_BELOW
    right, right_free = np.count_nonzero(called & occupied), np.count_nonzero(freed & ~occupied)
    positive, called_count, freed_count = np.count_nonzero(occupied), np.count_nonzero(called), np.count_nonzero(freed)
    precision, recall = _ratio(right, called_count), _ratio(right, positive)
    clipped = np.clip(probability, SMALLEST_PROBABILITY, 1 - SMALLEST_PROBABILITY)
    base = positive / count
    auc, best_f1 = _ranked(occupied, probability)
    return {
        "precision": precision,
        "recall": recall,
        "f1": _ratio(2 * precision * recall, precision + recall),
        "best_f1": best_f1,
        "iou": _ratio(right, positive + called_count - right),
        "auc": auc,
        "nll": float(-np.log(np.where(occupied, clipped, 1 - clipped)).mean()),
        "brier": float(np.square(probability - occupied).mean()),
        "ece": calibration_error(occupied, probability),
        "known": (called_count + freed_count) / count,
        "base_rate": base,
        "count": float(count),
        "free_precision": _ratio(right_free, freed_count),
        "free_recall": _ratio(right_free, count - positive),
        "base_rate_nll": float(-sum(p * np.log(p) for p in (base, 1 - base) if p > 0)),
    }


def _ratio(above: float, below: float) -> float:
    return float(above / below) if below else 0.0


def _cuts(occupied: np.ndarray, probability: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(cut, right, called): at every distinct probability, the highest first, how many are called occupied there, and how many are."""
    order = np.argsort(-probability, kind="stable")
    ranked = probability[order]
    last = np.append(np.flatnonzero(np.diff(ranked)), len(ranked) - 1)
    return ranked[last], np.cumsum(occupied[order])[last], last + 1


def error_ranking(occupied: np.ndarray, probability: np.ndarray, spread: np.ndarray) -> dict[str, float]:
    """`ERRORS`, and `ERROR_METRICS`: how well a map's `spread (Q,)`, as of `predict_std`, ranks its errors, p on the wrong side of 0.5, and
    how well 1 - |2p - 1| does, which costs nothing: areas under the ROC curve, 0.5 where all, or none, are errors."""
    wrong = (probability > 0.5) != occupied
    doubts = spread, 1 - np.abs(2 * probability - 1)
    ranked = {name: _ranked(wrong, doubt)[0] if len(wrong) else 0.5 for name, doubt in zip(ERROR_METRICS, doubts, strict=True)}
    return ranked | {ERRORS: float(wrong.mean()) if len(wrong) else 0.0}


def precision_recall_curve(occupied: np.ndarray, probability: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(cut, precision, recall) for "occupied if p >= cut" at every distinct probability, the highest first."""
    cut, right, called = _cuts(occupied, probability)
    return cut, right / called, right / max(right[-1], 1)


def _ranked(occupied: np.ndarray, probability: np.ndarray) -> tuple[float, float]:
    """The area under the ROC curve (ties count half) and the best F1 of any cut."""
    _, right, called = _cuts(occupied, probability)
    positive = int(right[-1])
    negative = len(occupied) - positive
    best_f1 = float((2 * right / (positive + called)).max())
    if not positive or not negative:
        return 0.5, best_f1
    true_rate = np.concatenate([[0.0], right / positive])
    false_rate = np.concatenate([[0.0], (called - right) / negative])
    return float(np.trapezoid(true_rate, false_rate)), best_f1


def calibration_error(occupied: np.ndarray, probability: np.ndarray) -> float:
    """ECE: the mean distance between the mean probability and the share of occupied, over equal bins of probability, by their size."""
    bin_of = np.minimum((probability * CALIBRATION_BINS).astype(int), CALIBRATION_BINS - 1)
    gap = np.bincount(bin_of, weights=probability - occupied, minlength=CALIBRATION_BINS)
    return float(np.abs(gap).sum() / len(probability))
