"""Clusters: seeds, and everything within the outer radius of each, so that clusters overlap (paper III-A; METHOD 0)."""

from __future__ import annotations

from functools import cached_property
from itertools import chain

import numpy as np
from scipy.spatial import cKDTree

from hilbertvae.cores import cores
from hilbertvae.portions import portions

SEEDS_AT_ONCE, MEMBERS_AT_ONCE = 4096, 2**20
"""Balls, and points in them, that the tree lists at a time: its lists take many times the memory of the numbers in them."""


class Clusters:
    """seeds: (M, D) metres; len() is M.

    Which points are theirs is laid out when first asked for: a frame that only needs the seed never does.
    """

    def __init__(self, seeds: np.ndarray, tree: cKDTree, outer_radius_m: float):
        self.seeds, self._tree, self._outer_radius_m = seeds, tree, outer_radius_m

    def __len__(self) -> int:
        return len(self.seeds)

    def select(self, chosen: slice | np.ndarray) -> Clusters:
        """The clusters at `chosen`."""
        some = Clusters(self.seeds[chosen], self._tree, self._outer_radius_m)
        if "sizes" in self.__dict__:  # counted already
            some.sizes = self.sizes[chosen]
        return some

    @cached_property
    def sizes(self) -> np.ndarray:
        """(M,) how many points each has."""
        return ball_sizes(self._tree, self.seeds, self._outer_radius_m)

    @cached_property
    def offsets(self) -> np.ndarray:
        """(M + 1,) where the points of each cluster start in `members`, and where the last one's end."""
        return np.concatenate([[0], np.cumsum(self.sizes)])

    @cached_property
    def members(self) -> np.ndarray:
        """(P,) flat indices of points, those of cluster m at `members[offsets[m]:offsets[m + 1]]`, ascending."""
        members = np.empty(self.offsets[-1], np.int64)
        for some in portions(self.offsets, SEEDS_AT_ONCE, MEMBERS_AT_ONCE):
            balls = self._tree.query_ball_point(self.seeds[some], self._outer_radius_m, workers=cores(), return_sorted=True)
            members[self.offsets[some.start] : self.offsets[some.stop]] = flat(balls)
        return members

    @property
    def numbers(self) -> np.ndarray:
        """(P,) the number of the cluster that each of `members` is in."""
        return np.repeat(np.arange(len(self)), np.diff(self.offsets))


def search_tree(points: np.ndarray) -> cKDTree:
    """A tree over `points (N, D)` for radius searches: of plain halves, which are the quickest to build."""
    return cKDTree(points, leafsize=32, balanced_tree=False, compact_nodes=False)


def clusters_around(points: np.ndarray, seeds: np.ndarray, outer_radius_m: float, minimum_points: int) -> Clusters:
    """The clusters of `points (N, D)` around those `seeds (M, D)` that have more than `minimum_points` within the outer radius."""
    tree = search_tree(points)
    return Clusters(seeds[ball_sizes(tree, seeds, outer_radius_m) > minimum_points], tree, outer_radius_m)


def ball_sizes(tree: cKDTree, centres: np.ndarray, radius_m: float) -> np.ndarray:
    """(M,) how many points lie within the radius of each of `centres (M, D)`."""
    sizes = np.zeros(len(centres), np.int64)
    if len(centres):
        near = cKDTree(centres).indices  # centre after centre nearby, so that what one ball reads is still in the cache for the next
        sizes[near] = tree.query_ball_point(centres[near], radius_m, workers=cores(), return_length=True)
    return sizes


def flat(balls: np.ndarray) -> np.ndarray:
    """The numbers in the tree's lists, one list after the other."""
    return np.fromiter(chain.from_iterable(balls), np.int64, sum(map(len, balls)))
