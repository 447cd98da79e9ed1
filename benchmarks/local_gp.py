"""A map like GPOM's: Gaussian process regression on labels -1 / +1 from the nearest thinned points, squashed (METHOD 6)."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import ndtr
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import Matern, WhiteKernel


class LocalGP:
    """One small scikit-learn process for each query, on the `neighbours` nearest of the points; fixed Matern kernel."""

    def __init__(self, points: np.ndarray, occupied: np.ndarray, neighbours: int = 60, length_m: float = 0.5, noise: float = 0.1):
        self.tree = cKDTree(points)
        self.label = np.where(occupied, 1.0, -1.0)
        self.neighbours = min(neighbours, len(points))
        self.kernel = Matern(length_m, nu=1.5) + WhiteKernel(noise)

    def probability(self, queries: np.ndarray) -> np.ndarray:
        """(Q,) p(occupied): the cumulative Gaussian of mean and variance."""
        nearest = self.tree.query(queries, k=self.neighbours)[1]
        answers = np.empty(len(queries))
        for k, (query, near) in enumerate(zip(queries, nearest, strict=True)):
            process = GaussianProcessRegressor(self.kernel, optimizer=None).fit(self.tree.data[near], self.label[near])
            mean, std = process.predict(query[None], return_std=True)
            answers[k] = ndtr(mean[0] / np.sqrt(1 + std[0] ** 2))
        return answers
