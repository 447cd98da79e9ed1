"""Quick-Means: seeds spread regularly over a cloud, and overlapping clusters around them (paper III-A, Alg. 1; METHOD 2)."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from hilbertvae.checks import InputError, check_points, check_positive, check_whole
from hilbertvae.clusters.clusters import Clusters, ball_sizes, flat, search_tree
from hilbertvae.cores import cores

LIVE_AT_ONCE = 1024
"""About so many live points of the walk are looked at together; the stretch of walk that holds them grows as points are consumed."""
LONGEST = 64
"""Times `LIVE_AT_ONCE`: a stretch is no longer than that, however few of its points should be live."""
MANY_POINTS = 10**6
"""From so many points on, a ball of the walk costs reads from memory rather than from the processor's cache."""


def check_radii(outer_radius_m: float, inner_radius_m: float, minimum_points: int) -> None:
    """An `InputError` that names the one which makes no clusters."""
    check_positive(outer_radius_m, "outer_radius_m")
    check_positive(inner_radius_m, "inner_radius_m")
    check_whole(minimum_points, "minimum_points")
    if inner_radius_m > outer_radius_m:
        raise InputError(f"inner_radius_m: expected at most outer_radius_m ({outer_radius_m}), got {inner_radius_m}")


def quick_means(points: np.ndarray, outer_radius_m: float, inner_radius_m: float, minimum_points: int = 1, seed: int = 0) -> Clusters:
    """Clusters of `points (N, D)`: each is a seed point and everything within the outer radius, so clusters overlap.

    Alg. 1 draws live points at random; walking one random permutation and skipping points already consumed follows the same law
    of seeds and needs no index bookkeeping. A drawn point consumes the live points within the inner radius, and becomes a cluster
    if its outer ball, over all points, has more than `minimum_points` members.
    """
    points = check_points(points, "points")
    check_radii(outer_radius_m, inner_radius_m, minimum_points)
    check_whole(seed, "seed")
    tree = search_tree(points)
    drawn, inner_sizes = _draw_seeds(tree, inner_radius_m, np.random.default_rng(seed))
    kept = inner_sizes > minimum_points  # an outer ball has no fewer points than the inner one, so only the others are counted
    kept[~kept] = ball_sizes(tree, points[drawn[~kept]], outer_radius_m) > minimum_points
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
            workers = cores() if tree.n >= MANY_POINTS else 1
            balls = tree.query_ball_point(tree.data[drawn[-1]], inner_radius_m, return_sorted=False, workers=workers)
            consumed[flat(balls)] = True
            sizes += map(len, balls)
    return np.concatenate(drawn), np.array(sizes)


def _first_come(points: np.ndarray, radius_m: float) -> np.ndarray:
    """(N,) bool: those of `points (N, D)` that no earlier one which is itself chosen has within the radius."""
    beaten = np.zeros(len(points), bool)
    earlier, later = cKDTree(points).query_pairs(radius_m, output_type="ndarray").T
    # Rounds (Blelloch, Fineman and Shun, 2012): who has none before it that may still be chosen is, and beats those after it.
    while len(later):
        waits = np.zeros(len(points), bool)
        waits[later] = True
        first = ~waits[earlier]
        beaten[later[first]] = True
        open_ = ~(first | beaten[earlier] | beaten[later])
        earlier, later = earlier[open_], later[open_]
    return ~beaten
