"""Aligned grids: a cluster's points, binned in its frame (paper III-A; METHOD 3).

Points are moved into the frame and binned once, there; a grid is never rotated as a grid.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from hilbertvae.bucket_index import BucketIndex
from hilbertvae.cloud import Cloud
from hilbertvae.grids.frame import Frames

FREE, UNKNOWN, OCCUPIED = -1, 0, 1
PLACE_STEPS = 240
"""Steps in a cell's side, by which places in it are kept: all of them fit in an int8."""
COUNT_STEPS = 12
"""Steps in which counts are kept for each power of e."""
SLACK = 1e-9
"""Of a cell: keeps points on a lattice plane, such as voxel centres of an aligned box, from falling a cell short by rounding."""
CELLS_AT_ONCE = 2**18
"""Cells counted at a time: few enough that they and their points stay in the processor's cache. Changes no number."""


def bin_points(cloud: Cloud, frames: Frames, cells: int) -> tuple[np.ndarray, np.ndarray]:
    """(hits, frees), each (M, cells, ..., cells) float32: the summed weights of the occupied and free points in each cell.

    Axis d of a grid is axis d of the frame; cell i of it covers [i / cells - 1/2, (i + 1) / cells - 1/2).
    """
    shape = (len(frames), *(cells,) * frames.centre.shape[1])
    hits, frees = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    for chosen, *counts in bin_portions(cloud, frames, cells):
        hits[chosen], frees[chosen] = counts
    return hits, frees


def bin_portions(cloud: Cloud, frames: Frames, cells: int) -> Iterator[tuple[slice, np.ndarray, np.ndarray]]:
    """`bin_points` for some frames after the other, (frames, hits, frees), so that the counts of all never lie in memory at once."""
    count, dimension = frames.centre.shape
    if not len(cloud) or not count:
        return
    size = cells**dimension
    for chosen, box, point, cell in _members(cloud, frames, cells):
        grids = chosen.stop - chosen.start
        flat = (cloud.occupied[point] * grids + box) * size + cell
        portion = np.bincount(flat, weights=cloud.weight[point], minlength=2 * grids * size)
        frees, hits = portion.astype(np.float32).reshape(2, -1, *(cells,) * dimension)
        yield chosen, hits, frees


def bin_places(cloud: Cloud, frames: Frames, cells: int) -> np.ndarray:
    """int8 (M, D, cells, ..., cells): where in each cell its points lie, on average by weight, from the cell's middle along each axis of
    the frame, in `PLACE_STEPS`ths of a cell; 0 in empty cells."""
    count, dimension = frames.centre.shape
    places = np.zeros((count, dimension, cells**dimension), np.int8)
    if not len(cloud) or not count:
        return places.reshape(count, dimension, *(cells,) * dimension)
    for chosen, box, point, cell in _members(cloud, frames, cells):
        flat, weight = box * cells**dimension + cell, cloud.weight[point]
        length = (chosen.stop - chosen.start) * cells**dimension
        total = np.maximum(np.bincount(flat, weights=weight, minlength=length), 1e-9)
        within = (frames.into(cloud.points[point], box + chosen.start) + 0.5) * cells + SLACK
        within -= np.floor(within) + 0.5
        for axis, moved in enumerate(within.T):
            mean = np.bincount(flat, weights=weight * moved, minlength=length) / total
            places[chosen, axis] = np.round(PLACE_STEPS * mean).reshape(-1, cells**dimension)
    return places.reshape(count, dimension, *(cells,) * dimension)


def _members(cloud: Cloud, frames: Frames, cells: int) -> Iterator[tuple[slice, np.ndarray, np.ndarray, np.ndarray]]:
    """(frames, box, point, cell) for some frames after the other: which points lie in which box of these, and in which cell of it."""
    at_once = max(1, CELLS_AT_ONCE // cells ** frames.centre.shape[1])
    index = BucketIndex(cloud.points, float(np.median(frames.scale)) / 4)
    low, high = frames.boxes()
    for start in range(0, len(frames), at_once):
        chosen = slice(start, min(start + at_once, len(frames)))
        box, point = index.in_boxes(low[chosen], high[chosen])
        cell, inside = cell_index(frames, cloud.points[point], box + start, cells)
        yield chosen, box[inside], point[inside], cell[inside]


def cell_index(frames: Frames, points: np.ndarray, frame: np.ndarray, cells: int) -> tuple[np.ndarray, np.ndarray]:
    """The flat cell (P,) that holds each point in the grid of its frame, and whether the box holds it at all (P,) bool."""
    flat, inside = np.zeros(len(points), np.int64), np.ones(len(points), bool)
    for axis in frames.into(points, frame).T:
        cell = np.floor((axis + 0.5) * cells + SLACK).astype(np.int64)
        inside &= (cell >= 0) & (cell < cells)
        flat = flat * cells + cell
    return flat, inside


def vote(hits: np.ndarray, frees: np.ndarray, occupied_share: float = 0.5) -> np.ndarray:
    """int8 grids: occupied where hits are at least `occupied_share` of the votes, free elsewhere, unknown without votes.

    0.5 is the paper's majority (ties go to occupied); 0.15 is the rule of the `voxels` cloud, which keeps walls that beams graze.
    """
    total = hits + frees
    # A quotient, as in the `voxels` cloud: in float32 a product misses ties, such as 3 of 20 votes at 0.15.
    found = np.divide(hits, total, out=np.zeros_like(total), where=total > 0)
    return np.where(total == 0, UNKNOWN, np.where(found >= occupied_share, OCCUPIED, FREE)).astype(np.int8)


def count_code(votes: np.ndarray) -> np.ndarray:
    """int8 codes of counts, finer where few votes tell more: round(12 log(1 + votes)), at most 127, from 39 000 votes on."""
    return np.minimum(np.round(COUNT_STEPS * np.log1p(votes)), 127).astype(np.int8)


def share(hits: np.ndarray, frees: np.ndarray) -> np.ndarray:
    """uint8 grids of the occupied share (the paper's footnote 1): 0 unknown, else 1 + round(254 hits / votes)."""
    total = hits + frees
    return np.where(total == 0, 0, 1 + np.round(254 * hits / np.maximum(total, 1e-9))).astype(np.uint8)
