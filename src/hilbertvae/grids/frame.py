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
from hilbertvae.sums import sums_by

SPREAD_DEG = np.array([0.0, 22.5, 45.0, 67.5])
"""A quarter turn is one of the symmetries that networks are trained with."""
SPREAD_M = 1.0
"""Side of the squares whose seeds have one angle."""
MARGIN = 4e-6
"""By which a box is larger than its cluster: more than cells reach over its upper side (`aligned_grid.SLACK`), else the farthest return
would be in the cell after the last."""
AT_ONCE = 256
"""Clusters whose points lie in memory at a time: those of a drive's would be gigabytes."""


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
    """`fixed`: the box is the cluster's diameter; `extent`: the largest extent of its returns becomes 1."""

    def __post_init__(self):
        for name, allowed in (("centre", CENTRES), ("rotation", ROTATIONS), ("scale", SCALES)):
            value = getattr(self, name)
            if not isinstance(value, str) or value not in allowed:
                raise InputError(f"frame.{name}: expected one of {', '.join(allowed)}, got {value!r}")


def cluster_frames(clusters: Clusters, cloud: Cloud, diameter_m: float, snap_m: float, settings: FrameSettings) -> Frames:
    """The frames of `clusters`, whose members index the occupied points of `cloud`.

    An unturned box of fixed scale is moved onto the lattice of `snap_m` cells, so that one cell of it is one voxel of the map: its middle
    is a corner of the lattice, or that of a cell where it has an odd number of them.
    """
    returns = cloud.points[cloud.occupied]
    centre = CENTRES[settings.centre](clusters, returns)
    rotation = ROTATIONS[settings.rotation](clusters, returns, cloud, diameter_m)
    scale = SCALES[settings.scale](clusters, returns, centre, rotation, diameter_m)
    frames = Frames(centre, rotation, scale)
    if settings.scale == "fixed" and settings.rotation == "none":
        inner = 0.5 * (round(diameter_m / snap_m) % 2)
        frames = Frames((np.round(centre / snap_m - inner) + inner) * snap_m, rotation, scale)
    return frames


def _mean(values: np.ndarray, segment: np.ndarray, count: int) -> np.ndarray:
    """Means (count, ...) of `values (P, ...)` by segment; 0 for an empty one."""
    flat = values.reshape(len(values), math.prod(values.shape[1:]))
    return (sums_by(segment, flat, count) / np.maximum(np.bincount(segment, minlength=count), 1)[:, None]).reshape(count, *values.shape[1:])


def _seed(clusters: Clusters, returns: np.ndarray) -> np.ndarray:
    return clusters.seeds


def _median(clusters: Clusters, returns: np.ndarray) -> np.ndarray:
    members = returns[clusters.members]
    bounds = zip(clusters.offsets, clusters.offsets[1:], strict=False)
    return np.array([np.median(members[a:b], axis=0) for a, b in bounds]).reshape(-1, returns.shape[1])


def _unturned(clusters: Clusters, returns: np.ndarray, cloud: Cloud, diameter_m: float) -> np.ndarray:
    dimension = returns.shape[1]
    return np.broadcast_to(np.eye(dimension), (len(clusters), dimension, dimension))


def _full(clusters: Clusters, returns: np.ndarray, cloud: Cloud, diameter_m: float) -> np.ndarray:
    return _eigenvectors(clusters, returns, cloud, diameter_m, axes=returns.shape[1])


def _yaw(clusters: Clusters, returns: np.ndarray, cloud: Cloud, diameter_m: float) -> np.ndarray:
    return _eigenvectors(clusters, returns, cloud, diameter_m, axes=2)


def _eigenvectors(clusters: Clusters, returns: np.ndarray, cloud: Cloud, diameter_m: float, axes: int) -> np.ndarray:
    """(M, D, D) proper rotations onto the eigenvectors of the returns' first `axes` coordinates, largest eigenvalue first.

    Each axis points towards the centroid of the free space around the seed, which a gap seldom changes; the one on which the
    centroid's side is least clear gives way where the rotation would otherwise be improper.
    """
    free = BucketIndex(cloud.points[~cloud.occupied], diameter_m / 2)
    rotation = np.tile(np.eye(returns.shape[1]), (len(clusters), 1, 1))
    for start in range(0, len(clusters), AT_ONCE):
        chosen = slice(start, start + AT_ONCE)
        rotation[chosen, :axes, :axes] = _axes(clusters.select(chosen), returns, free, diameter_m / 2, axes)
    return rotation


def _axes(clusters: Clusters, returns: np.ndarray, free: BucketIndex, radius_m: float, axes: int) -> np.ndarray:
    """(B, axes, axes), as columns."""
    segment, count = clusters.numbers, len(clusters)
    members = returns[clusters.members][:, :axes]
    mean = _mean(members, segment, count)
    centred = members - mean[segment]
    covariance = _mean(centred[:, :, None] * centred[:, None, :], segment, count)
    vectors = np.linalg.eigh(covariance)[1][:, :, ::-1]

    box, point = free.in_boxes(clusters.seeds - radius_m, clusters.seeds + radius_m)
    near = np.linalg.norm(free.points[point] - clusters.seeds[box], axis=1) <= radius_m  # in all coordinates: not the sky above a street
    side = np.einsum("md,mde->me", _mean(free.points[point[near], :axes] - mean[box[near]], box[near], count), vectors)
    vectors = vectors * np.where(side < 0, -1.0, 1.0)[:, None, :]
    improper = np.flatnonzero(np.linalg.det(vectors) < 0)
    vectors[improper, :, np.abs(side[improper]).argmin(axis=1)] *= -1
    return vectors


def _spread(clusters: Clusters, returns: np.ndarray, cloud: Cloud, diameter_m: float) -> np.ndarray:
    """The place of a seed alone says which angle is its cluster's, so that no other cluster has a say."""
    x, y = np.floor(clusters.seeds[:, :2] / SPREAD_M).astype(np.int64).T
    angle = (x + 2 * y) % len(SPREAD_DEG)
    cos, sin = np.cos(np.deg2rad(SPREAD_DEG))[angle], np.sin(np.deg2rad(SPREAD_DEG))[angle]
    rotation = np.tile(np.eye(returns.shape[1]), (len(clusters), 1, 1))
    rotation[:, 0, 0], rotation[:, 0, 1], rotation[:, 1, 0], rotation[:, 1, 1] = cos, -sin, sin, cos
    return rotation


def _fixed(clusters: Clusters, returns: np.ndarray, centre: np.ndarray, rotation: np.ndarray, diameter_m: float) -> np.ndarray:
    return np.full(len(clusters), float(diameter_m))


def _extent(clusters: Clusters, returns: np.ndarray, centre: np.ndarray, rotation: np.ndarray, diameter_m: float) -> np.ndarray:
    """The largest extent of a cluster along its axes, on both sides of the centre, so that no return falls out of the box."""
    segment = clusters.numbers
    turned = Frames(centre, rotation, np.ones(len(clusters))).into(returns[clusters.members], segment)
    reach = np.zeros(len(clusters))
    np.maximum.at(reach, segment, np.abs(turned).max(axis=1))
    return np.maximum(2 * reach * (1 + MARGIN), 1e-3)


CENTRES = {"seed": _seed, "median": _median}
ROTATIONS = {"full": _full, "yaw": _yaw, "none": _unturned, "spread": _spread}
SCALES = {"fixed": _fixed, "extent": _extent}
