"""What the Hilbert Maps on random features share: every feature speaks at every point, so their matrix is never whole in memory."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from scipy.sparse.linalg import LinearOperator
from scipy.special import expit

from hilbertvae.checks import check_count, check_positive
from hilbertvae.mappers.logistic import LogisticMapper


class DenseFeatures(Protocol):
    """Phi, with Phi(x) . Phi(x') about exp(-gamma |x - x'|^2)."""

    count: int
    """M, how many features there are."""

    def __call__(self, points: np.ndarray) -> np.ndarray | LinearOperator:
        """(Q, M) features of `points (Q, D)`."""

    def weighted_sum(self, points: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """(Q,) w . Phi(x) of `points (Q, D)`, each computed from its own row alone, so that no other query changes a bit of it."""


class RowsOnDemand:
    """The feature matrix of `points (N, D)` as `fit_logistic` asks for it: mini-batch by mini-batch, each made anew.

    A million points times a thousand features are 8 GB; a batch of 1024 is 8 MB.
    """

    def __init__(self, features: DenseFeatures, points: np.ndarray):
        self.features, self.points = features, points
        self.shape = (len(points), features.count)

    def __getitem__(self, rows: np.ndarray) -> np.ndarray | LinearOperator:
        return self.features(self.points[rows])


class DenseFeatureMapper(LogisticMapper):
    """Base of `FourierMapper` and `NystroemMapper`: their settings, and a logistic regression in bounded memory.

    components: how many features. gamma_per_m2: of the kernel exp(-gamma |x - x'|^2) that they stand for.
    weight_power, occupied_share, penalty, l1_share: as in `FixedGridMapper`.
    epochs, batch_size, rate: of the gradient descent (see `fit_logistic`). seed: of it and of the features.
    """

    chunk = 256

    def __init__(
        self,
        components=3000,
        gamma_per_m2=2.0,
        weight_power=0.5,
        occupied_share=0.4,
        penalty=1e-6,
        l1_share=0.15,
        epochs=3,
        batch_size=1024,
        rate=5.0,
        seed=0,
    ):
        self.components = components
        self.gamma_per_m2 = gamma_per_m2
        self.weight_power = weight_power
        self.occupied_share = occupied_share
        self.penalty = penalty
        self.l1_share = l1_share
        self.epochs = epochs
        self.batch_size = batch_size
        self.rate = rate
        self.seed = seed

    def _design(self, points):
        return RowsOnDemand(self.features_, points)

    def _probability(self, queries):
        return expit(self.features_.weighted_sum(queries, self.weights_) + self.intercept_)

    def check_settings(self) -> None:
        super().check_settings()
        check_positive(self.gamma_per_m2, "gamma_per_m2")
        check_count(self.components, "components")
        check_count(self.seed, "seed", most=2**32 - 1, least=0)  # what scikit-learn's features take
