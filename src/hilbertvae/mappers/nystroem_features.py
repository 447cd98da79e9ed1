"""HM on Nystroem features (Williams & Seeger 2001; Ramos & Ott 2015): the kernel to some of the points, whitened among these."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh
from scipy.sparse.linalg import LinearOperator, aslinearoperator
from scipy.spatial.distance import cdist

from hilbertvae.mappers.dense_features import DenseFeatureMapper
from hilbertvae.mappers.radial_features import RadialFeatures

SMALLEST = 1e-15
"""The least value of the kernel kept; at gamma 2 per m^2 that is a reach of 4.2 m. Whitening makes much of what is small."""
CELL_M = 0.5
LEAST_EIGENVALUE = 1e-12
"""Of K; scikit-learn's."""


class NystroemFeatures:
    """Phi(x) = K^(-1/2) k(x), k_m(x) = exp(-gamma |x - c_m|^2), K_lm = k_m(c_l), at landmarks c_m drawn from the points.

    Those of scikit-learn's `Nystroem`, drawn by the same numbers, relative to `origin (D,)`, the middle of the data; K^(-1/2) comes from
    its eigenvectors, which take a third of the time of the singular value decomposition there.
    """

    def __init__(self, points: np.ndarray, components: int, gamma_per_m2: float, seed: int):
        self.origin = points.mean(axis=0)
        self.count = min(components, len(points))
        self.landmarks = landmarks = points[np.random.RandomState(seed).permutation(len(points))[: self.count]] - self.origin
        values, vectors = eigh(np.exp(-gamma_per_m2 * cdist(landmarks, landmarks, "sqeuclidean")), driver="evd", overwrite_a=True)
        self.whitening = (vectors / np.sqrt(np.maximum(values, LEAST_EIGENVALUE))) @ vectors.T
        self._kernel = RadialFeatures(landmarks, gamma_per_m2, SMALLEST, CELL_M)

    def __call__(self, points: np.ndarray) -> LinearOperator:
        """(Q, M) features of `points (Q, D)`, as a product that is not multiplied out: Q M + M^2 multiplications per vector, not Q M^2."""
        return aslinearoperator(self._kernel(points - self.origin)) @ aslinearoperator(self.whitening)

    def weighted_sum(self, points: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """(Q,) w . Phi(x) of `points (Q, D)` for `weights (M,)`."""
        return self._kernel(points - self.origin) @ (self.whitening @ weights)


class NystroemMapper(DenseFeatureMapper):
    """HM on Nystroem features; settings as in `DenseFeatureMapper`, `components` being how many fit points are landmarks.

    Far from any landmark the answer is the intercept's, about `occupied_share`.
    """

    chunk = 2048  # `weighted_sum` reads the whole whitening matrix once for each

    def _feature_map(self, points, occupied, weight):
        return NystroemFeatures(points, self.components, self.gamma_per_m2, self.seed)
