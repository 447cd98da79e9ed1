"""ASK-Means (Guizilini & Ramos, AAAI 2017; METHOD 2): seeds far from each other, as many as a distance threshold asks for."""

from __future__ import annotations

import numpy as np

from hilbertvae.checks import check_count, check_points, check_positive, check_whole
from hilbertvae.clusters.clusters import search_tree

CANDIDATES = 5
"""Points drawn for each seed, of which the farthest wins; the source is not at hand, so the number is ours."""
TRIES = 128
"""Points looked at in one go to draw candidates from: of uniform points in a square, about one in three is drawn."""


def ask_means(points: np.ndarray, threshold_m: float, candidates: int = CANDIDATES, seed: int = 0) -> np.ndarray:
    """(M, D) seeds among `points (N, D)`, metres, in the order in which they were picked.

    The first is a random point. For each other one `candidates` points are drawn from the pool, each with a probability in proportion to
    its squared distance to the nearest seed so far, and the farthest of them wins. Points closer to a seed than the threshold leave the
    pool, and an empty pool ends it: seeds are at least the threshold apart, and every point is closer to one than that.
    """
    points = check_points(points, "points")
    check_positive(threshold_m, "threshold_m")
    check_count(candidates, "candidates")
    rng = np.random.default_rng(check_whole(seed, "seed"))
    pool = Pool(points, threshold_m)
    seeds = [int(rng.integers(len(points)))]
    pool.take(seeds[0])
    while pool.left:
        drawn = pool.draw(candidates, rng)
        seeds.append(int(drawn[pool.squared[drawn].argmax()]))
        pool.take(seeds[-1])
    return points[seeds]


class Pool:
    """Points that no seed has within the threshold, and how far each is from its nearest seed.

    squared: (N,) m^2 to the nearest seed, 0 for points that left. Squared distances only ever fall, so the largest one that was
    ever seen, the bound, holds for good: a new seed changes nothing beyond its root, and draws may be rejected by it. It is found anew, and
    those that left are put away, once as many points were looked at as that takes.
    """

    def __init__(self, points: np.ndarray, threshold_m: float):
        self._points, self._tree = points, search_tree(points)
        self._closest = threshold_m**2
        self.squared = np.full(len(points), np.inf)
        self.left = len(points)
        self._live, self._bound, self._looked_at = np.arange(len(points)), np.inf, 0

    def take(self, seed: int) -> None:
        """Make the point of that index a seed."""
        near = self._live
        if np.isfinite(self._bound):
            reach = np.sqrt(self._bound) * (1 + 1e-9)
            near = np.array(self._tree.query_ball_point(self._points[seed], reach, return_sorted=False))
        before = self.squared[near]
        after = np.minimum(before, np.square(self._points[near] - self._points[seed]).sum(axis=1))
        after[after < self._closest] = 0.0
        self.squared[near] = after
        self.left -= np.count_nonzero(before) - np.count_nonzero(after)
        self._looked_at += len(near)
        if self._looked_at > len(self._live):
            self._put_away()

    def draw(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """(count,) indices of points in the pool, each drawn on its own by its share of the sum of squared distances."""
        tries = self._live[rng.integers(len(self._live), size=TRIES)]
        drawn = tries[rng.random(TRIES) * self._bound < self.squared[tries]][:count]
        if len(drawn) == count:
            return drawn
        self._put_away()
        total = np.cumsum(self.squared[self._live])
        place = np.searchsorted(total, rng.random(count - len(drawn)) * total[-1], side="right")
        return np.append(drawn, self._live[np.minimum(place, len(total) - 1)])

    def _put_away(self) -> None:
        self._live = self._live[self.squared[self._live] > 0]
        self._bound = self.squared[self._live].max(initial=0.0)
        self._looked_at = 0
