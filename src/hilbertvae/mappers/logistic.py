"""Logistic regression on sparse features by stochastic gradient descent: what HM and LARD-HM are fitted with.

Eq. 14 to 16 with the misprints mended: p(y = +1 | x) = 1 / (1 + exp(-(w . Phi(x) + b))), and what is made small is the weighted mean of
log(1 + exp(-y (w . Phi + b))) plus the elastic net R(w) = penalty * (l1_share * |w|_1 + (1 - l1_share) / 2 * |w|^2). The intercept b is not penalised.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.special import expit

from hilbertvae.checks import InputError, check_positive


def fit_logistic(
    features: csr_array,
    occupied: np.ndarray,
    weight: np.ndarray,
    *,
    penalty: float = 0.0,
    l1_share: float = 0.15,
    epochs: int = 10,
    batch_size: int = 256,
    rate: float = 0.5,
    seed: int = 0,
) -> tuple[np.ndarray, float]:
    """The weights `w (M,)` and the intercept of `features (N, M)`, `occupied (N,)` bool and `weight (N,)`, which counts relative to its mean.

    Each epoch walks one seeded permutation in mini-batches. The rate of each weight decays by itself, rate / sqrt(sum of its squared gradients)
    (AdaGrad, Duchi, Hazan & Singer 2011): features are local, so one common rate starves those that few points touch. The elastic net is a proximal step,
    which gives exact zeros. Returned is the mean over the second half of the batches (Polyak & Juditsky 1992). Same seed, same bits.

    Raises `InputError` if a setting is out of its range.
    """
    check_logistic_settings(penalty=penalty, l1_share=l1_share, epochs=epochs, batch_size=batch_size, rate=rate)
    random = np.random.default_rng(seed)
    count, columns = features.shape
    target, weight = occupied.astype(np.float64), weight / weight.mean()
    # The intercept is the last entry of each vector, so that one update serves both.
    value, total, squared = np.zeros(columns + 1), np.zeros(columns + 1), np.zeros(columns + 1)
    gradient = np.empty(columns + 1)
    steps = epochs * -(-count // batch_size)
    averaged_from, step = steps // 2, 0
    for _ in range(epochs):
        order = random.permutation(count)
        for start in range(0, count, batch_size):
            rows = order[start : start + batch_size]
            batch = features[rows]
            residual = weight[rows] * (expit(batch @ value[:-1] + value[-1]) - target[rows]) / len(rows)
            gradient[:-1] = batch.T @ residual
            gradient[-1] = residual.sum()
            squared += gradient * gradient
            pace = rate / np.sqrt(np.maximum(squared, np.finfo(float).tiny))
            value -= pace * gradient
            if penalty > 0:
                value[:-1] = _shrink(value[:-1], pace[:-1] * penalty, l1_share)
            if step >= averaged_from:
                total += value
            step += 1
    mean = total / (steps - averaged_from)
    return mean[:-1], float(mean[-1])


def logistic(features: csr_array, weights: np.ndarray, intercept: float) -> np.ndarray:
    """(Q,) p(occupied) of `features (Q, M)`. A row's sum runs over that row alone, in its order: no other row changes a bit of it."""
    return expit(features @ weights + intercept)


def check_logistic_settings(*, penalty: float, l1_share: float, epochs: int, batch_size: int, rate: float) -> None:
    """`InputError` for a setting that `fit_logistic` cannot run with."""
    check_positive(rate, "rate")
    for name, value in (("epochs", epochs), ("batch_size", batch_size)):
        if not isinstance(value, (int, np.integer)) or isinstance(value, bool) or value < 1:
            raise InputError(f"{name}: expected a whole number of at least 1, got {value!r}")
    if not 0 <= penalty < np.inf:
        raise InputError(f"penalty: expected a number of at least 0, got {penalty!r}")
    if not 0 <= l1_share <= 1:
        raise InputError(f"l1_share: expected a share between 0 and 1, got {l1_share!r}")


def _shrink(value: np.ndarray, amount: np.ndarray, l1_share: float) -> np.ndarray:
    """The proximal step of amount * (l1_share |w|_1 + (1 - l1_share) / 2 |w|^2), for each weight."""
    pulled = np.sign(value) * np.maximum(np.abs(value) - amount * l1_share, 0.0)
    return pulled / (1.0 + amount * (1.0 - l1_share))
