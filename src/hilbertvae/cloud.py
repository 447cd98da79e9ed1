"""Labelled points: D = {(x_i, y_i)}, occupied where a beam ended and free along the way (paper II-A, METHOD 1).

How densely beams are sampled changes every score, so it is no setting of a run. Three clouds of a site are fixed:
`fit_cloud`, what mappers are given; `points_cloud`, for scoring as the paper does; `voxel_cloud`, for scoring area or volume.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hilbertvae.checks import InputError, check_points, check_positive
from hilbertvae.scans.scan import Scans

RESOLUTION_M = {2: 0.1, 3: 0.2}
"""The map's cell, by dimension."""
OCCUPIED_SHARE = 0.15
"""A voxel is occupied from this share of returns on: many beams graze a wall's voxel, and a majority would erase it."""
SAMPLES_AT_ONCE = 4_000_000


@dataclass(frozen=True)
class Cloud:
    """points: (N, D) float64, metres, map frame; occupied: (N,) bool; weight: (N,) float64, how many samples a point stands for."""

    points: np.ndarray
    occupied: np.ndarray
    weight: np.ndarray

    def __len__(self) -> int:
        return len(self.points)

    def select(self, chosen: np.ndarray) -> Cloud:
        """The points at `chosen`, a mask or indices."""
        return Cloud(self.points[chosen], self.occupied[chosen], self.weight[chosen])


def voxel_index(points: np.ndarray, resolution_m: float) -> np.ndarray:
    """(N, D) int64: the voxel of each point, on the lattice through the map's origin."""
    return np.floor(points / resolution_m).astype(np.int64)


@dataclass(frozen=True)
class VoxelVotes:
    """Sums over the samples in each voxel seen. index: (V, D) int64; hits, frees: (V,) counts; hit_mean, free_mean: (V, D) metres."""

    index: np.ndarray
    hits: np.ndarray
    frees: np.ndarray
    hit_mean: np.ndarray
    free_mean: np.ndarray


def voxel_votes(scans: Scans, resolution_m: float) -> VoxelVotes:
    """Returns, and beams sampled every voxel length up to one cell before the return, gathered by voxel.

    Works through the beams in portions, so that the free samples of all of them (1.5e8 for a long log) never lie in memory at once.
    """
    check_positive(resolution_m, "resolution_m")
    if not len(scans):
        raise InputError("scans: expected at least one return, got none")
    dimension = scans.dimension
    low = np.minimum(scans.points.min(axis=0), scans.origins.min(axis=0))
    high = np.maximum(scans.points.max(axis=0), scans.origins.max(axis=0))
    first = voxel_index(low, resolution_m)
    shape = voxel_index(high, resolution_m) - first + 1
    if np.prod(shape.astype(float)) > 2**62:
        raise InputError(f"scans: extent {(high - low).tolist()} m is too large for voxels of {resolution_m} m")

    keys, sums = np.empty(0, np.int64), np.empty((0, 2 + 2 * dimension))
    for samples, hit in _samples(scans, resolution_m):
        # Means are taken relative to the corner: with UTM coordinates a sum of thousands would lose digits.
        local = samples - low
        key = np.ravel_multi_index(tuple((voxel_index(samples, resolution_m) - first).T), tuple(shape))
        found, position = np.unique(key, return_inverse=True)
        columns = [~hit, hit] + [local[:, d] * chosen for chosen in (~hit, hit) for d in range(dimension)]
        portion = np.stack([np.bincount(position, weights=column, minlength=len(found)) for column in columns], axis=1)
        merged, position = np.unique(np.concatenate([keys, found]), return_inverse=True)
        total = np.zeros((len(merged), sums.shape[1]))
        total[position[: len(keys)]] += sums
        total[position[len(keys) :]] += portion
        keys, sums = merged, total

    index = np.stack(np.unravel_index(keys, tuple(shape)), axis=1) + first
    frees, hits = sums[:, 0], sums[:, 1]
    free_mean = sums[:, 2 : 2 + dimension] / np.maximum(frees, 1)[:, None] + low
    hit_mean = sums[:, 2 + dimension :] / np.maximum(hits, 1)[:, None] + low
    return VoxelVotes(index, hits, frees, *(_kept_inside(mean, index, resolution_m) for mean in (hit_mean, free_mean)))


def _kept_inside(means: np.ndarray, index: np.ndarray, resolution_m: float) -> np.ndarray:
    """Means back in their own voxels: rounding carries that of samples on a voxel's side across it, and out of reach of its gap."""
    across = voxel_index(means, resolution_m) != index
    return means + np.where(across, 1e-6 * ((index + 0.5) * resolution_m - means), 0.0)


def _samples(scans: Scans, resolution_m: float) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Portions of (samples (S, D), hit (S,) bool): each return, and its beam at every voxel length."""
    direction = scans.points - scans.origins
    length = np.linalg.norm(direction, axis=1)
    free = np.maximum(np.floor(length / resolution_m - 0.5), 0).astype(np.int64)
    portion = np.cumsum(free + 1) // SAMPLES_AT_ONCE
    for start, end in _runs(portion):
        count = free[start:end]
        beam = np.repeat(np.arange(start, end), count)
        step = np.arange(len(beam)) - np.repeat(np.cumsum(count) - count, count)
        fraction = (step + 0.5) * resolution_m / length[beam]
        along = scans.origins[beam] + direction[beam] * fraction[:, None]
        samples = np.concatenate([scans.points[start:end], along])
        yield samples, np.arange(len(samples)) < end - start


def _runs(values: np.ndarray) -> Iterator[tuple[int, int]]:
    """Start and end of each run of equal values."""
    edges = np.flatnonzero(np.diff(values)) + 1
    yield from zip([0, *edges.tolist()], [*edges.tolist(), len(values)], strict=True)


def fit_cloud(scans: Scans, resolution_m: float) -> Cloud:
    """What mappers are given: at most one point per voxel and label, at the mean of its samples, with their count as weight."""
    votes = voxel_votes(scans, resolution_m)
    hit, free = votes.hits > 0, votes.frees > 0
    return Cloud(
        np.concatenate([votes.hit_mean[hit], votes.free_mean[free]]),
        np.arange(hit.sum() + free.sum()) < hit.sum(),
        np.concatenate([votes.hits[hit], votes.frees[free]]),
    )


def voxel_cloud(scans: Scans, resolution_m: float) -> Cloud:
    """One point per voxel seen, at its centre, occupied if returns have at least 15 % of the votes; weight 1."""
    votes = voxel_votes(scans, resolution_m)
    share = votes.hits / (votes.hits + votes.frees)
    return Cloud((votes.index + 0.5) * resolution_m, share >= OCCUPIED_SHARE, np.ones(len(share)))


def points_cloud(scans: Scans, resolution_m: float, seed: int = 0) -> tuple[Cloud, np.ndarray]:
    """The paper's reading: each return, and max(1, floor(r / 2)) uniform free points along a beam of r metres.

    Also returns `beam (N,)`: the index of the return that each point belongs to.
    """
    length = np.linalg.norm(scans.points - scans.origins, axis=1)
    count = np.maximum(1, np.floor(length / 2)).astype(np.int64)
    beam = np.repeat(np.arange(len(scans)), count)
    reach = np.maximum(1 - resolution_m / np.maximum(length, 1e-9), 0)[beam]
    fraction = np.random.default_rng(seed).random(len(beam)) * reach
    free = scans.origins[beam] + (scans.points - scans.origins)[beam] * fraction[:, None]
    points = np.concatenate([scans.points, free])
    cloud = Cloud(points, np.arange(len(points)) < len(scans), np.ones(len(points)))
    return cloud, np.concatenate([np.arange(len(scans)), beam])


def cloud_from_scans(points, origins, resolution_m: float | None = None) -> Cloud:
    """The `fit` cloud of a user's scans.

    points: a list of (n_s, D) arrays in metres in the map frame, one per scan, or one (N, D) array.
    origins: (S, D), where the sensor stood in each scan; with one array of points, (N, D) or one (D,) origin.
    resolution_m: 0.1 in 2D and 0.2 in 3D unless given. Raises `InputError` for what does not fit together.
    """
    if isinstance(points, (list, tuple)) and len(points) and np.ndim(points[0]) == 2:
        origins = check_points(origins, "origins", dimension=np.shape(points[0])[1])
        if len(origins) != len(points):
            raise InputError(f"origins: expected one per scan ({len(points)}), got {len(origins)}")
        scan = np.repeat(np.arange(len(points), dtype=np.int32), [len(p) for p in points])
        points = np.concatenate([check_points(p, "points", dimension=origins.shape[1], allow_empty=True) for p in points])
        origins = origins[scan]
    else:
        points = check_points(points, "points")
        origins = check_points([origins] if np.ndim(origins) == 1 else origins, "origins", dimension=points.shape[1])
        if len(origins) not in (1, len(points)):
            raise InputError(f"origins: expected one, or one per point ({len(points)}), got {len(origins)}")
        origins = np.broadcast_to(origins, points.shape)
        scan = np.zeros(len(points), np.int32)
    scans = Scans(points, origins, scan, np.arange(len(points), dtype=np.int32))
    return fit_cloud(scans, resolution_m or RESOLUTION_M[points.shape[1]])
