"""The local ground of a 3D site: what most of a street is, so that scores can be split into what lies on it and what stands on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt, grey_opening, median_filter, uniform_filter
from scipy.spatial import cKDTree

from hilbertvae.checks import InputError, check_points
from hilbertvae.voxel_blocks import SIDE, by_block

TILE_M = 0.5
LOWEST_SHARE = 0.1
"""The height of a tile is that of its returns which has so many below it; a few returns of every site lie underground, by reflection."""
WIDEST_OBJECT_M = 4.0
"""Whatever is narrower in one direction, a car or a van, stands on the ground and is no part of it."""
ABOVE_GROUND_M = 0.4
"""From this height on a point is above ground (METHOD 7)."""
MOST_TILES = 2**26
BLOCK_M, MARGIN_M = SIDE[2] * TILE_M, 16.0
"""Of wide maps the ground is found a block at a time, with what lies around it: nothing farther off has a say in it."""
WIDE_TILES = 2**20
"""So many tiles, half a kilometre in square, are no wide map yet."""


@dataclass(frozen=True)
class Ground:
    """low: (2,) metres, a corner of the tiles; height_m: (X, Y) of the ground in the middle of each."""

    low: np.ndarray
    height_m: np.ndarray

    def height_above(self, points: np.ndarray) -> np.ndarray:
        """(Q,) metres of `points (Q, 3)` above the ground of their tile; beyond the tiles, above that of the nearest one."""
        tile = np.floor((points[:, :2] - self.low) / TILE_M).astype(np.int64)
        return points[:, 2] - self.height_m[tuple(np.clip(tile, 0, np.array(self.height_m.shape) - 1).T)]


def find_ground(returns: np.ndarray) -> Ground:
    """The ground below `returns (N, 3)`, metres, z up.

    Low returns of each tile, opened as an image (Serra 1982): what a square of `WIDEST_OBJECT_M` does not fit into is taken away, and
    slopes stay where they are. Tiles without returns take the nearest one's height. Raises `InputError` for no points, or not 3D.
    """
    returns = check_points(returns, "returns", dimension=3)
    low = returns[:, :2].min(axis=0)
    with np.errstate(over="ignore"):
        extent = returns[:, :2].max(axis=0) - low
        tiles = np.prod(extent / TILE_M + 1)
    if tiles > MOST_TILES:  # whole numbers would wrap
        raise InputError(f"returns: extent {extent.tolist()} m is too large for tiles of {TILE_M} m; is there an outlier?")
    tile = np.floor((returns[:, :2] - low) / TILE_M).astype(np.int64)
    shape = tile.max(axis=0) + 1
    key = np.ravel_multi_index(tuple(tile.T), tuple(shape))
    order = np.lexsort([returns[:, 2], key])
    found, start, count = np.unique(key[order], return_index=True, return_counts=True)
    lowest = returns[order[start + (LOWEST_SHARE * count).astype(np.int64)], 2]
    height = np.full(shape.prod(), np.nan)
    height[found] = lowest
    height = height.reshape(shape)
    nearest = distance_transform_edt(np.isnan(height), return_distances=False, return_indices=True)
    size = 2 * round(WIDEST_OBJECT_M / TILE_M / 2) + 1
    level = median_filter(height[tuple(nearest)], 3, mode="nearest")  # where a tile has few returns, one underground makes a pit
    opened = grey_opening(level, size=(size, size), mode="nearest")
    return Ground(low, uniform_filter(opened, 3, mode="nearest"))


@dataclass(frozen=True)
class BlockGround:
    """key: (B, 2) whole numbers, the blocks of `by_block` that have a ground; parts: theirs."""

    key: np.ndarray
    parts: list[Ground]

    def height_above(self, points: np.ndarray) -> np.ndarray:
        """(Q,) metres of `points (Q, 3)` above the ground of their block, or of the nearest one."""
        _, block = cKDTree(self.key + 0.5).query(points[:, :2] / BLOCK_M)
        height = np.empty(len(points))
        for number in np.unique(block):
            chosen = block == number
            height[chosen] = self.parts[number].height_above(points[chosen])
        return height


def find_wide_ground(returns: np.ndarray) -> Ground | BlockGround:
    """As `find_ground`, of returns that may lie kilometres apart: it costs what they cover, not the rectangle around them."""
    returns = check_points(returns, "returns", dimension=3)
    with np.errstate(over="ignore"):
        wide = np.prod(np.ptp(returns[:, :2], axis=0) / TILE_M + 1) > WIDE_TILES
    if not wide:
        return find_ground(returns)
    rows, parts = dict(by_block(np.floor(returns[:, :2] / TILE_M).astype(np.int64))), []
    for x, y in rows:
        beside = [(x + dx, y + dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1)]
        near = returns[np.concatenate([rows[key] for key in beside if key in rows])]
        from_middle = near[:, :2] - (np.array([x, y]) + 0.5) * BLOCK_M
        parts.append(find_ground(near[(np.abs(from_middle) <= BLOCK_M / 2 + MARGIN_M).all(axis=1)]))
    return BlockGround(np.array(list(rows)), parts)
