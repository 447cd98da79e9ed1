"""The frame of a cluster: translation, rotation and scale that align its grid (paper III-A, Eq. 9 and 13; METHOD 3).

Rows are points: H = (G - centre) V / s, and back G = s H V^T + centre (Eq. 13 as printed has V^T on the wrong side).
In the frame the grid's box is [-1/2, 1/2]^D.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hilbertvae.bucket_index import BucketIndex
from hilbertvae.checks import InputError
from hilbertvae.cloud import Cloud
from hilbertvae.clusters.clusters import Clusters
from hilbertvae.portions import portions
from hilbertvae.sums import sums_by

SPREAD_DEG = np.array([0.0, 22.5, 45.0, 67.5])
"""A quarter turn is one of the symmetries that networks are trained with."""
SPREAD_M = 1.0
"""Side of the squares whose seeds have one angle."""
MARGIN = 4e-6
"""By which a box is larger than its cluster: more than cells reach over its upper side (`aligned_grid.SLACK`), else the farthest return
would be in the cell after the last."""
LEAST_SCALE_M = 1e-3
"""Of a box whose returns coincide, which has no extent."""
AT_ONCE, MEMBERS_AT_ONCE = 256, 2**18
"""Clusters, and points of theirs, that lie in memory at a time: those of a drive's would be gigabytes."""
FREE_AT_ONCE = 2**20
"""Free points that are looked at for their axes at a time."""


@dataclass(frozen=True)
class Frames:
    """centre: (M, D) metres; rotation: (M, D, D), columns are the frame's axes; scale: (M,) metres, the side of the box."""

    centre: np.ndarray
    rotation: np.ndarray
    scale: np.ndarray

    def __len__(self) -> int:
        return len(self.centre)

    def select(self, chosen: slice | np.ndarray) -> Frames:
        """The frames at `chosen`."""
        return Frames(self.centre[chosen], self.rotation[chosen], self.scale[chosen])

    def into(self, points: np.ndarray, frame: np.ndarray) -> np.ndarray:
        """`points (P, D)` in metres, each in the frame of number `frame (P,)`: Eq. 9."""
        # One axis at a time: numpy is slow where the last axis is short.
        scale = self.scale[frame]
        moved = [axis - centre[frame] for axis, centre in zip(points.T, self.centre.T, strict=True)]
        if self.turned:
            moved = [
                sum(axis * turn[frame] for axis, turn in zip(moved, column.T, strict=True)) for column in np.moveaxis(self.rotation, 2, 0)
            ]
        return np.stack([axis / scale for axis in moved], axis=1)

    def back(self, points: np.ndarray, frame: np.ndarray) -> np.ndarray:
        """From the frames to the map: Eq. 13, put right."""
        return np.einsum("pe,pde->pd", points, self.rotation[frame]) * self.scale[frame, None] + self.centre[frame]

    @cached_property
    def turned(self) -> bool:
        """Whether any frame is rotated."""
        return bool(np.any(self.rotation != np.eye(self.rotation.shape[-1])))

    def boxes(self) -> tuple[np.ndarray, np.ndarray]:
        """Axis-parallel bounds (low, high), each (M, D) metres, of the boxes."""
        half = np.abs(self.rotation).sum(axis=2) * self.scale[:, None] / 2
        return self.centre - half, self.centre + half


@dataclass
class FrameSettings:
    """How a cluster gets its frame. Faithful to the paper: median, full, extent. A gap turns and shifts that one (METHOD 3)."""

    centre: str = "seed"
    """`seed`: the cluster's seed, which a gap can't move; `median`: per-axis median of its returns."""
    rotation: str = "none"
    """`full`: eigenvectors of its returns; `yaw`: about the vertical only; `none`: axis-parallel; `spread`: about the vertical by one of
    four angles, neighbours by different ones, so that what falls between cells in one box falls into them in the next."""
    scale: str = "fixed"
    """`fixed`: the box is the cluster's diameter; `extent`: the return that is farthest along any axis of it lies on its side."""

    def __post_init__(self):
        for name, allowed in (("centre", CENTRES), ("rotation", ROTATIONS), ("scale", SCALES)):
            value = getattr(self, name)
            if not isinstance(value, str) or value not in allowed:
                raise InputError(f"frame.{name}: expected one of {', '.join(allowed)}, got {value!r}")

    @property
    def from_seeds(self) -> bool:
        """Whether seeds alone say where the boxes are, and no other point moves them."""
        return self.centre == "seed" and self.rotation in ("none", "spread") and self.scale == "fixed"


@dataclass(frozen=True)
class Surroundings:
    """What clusters lie in. diameter_m: of their balls."""

    cloud: Cloud
    diameter_m: float

    @cached_property
    def returns(self) -> np.ndarray:
        """(N, D) the occupied points, which the clusters' members index."""
        return self.cloud.points[self.cloud.occupied]

    @cached_property
    def free(self) -> BucketIndex:
        """The free points."""
        return BucketIndex(self.cloud.points[~self.cloud.occupied], self.diameter_m / 2)


def cluster_frames(clusters: Clusters, cloud: Cloud, diameter_m: float, snap_m: float, settings: FrameSettings) -> Frames:
    """The frames of `clusters`, whose members index the occupied points of `cloud`.

    An unturned box of fixed scale is moved onto the lattice of `snap_m` cells, so that one cell of it is one voxel of the map: its middle
    is a corner of the lattice, or that of a cell where it has an odd number of them.
    """
    around = Surroundings(cloud, diameter_m)
    if settings.from_seeds:
        return _frames(clusters, around, snap_m, settings)
    count, dimension = clusters.seeds.shape
    frames = Frames(np.empty((count, dimension)), np.empty((count, dimension, dimension)), np.empty(count))
    for some in portions(clusters.offsets, AT_ONCE, MEMBERS_AT_ONCE):
        found = _frames(clusters.select(some), around, snap_m, settings)
        frames.centre[some], frames.rotation[some], frames.scale[some] = found.centre, found.rotation, found.scale
    return frames


def _frames(clusters: Clusters, around: Surroundings, snap_m: float, settings: FrameSettings) -> Frames:
    centre = CENTRES[settings.centre](clusters, around)
    rotation = ROTATIONS[settings.rotation](clusters, around)
    scale = SCALES[settings.scale](clusters, around, centre, rotation)
    if settings.scale == "fixed" and settings.rotation == "none":
        inner = 0.5 * (round(around.diameter_m / snap_m) % 2)
        centre = (np.round(centre / snap_m - inner) + inner) * snap_m
    return Frames(centre, rotation, scale)


def _mean(values: np.ndarray, segment: np.ndarray, count: int) -> np.ndarray:
    """Means (count, ...) of `values (P, ...)` by segment; 0 for an empty one."""
    flat = values.reshape(len(values), math.prod(values.shape[1:]))
    return (sums_by(segment, flat, count) / np.maximum(np.bincount(segment, minlength=count), 1)[:, None]).reshape(count, *values.shape[1:])


def _seed(clusters: Clusters, around: Surroundings) -> np.ndarray:
    return clusters.seeds


def _median(clusters: Clusters, around: Surroundings) -> np.ndarray:
    members = around.returns[clusters.members]
    bounds = zip(clusters.offsets, clusters.offsets[1:], strict=False)
    return np.array([np.median(members[a:b], axis=0) for a, b in bounds]).reshape(clusters.seeds.shape)


def _unturned(clusters: Clusters, around: Surroundings) -> np.ndarray:
    count, dimension = clusters.seeds.shape
    return np.broadcast_to(np.eye(dimension), (count, dimension, dimension))


def _full(clusters: Clusters, around: Surroundings) -> np.ndarray:
    return _eigenvectors(clusters, around, axes=clusters.seeds.shape[1])


def _yaw(clusters: Clusters, around: Surroundings) -> np.ndarray:
    return _eigenvectors(clusters, around, axes=2)


def _eigenvectors(clusters: Clusters, around: Surroundings, axes: int) -> np.ndarray:
    """(M, D, D) proper rotations onto the eigenvectors of the returns' first `axes` coordinates, largest eigenvalue first.

    Each axis points towards the centroid of the free space around the seed, which a gap seldom changes; the one on which the
    centroid's side is least clear gives way where the rotation would otherwise be improper.
    """
    segment, (count, dimension) = clusters.numbers, clusters.seeds.shape
    members = around.returns[clusters.members][:, :axes]
    mean = _mean(members, segment, count)
    centred = members - mean[segment]
    covariance = _mean(centred[:, :, None] * centred[:, None, :], segment, count)
    vectors = np.linalg.eigh(covariance)[1][:, :, ::-1]

    side = np.einsum("md,mde->me", _free_side(clusters, around, mean), vectors)
    vectors = vectors * np.where(side < 0, -1.0, 1.0)[:, None, :]
    improper = np.flatnonzero(np.linalg.det(vectors) < 0)
    vectors[improper, :, np.abs(side[improper]).argmin(axis=1)] *= -1
    rotation = np.tile(np.eye(dimension), (count, 1, 1))
    rotation[:, :axes, :axes] = vectors
    return rotation


def _free_side(clusters: Clusters, around: Surroundings, mean: np.ndarray) -> np.ndarray:
    """(M, A) metres from `mean (M, A)` to the centroid of the free points in each cluster's ball, in the first A coordinates; 0 without."""
    seeds, radius_m, axes = clusters.seeds, around.diameter_m / 2, mean.shape[1]
    side = np.zeros(mean.shape)
    for some, box, point in around.free.in_portions(seeds - radius_m, seeds + radius_m, FREE_AT_ONCE):
        found = around.free.points[point]
        near = np.linalg.norm(found - seeds[box], axis=1) <= radius_m  # in all coordinates: not the sky above a street
        box, found = box[near], found[near, :axes]
        side[some] = _mean(found - mean[box], box - some.start, some.stop - some.start)
    return side


def _spread(clusters: Clusters, around: Surroundings) -> np.ndarray:
    """The place of a seed alone says which angle is its cluster's, so that no other cluster has a say."""
    x, y = np.floor(clusters.seeds[:, :2] / SPREAD_M).astype(np.int64).T
    angle = (x + 2 * y) % len(SPREAD_DEG)
    cos, sin = np.cos(np.deg2rad(SPREAD_DEG))[angle], np.sin(np.deg2rad(SPREAD_DEG))[angle]
    rotation = np.tile(np.eye(clusters.seeds.shape[1]), (len(clusters), 1, 1))
    rotation[:, 0, 0], rotation[:, 0, 1], rotation[:, 1, 0], rotation[:, 1, 1] = cos, -sin, sin, cos
    return rotation


def _fixed(clusters: Clusters, around: Surroundings, centre: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    return np.full(len(clusters), float(around.diameter_m))


def _extent(clusters: Clusters, around: Surroundings, centre: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """The largest extent of a cluster along its axes, on both sides of the centre, so that no return falls out of the box."""
    segment = clusters.numbers
    turned = Frames(centre, rotation, np.ones(len(clusters))).into(around.returns[clusters.members], segment)
    reach = np.zeros(len(clusters))
    np.maximum.at(reach, segment, np.abs(turned).max(axis=1))
    return np.maximum(2 * reach * (1 + MARGIN), LEAST_SCALE_M)


CENTRES = {"seed": _seed, "median": _median}
ROTATIONS = {"full": _full, "yaw": _yaw, "none": _unturned, "spread": _spread}
SCALES = {"fixed": _fixed, "extent": _extent}
