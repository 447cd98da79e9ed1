"""Aligned grids: a cluster's points, binned in its frame (paper III-A; METHOD 3).

Points are moved into the frame and binned once, there; a grid is never rotated as a grid.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from hilbertvae.bucket_index import BucketIndex
from hilbertvae.cloud import Cloud
from hilbertvae.cores import on_all_cores
from hilbertvae.grids.frame import Frames

FREE, UNKNOWN, OCCUPIED = -1, 0, 1
PLACE_STEPS = 240
"""Steps in a cell's side, by which places in it are kept: all of them fit in an int8."""
COUNT_STEPS = 12
"""Steps in which counts are kept for each power of e."""
SLACK = 1e-6
"""Of a cell: keeps points on a lattice plane, such as voxel centres of an aligned box, from falling a cell short by rounding, also where
coordinates are those of a map grid (4e6 m are told apart to 5e-10 m)."""
MOST_WEIGHT = 1e30
"""What a point counts for at most: sums of larger weights would be no numbers in single precision, and cells of theirs free."""
CELLS_AT_ONCE, POINTS_AT_ONCE = 2**18, 2**20
"""Cells counted at a time, few enough that they and their points stay in the processor's cache, and points looked at for them, which are
many where voxels are finer than cells. Change no number."""
LARGE = 8
"""From how many times the size of most boxes on the largest has a say in that of buckets: beside clusters of returns that coincide, whose
boxes are of a millimetre, it would be made of more than can be looked up."""


class IndexedCloud:
    """A cloud whose points in boxes of about `side_m` are found without a look at all others: made once for many frames, it spares a
    sort of all points for each binning."""

    def __init__(self, cloud: Cloud, side_m: float):
        self.cloud = cloud
        self.index = BucketIndex(cloud.points, side_m / 4)

    def __len__(self) -> int:
        return len(self.cloud)

    @classmethod
    def around(cls, cloud: Cloud | IndexedCloud, frames: Frames) -> IndexedCloud:
        """That cloud, for boxes of these frames: for most of them, unless the others are `LARGE`."""
        if isinstance(cloud, IndexedCloud):
            return cloud
        return cls(cloud, max(float(np.median(frames.scale)), float(frames.scale.max()) / LARGE))


class Members(NamedTuple):
    """frames: some that follow each other. box, point, cell: (P,) which points of the cloud lie in which of these, counted from their
    first, and in which cell of its grid."""

    frames: slice
    box: np.ndarray
    point: np.ndarray
    cell: np.ndarray

    def count(self) -> int:
        """How many frames there are."""
        return self.frames.stop - self.frames.start


def bin_points(cloud: Cloud | IndexedCloud, frames: Frames, cells: int) -> tuple[np.ndarray, np.ndarray]:
    """(hits, frees), each (M, cells, ..., cells) float32: the summed weights of the occupied and free points in each cell.

    Axis d of a grid is axis d of the frame; cell i of it covers [i / cells - 1/2, (i + 1) / cells - 1/2).
    """
    shape = (len(frames), *(cells,) * frames.centre.shape[1])
    hits, frees = np.zeros(shape, np.float32), np.zeros(shape, np.float32)

    def put(found: Members, of: Cloud) -> None:
        hits[found.frames], frees[found.frames] = count_votes(of, found, shape[1:])

    bin_members(put, cloud, frames, cells)
    return hits, frees


def bin_places(cloud: Cloud | IndexedCloud, frames: Frames, cells: int) -> np.ndarray:
    """int8 (M, D, cells, ..., cells): where in each cell its returns lie (`mean_places`)."""
    dimension = frames.centre.shape[1]
    places = np.zeros((len(frames), dimension, *(cells,) * dimension), np.int8)

    def put(found: Members, of: Cloud) -> None:
        places[found.frames] = mean_places(of, frames, found, cells)

    bin_members(put, cloud, frames, cells)
    return places


def bin_members(put: Callable[[Members, Cloud], None], cloud: Cloud | IndexedCloud, frames: Frames, cells: int) -> None:
    """Call `put` with the points in the boxes of some frames after the other, and the cloud that they are of: few enough at a time to
    stay in the processor's cache, on all cores. Without points it is not called."""
    if not len(cloud) or not len(frames):
        return
    cloud = IndexedCloud.around(cloud, frames)
    at_once = max(1, CELLS_AT_ONCE // cells ** frames.centre.shape[1])
    low, high = frames.boxes()
    slack = 2 * SLACK / cells * frames.scale[:, None]  # `cell_index` decides about points on a box's side
    low, high = low - slack, high + slack

    def part(start: int) -> None:
        some = slice(start, min(start + at_once, len(frames)))
        for boxes, box, point in cloud.index.in_portions(low[some], high[some], POINTS_AT_ONCE):
            chosen = slice(start + boxes.start, start + boxes.stop)
            cell, inside = cell_index(frames, cloud.cloud.points[point], box + start, cells)
            put(Members(chosen, box[inside] - boxes.start, point[inside], cell[inside]), cloud.cloud)

    on_all_cores(part, range(0, len(frames), at_once))


def count_votes(cloud: Cloud, found: Members, shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """(hits, frees), each (B, *shape) float32, as of `bin_points`, of the frames found."""
    grids, size = found.count(), int(np.prod(shape))
    flat = (cloud.occupied[found.point] * grids + found.box) * size + found.cell
    portion = np.bincount(flat, weights=np.minimum(cloud.weight[found.point], MOST_WEIGHT), minlength=2 * grids * size)
    frees, hits = portion.astype(np.float32).reshape(2, grids, *shape)
    return hits, frees


def mean_places(cloud: Cloud, frames: Frames, found: Members, cells: int) -> np.ndarray:
    """int8 (B, D, cells, ..., cells): where in each cell its returns lie, on average by weight, from the cell's middle along each axis of
    the frame, in `PLACE_STEPS`ths of a cell; 0 in cells without."""
    dimension = frames.centre.shape[1]
    returns = np.flatnonzero(cloud.occupied[found.point])
    box, point, length = found.box[returns], found.point[returns], found.count() * cells**dimension
    flat, weight = box * cells**dimension + found.cell[returns], np.minimum(cloud.weight[point], MOST_WEIGHT)
    total = np.maximum(np.bincount(flat, weights=weight, minlength=length), 1e-9)
    within = (frames.into(cloud.points[point], box + found.frames.start) + 0.5) * cells
    within -= np.floor(within + SLACK) + 0.5
    sums = [np.bincount(flat, weights=weight * moved, minlength=length) for moved in within.T]
    means = np.stack([np.round(PLACE_STEPS * total_moved / total) for total_moved in sums])
    return means.astype(np.int8).reshape(dimension, found.count(), *(cells,) * dimension).swapaxes(0, 1)


def cell_index(frames: Frames, points: np.ndarray, frame: np.ndarray, cells: int, held: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """The flat cell (P,) that holds each point in the grid of its frame, and whether the box holds it at all (P,) bool.

    held: each box is known to hold its point; one as near to the upper side as rounding goes is in the last cell, not in the next box's.
    """
    flat, inside = np.zeros(len(points), np.int64), np.ones(len(points), bool)
    for axis in frames.into(points, frame).T:
        cell = np.floor((axis + 0.5) * cells + SLACK).astype(np.int64)
        if held:
            np.clip(cell, 0, cells - 1, out=cell)
        inside &= (cell >= 0) & (cell < cells)
        flat = flat * cells + cell
    return flat, inside


def vote(hits: np.ndarray, frees: np.ndarray, occupied_share: float = 0.5) -> np.ndarray:
    """int8 grids: occupied where hits are at least `occupied_share` of the votes, free elsewhere, unknown without votes.

    0.5 is the paper's majority (ties go to occupied); 0.15 is the rule of the `voxels` cloud, which keeps walls that beams graze.
    """
    total = hits + frees
    # A quotient, as in the `voxels` cloud: in float32 a product misses ties, such as 3 of 20 votes at 0.15.
    found = np.divide(hits, total, out=np.zeros_like(total, dtype=np.result_type(total, np.float16)), where=total > 0)
    return np.where(total == 0, UNKNOWN, np.where(found >= occupied_share, OCCUPIED, FREE)).astype(np.int8)


def count_code(votes: np.ndarray) -> np.ndarray:
    """int8 codes of counts, finer where few votes tell more: round(12 log(1 + votes)), at most 127, from 39 000 votes on."""
    return np.minimum(np.round(COUNT_STEPS * np.log1p(votes)), 127).astype(np.int8)
