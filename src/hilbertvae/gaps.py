"""Gaps: balls of a site that no method is shown before scoring (paper IV, METHOD 7)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hilbertvae.checks import InputError, check_positive
from hilbertvae.cloud import Cloud, voxel_index

LEAST_SHARE, MOST_SHARE = 0.10, 0.15
"""Balls are added until at least the first share of the points is gone, and none that would take more than the second."""
INSIDE, OUTSIDE, RIM = 1, 0, -1


@dataclass(frozen=True)
class Gaps:
    """Balls that lie apart. centres: (G, D) metres; radius_m: (G,); resolution_m: the voxels that decide what is inside."""

    centres: np.ndarray
    radius_m: np.ndarray
    resolution_m: float

    def part(self, points: np.ndarray) -> np.ndarray:
        """(N,) int8 per point: `INSIDE` if its voxel lies wholly in a ball, `RIM` if a ball's surface cuts it, else `OUTSIDE`.

        The voxel decides, not the point, so that the same balls cut all clouds alike, and a thinned point, the mean of samples
        anywhere in its voxel, can't carry a removed sample out of the gap.
        """
        low = voxel_index(points, self.resolution_m) * self.resolution_m
        part = np.zeros(len(points), np.int8)
        for centre, radius in zip(self.centres, self.radius_m, strict=True):
            near = np.flatnonzero((np.abs(points - centre) < radius + self.resolution_m).all(axis=1))
            below, above = low[near] - centre, low[near] + self.resolution_m - centre
            nearest = np.linalg.norm(np.clip(0, below, above), axis=1)
            farthest = np.linalg.norm(np.maximum(np.abs(below), np.abs(above)), axis=1)
            part[near[nearest < radius]] = RIM
            part[near[farthest < radius]] = INSIDE
        return part

    def cut(self, cloud: Cloud) -> Cloud:
        """The part of `cloud` that a method may see: outside, without the rim."""
        return cloud.select(self.part(cloud.points) == OUTSIDE)


def random_gaps(
    cloud: Cloud, diameter_m: float | tuple[float, float], resolution_m: float, seed: int, centred: bool = False, attempts: int = 2000
) -> Gaps:
    """Balls around random occupied points of `cloud`, until 10 to 15 % of its points are gone.

    A centre is moved off its point by a uniform offset within the radius: centred on the point, the distance to the centre alone
    would tell where the wall is. `centred` leaves it there. A range of diameters draws each ball's own, uniformly.
    """
    sizes = (diameter_m, diameter_m) if np.isscalar(diameter_m) else tuple(diameter_m)
    if len(sizes) != 2 or sizes[0] > sizes[1]:
        raise InputError(f"gap diameters: expected one in metres, or the smallest and the largest, got {diameter_m}")
    low, high = (check_positive(size, "diameter_m") for size in sizes)
    if not cloud.occupied.any():
        raise InputError("cloud: expected occupied points to put gaps around, got none")
    rng = np.random.default_rng(seed)
    occupied = np.flatnonzero(cloud.occupied)
    dimension = cloud.points.shape[1]
    centres, radii = np.empty((0, dimension)), np.empty(0)
    gone = np.zeros(len(cloud), bool)
    for _ in range(attempts):
        if gone.mean() >= LEAST_SHARE:
            break
        radius = rng.uniform(low, high) / 2
        offset = rng.standard_normal(dimension)
        offset *= radius * rng.random() ** (1 / dimension) / np.linalg.norm(offset)
        centre = cloud.points[rng.choice(occupied)] + (0 if centred else offset)
        if (np.linalg.norm(centres - centre, axis=1) < radii + radius).any():
            continue
        ball = Gaps(centre[None], np.array([radius]), resolution_m)
        taken = gone | (ball.part(cloud.points) != OUTSIDE)
        if taken.mean() > MOST_SHARE:
            continue
        gone = taken
        centres, radii = np.vstack([centres, centre]), np.append(radii, radius)
    if not len(centres):
        raise InputError(f"gaps of {diameter_m} m: none fits into this site without removing more than {MOST_SHARE:.0%} of it")
    return Gaps(centres, radii, resolution_m)
