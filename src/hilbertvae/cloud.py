"""Labelled points: D = {(x_i, y_i)}, occupied where a beam ended and free along the way (paper II-A, METHOD 1).

How densely beams are sampled changes every score, so it is no setting of a run. Three clouds of a site are fixed:
`fit_cloud`, what mappers are given; `points_cloud`, for scoring as the paper does; `voxel_cloud`, for scoring area or volume.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hilbertvae.checks import InputError, check_cell_m, check_points, check_positive
from hilbertvae.scans.beam_lengths import (
    LONGEST_MEDIAN_M,
    LONGEST_PLANAR_M,
    SHORTEST_M,
    ClippedCheck,
    UnitCheck,
    beam_lengths,
    warn_of_long_beams,
    within_range,
)
from hilbertvae.scans.rounded import warn_if_rounded
from hilbertvae.scans.scan import Scans
from hilbertvae.voxel_votes import VoxelVotes, distinct_voxels, voxel_index, voxel_votes

RESOLUTION_M = {2: 0.1, 3: 0.2}
"""The map's cell, by dimension."""
FREE_POINT_M = 2.0
"""The `points` cloud has a free point in so much of a beam: the rule of the author's own code (METHOD 1)."""
OCCUPIED_SHARE = 0.15
"""A voxel is occupied from this share of returns on: many beams graze a wall's voxel, and a majority would erase it."""
READINGS = ("voxels", "points")
"""How a site is asked: every voxel once, or every return and the free points of `points_cloud`, as in the paper."""
MOST_DOUBTFUL = 1e8
"""Places of free space along beams that can hardly be in metres: a minute's work. A site of 2e7 returns, in metres, has more."""
NO_RETURN = "; leave out beams without a return"


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


def fit_cloud(scans: Scans, resolution_m: float) -> Cloud:
    """What mappers are given: at most one point per voxel and label, at the mean of its samples, with their count as weight."""
    return thinned_cloud(voxel_votes(scans, resolution_m))


def thinned_cloud(votes: VoxelVotes) -> Cloud:
    """`fit_cloud` of beams that were sampled before."""
    hit, free = votes.hits > 0, votes.frees > 0
    return Cloud(
        np.concatenate([votes.hit_mean[hit], votes.free_mean[free]]),
        np.arange(hit.sum() + free.sum()) < hit.sum(),
        np.concatenate([votes.hits[hit], votes.frees[free]]),
    )


def placed_as(cloud: Cloud, other: Cloud, resolution_m: float) -> Cloud:
    """A `fit_cloud`, each point where `other`, that of some of the same scans, has one in its voxel: the one of its label if there are two.

    Means of fewer samples lie elsewhere in a voxel, and so perhaps in another cell of a turned box, where only one of both knows something.
    """
    if not len(cloud) or not len(other):
        return cloud
    _, voxel = distinct_voxels(voxel_index(np.concatenate([other.points, cloud.points]), resolution_m))
    theirs, mine = voxel[: len(other)], voxel[len(other) :]
    place = np.full((2, len(voxel)), -1)  # by label and voxel
    place[other.occupied.astype(int), theirs] = np.arange(len(other))
    own, opposite = place[cloud.occupied.astype(int), mine], place[1 - cloud.occupied.astype(int), mine]
    there = np.where(own >= 0, own, opposite)
    points = np.where((there >= 0)[:, None], other.points[there], cloud.points)
    return Cloud(points, cloud.occupied, cloud.weight)


def labelled_voxels(cloud: Cloud, resolution_m: float) -> Cloud:
    """`voxel_cloud` of a `fit_cloud`: what a map of it would say."""
    if not len(cloud):
        return cloud
    index, voxel = distinct_voxels(voxel_index(cloud.points, resolution_m))
    hits, frees = (np.bincount(voxel, np.where(cloud.occupied == label, cloud.weight, 0.0), len(index)) for label in (True, False))
    return _voted(index, hits, frees, resolution_m)


def voxel_cloud(scans: Scans, resolution_m: float) -> Cloud:
    """One point per voxel seen, at its centre, occupied if returns have at least 15 % of the votes; weight 1."""
    return voted_cloud(voxel_votes(scans, resolution_m))


def voted_cloud(votes: VoxelVotes) -> Cloud:
    """`voxel_cloud` of beams that were sampled before."""
    return _voted(votes.index, votes.hits, votes.frees, votes.resolution_m)


def _voted(index: np.ndarray, hits: np.ndarray, frees: np.ndarray, resolution_m: float) -> Cloud:
    """One point for each voxel at its centre, with the label of its votes."""
    return Cloud((index + 0.5) * resolution_m, hits / (hits + frees) >= OCCUPIED_SHARE, np.ones(len(index)))


def points_cloud(scans: Scans, resolution_m: float, seed: int = 0) -> tuple[Cloud, np.ndarray]:
    """The paper's reading: each return, and max(1, floor(r / 2)) uniform free points along a beam of r metres.

    Also returns `beam (N,)`: the index of the return that each point belongs to.
    """
    length = np.linalg.norm(scans.points - scans.origins, axis=1)
    count = np.maximum(1, np.floor(length / FREE_POINT_M)).astype(np.int64)
    beam = np.repeat(np.arange(len(scans)), count)
    reach = np.maximum(1 - resolution_m / np.maximum(length, 1e-9), 0)[beam]
    fraction = np.random.default_rng(seed).random(len(beam)) * reach
    free = scans.origins[beam] + (scans.points - scans.origins)[beam] * fraction[:, None]
    points = np.concatenate([scans.points, free])
    cloud = Cloud(points, np.arange(len(points)) < len(scans), np.ones(len(points)))
    return cloud, np.concatenate([np.arange(len(scans)), beam])


def cloud_from_scans(points, origins, resolution_m: float | None = None, max_range_m: float | None = None) -> Cloud:
    """Labelled points for `fit`, of scans: returns, and the free space before them.

    points: a list of (n_s, D) arrays in metres in the map frame, one per scan, an (S, n, D) array of scans, or one (N, D) array. Of
    several scans some may be empty. Beams without a return are left out; what ends where it began, as drivers write them, is so here.
    origins: (S, D), where the sensor stood in each scan; with one (N, D) array of points, (N, D) or one (D,) origin.
    resolution_m: 0.1 in 2D and 0.2 in 3D unless given. max_range_m: beams as long as this and longer are dropped; none unless given.
    The cloud has `points` (N, D) in metres, `occupied` (N,) bool and `weight` (N,), how many samples each point is the mean of.
    Raises `InputError` for what does not fit together, and for so many beams that can hardly be in metres that their free space would take
    hours. A `UserWarning` says where coordinates can't be in metres otherwise, where a beam is longer than any laser's, where many are of
    one length, as of no return, and where half or single precision has moved far coordinates by a part of a cell.
    """
    first = origins[0] if isinstance(origins, (list, tuple)) and len(origins) else origins
    came_as = first.dtype if isinstance(getattr(first, "dtype", None), np.dtype) else np.dtype(np.float64)
    ragged = getattr(points, "dtype", None) == np.dtype(object) and len(_shape(points)) == 1  # as numpy keeps scans of different lengths
    if ragged or (not isinstance(points, (list, tuple)) and len(_shape(points)) == 3):
        points = list(points)
    one = next((scan for scan in points if len(_shape(scan)) == 2), None) if isinstance(points, (list, tuple)) else None
    if one is not None:
        dimension = check_points(one, "points", allow_empty=True, hint=NO_RETURN).shape[1]
        if len(_shape(origins)) == 1:
            raise InputError(f"origins: expected one per scan, shape ({len(points)}, {dimension}), got one of shape {_shape(origins)}")
        origins = check_points(origins, "origins", dimension=dimension)
        if len(origins) != len(points):
            raise InputError(f"origins: expected one per scan ({len(points)}), got {len(origins)}")
        warn_if_rounded(origins, "origins", came_as=came_as)
        points = [np.empty((0, dimension)) if _shape(p) == (0,) else p for p in points]  # an empty list has no second axis
        points = [check_points(p, f"points[{k}]", dimension=dimension, allow_empty=True, hint=NO_RETURN) for k, p in enumerate(points)]
        scan = np.repeat(np.arange(len(points), dtype=np.int32), list(map(len, points)))
        points = np.concatenate(points)
        origins = origins[scan]
    else:
        if isinstance(points, (list, tuple)) and len(points) and all(_shape(scan) == (0,) for scan in points):
            raise InputError(f"points: expected a return in at least one of {len(points)} scans, got none")
        points = check_points(points, "points", hint=NO_RETURN)
        origins = check_points([origins] if len(_shape(origins)) == 1 else origins, "origins", dimension=points.shape[1])
        if len(origins) not in (1, len(points)):
            raise InputError(f"origins: expected one, or one per point ({len(points)}), got {len(origins)}")
        warn_if_rounded(origins, "origins", came_as=came_as)
        origins = np.broadcast_to(origins, points.shape)
        scan = np.zeros(len(points), np.int32)
    resolution_m = RESOLUTION_M[points.shape[1]] if resolution_m is None else check_cell_m(resolution_m, "resolution_m")
    warn_if_rounded(points, "points")
    lengths = beam_lengths(points, origins)
    units = UnitCheck(longest_m=LONGEST_PLANAR_M if points.shape[1] == 2 else LONGEST_MEDIAN_M)
    units.see(lengths)
    warn_of_long_beams(lengths, "points")
    kept = _returned(lengths, scan, units, max_range_m)
    points, origins, scan, lengths = points[kept], origins[kept], scan[kept], lengths[kept]
    places = float(lengths.sum()) / resolution_m
    if places > MOST_DOUBTFUL and (doubt := units.doubt()):  # a room in millimetres would take hours, and all memory
        raise InputError(f"points: {doubt}. Free space along them would be {places:.1g} places; max_range_m drops long beams")
    units.warn("points")
    return fit_cloud(Scans(points, origins, scan, np.arange(len(points), dtype=np.int32)), resolution_m)


def _returned(lengths: np.ndarray, scan: np.ndarray, units: UnitCheck, max_range_m: float | None) -> np.ndarray:
    """(N,) bool: which beams, of `lengths (N,)` in the scans `scan (N,)`, have a return within `max_range_m`; an `InputError` for none of
    some, and a `UserWarning` where many are of one length."""
    limit_m = np.inf if max_range_m is None else check_positive(max_range_m, "max_range_m")
    clipped = ClippedCheck(limit_m, of_points=True)
    for portion in np.split(lengths, np.flatnonzero(np.diff(scan)) + 1):
        clipped.see(portion[portion > SHORTEST_M])
    clipped.warn("points", "max_range_m")
    kept = within_range(lengths, SHORTEST_M, limit_m)
    if kept.any():
        return kept
    if max_range_m is not None:
        found = f"none of {len(lengths)}" + (f", the shortest with {lengths.min():.4g} m" if len(lengths) else "")
        raise InputError(f"max_range_m: expected beams shorter than {max_range_m} m, got {found}{units.hint(max_range_m)}")
    if len(lengths):
        where = f"{len(lengths)} points where the sensor stood"
        raise InputError(f"points: expected returns, got {where}; are they in its frame, not the map's?")
    return kept


def _shape(values) -> tuple[int, ...]:
    """The shape of an array; () of what makes none, as rows of several lengths."""
    try:
        return np.shape(values)
    except (TypeError, ValueError, RuntimeError):
        return ()
