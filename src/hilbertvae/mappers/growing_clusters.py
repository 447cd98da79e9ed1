"""Clusters and grids of a map that grows scan by scan: what a scan touches is found, and only that is made anew.

Quick-Means' rule holds for what is new: a return farther than the inner radius from every seed so far becomes a seed. A seed is a cluster
as soon as more than `minimum_points` returns lie within the outer radius.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from scipy.spatial import cKDTree

from hilbertvae.bucket_index import BucketIndex
from hilbertvae.checks import InputError
from hilbertvae.cloud import Cloud
from hilbertvae.clusters.clusters import Clusters, ball_sizes, search_tree
from hilbertvae.clusters.starts import quick_means_seeds
from hilbertvae.grids.aligned_grid import count_code, vote
from hilbertvae.grids.cluster_grids import GridSettings, frames_of
from hilbertvae.grids.frame import Frames, FrameSettings
from hilbertvae.mappers.evidence import Evidence
from hilbertvae.mappers.growing_array import GrowingArray, own_rows
from hilbertvae.reconstruction.completion import Completion

ON_VOXELS = FrameSettings(centre="seed", rotation="none", scale="fixed")
"""Frames whose boxes lie on the lattice."""

CompletedParts = Callable[[Callable[[Frames], Cloud], Frames], Iterator[tuple[slice, Completion]]]
"""(what gives the points around some frames, frames) -> (part of them, what a network makes of it), one part after the other."""


class GrowingClusters:
    """The clusters of `evidence`, which `add` adds to; `settle` makes anew the grids of those that have changed since.

    detailed: whether a network is shown grids as `bin_detailed` makes them, and not labels alone. seeds: (M, D) of the clusters that there
    are, with their frames and completed grids. small_seeds: (S, D) those with too few returns;
    unless given, they are drawn from the returns that lie within the inner radius of no seed.
    """

    def __init__(
        self,
        evidence: Evidence,
        grid: GridSettings,
        detailed: bool,
        draw: int,
        seeds: np.ndarray,
        frames: Frames,
        completed: Completion,
        small_seeds: np.ndarray | None = None,
    ):
        self.evidence, self.grid, self.detailed, self.draw = evidence, grid, detailed, draw
        self._seeds, self._centre, self._scale = GrowingArray(seeds), GrowingArray(frames.centre), GrowingArray(frames.scale)
        self._rotation = GrowingArray(np.array(frames.rotation))
        self._value = GrowingArray(completed.value)
        self._known = None if completed.known is None else GrowingArray(completed.known)
        self._stale = GrowingArray(np.zeros(len(seeds), bool))
        self.is_whole = True
        """False where `add` was ended half-way, for want of memory: what it did can't be taken back."""
        self.small_seeds = np.empty((0, seeds.shape[1])) if small_seeds is None else small_seeds
        if small_seeds is None and len(evidence):
            cloud = evidence.cloud()
            self._draw_seeds(cloud.points[cloud.occupied])

    @property
    def seeds(self) -> np.ndarray:
        return self._seeds.rows

    @property
    def frames(self) -> Frames:
        return Frames(self._centre.rows, self._rotation.rows, self._scale.rows)

    @property
    def completed(self) -> Completion:
        return Completion(self._value.rows, None if self._known is None else self._known.rows)

    @property
    def stale(self) -> np.ndarray:
        """(M,) bool: whether what each cluster's grid is made of has changed since it was made."""
        return self._stale.rows

    def add(self, cloud: Cloud) -> None:
        """Add a scan to the evidence, and find the clusters that it touches and makes, and their frames."""
        own_rows(self, self.evidence, self.evidence.bricks)
        self.is_whole = False
        try:
            rows, *before = self.evidence.add(cloud.points, cloud.occupied, cloud.weight)
        except InputError:  # refused before anything was altered
            self.is_whole = True
            raise
        hit = rows[self.evidence.hits[rows] > before[0]]
        if self._cell_is_voxel():
            after = self.evidence.hits[rows], self.evidence.frees[rows]
            changed = self._label(*before) != self._label(*after)
            if self.detailed:
                changed |= (after[0] > before[0]) | (count_code(after[1]) != count_code(before[1]))
            rows = rows[changed]
        touched = self._touched(rows)
        self.stale[touched] = True
        count = len(self.seeds)
        returns = self.evidence.returns(hit)
        if len(returns):
            self._draw_seeds(returns)
            self._promote(returns)
        moved = touched[:0] if self.grid.frame.from_seeds else touched
        self._find_frames(np.append(moved, np.arange(count, len(self.seeds))))
        self.is_whole = True

    def settle(self, completed_parts: CompletedParts, wanted: np.ndarray | None = None) -> None:
        """Make the stale clusters' grids from the evidence as it is now; of these only the `wanted (M,)`, if that is given."""
        stale = np.flatnonzero(self.stale if wanted is None else self.stale & wanted)
        if not len(stale):
            return
        own_rows(self, self.evidence, self.evidence.bricks)
        frames = Frames(self._centre.rows[stale], self._rotation.rows[stale], self._scale.rows[stale])
        for part, completed in completed_parts(lambda boxes: self.evidence.cloud(*boxes.boxes()), frames):
            self._value.rows[stale[part]] = completed.value
            if self._known is not None:
                self._known.rows[stale[part]] = completed.known
            self.stale[stale[part]] = False

    def _find_frames(self, chosen: np.ndarray) -> None:
        """Give the chosen clusters the frames that the evidence gives them."""
        if not len(chosen):
            return
        seeds, radius_m = self.seeds[chosen], self.grid.cluster_diameter_m / 2
        around = seeds[:0] if self.grid.frame.from_seeds else seeds
        cloud = self.evidence.cloud(around - radius_m, around + radius_m)
        frames = frames_of(Clusters(seeds, search_tree(cloud.points[cloud.occupied]), radius_m), cloud, self.grid)
        self._centre.rows[chosen], self._rotation.rows[chosen], self._scale.rows[chosen] = frames.centre, frames.rotation, frames.scale

    def _cell_is_voxel(self) -> bool:
        """Whether each cell of a grid is one voxel of the evidence: then a grid changes where a voxel's label does, and nowhere else."""
        grid = self.grid
        return grid.frame == ON_VOXELS and grid.cells % 2 == 0 and bool(np.isclose(grid.cell_m, self.evidence.resolution_m, rtol=1e-9))

    def _label(self, hits: np.ndarray, frees: np.ndarray) -> np.ndarray:
        return vote(hits.astype(np.float32), frees.astype(np.float32), self.grid.occupied_share)

    def _touched(self, rows: np.ndarray) -> np.ndarray:
        """The clusters in whose box one of the voxels `rows` lies; where frames follow their returns, also those in whose ball it may lie.

        Voxels are looked at brick by brick, by the box around those of one brick: a cluster too many costs time and changes nothing.
        """
        if not len(rows) or not len(self.seeds):
            return np.empty(0, np.int64)
        resolution_m, bricks = self.evidence.resolution_m, self.evidence.bricks
        place = np.sort(self.evidence.places[rows])
        index = bricks.indices(place)
        start = np.flatnonzero(np.diff(bricks.brick_of(place), prepend=-1))
        lowest, highest = np.minimum.reduceat(index, start), np.maximum.reduceat(index, start)
        # A quarter of a voxel is far more than rounding takes, and less than any part of a voxel in an aligned box.
        slack = 0.25 * resolution_m if self._cell_is_voxel() else -resolution_m
        lowest, highest = lowest * resolution_m + slack, (highest + 1) * resolution_m - slack
        low, high = self.frames.boxes()
        if not self.grid.frame.from_seeds:
            radius_m = self.grid.cluster_diameter_m / 2
            low, high = np.minimum(low, self.seeds - radius_m), np.maximum(high, self.seeds + radius_m)
        side_m = bricks.side * resolution_m
        near = np.flatnonzero(((low <= highest.max(axis=0)) & (high >= lowest.min(axis=0))).all(axis=1))
        box, brick = BucketIndex((lowest + highest) / 2, self.grid.cluster_diameter_m / 2).in_boxes(low[near] - side_m, high[near] + side_m)
        meets = ((lowest[brick] <= high[near][box]) & (highest[brick] >= low[near][box])).all(axis=1)
        return near[np.unique(box[meets])]

    def _draw_seeds(self, returns: np.ndarray) -> None:
        """Seeds of the `returns (R, D)` that no seed has within the inner radius, so that afterwards each return has one."""
        radius_m = self.grid.inner_radius_m
        seeds = np.concatenate([seeds[_within(seeds, returns, radius_m)] for seeds in (self.seeds, self.small_seeds)])
        alone = returns[cKDTree(seeds).query(returns)[0] > radius_m] if len(seeds) else returns
        if len(alone):
            # By place, and not in order of arrival, which a map that is saved forgets.
            alone = alone[np.lexsort(alone.T)]
            self.small_seeds = np.concatenate([self.small_seeds, quick_means_seeds(alone, radius_m, self.draw)])

    def _promote(self, returns: np.ndarray) -> None:
        """Make clusters of the small seeds that have got enough returns by the new ones, `returns (R, D)`."""
        radius_m = self.grid.cluster_diameter_m / 2
        near = _within(self.small_seeds, returns, radius_m)
        seeds = self.small_seeds[near]
        if not len(seeds):
            return
        cloud = self.evidence.cloud(seeds - radius_m, seeds + radius_m)
        grown = ball_sizes(search_tree(cloud.points[cloud.occupied]), seeds, radius_m) > self.grid.minimum_points
        new, near[near] = seeds[grown], grown
        self.small_seeds = self.small_seeds[~near]
        count, dimension = new.shape
        self._seeds.append(new)
        for rows, shape in ((self._centre, (dimension,)), (self._rotation, (dimension, dimension)), (self._scale, ())):
            rows.append(np.zeros((count, *shape)))
        for grids in (self._value, self._known):
            if grids is not None:
                grids.append(np.zeros((count, *grids.rows.shape[1:]), grids.rows.dtype))
        self._stale.append(np.ones(count, bool))


def _within(seeds: np.ndarray, returns: np.ndarray, radius_m: float) -> np.ndarray:
    """(S,) bool: the `seeds (S, D)` that lie in the box around `returns (R, D)`, widened by the radius."""
    return ((seeds >= returns.min(axis=0) - radius_m) & (seeds <= returns.max(axis=0) + radius_m)).all(axis=1)
