"""A 3D map's answers on a sparse lattice: blocks of voxels, asked only near data, so that a long drive fits into memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy import ndimage

from hilbertvae.checks import InputError, check_points, check_positive
from hilbertvae.voxel_votes import voxel_index

BLOCK = 32
"""Voxels along a block's side."""
QUERIES_AT_ONCE = 1_000_000
REACH_M = 1.5
"""How far from data a map is asked unless told otherwise: over the middle of a gap of 2.5 m, not much further into the unknown."""

Predict = Callable[[np.ndarray], np.ndarray]
Blocks = dict[tuple[int, int, int], np.ndarray]


@dataclass(frozen=True)
class Field:
    """p(occupied) at the centres of voxels of the map's lattice.

    blocks: by block (voxel index // 32), (32, 32, 32) float32 over x, y, z; NaN where the map was not asked.
    resolution_m: the voxel's side.
    """

    blocks: Blocks
    resolution_m: float

    @classmethod
    def near(cls, predict: Predict, points: np.ndarray, resolution_m: float, reach_m: float = REACH_M) -> Field:
        """Ask at every voxel that is at most `reach_m` from a voxel of `points (N, 3)` along each axis.

        predict: (Q, 3) metres -> (Q,) p(occupied). Raises `InputError` for points that are not 3D, or a reach of more than 32 voxels.
        """
        check_points(points, "points", dimension=3)
        reach = int(np.ceil(check_positive(reach_m, "reach_m") / check_positive(resolution_m, "resolution_m") - 1e-9))
        if reach > BLOCK:
            raise InputError(f"reach_m: expected at most {BLOCK} voxels, {BLOCK * resolution_m:g} m, got {reach_m:g} m")
        data = _marked(voxel_index(points, resolution_m))
        around = {tuple(np.add(key, step)) for key in data for step in product((-1, 0, 1), repeat=3)}
        blocks: Blocks = {}
        waiting: list[tuple[tuple, np.ndarray]] = []
        for key in sorted(around):
            near = padded(data, key, reach, reach, False)
            for axis in range(3):
                near = ndimage.maximum_filter1d(near, 2 * reach + 1, axis=axis, mode="constant")
            near = near[reach : reach + BLOCK, reach : reach + BLOCK, reach : reach + BLOCK]
            if near.any():
                waiting.append((key, np.argwhere(near)))
            if sum(len(local) for _, local in waiting) >= QUERIES_AT_ONCE:
                blocks |= _asked(predict, waiting, resolution_m)
                waiting = []
        return cls(blocks | _asked(predict, waiting, resolution_m), resolution_m)

    def above(self, cut: float) -> tuple[np.ndarray, np.ndarray]:
        """(V, 3) metres and (V,): the centres of voxels with p > `cut`, and their p."""
        centres, values = [np.empty((0, 3))], [np.empty(0, np.float32)]
        for key, block in self.blocks.items():
            local = np.argwhere(block > cut)
            centres.append((local + np.array(key) * BLOCK + 0.5) * self.resolution_m)
            values.append(block[tuple(local.T)])
        return np.concatenate(centres), np.concatenate(values).astype(np.float64)


def padded(blocks: Blocks, key: tuple, before: int, after: int, fill) -> np.ndarray:
    """The block at `key` with so many voxels of its neighbours before and after it along each axis, `fill` where there is no block."""
    dtype = next(iter(blocks.values())).dtype if blocks else np.float32
    whole = np.full((before + BLOCK + after,) * 3, fill, dtype)
    to = {-1: slice(0, before), 0: slice(before, before + BLOCK), 1: slice(before + BLOCK, None)}
    taken = {-1: slice(BLOCK - before, None), 0: slice(None), 1: slice(0, after)}
    for step in product((-1, 0, 1), repeat=3):
        block = blocks.get(tuple(int(k + s) for k, s in zip(key, step, strict=True)))
        if block is not None:
            whole[tuple(to[s] for s in step)] = block[tuple(taken[s] for s in step)]
    return whole


def _marked(index: np.ndarray) -> Blocks:
    """Blocks of bool that are true at `index (N, 3)`."""
    blocks: Blocks = {}
    for key, local in _by_block(index):
        block = blocks[key] = np.zeros((BLOCK,) * 3, bool)
        block[tuple(local.T)] = True
    return blocks


def _by_block(index: np.ndarray) -> Iterator[tuple[tuple, np.ndarray]]:
    """Each block's key and the (n, 3) places in it that `index` names."""
    key = index // BLOCK
    low = key.min(axis=0)
    flat = np.ravel_multi_index(tuple((key - low).T), tuple(key.max(axis=0) - low + 1))
    order = np.argsort(flat, kind="stable")
    starts = np.flatnonzero(np.diff(flat[order], prepend=-1))
    for part in np.split(order, starts[1:]):
        yield tuple(key[part[0]].tolist()), index[part] % BLOCK


def _asked(predict: Predict, waiting: list[tuple[tuple, np.ndarray]], resolution_m: float) -> Blocks:
    """Blocks with the answers at the places that wait, from one call."""
    if not waiting:
        return {}
    queries = np.concatenate([local + np.array(key) * BLOCK for key, local in waiting])
    answers = np.asarray(predict((queries + 0.5) * resolution_m))
    if answers.shape != (len(queries),):
        raise InputError(f"predict: expected an answer of shape ({len(queries)},), one per query, got {answers.shape}")
    blocks: Blocks = {}
    parts = np.split(answers, np.cumsum([len(local) for _, local in waiting])[:-1])
    for (key, local), part in zip(waiting, parts, strict=True):
        block = blocks[tuple(int(k) for k in key)] = np.full((BLOCK,) * 3, np.nan, np.float32)
        block[tuple(local.T)] = part
    return blocks
