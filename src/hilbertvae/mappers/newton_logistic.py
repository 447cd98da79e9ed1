"""Logistic regression on a few features, some of whose weights shall not be negative, by Newton's method (Eq. 15)."""

from __future__ import annotations

import numpy as np
from scipy.sparse import issparse
from scipy.special import expit

from hilbertvae.checks import InputError

MOST_STEPS, SMALLEST_PACE = 100, 1e-12
LIGHT_RIDGE = 1e-3
"""So that features which say the same have one optimum."""
NEAR_ZERO = 1e-2
"""A weight that shall not be negative may count as 0 from here on, if a plain gradient step would take some weight as far."""


def logistic_weights(features, occupied, nonnegative, ridge=LIGHT_RIDGE, towards=None, offset=0.0, counts=1.0) -> np.ndarray:
    """w (F,) that minimises the sum over queries of `counts (N,)` log(1 + exp(-y (offset + w . Phi))) + ridge |w - towards|^2.

    A symmetric `ridge` (F, F) stands for its quadratic form of w - towards.
    Convex, with few features, which say nearly the same: Newton's method reaches in ten steps the optimum that SGD (Eq. 16) would wander
    around. Weights that shall not be negative are projected (Bertsekas 1982): one at 0, or about to be, that its gradient presses there
    is left out of the system of equations, and takes a plain gradient step. Features may be sparse.
    """
    sign, features = np.where(occupied, 1.0, -1.0), features.astype(np.float64)
    count = features.shape[1]
    towards = np.zeros(count) if towards is None else towards
    bounded = np.isin(np.arange(count), nonnegative)
    ridge = ridge * np.eye(count) if np.ndim(ridge) == 0 else ridge

    def loss(weights):
        margin = sign * (features @ weights + offset)
        return (counts * np.logaddexp(0, -margin)).sum() + (weights - towards) @ ridge @ (weights - towards), margin

    weights = np.where(bounded, np.maximum(towards, 0.1), 0.0)
    value, margin = loss(weights)
    if not np.isfinite(value):  # no step would seem to help, and the weights it began with be taken for the optimum
        raise InputError(f"logistic weights: expected finite features, targets and counts, got a loss of {value}")
    for _ in range(MOST_STEPS):
        wrong = expit(-margin)
        gradient = features.T @ (-sign * counts * wrong) + 2 * (ridge @ (weights - towards))
        bend = (counts * wrong * (1 - wrong))[:, None]
        hessian = (features.T @ features.multiply(bend)).toarray() if issparse(features) else features.T @ (features * bend)
        hessian += 2 * ridge
        step = gradient / np.diag(hessian)
        plain = np.where(bounded, np.minimum(step, weights), step)
        # The margin shrinks as the optimum nears. Without one, a weight just above 0 stops every step that would take it below.
        free = ~(bounded & (weights <= min(NEAR_ZERO, np.abs(plain).max())) & (gradient > 0))
        step[free] = np.linalg.solve(hessian[np.ix_(free, free)], gradient[free])
        pace, before = 1.0, value
        while pace > SMALLEST_PACE:
            tried = np.where(bounded, np.maximum(weights - pace * step, 0.0), weights - pace * step)
            value, margin = loss(tried)
            if value <= before - 1e-4 * gradient @ (weights - tried):
                break
            pace /= 2
        else:  # no step is small enough to help: the optimum, to rounding
            return weights
        moved, weights = np.abs(tried - weights).max(), tried
        if moved <= 1e-10 * (1 + np.abs(weights).max()):
            break
    return weights
