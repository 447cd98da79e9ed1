"""Aligned grids: a cluster's points, binned in its frame (paper III-A; METHOD 3).

Points are moved into the frame and binned once, there; a grid is never rotated as a grid.
"""

from __future__ import annotations

import numpy as np

from hilbertvae.bucket_index import BucketIndex
from hilbertvae.cloud import Cloud
from hilbertvae.grids.frame import Frames

FREE, UNKNOWN, OCCUPIED = -1, 0, 1
FRAMES_AT_ONCE = 256


def bin_points(cloud: Cloud, frames: Frames, cells: int) -> tuple[np.ndarray, np.ndarray]:
    """(hits, frees), each (M, cells, ..., cells) float32: the summed weights of the occupied and free points in each cell.

    Axis d of a grid is axis d of the frame; cell i of it covers [i / cells - 1/2, (i + 1) / cells - 1/2).
    """
    count, dimension = frames.centre.shape
    size = cells**dimension
    counts = np.zeros((2, count, size), np.float32)
    if not len(cloud) or not count:
        return counts[0].reshape(count, *(cells,) * dimension), counts[1].reshape(count, *(cells,) * dimension)
    index = BucketIndex(cloud.points, float(np.median(frames.scale)) / 4)
    low, high = frames.boxes()
    for start in range(0, count, FRAMES_AT_ONCE):
        chosen = slice(start, min(start + FRAMES_AT_ONCE, count))
        box, point = index.in_boxes(low[chosen], high[chosen])
        cell, inside = cell_index(frames, cloud.points[point], box + start, cells)
        flat = (cloud.occupied[point] * (chosen.stop - start) + box)[inside] * size + cell[inside]
        portion = np.bincount(flat, weights=cloud.weight[point[inside]], minlength=2 * (chosen.stop - start) * size)
        counts[:, chosen] = portion.reshape(2, -1, size)
    frees, hits = counts.reshape(2, count, *(cells,) * dimension)
    return hits, frees


def cell_index(frames: Frames, points: np.ndarray, frame: np.ndarray, cells: int) -> tuple[np.ndarray, np.ndarray]:
    """The flat cell (P,) that holds each point in the grid of its frame, and whether the box holds it at all (P,) bool."""
    dimension = points.shape[1]
    # The slack keeps points on a lattice plane, such as voxel centres of an aligned box, from falling a cell short by rounding.
    cell = np.floor((frames.into(points, frame) + 0.5) * cells + 1e-9).astype(np.int64)
    inside = ((cell >= 0) & (cell < cells)).all(axis=1)
    flat = cell[:, 0]
    for d in range(1, dimension):
        flat = flat * cells + cell[:, d]
    return flat, inside


def vote(hits: np.ndarray, frees: np.ndarray, occupied_share: float = 0.5) -> np.ndarray:
    """int8 grids: occupied where hits are at least `occupied_share` of the votes, free elsewhere, unknown without votes.

    0.5 is the paper's majority (ties go to occupied); 0.15 is the rule of the `voxels` cloud, which keeps walls that beams graze.
    """
    total = hits + frees
    return np.where(total == 0, UNKNOWN, np.where(hits >= occupied_share * total, OCCUPIED, FREE)).astype(np.int8)


def share(hits: np.ndarray, frees: np.ndarray) -> np.ndarray:
    """uint8 grids of the occupied share (the paper's footnote 1): 0 unknown, else 1 + round(254 hits / votes)."""
    total = hits + frees
    return np.where(total == 0, 0, 1 + np.round(254 * hits / np.maximum(total, 1e-9))).astype(np.uint8)
