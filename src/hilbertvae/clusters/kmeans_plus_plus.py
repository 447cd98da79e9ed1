"""k-means++ (Arthur & Vassilvitskii 2007), scikit-learn's: the next seed is drawn by its squared distance to those there are.

scikit-learn's is the greedy one: of 2 + log(count) draws, the one that lowers the potential most becomes the seed.
"""

from __future__ import annotations

import numpy as np

from hilbertvae.checks import InputError, check_count, check_points, check_whole


def kmeans_plus_plus(points: np.ndarray, count: int, weight: np.ndarray | None = None, seed: int = 0) -> np.ndarray:
    """(count, D) seeds among `points (N, D)`, metres, in the order drawn; `weight (N,)`: how many points each stands for, 1 unless given.

    An `InputError` for more seeds than points. Seeds differ where there are as many different points, unless squares of how far apart the
    farthest are have no digits for the others: of points in 10 m, with one 1e9 m away, some are seeds twice.
    """
    from sklearn.cluster import kmeans_plusplus  # late: seconds that only this start should cost

    points = check_points(points, "points")
    count = check_count(count, "count", len(points))
    if weight is not None:
        weight = np.asarray(weight, np.float64)
        if weight.shape != (len(points),) or not np.isfinite(weight).all() or (weight < 0).any() or not weight.any():
            raise InputError(f"weight: expected {len(points)} numbers of at least 0, not all of them 0, got {weight!r:.60}")
    random = np.random.RandomState(np.random.PCG64(check_whole(seed, "seed")))  # scikit-learn takes no Generator
    # It takes distances from dot products, which would lose all digits far from the origin (UTM).
    chosen = kmeans_plusplus(points - points.mean(axis=0), count, sample_weight=weight, random_state=random)[1]
    return points[chosen]
