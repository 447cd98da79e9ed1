"""What was observed in each voxel, kept as counts, so that a reconstruction adds to it and never overwrites it."""

from __future__ import annotations

import itertools

import numpy as np

from hilbertvae.cloud import voxel_index


class Evidence:
    """Hits and frees per voxel of a cloud, looked up at any queries. Memory follows the voxels seen, not the extent."""

    def __init__(self, points: np.ndarray, occupied: np.ndarray, weight: np.ndarray, resolution_m: float):
        self.resolution_m = resolution_m
        index = voxel_index(points, resolution_m)
        # One voxel of margin on every side, so that a neighbour's key never wraps into another row.
        self.low = index.min(axis=0) - 1
        self.shape = index.max(axis=0) - self.low + 2
        key = self._key(index)
        self.keys, position = np.unique(key, return_inverse=True)
        self.hits = np.bincount(position, weights=weight * occupied, minlength=len(self.keys))
        self.frees = np.bincount(position, weights=weight * ~occupied, minlength=len(self.keys))

    def _key(self, index: np.ndarray) -> np.ndarray:
        return np.ravel_multi_index(tuple((index - self.low).T), tuple(self.shape))

    def find(self, queries: np.ndarray) -> np.ndarray:
        """(Q,) the number of the voxel that holds each query, -1 where none was seen."""
        index = voxel_index(queries, self.resolution_m)
        inside = ((index > self.low) & (index < self.low + self.shape - 1)).all(axis=1)
        found = np.full(len(queries), -1, np.int64)
        found[inside] = self._search(self._key(index[inside]))
        return found

    def _search(self, key: np.ndarray) -> np.ndarray:
        position = np.minimum(np.searchsorted(self.keys, key), len(self.keys) - 1)
        return np.where(self.keys[position] == key, position, -1)

    def around(self) -> tuple[np.ndarray, np.ndarray]:
        """(hits, frees), each (V,): sums over every seen voxel's neighbours in the block of 3^D, without itself."""
        strides = np.append(np.cumprod(self.shape[::-1])[::-1][1:], 1)
        hits, frees = np.zeros(len(self.keys)), np.zeros(len(self.keys))
        for step in itertools.product((-1, 0, 1), repeat=len(self.shape)):
            if any(step):
                found = self._search(self.keys + int(np.dot(step, strides)))
                hits += np.where(found >= 0, self.hits[found], 0)
                frees += np.where(found >= 0, self.frees[found], 0)
        return hits, frees

    def features(self) -> np.ndarray:
        """(V, 4) what the Hilbert Map is told of a seen voxel: the log-odds of its votes and of its neighbours', and how many each has."""
        hits, frees = self.around()
        own, around = np.log((self.hits + 0.5) / (self.frees + 0.5)), np.log((hits + 0.5) / (frees + 0.5))
        votes, votes_around = np.log1p(self.hits + self.frees), np.log1p(hits + frees)
        return np.stack([own, around, votes, votes_around], axis=1)
