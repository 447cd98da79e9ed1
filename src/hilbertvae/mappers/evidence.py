"""What was observed in each voxel, kept as counts and mean positions, so that a reconstruction adds to it and never overwrites it."""

from __future__ import annotations

from threading import Lock

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.cloud import Cloud
from hilbertvae.mappers.growing_array import GrowingArray
from hilbertvae.mappers.nearness import SEEN_NEAR_M, Nearness
from hilbertvae.mappers.vote_share import SHARES, share_features
from hilbertvae.mappers.voxel_bricks import NONE, VoxelBricks
from hilbertvae.sums import sums_by
from hilbertvae.voxel_votes import MARGIN, voxel_floor, voxel_index

FAR_VOXELS = 2.0
"""Distances are cut off here: the block of neighbours that is searched reaches no farther."""
NEAREST_HITS = 3
HEAVIEST = 1e12  # of a point's weight: sums of votes lose what is so much less
BRICKS_AT_ONCE = 64
"""Few enough that their votes stay in the processor's cache. Changes no number."""

_ONE_AT_A_TIME = Lock()


class Evidence:
    """Hits and frees per voxel of a cloud, looked up at any queries. Memory follows the voxels seen, not the extent.

    A voxel's votes say how often a beam ended in it; where in the voxel its returns lie says more: a wall is a line through it, and a
    query on that line is a wall's while its neighbour 5 cm beside it is not. On csail's held-out beams the distances took P / R at the
    cut from 0.966 / 0.962 to 0.971 / 0.976, where the best vote of a voxel reaches 0.958 / 0.988.

    hits, frees: (V + 1,) summed weights; hit_mean, free_mean: for each axis (V + 1,) float32, mean positions in voxels from a voxel's lower
    corner, so that large coordinates cost no digits. Row 0 stands for all voxels never seen: no votes, and infinitely far.
    """

    _near, _looked_at = None, 0  # of the class, too: older pickles have neither

    def __init__(self, points: np.ndarray, occupied: np.ndarray, weight: np.ndarray, resolution_m: float):
        self.resolution_m = resolution_m
        self.dimension = dimension = points.shape[1]
        self.bricks = VoxelBricks(dimension)
        self._brick_m = self.bricks.side * resolution_m
        self._place, self._features = GrowingArray(np.zeros(1, np.int64)), GrowingArray(np.zeros((1, 4)))
        self._hits, self._frees = GrowingArray(np.zeros(1)), GrowingArray(np.zeros(1))
        self._hit_mean, self._free_mean = ([GrowingArray(np.full(1, np.inf, np.float32)) for _ in range(dimension)] for _ in range(2))
        if len(points):
            self.add(points, occupied, weight)

    @classmethod
    def of_voxels(cls, index, hits, frees, hit_mean, free_mean, resolution_m: float) -> Evidence:
        """Evidence with the votes `hits`, `frees (V,)` of the voxels `index (V, D)`, each of which is there once.

        hit_mean, free_mean: (., D) float32, of those voxels that have some. Raises `InputError` for voxels too far apart, or there twice.
        """
        nothing = np.empty(0)
        made = cls(np.empty((0, index.shape[1])), nothing.astype(bool), nothing, resolution_m)
        if not len(index):
            return made
        row, fresh = made.bricks.add(index)
        if len(fresh) < len(row):
            raise InputError("expected each voxel once")
        made._make_room(fresh)
        for votes, mean, given, places in ((made.hits, made.hit_mean, hits, hit_mean), (made.frees, made.free_mean, frees, free_mean)):
            votes[row] = given
            for axis, place in zip(mean, places.T, strict=True):
                axis[row[given > 0]] = place
        made._find_features(np.arange(len(made.bricks.corners)))
        return made

    def __len__(self) -> int:
        """How many voxels were seen."""
        return self.bricks.count

    @property
    def hits(self) -> np.ndarray:
        return self._hits.rows

    @property
    def frees(self) -> np.ndarray:
        return self._frees.rows

    @property
    def hit_mean(self) -> list[np.ndarray]:
        return [axis.rows for axis in self._hit_mean]

    @property
    def free_mean(self) -> list[np.ndarray]:
        return [axis.rows for axis in self._free_mean]

    @property
    def places(self) -> np.ndarray:
        """(V + 1,) where each voxel lies in `bricks`; that of row 0 means nothing."""
        return self._place.rows

    @property
    def feature_count(self) -> int:
        """How many features a query in a seen voxel has."""
        return self._features.rows.shape[1] + 2 * NEAREST_HITS + 3 + SHARES

    def add(self, points: np.ndarray, occupied: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Add a cloud at the cost of what it touches: counts add up, and mean positions go by count.

        Returns the rows (T,) of the voxels in which it lies, and which hits and frees (T,) each had before. Raises `InputError`, and adds
        nothing, for points that lie too far from the others, and weights above `HEAVIEST`.
        """
        if (heaviest := weight.max(initial=0)) > HEAVIEST:
            raise InputError(f"sample_weight: expected at most {HEAVIEST:g}, got {heaviest:g}")
        index = voxel_index(points, self.resolution_m)
        try:
            row, fresh = self.bricks.add(index)
        except InputError as error:
            every = np.vstack([points, *(self.bounds() if len(self) else ())])
            extent = f"extent {np.ptp(every, axis=0).tolist()} m"
            raise InputError(f"points: {extent} is too large for voxels of {self.resolution_m} m; is there an outlier?") from error
        self._make_room(fresh)
        touched, position = np.unique(row, return_inverse=True)
        before = self.hits[touched], self.frees[touched]
        local = points / self.resolution_m - index
        for votes, mean, counted in ((self.hits, self.hit_mean, occupied), (self.frees, self.free_mean, ~occupied)):
            if counted.any():
                _merge(votes, mean, touched, position[counted], weight[counted], local[counted])
        self._find_features(self.bricks.with_voxels(self.places[touched]))
        if len(fresh) or ((before[0] == 0) & (self.hits[touched] > 0)).any():
            self._near, self._looked_at = None, 0
        return touched, *before

    def _make_room(self, places: np.ndarray) -> None:
        count = len(places)
        self._place.append(places)
        for votes in (self._hits, self._frees):
            votes.append(np.zeros(count))
        for mean in (*self._hit_mean, *self._free_mean):
            mean.append(np.full(count, np.inf, np.float32))
        self._features.append(np.zeros((count, 4)))

    def _find_features(self, bricks: np.ndarray) -> None:
        """Of the voxels in `bricks`: the log-odds of a voxel's votes and of its neighbours', and how many each has."""
        inner, *parts = self.bricks.parts()
        for start in range(0, len(bricks), BRICKS_AT_ONCE):
            # Bricks along the last axis: numpy is slow where that is short.
            block = np.moveaxis(self.bricks.blocks[bricks[start : start + BRICKS_AT_ONCE]], 0, -1).copy()
            seen = block[inner] > 0
            rows, around = block[inner][seen], []
            for votes in (self.hits, self.frees):
                dense, total = votes.take(block), np.zeros(seen.shape)
                for part in parts:
                    total += dense[part]
                around.append(total[seen])
            for column, (hits, frees) in enumerate(((self.hits[rows], self.frees[rows]), around)):
                self._features.rows[rows, column] = np.log((hits + 0.5) / (frees + 0.5))
                self._features.rows[rows, column + 2] = np.log1p(hits + frees)

    def find(self, queries: np.ndarray) -> np.ndarray:
        """(Q,) the row of the voxel that holds each query, -1 where none was seen."""
        if not len(self):
            return np.full(len(queries), NONE)
        place = self.bricks.places(voxel_index(queries, self.resolution_m))
        row = np.where(place == NONE, 0, self.bricks.numbers[np.maximum(place, 0)])
        return np.where(row == 0, NONE, row)

    def away(self, queries: np.ndarray) -> np.ndarray:
        """`Nearness.away` of (Q, D) queries; infinite where nothing was seen at all."""
        return self._nearness(queries).away(queries) if len(self) and len(queries) else np.full(len(queries), np.inf)

    def _nearness(self, queries: np.ndarray) -> Nearness:
        """Made by one of the threads that ask: of what lies around `queries (Q, D)`, so that few don't wait for all of a large map that has
        changed; of all once half of it was looked at since."""
        with _ONE_AT_A_TIME:
            if self._near is None:
                corners = self.bricks.corners * self._brick_m
                low, high = queries.min(axis=0) - SEEN_NEAR_M - self._brick_m, queries.max(axis=0) + SEEN_NEAR_M
                around = np.flatnonzero(((corners >= low) & (corners <= high)).all(axis=1))
                self._looked_at += len(around) + 1 + len(corners) // 50  # to look for them takes time, too
                if 2 * self._looked_at <= len(corners):
                    return self._near_in(around)
                self._near = self._near_in(np.arange(len(corners)))
            return self._near

    def _near_in(self, bricks: np.ndarray) -> Nearness:
        rows, index = self.bricks.voxels(bricks)
        middles = (index + 0.5) * self.resolution_m
        return Nearness(middles, self.hits[rows] > 0, (self.bricks.corners[bricks] + 0.5) * self._brick_m, self._brick_m)

    def features(self, queries: np.ndarray, voxel: np.ndarray) -> np.ndarray:
        """(Q, F) what the Hilbert Map is told of `queries (Q, D)` in the seen voxels `voxel (Q,)`.

        The voxel's own features, then distances in voxels, cut off: to the three nearest mean returns of the block, also cut off at one
        voxel, to the nearest mean free point, and the square of the nearest of each; last the voxel's `share_features`.
        """
        local = queries / self.resolution_m
        local = (local - voxel_floor(local)).astype(np.float32)
        block = self.bricks.numbers.take(self.places[voxel][:, None] + self.bricks.steps).astype(np.intp)
        hit, free = np.zeros(block.shape, np.float32), np.zeros(block.shape, np.float32)
        # One axis at a time: numpy is slow where the last axis is short.
        for axis, move in enumerate(self.bricks.moves.T.astype(np.float32)):
            toward = local[:, axis, None] - move
            for squared, mean in ((hit, self.hit_mean), (free, self.free_mean)):
                away = mean[axis].take(block)
                away -= toward
                away *= away
                squared += away
        hit.sort(axis=1)
        hit = np.minimum(np.sqrt(hit[:, :NEAREST_HITS]), FAR_VOXELS)
        free = np.minimum(np.sqrt(free.min(axis=1, keepdims=True)), FAR_VOXELS)
        shares = share_features(self.hits[voxel], self.frees[voxel])
        return np.hstack([self._features.rows[voxel], hit, np.minimum(hit, 1.0), free, hit[:, :1] ** 2, free**2, shares])

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """(low (D,), high (D,)) metres, of the bricks that hold all that was seen."""
        corners = self.bricks.corners
        return corners.min(axis=0) * self._brick_m, (corners.max(axis=0) + 1) * self._brick_m

    def returns(self, rows: np.ndarray) -> np.ndarray:
        """(R, D) metres: the mean returns of the voxels `rows (R,)`, which have some."""
        mean = np.stack([axis[rows] for axis in self.hit_mean], axis=1)
        return (self.bricks.indices(self.places[rows]) + mean.astype(float)) * self.resolution_m

    def point_count(self) -> int:
        """How many points the cloud of all that was observed has."""
        return int(np.count_nonzero(self.hits) + np.count_nonzero(self.frees))

    def cloud(self, low: np.ndarray | None = None, high: np.ndarray | None = None) -> Cloud:
        """All that was observed, or that in the boxes from `low (B, D)` to `high (B, D)`, metres, and some of what lies beside them.

        At most one point per voxel and label, at the mean of what was added."""
        near = None if low is None else (voxel_index(low, self.resolution_m), voxel_index(high, self.resolution_m))
        rows, index = self.bricks.voxels(None if near is None else self.bricks.meeting(*near))
        hit, free = self.hits[rows] > 0, self.frees[rows] > 0
        means = [np.stack([axis[rows] for axis in mean], axis=1).astype(float) for mean in (self.hit_mean, self.free_mean)]
        points = [(index + mean)[some] for some, mean in zip((hit, free), means, strict=True)]
        return Cloud(
            np.concatenate(points) * self.resolution_m,
            np.arange(len(points[0]) + len(points[1])) < len(points[0]),
            np.concatenate([self.hits[rows[hit]], self.frees[rows[free]]]),
        )


def _merge(votes: np.ndarray, mean: list[np.ndarray], touched, position, weight, local) -> None:
    """Add points of one label, in the voxels `touched[position]`, to the votes and means of these, in place."""
    added = np.bincount(position, weights=weight, minlength=len(touched))
    some = np.flatnonzero(added > 0)
    rows, added = touched[some], added[some]
    old = votes[rows]
    votes[rows] = total = old + added
    for sums, axis in zip(sums_by(position, local, len(touched), weight)[some].T, mean, strict=True):
        sums += old * np.where(old > 0, axis[rows], 0.0)
        axis[rows] = np.clip(sums / total, MARGIN, 1 - MARGIN)
