"""A 3D map's answers on a sparse lattice: blocks of voxels, asked only near data, so that a long drive fits into memory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hilbertvae.checks import InputError, check_points
from hilbertvae.voxel_blocks import SIDE, Blocks, Key, NearVoxels, lattice_index

BLOCK = SIDE[3]
"""Voxels along a block's side."""
QUERIES_AT_ONCE = 1_000_000
REACH_M = 1.5
"""How far from data a map is asked unless told otherwise: over the middle of a gap of 2.5 m, not much further into the unknown."""

Predict = Callable[[np.ndarray], np.ndarray]


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

        predict: (Q, 3) metres -> (Q,) p(occupied). Raises `InputError` for points that are not 3D, or a reach of more than 128 voxels.
        """
        check_points(points, "points", dimension=3)
        blocks: Blocks = {}
        for _, portion in NearVoxels.of(points, resolution_m, reach_m).portions(QUERIES_AT_ONCE):
            blocks |= _asked(predict, portion, resolution_m)
        return cls(blocks, resolution_m)

    def above(self, cut: float) -> tuple[np.ndarray, np.ndarray]:
        """(V, 3) metres and (V,): the centres of voxels with p > `cut`, and their p."""
        centres, values = [np.empty((0, 3))], [np.empty(0, np.float32)]
        for key, block in self.blocks.items():
            local = np.argwhere(block > cut)
            centres.append((local + np.array(key) * BLOCK + 0.5) * self.resolution_m)
            values.append(block[tuple(local.T)])
        return np.concatenate(centres), np.concatenate(values).astype(np.float64)


def answers(predict: Predict, queries: np.ndarray) -> np.ndarray:
    """(Q,) what `predict` says of `queries (Q, D)`; an `InputError` if that is not one number per query."""
    found = np.asarray(predict(queries))
    if found.shape != (len(queries),):
        raise InputError(f"predict: expected an answer of shape ({len(queries)},), one per query, got {found.shape}")
    return found


def _asked(predict: Predict, portion: list[tuple[Key, np.ndarray]], resolution_m: float) -> Blocks:
    """Blocks with the answers at the voxels of a portion, from one call."""
    found = answers(predict, (lattice_index(portion) + 0.5) * resolution_m)
    blocks: Blocks = {}
    parts = np.split(found, np.cumsum([len(local) for _, local in portion])[:-1])
    for (key, local), part in zip(portion, parts, strict=True):
        block = blocks[key] = np.full((BLOCK,) * 3, np.nan, np.float32)
        block[tuple(local.T)] = part
    return blocks
