"""Quick-Means: seeds spread regularly over a cloud, and overlapping clusters around them (paper III-A, Alg. 1; METHOD 2)."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain

import numpy as np
from scipy.spatial import cKDTree

from hilbertvae.checks import InputError, check_points, check_positive

STRIDE = 4096
"""Points of the walk that are checked for being consumed at once, before each is by itself."""
SEEDS_AT_ONCE = 4096


@dataclass(frozen=True)
class Clusters:
    """seeds: (M, D) metres; members: flat indices of points, those of cluster m at `members[offsets[m]:offsets[m + 1]]`."""

    seeds: np.ndarray
    members: np.ndarray
    offsets: np.ndarray

    def __len__(self) -> int:
        return len(self.seeds)


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
    tree = cKDTree(points, balanced_tree=False, compact_nodes=False)
    drawn = _draw_seeds(tree, inner_radius_m, np.random.default_rng(seed))
    members, sizes = _balls(tree, points[drawn], outer_radius_m)
    kept = sizes > minimum_points
    return Clusters(points[drawn[kept]], members[np.repeat(kept, sizes)], np.concatenate([[0], np.cumsum(sizes[kept])]))


def _draw_seeds(tree: cKDTree, inner_radius_m: float, rng: np.random.Generator) -> np.ndarray:
    """Indices of points more than the inner radius apart, such that every point is within it of one of them."""
    consumed = np.zeros(tree.n, bool)
    walk = rng.permutation(tree.n)
    drawn = []
    for start in range(0, tree.n, STRIDE):
        stretch = walk[start : start + STRIDE]
        for candidate in stretch[~consumed[stretch]].tolist():
            if consumed[candidate]:
                continue
            drawn.append(candidate)
            consumed[tree.query_ball_point(tree.data[candidate], inner_radius_m)] = True
    return np.array(drawn)


def _balls(tree: cKDTree, seeds: np.ndarray, radius_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Which points lie within the radius of each of `seeds (M, D)`: flat indices (P,), ascending in each ball, and sizes (M,).

    Some seeds at a time: the tree answers in lists, which take many times the memory of the numbers in them.
    """
    members, sizes = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    for start in range(0, len(seeds), SEEDS_AT_ONCE):
        balls = tree.query_ball_point(seeds[start : start + SEEDS_AT_ONCE], radius_m, workers=-1, return_sorted=True)
        sizes.append(np.fromiter(map(len, balls), np.int64, len(balls)))
        members.append(np.fromiter(chain.from_iterable(balls), np.int64, sizes[-1].sum()))
    return np.concatenate(members), np.concatenate(sizes)
