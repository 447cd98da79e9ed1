"""Which points lie in which boxes, for many boxes at once.

Points are sorted into cubic buckets. The buckets of one row (all but the last axis fixed) are one run of the sorted points, so a box
is a few runs, found by bisection and laid out with `repeat`: no Python loop over boxes or points.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from hilbertvae.portions import portions


class BucketIndex:
    """Search structure over `points (N, D)` with buckets of `size_m`; about half the size of the boxes asked for is a good choice."""

    def __init__(self, points: np.ndarray, size_m: float):
        self.size_m = size_m
        self.points = points
        self.low = points.min(axis=0) if len(points) else np.zeros(points.shape[1])
        bucket = self._bucket(points)
        self.shape = bucket.max(axis=0) + 1 if len(points) else np.ones(points.shape[1], np.int64)
        key = np.ravel_multi_index(tuple(bucket.T), tuple(self.shape))
        self.order = _narrow(np.argsort(key, kind="stable"), len(points))
        self.keys = _narrow(key[self.order], int(np.prod(self.shape)))

    def _bucket(self, points: np.ndarray) -> np.ndarray:
        return np.floor((points - self.low) / self.size_m).astype(np.int64)

    def in_boxes(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pairs (box (P,), point (P,)) with `low[box] <= points[point] <= high[box]`, sorted by box. low, high: (B, D) metres."""
        return self._inside(*self._runs(low, high), low, high)

    def in_portions(self, low: np.ndarray, high: np.ndarray, most: int) -> Iterator[tuple[slice, np.ndarray, np.ndarray]]:
        """(boxes, box (P,), point (P,)): the pairs of `in_boxes`, some boxes after the other: as many at a time as have at most `most`
        points to look at, or one."""
        start, end, box = self._runs(low, high)
        first = np.searchsorted(box, np.arange(len(low) + 1))
        looked_at = np.concatenate([[0], np.cumsum(end - start)])[first]
        for boxes in portions(looked_at, len(low), most):
            runs = slice(first[boxes.start], first[boxes.stop])
            yield boxes, *self._inside(start[runs], end[runs], box[runs], low, high)

    def _runs(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Runs of the sorted points, (R,) where each starts, where it ends, and in which box it may lie, sorted by box."""
        first = np.clip(self._bucket(low), 0, self.shape)
        last = np.clip(self._bucket(high), -1, self.shape - 1)
        rows = (last - first + 1)[:, :-1].max(axis=0, initial=0)
        starts, ends, boxes = [], [], []
        for step in itertools.product(*(range(max(count, 0)) for count in rows)):
            row = first[:, :-1] + np.array(step, np.int64)
            box = np.flatnonzero((row <= last[:, :-1]).all(axis=1) & (first <= last).all(axis=1))
            key = np.ravel_multi_index((*row[box].T, first[box, -1]), tuple(self.shape))
            of = self.keys.dtype  # another's would have all keys copied
            starts.append(np.searchsorted(self.keys, key.astype(of), "left"))
            ends.append(np.searchsorted(self.keys, (key + (last - first)[box, -1]).astype(of), "right"))
            boxes.append(box)
        if not boxes:
            return np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0, np.int64)
        start, end, box = np.concatenate(starts), np.concatenate(ends), np.concatenate(boxes)
        by_box = np.argsort(box, kind="stable")
        return start[by_box], end[by_box], box[by_box]

    def _inside(
        self, start: np.ndarray, end: np.ndarray, box: np.ndarray, low: np.ndarray, high: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """The pairs of a box and a point in it, of these runs."""
        count = end - start
        box = np.repeat(box, count)
        position = np.arange(len(box)) - np.repeat(np.cumsum(count) - count, count) + np.repeat(start, count)
        point = self.order[position]
        inside = np.ones(len(point), bool)
        for axis, lowest, highest in zip(self.points.T, low.T, high.T, strict=True):  # numpy is slow where the last axis is short
            place = axis[point]
            inside &= (place >= lowest[box]) & (place <= highest[box])
        return box[inside], point[inside]


def _narrow(numbers: np.ndarray, end: int) -> np.ndarray:
    """`numbers` from 0 to below `end` in as few bytes as hold them: of 2e7 points an index is kept while a network completes their map."""
    return numbers.astype(np.int32) if end <= np.iinfo(np.int32).max else numbers
