"""HM on random Fourier features (Rahimi & Recht 2007; Ramos & Ott 2015): waves over the whole site that add up to the kernel on average."""

from __future__ import annotations

import numpy as np
from sklearn.kernel_approximation import RBFSampler

from hilbertvae.mappers.dense_features import DenseFeatureMapper

FAR_M = 1e30
"""Coordinates are cut off here, so that float32 holds them."""
BLOCK = 200_000
"""Features computed together: few enough to stay in the processor's cache. Changes no number."""


class FourierFeatures:
    """Phi_m(x) = sqrt(2 / M) cos(w_m . (x - origin) + b_m), w ~ N(0, 2 gamma I), b ~ U(0, 2 pi), as scikit-learn's `RBFSampler` draws them.

    origin (D,): the middle of the data. From there a site's coordinates are exact enough in float32, whose cosine is seven times as fast.
    """

    def __init__(self, origin: np.ndarray, components: int, gamma_per_m2: float, seed: int):
        sampler = RBFSampler(gamma=gamma_per_m2, n_components=components, random_state=seed).fit(origin[None])
        self.origin, self.count = origin, components
        self.waves, self.phases = sampler.random_weights_.astype(np.float32), sampler.random_offset_.astype(np.float32)

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """(Q, M) float32 features of `points (Q, D)`."""
        away = np.clip(points - self.origin, -FAR_M, FAR_M).astype(np.float32)
        features = np.empty((len(points), self.count), np.float32)
        rows = max(1, BLOCK // self.count)
        for start in range(0, len(points), rows):
            angle = features[start : start + rows]
            angle[:] = self.phases
            # Axis by axis instead of the sampler's matrix product, in whose last bits a row's place among the others shows.
            for coordinate, wave in zip(away[start : start + rows].T, self.waves, strict=True):
                angle += coordinate[:, None] * wave
            np.cos(angle, out=angle)
            angle *= np.float32(np.sqrt(2.0 / self.count))
        return features

    def weighted_sum(self, points: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """(Q,) w . Phi(x) of `points (Q, D)` for `weights (M,)`."""
        return (self(points) * weights).sum(axis=1)


class FourierMapper(DenseFeatureMapper):
    """HM on random Fourier features; settings as in `DenseFeatureMapper`.

    Waves do not fade: where no point is near, the answer is whatever they happen to add up to, and nowhere is it unknown.
    """

    def _feature_map(self, points, occupied, weight):
        return FourierFeatures(points.mean(axis=0), self.components, self.gamma_per_m2, self.seed)
