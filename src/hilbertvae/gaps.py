"""Gaps: balls of a site that no method is shown before scoring (paper IV, METHOD 7)."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from hilbertvae.bucket_index import BucketIndex
from hilbertvae.checks import InputError, check_cell_m, check_positive, check_whole
from hilbertvae.cloud import Cloud
from hilbertvae.voxel_votes import voxel_index

LEAST_SHARE, MOST_SHARE = 0.10, 0.15
"""Balls are added until at least the first share of the points is gone, and none that would take more than the second."""
HOPELESS = 500
"""After so many balls of which none could be cut, none will be; each try of a large one counts most of the site's points."""
MOST_RASTER_CELLS = 1 << 24
"""Of a raster that is kept whole; where balls lie farther apart its cells are looked up one by one, which takes longer."""
INSIDE, OUTSIDE, RIM = 1, 0, -1


class NoRoom(InputError):
    """A site from which no gap can be cut."""


@dataclass(frozen=True)
class Gaps:
    """Balls that lie apart. centres: (G, D) metres; radius_m: (G,); resolution_m: the voxels that decide what is inside; share: of the
    points that they were cut from, how many are gone, if that is known; rim: whether voxels that a surface cuts belong to neither part
    (METHOD 7), or their middles decide."""

    centres: np.ndarray
    radius_m: np.ndarray
    resolution_m: float
    share: float = math.nan
    rim: bool = True

    def part(self, points: np.ndarray) -> np.ndarray:
        """(N,) int8 per point: `INSIDE` if its voxel lies wholly in a ball, `RIM` if a ball's surface cuts it, else `OUTSIDE`; without a
        `rim`, `INSIDE` if the middle of its voxel lies in a ball.

        The voxel decides, not the point, so that the same balls cut all clouds alike, and a thinned point, the mean of samples
        anywhere in its voxel, can't carry a removed sample out of the gap.
        """
        point, _, inside, cut = self._touched(points)
        part = np.zeros(len(points), np.int8)
        part[point[cut]] = RIM
        part[point[inside]] = INSIDE
        return part

    def gap_of(self, points: np.ndarray) -> np.ndarray:
        """(N,) int64: the number of the ball that each point is `INSIDE`, -1 where it is in none."""
        point, ball, inside, _ = self._touched(points)
        gap = np.full(len(points), -1)
        gap[point[inside]] = ball[inside]
        return gap

    def count(self, points: np.ndarray) -> np.ndarray:
        """(G,) int64: how many points are `INSIDE` each ball."""
        gap = self.gap_of(points)
        return np.bincount(gap[gap >= 0], minlength=len(self.centres))

    def _near(self, points: np.ndarray) -> np.ndarray:
        """(N,) bool: whether a point's cell, of a raster of cells as large as a ball, holds part of a ball: most points' does not."""
        if not len(self.centres):
            return np.zeros(len(points), bool)
        reach = self.radius_m[:, None] + self.resolution_m
        side = float(2 * reach.max())
        first, last = voxel_index(self.centres - reach, side), voxel_index(self.centres + reach, side)
        low = first.min(axis=0)
        shape = last.max(axis=0) - low + 1
        # A ball reaches into two cells along an axis, no more.
        reached = np.concatenate([np.minimum(first + step, last) - low for step in itertools.product((0, 1), repeat=len(low))])
        cell = voxel_index(points, side) - low
        inside = ((cell >= 0) & (cell < shape)).all(axis=1)
        if math.prod(map(int, shape)) > MOST_RASTER_CELLS:
            inside[inside] = np.isin(_as_keys(cell[inside]), _as_keys(reached))
            return inside
        held = np.zeros(shape, bool)
        held[tuple(reached.T)] = True
        inside[inside] = held[tuple(cell[inside].T)]
        return inside

    def _touched(self, points: np.ndarray) -> tuple[np.ndarray, ...]:
        """Pairs of a point and a ball whose voxel and surface may meet: (P,) which point, (P,) which ball, (P,) bool whether the point is
        `INSIDE` the ball, and (P,) bool whether in its `RIM`."""
        close = np.flatnonzero(self._near(points))
        index = BucketIndex(points[close], float(self.radius_m.max(initial=1.0)))
        reach = self.radius_m[:, None] + self.resolution_m
        ball, point = index.in_boxes(self.centres - reach, self.centres + reach)
        nearest, farthest, middle = np.zeros(len(point)), np.zeros(len(point)), np.zeros(len(point))
        for axis, centre in zip(index.points.T, self.centres.T, strict=True):
            below = voxel_index(axis[point], self.resolution_m) * self.resolution_m - centre[ball]
            above = below + self.resolution_m
            nearest += np.clip(0, below, above) ** 2
            farthest += np.maximum(np.abs(below), np.abs(above)) ** 2
            middle += ((below + above) / 2) ** 2
        squared = self.radius_m[ball] ** 2
        inside = (farthest if self.rim else middle) < squared
        return close[point], ball, inside, (nearest < squared) & ~inside & self.rim

    def cut(self, cloud: Cloud) -> Cloud:
        """The part of `cloud` that a method may see: outside, without the rim."""
        return cloud.select(self.part(cloud.points) == OUTSIDE)


def is_range(sizes) -> bool:
    """Whether these are two sizes, the smaller first, of which gaps may be."""
    if np.ndim(sizes) != 1 or len(sizes) != 2:
        return False
    try:
        low, high = (check_positive(size, "size") for size in sizes)
    except InputError:
        return False
    return low <= high


def random_gaps(
    cloud: Cloud,
    diameter_m: float | tuple[float, float],
    resolution_m: float,
    seed: int,
    centred: bool = False,
    attempts: int = 20_000,
    rim: bool = True,
) -> Gaps:
    """Balls around random occupied points of `cloud`, until 10 to 15 % of its points are gone.

    A centre is moved off its point by a uniform offset within the radius: centred on the point, the distance to the centre alone
    would tell where the wall is. `centred` leaves it there. A range of diameters draws each ball's own, uniformly. `rim`: as `Gaps` has it.
    """
    if np.ndim(diameter_m):
        if not is_range(diameter_m):
            raise InputError(f"gap diameters: expected one in metres, or the smallest and the largest, got {diameter_m}")
        low, high = map(float, diameter_m)
    else:
        low = high = check_positive(diameter_m, "diameter_m")
    check_cell_m(resolution_m, "resolution_m")
    if not cloud.occupied.any():
        raise InputError("cloud: expected occupied points to put gaps around, got none")
    rng = np.random.default_rng(check_whole(seed, "seed"))
    occupied = np.flatnonzero(cloud.occupied)
    dimension = cloud.points.shape[1]
    centres, radii = np.empty((0, dimension)), np.empty(0)
    gone = np.zeros(len(cloud), bool)
    count = 0
    index = BucketIndex(cloud.points, high / 2)
    for attempt in range(attempts):
        if count >= LEAST_SHARE * len(cloud) or (attempt >= HOPELESS and not len(centres)):
            break
        radius = rng.uniform(low, high) / 2
        offset = rng.standard_normal(dimension)
        offset *= radius * rng.random() ** (1 / dimension) / math.sqrt(offset @ offset)
        centre = cloud.points[occupied[rng.integers(len(occupied))]] + (0 if centred else offset)
        apart = centres - centre  # most attempts end here, in a site that is nearly full: the plainest arithmetic is the fastest
        if (np.sqrt((apart * apart).sum(axis=1)) < radii + radius).any():
            continue
        ball = Gaps(centre[None], np.array([radius]), resolution_m, rim=rim)
        reach = radius + 2 * resolution_m
        near = index.in_boxes(centre[None] - reach, centre[None] + reach)[1]
        taken = near[(ball.part(cloud.points[near]) != OUTSIDE) & ~gone[near]]
        if count + len(taken) > MOST_SHARE * len(cloud):
            continue
        gone[taken] = True
        count += len(taken)
        centres, radii = np.vstack([centres, centre]), np.append(radii, radius)
    if not len(centres):
        raise NoRoom(f"gaps of {diameter_m} m: none fits into this site without removing more than {MOST_SHARE:.0%} of it")
    return Gaps(centres, radii, resolution_m, count / len(cloud), rim)


def _as_keys(cells: np.ndarray) -> np.ndarray:
    """(N,) one opaque value for each row of integers, to be compared as a whole."""
    cells = np.ascontiguousarray(cells)
    return cells.view(np.dtype((np.void, cells.dtype.itemsize * cells.shape[1]))).ravel()
