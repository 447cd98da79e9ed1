"""Quick-Means: seeds spread regularly over a cloud, and overlapping clusters around them (paper III-A, Alg. 1; METHOD 2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from hilbertvae.checks import InputError, check_points, check_positive


@dataclass(frozen=True)
class Clusters:
    """seeds: (M, D) metres; members: flat indices of points, those of cluster m at `members[offsets[m]:offsets[m + 1]]`."""

    seeds: np.ndarray
    members: np.ndarray
    offsets: np.ndarray

    def __len__(self) -> int:
        return len(self.seeds)


def quick_means(
    points: np.ndarray, outer_radius_m: float, inner_radius_m: float, minimum_points: int = 1, seed: int = 0
) -> Clusters:
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
    balls = tree.query_ball_point(points[drawn], outer_radius_m, workers=-1, return_sorted=True)
    sizes = np.fromiter(map(len, balls), np.int64, len(balls))
    kept = np.flatnonzero(sizes > minimum_points)
    members = np.concatenate([np.asarray(balls[k], np.int64) for k in kept]) if len(kept) else np.empty(0, np.int64)
    return Clusters(points[drawn[kept]], members, np.concatenate([[0], np.cumsum(sizes[kept])]))


def _draw_seeds(tree: cKDTree, inner_radius_m: float, rng: np.random.Generator) -> np.ndarray:
    """Indices of points more than the inner radius apart, such that every point is within it of one of them."""
    consumed = np.zeros(tree.n, bool)
    drawn = []
    for candidate in rng.permutation(tree.n).tolist():
        if consumed[candidate]:
            continue
        drawn.append(candidate)
        consumed[tree.query_ball_point(tree.data[candidate], inner_radius_m)] = True
    return np.array(drawn)
