"""k-means|| (Bahmani et al., Scalable K-Means++, 2012): many candidates in a few rounds, then a weighted k-means++ among them."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from hilbertvae.checks import check_count, check_points, check_positive, check_whole
from hilbertvae.clusters.kmeans_plus_plus import kmeans_plus_plus


def kmeans_parallel(points: np.ndarray, count: int, oversampling: float = 2.0, rounds: int = 5, seed: int = 0) -> np.ndarray:
    """(count, D) seeds among `points (N, D)`, metres; an `InputError` for more seeds than points.

    Algorithm 2 there: from one random point on, each round takes every point with probability
    min(1, `oversampling` * count * d^2 / (sum of d^2)), d its distance to the nearest candidate, each point on its own. Candidates then
    stand for the points that they are nearest to, and k-means++ picks `count` of them by that weight. Twice the count and five rounds
    are among what the source's experiments take; candidates that are too few all the same are filled up with random points.
    """
    points = check_points(points, "points")
    count = check_count(count, "count", len(points))
    check_positive(oversampling, "oversampling")
    check_count(rounds, "rounds")
    rng = np.random.default_rng(check_whole(seed, "seed"))
    candidates = Candidates(points)
    candidates.add(rng.integers(len(points), size=1))
    for _ in range(rounds):
        potential = candidates.squared.sum()
        candidates.add(np.flatnonzero(rng.random(len(points)) * potential < oversampling * count * candidates.squared))
    missing = count - len(candidates.chosen)
    if missing > 0:
        others = np.setdiff1d(np.arange(len(points)), candidates.chosen)
        candidates.add(rng.choice(others, missing, replace=False))
    weight = np.bincount(candidates.nearest, minlength=len(candidates.chosen))
    return kmeans_plus_plus(points[candidates.chosen], count, weight, seed=int(rng.integers(2**32)))


class Candidates:
    """Points that were chosen, and which of them is nearest to each point.

    chosen: (C,) indices of points, in the order added; squared: (N,) m^2 from each point to the nearest of them, and nearest: (N,) which
    of C that is (of several, the one added first).
    """

    def __init__(self, points: np.ndarray):
        self._points = points
        self.chosen = np.empty(0, np.int64)
        self.squared = np.full(len(points), np.inf)
        self.nearest = np.zeros(len(points), np.int64)

    def add(self, chosen: np.ndarray) -> None:
        """Choose more points: only distances to these are looked at."""
        if not len(chosen):
            return
        away, which = cKDTree(self._points[chosen]).query(self._points)
        closer = away**2 < self.squared
        self.squared[closer] = away[closer] ** 2
        self.nearest[closer] = which[closer] + len(self.chosen)
        self.chosen = np.append(self.chosen, chosen)
