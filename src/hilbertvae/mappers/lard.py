"""LARD-HM (Guizilini & Ramos, IROS 2016): a feature per cluster of returns, as long and as thick as it, and a logistic regression."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array, get_index_dtype
from scipy.spatial import cKDTree

from hilbertvae.checks import check_positive
from hilbertvae.clusters.clusters import Clusters
from hilbertvae.clusters.quick_means import check_radii, quick_means
from hilbertvae.cores import workers
from hilbertvae.mappers.logistic import LogisticMapper
from hilbertvae.sums import sums_by

NEAREST = 5
"""Only so many clusters speak at a point: those whose means are nearest (METHOD 6)."""
STRETCH = 5.0
"""A feature is this many covariances wide (METHOD 6)."""


class ClusterFeatures:
    """Phi_m(x) = exp(-(x - mu_m)^T (5 Sigma_m)^-1 (x - mu_m)) for the 5 clusters whose means are nearest to x, 0 for all others.

    points (N, D) and weight (N,): the returns that `clusters` index. Mean and covariance are of weighted returns; `thickness_m` squared is
    added to the covariance's diagonal, so that a straight wall or a single return has a volume.
    """

    def __init__(self, points: np.ndarray, weight: np.ndarray, clusters: Clusters, thickness_m: float):
        count, dimension = len(clusters), points.shape[1]
        cluster = clusters.numbers
        weight = weight[clusters.members]
        total = np.bincount(cluster, weight, count)
        # Taken from the seed, so that large coordinates cost no digits.
        away = points[clusters.members] - clusters.seeds[cluster]
        centre = sums_by(cluster, away, count, weight) / total[:, None]
        away -= centre[cluster]
        covariance = np.empty((count, dimension, dimension))
        for a in range(dimension):
            covariance[:, a] = sums_by(cluster, away, count, weight * away[:, a]) / total[:, None]
        covariance += thickness_m**2 * np.eye(dimension)
        self.means = clusters.seeds + centre
        self.precisions = np.linalg.inv(STRETCH * covariance)
        self._tree = cKDTree(self.means)

    def __call__(self, points: np.ndarray) -> csr_array:
        """(Q, M) features of `points (Q, D)`; in each row the nearest cluster comes first."""
        shape = (len(points), len(self.means))
        nearest = min(NEAREST, len(self.means))
        if 0 in shape:
            return csr_array(shape)
        column = self._tree.query(points, k=np.arange(1, nearest + 1), workers=workers(len(points)))[1]
        away = [points[:, axis, None] - self.means[column, axis] for axis in range(points.shape[1])]
        exponent = np.zeros(column.shape)
        for a, first in enumerate(away):
            for b, second in enumerate(away):
                exponent += self.precisions[column, a, b] * first * second
        width = get_index_dtype(maxval=column.size)  # of the bounds: else columns take eight bytes each, too
        bounds = np.arange(0, column.size + 1, nearest, dtype=width)
        return csr_array((np.exp(-exponent).ravel(), column.astype(np.int32).ravel(), bounds), shape=shape)


class LardMapper(LogisticMapper):
    """LARD-HM on Quick-Means clusters of the returns. Far from any cluster the answer is the intercept's, which learns to say free.

    outer_radius_m, inner_radius_m, minimum_points: of Quick-Means. The paper's row has the clusters of CVAE-HM, 2.5 and 1.375 m.
    thickness_m: see `ClusterFeatures`. weight_power, occupied_share: as in `FixedGridMapper`.
    epochs, batch_size, rate: of the gradient descent (see `fit_logistic`), which has no regulariser here. seed: of both.
    """

    def __init__(
        self,
        outer_radius_m=0.75,
        inner_radius_m=0.5,
        minimum_points=1,
        thickness_m=0.03,
        weight_power=0.5,
        occupied_share=0.4,
        epochs=10,
        batch_size=256,
        rate=5.0,
        seed=0,
    ):
        self.outer_radius_m = outer_radius_m
        self.inner_radius_m = inner_radius_m
        self.minimum_points = minimum_points
        self.thickness_m = thickness_m
        self.weight_power = weight_power
        self.occupied_share = occupied_share
        self.epochs = epochs
        self.batch_size = batch_size
        self.rate = rate
        self.seed = seed

    def check_settings(self) -> None:
        super().check_settings()
        check_radii(self.outer_radius_m, self.inner_radius_m, self.minimum_points)
        check_positive(self.thickness_m, "thickness_m")

    def _feature_map(self, points, occupied, weight):
        returns = points[occupied]
        clusters = quick_means(returns, self.outer_radius_m, self.inner_radius_m, self.minimum_points, self.seed)
        return ClusterFeatures(returns, weight[occupied], clusters, self.thickness_m)
