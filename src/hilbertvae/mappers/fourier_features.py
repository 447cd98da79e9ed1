"""HM on random Fourier features (Rahimi & Recht 2007; Ramos & Ott 2015): waves over the whole site that add up to the kernel on average."""

from __future__ import annotations

from collections.abc import Iterator

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
        features = np.empty((len(points), self.count), np.float32)
        for rows, values in self._blocks(points):
            np.multiply(values, np.float32(np.sqrt(2.0 / self.count)), out=features[rows])
        return features

    def weighted_sum(self, points: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """(Q,) w . Phi(x) of `points (Q, D)` for `weights (M,)`."""
        sums = np.empty(len(points))
        scaled = (weights * np.sqrt(2.0 / self.count)).astype(np.float32)
        for rows, values in self._blocks(points):
            values *= scaled
            sums[rows] = values.sum(axis=1, dtype=np.float64)
        return sums

    def _blocks(self, points: np.ndarray) -> Iterator[tuple[slice, np.ndarray]]:
        """Some rows at a time, and cos(w . (x - origin) + b) (B, M) of their points; the next ones overwrite it."""
        away = np.clip(points - self.origin, -FAR_M, FAR_M).astype(np.float32)
        count = max(1, BLOCK // self.count)
        block, product = np.empty((2, count, self.count), np.float32)
        for start in range(0, len(points), count):
            part = away[start : start + count]
            angle = block[: len(part)]
            angle[:] = self.phases
            # Axis by axis instead of the sampler's matrix product, in whose last bits a row's place among the others shows.
            for coordinate, wave in zip(part.T, self.waves, strict=True):
                angle += np.multiply(coordinate[:, None], wave, out=product[: len(part)])
            np.cos(angle, out=angle)
            yield slice(start, start + len(part)), angle


class FourierMapper(DenseFeatureMapper):
    """HM on random Fourier features; settings as in `DenseFeatureMapper`.

    Waves do not fade: where no point is near, the answer is whatever they happen to add up to, and nowhere is it unknown.
    """

    def _feature_map(self, points, occupied, weight):
        return FourierFeatures(points.mean(axis=0), self.components, self.gamma_per_m2, self.seed)
