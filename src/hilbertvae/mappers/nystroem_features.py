"""HM on Nystroem features (Williams & Seeger 2001; Ramos & Ott 2015): the kernel to some of the points, whitened among these."""

from __future__ import annotations

import numpy as np
from scipy.sparse.linalg import LinearOperator, aslinearoperator
from sklearn.kernel_approximation import Nystroem

from hilbertvae.mappers.dense_features import DenseFeatureMapper


class NystroemFeatures:
    """Phi(x) = K^(-1/2) k(x), k_m(x) = exp(-gamma |x - c_m|^2), K_lm = k_m(c_l), at landmarks c_m drawn from the points.

    Drawn and whitened by scikit-learn's `Nystroem`, relative to `origin (D,)`, the middle of the data.
    """

    def __init__(self, points: np.ndarray, components: int, gamma_per_m2: float, seed: int):
        self.origin = points.mean(axis=0)
        self.gamma_per_m2 = gamma_per_m2
        self.count = min(components, len(points))
        self.sampler = Nystroem(gamma=gamma_per_m2, n_components=self.count, random_state=seed).fit(points - self.origin)

    def __call__(self, points: np.ndarray) -> LinearOperator:
        """(Q, M) features of `points (Q, D)`, as a product that is not multiplied out: Q M + M^2 multiplications per vector, not Q M^2."""
        return aslinearoperator(self._kernel(points)) @ aslinearoperator(self.sampler.normalization_.T)

    def weighted_sum(self, points: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """(Q,) w . Phi(x) of `points (Q, D)` for `weights (M,)`."""
        return (self._kernel(points) * (self.sampler.normalization_.T @ weights)).sum(axis=1)

    def _kernel(self, points: np.ndarray) -> np.ndarray:
        """(Q, M) k(x)."""
        squared = np.zeros((len(points), self.count))
        # Axis by axis: a matrix product would show, in the last bits of a row, its place among the others.
        for away, landmark in zip((points - self.origin).T, self.sampler.components_.T, strict=True):
            step = away[:, None] - landmark
            step *= step
            squared += step
        squared *= -self.gamma_per_m2
        return np.exp(squared, out=squared)


class NystroemMapper(DenseFeatureMapper):
    """HM on Nystroem features; settings as in `DenseFeatureMapper`, `components` being how many fit points are landmarks.

    Far from any landmark the answer is the intercept's, about `occupied_share`.
    """

    def _feature_map(self, points, occupied, weight):
        return NystroemFeatures(points, self.components, self.gamma_per_m2, self.seed)
