"""The map's lattice in blocks of voxels, held only where there is something, so that a long drive fits into memory; D is 2 or 3."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from hilbertvae.checks import InputError, check_points, check_positive
from hilbertvae.voxel_votes import FARTHEST, voxel_index

SIDE = {2: 256, 3: 32}
"""Voxels along a block's side, by dimension."""
POINTS_AT_ONCE = 1_000_000
MOST_BLOCKS = 4
"""Blocks that a reach may span, so that what is looked at around one stays small: 24 MB in 3D."""

Key = tuple[int, ...]
Blocks = dict[Key, np.ndarray]
"""By block (voxel index // side) an array of D axes, x first, each as long as a block's side."""


def by_block(index: np.ndarray) -> Iterator[tuple[Key, np.ndarray]]:
    """Each block's key and the rows (n,) of `index (N, D)` that lie in it."""
    if not len(index):
        return
    key = index // SIDE[index.shape[1]]
    low = key.min(axis=0)
    flat = np.ravel_multi_index(tuple((key - low).T), tuple(key.max(axis=0) - low + 1))
    order = np.argsort(flat, kind="stable")
    starts = np.flatnonzero(np.diff(flat[order], prepend=-1))
    for part in np.split(order, starts[1:]):
        yield tuple(key[part[0]].tolist()), part


def padded(blocks: Blocks, key: Key, before: int, after: int, fill) -> np.ndarray:
    """The block at `key` with so many voxels before and after it along each axis, of however many blocks; `fill` where there is none."""
    side, dimension = SIDE[len(key)], len(key)
    dtype = next(iter(blocks.values())).dtype if blocks else np.float32
    length = before + side + after
    whole = np.full((length,) * dimension, fill, dtype)
    first = {step: before + step * side for step in range(-math.ceil(before / side), math.ceil(after / side) + 1)}
    to = {step: slice(max(start, 0), start + side) for step, start in first.items()}
    taken = {step: slice(max(-start, 0), length - start) for step, start in first.items()}
    for step in product(first, repeat=dimension):
        block = blocks.get(tuple(int(k + s) for k, s in zip(key, step, strict=True)))
        if block is not None:
            whole[tuple(to[s] for s in step)] = block[tuple(taken[s] for s in step)]
    return whole


def longest_reach_m(resolution_m: float, dimension: int) -> float:
    """How far from points `NearVoxels` reaches at most, metres."""
    return MOST_BLOCKS * SIDE[dimension] * resolution_m


@dataclass(frozen=True)
class NearVoxels:
    """The voxels that are at most `reach` voxels from those of some points, along each axis.

    seen: blocks of bool, true at the points' own voxels; keys: the blocks that may hold a voxel, in order.
    """

    seen: Blocks
    reach: int
    keys: list[Key]

    @classmethod
    def of(cls, points: np.ndarray, resolution_m: float, reach_m: float | None) -> NearVoxels:
        """Around `points (N, D)` in metres; without a reach, the points' own voxels alone. Raises `InputError` for a reach beyond
        `longest_reach_m`, and for points too far from the origin."""
        points = check_points(points)
        dimension = points.shape[1]
        side = SIDE[dimension]
        check_positive(resolution_m, "resolution_m")
        reach = 0 if reach_m is None else int(np.ceil(check_positive(reach_m, "reach_m") / resolution_m - 1e-9))
        if reach > MOST_BLOCKS * side:
            most_m = longest_reach_m(resolution_m, dimension)
            raise InputError(f"reach_m: expected at most {MOST_BLOCKS * side} voxels, {most_m:g} m, got {reach_m:g} m")
        if np.abs(points).max() / resolution_m > FARTHEST or np.prod(np.ptp(points, axis=0) / (resolution_m * side) + 3) > 2**62:
            low, high = points.min(axis=0).tolist(), points.max(axis=0).tolist()
            raise InputError(f"points: {low} to {high} m is too large for voxels of {resolution_m} m; is there an outlier?")
        seen: Blocks = {}
        for start in range(0, len(points), POINTS_AT_ONCE):
            index = voxel_index(points[start : start + POINTS_AT_ONCE], resolution_m)
            for key, rows in by_block(index):
                if key not in seen:
                    seen[key] = np.zeros((side,) * dimension, bool)
                seen[key][tuple((index[rows] % side).T)] = True
        keys, blocks = set(seen), math.ceil(reach / side)
        for axis in range(dimension):
            keys = {(*key[:axis], key[axis] + step, *key[axis + 1 :]) for key in keys for step in range(-blocks, blocks + 1)}
        return cls(seen, reach, sorted(keys))

    def voxels(self, key: Key) -> np.ndarray:
        """(n, D) int64: places in the block at `key`, from its first voxel, in the order of an array's elements."""
        if not self.reach:
            return np.argwhere(self.seen[key])
        near = padded(self.seen, key, self.reach, self.reach, False)
        if not near.any():
            return np.empty((0, len(key)), np.int64)
        for _ in key:
            near = np.moveaxis(_any_of_next(near, 2 * self.reach + 1), 0, -1)
        return np.argwhere(near)

    def portions(self, at_once: int) -> Iterator[tuple[int, list[tuple[Key, np.ndarray]]]]:
        """How many blocks are done, and keys and voxels of the next ones that have any: just over `at_once` voxels at a time."""
        waiting: list[tuple[Key, np.ndarray]] = []
        held = 0
        for done, key in enumerate(self.keys, start=1):
            local = self.voxels(key)
            if len(local):
                waiting.append((key, local))
                held += len(local)
            if waiting and (held >= at_once or done == len(self.keys)):
                yield done, waiting
                waiting, held = [], 0


def _any_of_next(values: np.ndarray, count: int) -> np.ndarray:
    """Along the first axis, `count - 1` shorter: whether any of `count` bools from each on is true."""
    done = 1
    while done < count:
        step = min(done, count - done)
        values, done = values[:-step] | values[step:], done + step
    return values


def lattice_index(portion: list[tuple[Key, np.ndarray]]) -> np.ndarray:
    """(V, D) int64: the voxels of a portion on the map's lattice."""
    return np.concatenate([local + np.array(key) * SIDE[len(key)] for key, local in portion])
