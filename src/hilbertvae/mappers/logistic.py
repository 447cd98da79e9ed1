"""Logistic regression by stochastic gradient descent: what HM, on any features, and LARD-HM share (Eq. 14 to 16).

With the misprints of Eq. 14 and 15 mended (METHOD 5), p(y = +1 | x) = 1 / (1 + exp(-(w . Phi(x) + b))), and what is made small is the
weighted mean of log(1 + exp(-y (w . Phi + b))) plus the elastic net R(w) = penalty (l1_share |w|_1 + (1 - l1_share) / 2 |w|^2).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from scipy.special import expit
from sklearn.utils.validation import check_is_fitted

from hilbertvae.checks import InputError, check_count, check_not_negative, check_positive
from hilbertvae.mappers.mapper import Mapper

INTERCEPT_PACE = 0.01
"""The intercept learns this much slower. It is in every point's sum and HM's features nearly add up to a constant, so the two compete: at
full pace it ends at +3.8 for HM on csail (+19 without a penalty), and gaps fill with walls. scikit-learn does so on sparse data."""


class FeatureMatrix(Protocol):
    """(N, M) features: a sparse matrix, or what makes rows of one when they are asked for."""

    shape: tuple[int, int]

    def __getitem__(self, rows: np.ndarray) -> Any:
        """(B, M) the features of `rows (B,)`: what has `@`, `.T` and a `dtype`."""


def fit_logistic(
    features: FeatureMatrix,
    occupied: np.ndarray,
    weight: np.ndarray,
    *,
    penalty: float,
    l1_share: float,
    epochs: int,
    batch_size: int,
    rate: float,
    seed: int,
) -> tuple[np.ndarray, float]:
    """The weights `(M,)` and the intercept for `features (N, M)`, `occupied (N,)` bool of both kinds and `weight (N,)`.

    Each epoch walks a seeded permutation in mini-batches. Each weight has its own decaying rate, `rate` over the root of the sum of its
    squared gradients (AdaGrad, Duchi, Hazan & Singer 2011): features are local, so a common rate starves those that few points touch.
    The elastic net is a proximal step, which gives exact zeros. The intercept starts at the log-odds of the base rate and is not penalised.
    Returned is the mean over the second half of the steps (Polyak & Juditsky 1992). The same seed gives the same bits.
    """
    random = np.random.default_rng(seed)
    count, columns = features.shape
    target, weight = occupied.astype(np.float64), weight / weight.mean()
    share = np.average(target, weights=weight)
    # The intercept is the last entry of each vector, so that one update serves both.
    value, total, squared, gradient = np.zeros((4, columns + 1))
    # Features may be hundreds of thousands: fresh arrays for what lies between would take four times as long.
    pace, between, further = np.empty((3, columns + 1))
    value[-1] = np.log(share / (1.0 - share))
    steps = epochs * -(-count // batch_size)
    step, averaged_from = 0, steps // 2
    for _ in range(epochs):
        order = random.permutation(count)
        for start in range(0, count, batch_size):
            rows = order[start : start + batch_size]
            batch = features[rows]
            residual = weight[rows] * (expit(batch @ value[:-1].astype(batch.dtype, copy=False) + value[-1]) - target[rows]) / len(rows)
            gradient[:-1] = batch.T @ residual.astype(batch.dtype, copy=False)
            gradient[-1] = residual.sum()
            squared += np.multiply(gradient, gradient, out=between)
            np.sqrt(np.maximum(squared, np.finfo(float).tiny, out=pace), out=pace)
            np.divide(rate, pace, out=pace)
            pace[-1] *= INTERCEPT_PACE
            value -= np.multiply(pace, gradient, out=between)
            if penalty > 0:
                pace *= penalty
                _shrink(value[:-1], pace[:-1], l1_share, between[:-1], further[:-1])
            if step >= averaged_from:
                total += value
            step += 1
    mean = total / (steps - averaged_from)
    return mean[:-1], float(mean[-1])


def _shrink(value: np.ndarray, amount: np.ndarray, l1_share: float, between: np.ndarray, further: np.ndarray) -> None:
    """The proximal step of amount (l1_share |w|_1 + (1 - l1_share) / 2 |w|^2), weight by weight, in place; other arrays are overwritten."""
    threshold = np.multiply(amount, l1_share, out=between)
    value -= np.clip(value, np.negative(threshold, out=further), threshold, out=between)
    amount *= 1.0 - l1_share
    amount += 1.0
    value /= amount


def balanced_weight(weight: np.ndarray, occupied: np.ndarray, power: float, occupied_share: float | None) -> np.ndarray:
    """(N,) weight^power, then rescaled so that occupied points hold `occupied_share` of the sum (None: as it comes)."""
    weight = weight**power
    if occupied_share is None:
        return weight
    hit = occupied.astype(bool)
    return weight * np.where(hit, occupied_share / weight[hit].sum(), (1.0 - occupied_share) / weight[~hit].sum())


class LogisticMapper(Mapper):
    """Base of the mappers that are a feature map and a logistic regression on it.

    A subclass takes `weight_power`, `occupied_share`, `epochs`, `batch_size`, `rate` and `seed` among its settings (and `penalty` and
    `l1_share` if it has a regulariser), and implements `_feature_map`. Fitted: `features_`, `weights_ (M,)`, `intercept_`.
    """

    penalty = 0.0
    l1_share = 0.0

    def _feature_map(self, points: np.ndarray, occupied: np.ndarray, weight: np.ndarray) -> Callable[[np.ndarray], Any]:
        """From the fit points, a function of points (Q, D) to features (Q, M), each row a function of its own point alone."""
        raise NotImplementedError

    def _fit(self, points, occupied, weight):
        self.features_ = self._feature_map(points, occupied, weight)
        self.weights_, self.intercept_ = fit_logistic(
            self._design(points),
            occupied,
            balanced_weight(weight, occupied, self.weight_power, self.occupied_share),
            penalty=self.penalty,
            l1_share=self.l1_share,
            epochs=self.epochs,
            batch_size=self.batch_size,
            rate=self.rate,
            seed=self.seed,
        )

    def _design(self, points: np.ndarray) -> FeatureMatrix:
        """The features (N, M) of the fit points."""
        return self.features_(points)

    def _probability(self, queries):
        # A row's sum runs over that row alone, in its own order: no other query changes a bit of it.
        return expit(self.features_(queries) @ self.weights_ + self.intercept_)

    def cluster_count(self) -> int:
        """How many features the fitted map has."""
        check_is_fitted(self)
        return len(self.weights_)

    def check_settings(self) -> None:
        super().check_settings()
        check_positive(self.rate, "rate")
        for name in ("epochs", "batch_size"):
            check_count(getattr(self, name), name)
        for name in ("penalty", "weight_power"):
            check_not_negative(getattr(self, name), name)
        if check_not_negative(self.l1_share, "l1_share") > 1:
            raise InputError(f"l1_share: expected a share from 0 to 1, got {self.l1_share!r}")
        if self.occupied_share is not None and check_positive(self.occupied_share, "occupied_share") >= 1:
            raise InputError(f"occupied_share: expected a share between 0 and 1, or None, got {self.occupied_share!r}")
