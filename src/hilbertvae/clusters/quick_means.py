"""Quick-Means: seeds spread regularly over a cloud, and overlapping clusters around them (paper III-A, Alg. 1; METHOD 2)."""

from __future__ import annotations

from functools import cached_property
from itertools import chain

import numpy as np
from scipy.spatial import cKDTree

from hilbertvae.checks import InputError, check_points, check_positive

LIVE_AT_ONCE = 1024
"""About so many live points of the walk are looked at together; the stretch of walk that holds them grows as points are consumed."""
LONGEST = 64
"""Times `LIVE_AT_ONCE`: a stretch is no longer than that, however few of its points should be live."""
SEEDS_AT_ONCE = 4096
MANY_POINTS = 10**6
"""From so many points on, a ball of the walk costs reads from memory rather than from the processor's cache."""


class Clusters:
    """seeds: (M, D) metres; len() is M.

    Which points are theirs is laid out when first asked for: a frame that only needs the seed never does.
    """

    def __init__(self, seeds: np.ndarray, tree: cKDTree, outer_radius_m: float):
        self.seeds, self._tree, self._outer_radius_m = seeds, tree, outer_radius_m

    def __len__(self) -> int:
        return len(self.seeds)

    @cached_property
    def sizes(self) -> np.ndarray:
        """(M,) how many points each has."""
        return _ball_sizes(self._tree, self.seeds, self._outer_radius_m)

    @cached_property
    def offsets(self) -> np.ndarray:
        """(M + 1,) where the points of each cluster start in `members`, and where the last one's end."""
        return np.concatenate([[0], np.cumsum(self.sizes)])

    @cached_property
    def members(self) -> np.ndarray:
        """(P,) flat indices of points, those of cluster m at `members[offsets[m]:offsets[m + 1]]`, ascending."""
        return _balls(self._tree, self.seeds, self._outer_radius_m)


def quick_means(points: np.ndarray, outer_radius_m: float, inner_radius_m: float, minimum_points: int = 1, seed: int = 0) -> Clusters:
    """Clusters of `points (N, D)`: each is a seed point and everything within the outer radius, so clusters overlap.

    Alg. 1 draws live points at random; walking one random permutation and skipping points already consumed follows the same law
    of seeds and needs no index bookkeeping. A drawn point consumes the live points within the inner radius, and becomes a cluster
    if its outer ball, over all points, has more than `minimum_points` members.
    """
    points = check_points(points, "points")
    check_positive(outer_radius_m, "outer_radius_m")
    check_positive(inner_radius_m, "inner_radius_m")
    if inner_radius_m > outer_radius_m:
        raise InputError(f"inner_radius_m: expected at most outer_radius_m ({outer_radius_m}), got {inner_radius_m}")
    tree = cKDTree(points, leafsize=32, balanced_tree=False, compact_nodes=False)
    drawn, inner_sizes = _draw_seeds(tree, inner_radius_m, np.random.default_rng(seed))
    kept = inner_sizes > minimum_points  # an outer ball has no fewer points than the inner one, so only the others are counted
    kept[~kept] = _ball_sizes(tree, points[drawn[~kept]], outer_radius_m) > minimum_points
    return Clusters(points[drawn[kept]], tree, outer_radius_m)


def _draw_seeds(tree: cKDTree, inner_radius_m: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Indices of points more than the inner radius apart, such that every point is within it of one of them, and how many are."""
    consumed = np.zeros(tree.n, bool)
    walk = rng.permutation(tree.n)
    drawn, sizes = [], []
    start, length = 0, LIVE_AT_ONCE
    while start < tree.n:
        stretch = walk[start : start + length]
        live = stretch[~consumed[stretch]]
        start += length
        length = int(LIVE_AT_ONCE * min(LONGEST, len(stretch) / max(len(live), 1)))
        if len(live):
            drawn.append(live[_first_come(tree.data[live], inner_radius_m)])
            # In a small tree, starting threads would take longer than finding these few balls.
            workers = -1 if tree.n >= MANY_POINTS else 1
            balls = tree.query_ball_point(tree.data[drawn[-1]], inner_radius_m, return_sorted=False, workers=workers)
            consumed[_flat(balls)] = True
            sizes += map(len, balls)
    return np.concatenate(drawn), np.array(sizes)


def _first_come(points: np.ndarray, radius_m: float) -> np.ndarray:
    """(N,) bool: those of `points (N, D)` that no earlier one which is itself chosen has within the radius."""
    chosen = np.ones(len(points), bool)
    pairs = cKDTree(points).query_pairs(radius_m, output_type="ndarray")
    # In order of the earlier point: when its pairs come up, it has been decided whether it is chosen.
    for earlier, later in pairs[np.lexsort(pairs.T[::-1])].tolist():
        if chosen[earlier]:
            chosen[later] = False
    return chosen


def _ball_sizes(tree: cKDTree, centres: np.ndarray, radius_m: float) -> np.ndarray:
    """(M,) how many points lie within the radius of each of `centres (M, D)`."""
    sizes = np.zeros(len(centres), np.int64)
    if len(centres):
        near = cKDTree(centres).indices  # centre after centre nearby, so that what one ball reads is still in the cache for the next
        sizes[near] = tree.query_ball_point(centres[near], radius_m, workers=-1, return_length=True)
    return sizes


def _balls(tree: cKDTree, centres: np.ndarray, radius_m: float) -> np.ndarray:
    """(P,) which points lie within the radius of each of `centres (M, D)`, ball after ball, ascending in each.

    Some balls at a time: the tree answers in lists, which take many times the memory of the numbers in them.
    """
    members = [np.empty(0, np.int64)]
    for start in range(0, len(centres), SEEDS_AT_ONCE):
        balls = tree.query_ball_point(centres[start : start + SEEDS_AT_ONCE], radius_m, workers=-1, return_sorted=True)
        members.append(_flat(balls))
    return np.concatenate(members)


def _flat(balls: np.ndarray) -> np.ndarray:
    """The numbers in the tree's lists, one list after the other."""
    return np.fromiter(chain.from_iterable(balls), np.int64, sum(map(len, balls)))
