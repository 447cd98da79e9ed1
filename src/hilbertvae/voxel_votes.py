"""How often beams ended in each voxel, and how often they passed: what every cloud of a site is made from (METHOD 1)."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np

from hilbertvae.checks import InputError, check_positive
from hilbertvae.cores import cores
from hilbertvae.scans.scan import Scans
from hilbertvae.sums import sums_by

SAMPLES_AT_ONCE = 1_000_000
MOST_AT_ONCE = 4
"""Portions of as many samples, whatever the cores: each takes some 100 MB while it is gathered."""
MOST_ALONG = {2: 2**34, 3: 2**22}
"""Voxels along an axis: as many as a map's bricks tell apart (`mappers/voxel_bricks.py`)."""
MOST_SAMPLES = 1e6
"""Of one beam, whose samples lie in memory at once: 100 km in cells of 0.1 m."""
SLACK = 2.0**-24
"""Of a voxel's side: what lies no farther below the next voxel is on its side but for rounding, as of a lattice's coordinates in decimals,
also where these are those of a map grid (5e6 m) and cells of 5 mm and more."""
MARGIN = 2.0**-18
"""Of a voxel's side: so near to it no place comes, lest it is carried across, by rounding or by the slack of a grid's cells
(`grids/aligned_grid.py`): returns in whole centimetres lie on sides of voxels."""
FARTHEST = 2.0**44
"""Voxels from the origin; beyond, centres of voxels would lose their digits."""
BYTES_A_VOXEL = 1000
"""What a voxel seen takes at the least, at the worst moment on its way into a map."""


def voxel_floor(places: np.ndarray) -> np.ndarray:
    """The voxels, whole numbers in float64, of coordinates `places` in voxels from the map's origin; one on a side is in the voxel above,
    though 0.3 / 0.1 is 2.9999999999999996."""
    return np.floor(places + SLACK)


def voxel_index(points: np.ndarray | float, resolution_m: float) -> np.ndarray:
    """(N, D) int64: the voxel of each point, on the lattice through the map's origin; of one beyond all lattices, the least number. Of one
    coordinate alone, that along its axis."""
    with np.errstate(over="ignore", invalid="ignore"):
        return voxel_floor(points / resolution_m).astype(np.int64)


def distinct_voxels(index: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(V, D) int64 the different ones of the voxels `index (N, D)`, in order, and (N,) which of them each is."""
    first = index.min(axis=0)
    shape = tuple(index.max(axis=0) - first + 1)
    keys, which = np.unique(np.ravel_multi_index(tuple((index - first).T), shape), return_inverse=True)
    return np.stack(np.unravel_index(keys, shape), axis=1) + first, which


def inside_voxels(points: np.ndarray, resolution_m: float, index: np.ndarray) -> np.ndarray:
    """(N, D) the points, each off the sides of its voxel `index (N, D)` by `MARGIN`."""
    return np.clip(points, (index + MARGIN) * resolution_m, (index + (1 - MARGIN)) * resolution_m)


@dataclass(frozen=True)
class VoxelVotes:
    """Sums over the samples in each voxel seen. index: (V, D) int64; hits, frees: (V,) counts; hit_mean, free_mean: (V, D) metres."""

    index: np.ndarray
    hits: np.ndarray
    frees: np.ndarray
    hit_mean: np.ndarray
    free_mean: np.ndarray
    resolution_m: float

    def merged(self, other: VoxelVotes) -> VoxelVotes:
        """The votes of both, as if their beams had been sampled together."""
        index, position = distinct_voxels(np.concatenate([self.index, other.index]))
        corner = index.min(axis=0) * self.resolution_m
        counts, means = [], []
        for count, mean in (("hits", "hit_mean"), ("frees", "free_mean")):
            weight = np.concatenate([getattr(self, count), getattr(other, count)])
            local = np.concatenate([getattr(self, mean), getattr(other, mean)]) - corner
            counts.append(np.bincount(position, weights=weight, minlength=len(index)))
            sums = sums_by(position, local, len(index), weight)
            means.append(_means(counts[-1], sums, corner, index, self.resolution_m))
        return VoxelVotes(index, *counts, *means, self.resolution_m)


def voxel_votes(scans: Scans, resolution_m: float) -> VoxelVotes:
    """Returns, and beams sampled every voxel length up to one cell before the return, gathered by voxel.

    Works through the beams in portions, so that the free samples of all of them (1.5e8 for a long log) never lie in memory at once.
    """
    check_positive(resolution_m, "resolution_m")
    if not len(scans):
        raise InputError("scans: expected at least one return, got none")
    # Means are taken relative to the corner: with UTM coordinates a sum of thousands would lose digits.
    low = np.minimum(scans.points.min(axis=0), scans.origins.min(axis=0))
    high = np.maximum(scans.points.max(axis=0), scans.origins.max(axis=0))
    with np.errstate(over="ignore"):
        across, farthest = (high - low) / resolution_m + 2, np.abs([low, high]).max()
        voxels = np.prod(across)
    if voxels > 2**62 or across.max() > MOST_ALONG[scans.dimension] or farthest / resolution_m > FARTHEST:  # whole numbers would wrap
        where = f"extent {(high - low).tolist()} m, up to {farthest:.6g} m from 0,"
        raise InputError(f"scans: {where} is too large for voxels of {resolution_m} m; is there an outlier?")
    first = voxel_index(low, resolution_m)
    shape = voxel_index(high, resolution_m) - first + 1
    longest = float(np.sqrt(np.square(scans.points - scans.origins).sum(axis=1).max()))
    if longest / resolution_m > MOST_SAMPLES:
        raise InputError(f"scans: a beam of {longest:.6g} m is too long for voxels of {resolution_m} m; is there an outlier?")

    def gathered(samples: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        key = np.zeros(len(samples[0]), np.int64)
        for axis, corner, cells in zip(samples, first, shape, strict=True):
            key = key * cells + (voxel_floor(axis / resolution_m).astype(np.int64) - corner)
        return _summed(key, [axis - corner for axis, corner in zip(samples, low, strict=True)])

    hit_keys, hit_sums = gathered(list(scans.points.T.copy()))
    free_keys, free_sums = np.empty(0, np.int64), np.empty((1 + scans.dimension, 0))
    waiting, held = [], 0
    for found in _in_order(lambda samples: gathered(samples()), _free_samples(scans, resolution_m)):
        waiting.append(found)
        held += len(found[0])
        if held > SAMPLES_AT_ONCE + len(free_keys):  # seldom, since each time all voxels are sorted again
            free_keys, free_sums = _merged([(free_keys, free_sums), *waiting])
            waiting, held = [], 0
            _check_memory(len(free_keys), resolution_m)
    free_keys, free_sums = _merged([(free_keys, free_sums), *waiting])

    keys = np.sort(np.concatenate([hit_keys, free_keys]))  # np.union1d hashes, which takes ten times as long
    keys = keys[np.append(True, keys[1:] != keys[:-1])]
    index = np.stack(np.unravel_index(keys, tuple(shape)), axis=1) + first
    counts, means = [], []
    for own, total in ((hit_keys, hit_sums), (free_keys, free_sums)):
        every = np.zeros((1 + scans.dimension, len(keys)))
        every[:, np.searchsorted(keys, own)] = total
        counts.append(every[0])
        means.append(_means(every[0], every[1:].T, low, index, resolution_m))
    return VoxelVotes(index, *counts, *means, resolution_m)


def _check_memory(voxels: int, resolution_m: float) -> None:
    """An `InputError` where so many voxels are more than this machine can hold, before the system ends the process without a word."""
    if not hasattr(os, "sysconf"):  # Windows
        return
    needed, there = voxels * BYTES_A_VOXEL, os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if needed > there:
        raise InputError(
            f"resolution_m: beams pass more than {voxels} voxels of {resolution_m} m, which take more than the {there / 2**30:.0f} GiB of "
            "memory that there are; expected larger ones, or coordinates in metres"
        )


def _summed(key: np.ndarray, columns: list[np.ndarray], count: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """The distinct keys (K,), ascending, and by key (1 + C, K) the sum of `count`, or how many rows have it, and sums of the columns."""
    if not len(key):
        return key, np.empty((1 + len(columns), 0))
    order, ordered = sorted_keys(key)
    starts = np.flatnonzero(np.append(True, ordered[1:] != ordered[:-1]))
    counted = np.diff(starts, append=len(key)) if count is None else np.add.reduceat(count[order], starts)
    return ordered[starts], np.stack([counted, *(np.add.reduceat(column[order], starts) for column in columns)])


def sorted_keys(key: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The stable order of keys (K,) >= 0, and the keys in it: place and key in one number sort in half of argsort's time."""
    bits = len(key).bit_length()
    if int(key.max()) >> (62 - bits):
        order = np.argsort(key, kind="stable")
        return order, key[order]
    both = key << bits
    both |= np.arange(len(key))
    both.sort()
    return both & ((1 << bits) - 1), both >> bits


def _merged(parts: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """What `_summed` gives for the rows of all parts together."""
    key, sums = np.concatenate([key for key, _ in parts]), np.concatenate([sums for _, sums in parts], axis=1)
    return _summed(key, list(sums[1:]), sums[0])


def _means(count: np.ndarray, sums: np.ndarray, low: np.ndarray, index: np.ndarray, resolution_m: float) -> np.ndarray:
    """(V, D) metres, in their own voxels: rounding carries the mean of samples on a voxel's side across it, out of reach of its gap."""
    mean = inside_voxels(sums / np.maximum(count, 1)[:, None] + low, resolution_m, index)
    across = voxel_index(mean, resolution_m) != index
    return mean + np.where(across, 1e-6 * ((index + 0.5) * resolution_m - mean), 0.0)


def _in_order(task: Callable, items: Iterable) -> Iterator:
    """What `task` makes of each item, in their order, a few of them at once: each takes memory."""
    with ThreadPoolExecutor(count := min(cores(), MOST_AT_ONCE)) as pool:
        waiting = deque()
        for item in items:
            waiting.append(pool.submit(task, item))
            if len(waiting) > count:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def _free_samples(scans: Scans, resolution_m: float) -> Iterator[Callable[[], list[np.ndarray]]]:
    """Portions of the points at every voxel length along the beams, made when asked for: D arrays (S,), one per axis, since numpy is slow
    on short rows."""
    direction = scans.points - scans.origins
    length = np.linalg.norm(direction, axis=1)
    free = np.maximum(np.floor(length / resolution_m - 0.5), 0).astype(np.int64)
    step = direction * (resolution_m / np.maximum(length, 1e-12))[:, None]
    portion = np.cumsum(free) // SAMPLES_AT_ONCE

    def samples(start: int, end: int) -> list[np.ndarray]:
        count = free[start:end]
        along = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count) + 0.5
        return [
            np.repeat(origin, count) + np.repeat(one, count) * along
            for origin, one in zip(scans.origins[start:end].T, step[start:end].T, strict=True)
        ]

    for start, end in _runs(portion):
        yield partial(samples, start, end)


def _runs(values: np.ndarray) -> Iterator[tuple[int, int]]:
    """Start and end of each run of equal values."""
    edges = np.flatnonzero(np.diff(values)) + 1
    yield from zip([0, *edges.tolist()], [*edges.tolist(), len(values)], strict=True)
