"""Poses of 3D scans that come without any: lidar odometry by KISS-ICP.

Vizzo, Guadagnino, Mersch, Wiesmann, Behley, Stachniss, *KISS-ICP: In Defense of Point-to-Point ICP*, RA-L 2023, through its own package.
"""

from __future__ import annotations

import os
import warnings
from types import ModuleType

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from hilbertvae.checks import InputError, extra_module
from hilbertvae.scans.deskewing import Beams, deskewed
from hilbertvae.scans.point_times import LONGEST_SWEEP

KISS_ICP = "kiss_icp"
FINDING = "Finding poses by KISS-ICP"
"""What progress is called."""
RANGE_QUANTILE = 0.99
"""Voxels are a hundredth of the range, as KISS-ICP has them; the range is the data's, since a room wants smaller ones than a street."""
SMALLEST_RANGE_M = 5.0
STARTS = ((0, 0), (0.05, 0), (-0.05, 0), (0, 0.05), (0, -0.05), (0.1, 0), (-0.1, 0), (0, 0.1), (0, -0.1))
"""Where a motion is tried from: KISS-ICP's guess, and these shares of the range beside it, along each axis."""
GOOD_FIT, BAD_FIT = 0.6, 0.7
"""Scans of KITTI, nuScenes and simulated streets fit with 0.3 to 0.66 where they are matched right, 1 to 7 m apart, and with 0.68 to
0.97 where they are not. From the first on, a motion is tried from elsewhere; from the second on, poses get a warning."""
COLUMN_M, LEVEL_M = 0.5, 0.2
"""Side of the columns in which points stand, and how far from a column's lowest and highest point its floor and ceiling reach."""
FEWEST = 100
"""Points that stand, from which on they tell a motion by themselves."""


def check_poses_choice(poses: str | None) -> None:
    """An `InputError` unless `poses` is None or names the one way there is to find poses."""
    if poses not in (None, KISS_ICP):
        raise InputError(f"reading.poses: expected {KISS_ICP} or nothing, got {poses!r}")


class KissOdometry:
    """One scan after the other, in the order of travel; the map frame is that of the first.

    KISS-ICP guesses each motion from the one before, and the first from standing still: a sensor that moves 4 m from scan to scan is
    then taken to stand, and so is one that left scans out. So the first motion is tried from several places, since ground and straight
    fronts fit well enough where nothing moved, and so is a scan that fits the one before badly.

    Rings of a lidar on a floor or a ceiling lie as they lay, wherever it goes, and hold it where it was. So what stands upright says alone
    how far along the plane and which way round the sensor moved; height, pitch and roll are as all points have them.
    """

    def __init__(self):
        self._kiss = self._voxel_m = self._range_m = self._standing = None
        self._before: cKDTree | None = None
        self._stamp_ns: int | None = None
        self._took_ns = 0  # from the last scan but one to the last
        self.fits: list[float] = []
        """How well each scan from the second on fits the one before: 0 is best, 1 is not at all (see `_fit`)."""

    def deskewed(self, points: np.ndarray, starts: np.ndarray, times_ns: np.ndarray | None, stamp_ns: int) -> Beams:
        """Both (N, 3), metres, as the sensor's frame at `stamp_ns` has them, if it moves on as it did from the scan before, which is all
        that is known before a scan is registered. times_ns: (N,), when each beam was measured, after `stamp_ns`."""
        took_ns, self._took_ns = self._took_ns, 0 if self._stamp_ns is None else stamp_ns - self._stamp_ns
        self._stamp_ns = stamp_ns
        # Beams of before or after as long a time as a sweep may take are too far from the motion that is known.
        if times_ns is None or not self.fits or took_ns <= 0 or np.abs(times_ns).max(initial=0) > LONGEST_SWEEP * took_ns:
            return points, starts
        return deskewed(points, starts, times_ns / took_ns, self._kiss.last_delta)

    def register(self, points: np.ndarray) -> np.ndarray:
        """(3, 4) float64, the pose of a scan's `points (N, 3)`, finite, metres, sensor frame. A scan without points moves on as before."""
        if not len(points):
            return np.eye(3, 4) if self._kiss is None else self._kiss.last_pose[:3].copy()
        points = np.ascontiguousarray(points, dtype=np.float64)
        if self._kiss is None:
            self._start(points)
        kiss, stand = self._kiss, stands(points)
        source, thinned = kiss.voxelize(points)
        upright, upright_thinned = kiss.voxelize(points[stand]) if np.count_nonzero(stand) >= FEWEST else (source, thinned)
        if self._before is not None:
            self._move(source, upright)
        kiss.local_map.update(thinned, kiss.last_pose)
        self._standing.update(upright_thinned, kiss.last_pose)
        self._before = cKDTree(upright_thinned)
        return kiss.last_pose[:3].copy()

    def warn(self, path: str | os.PathLike) -> None:
        """One `UserWarning` where scans fit so badly that their poses are probably wrong."""
        bad = np.flatnonzero(np.array(self.fits) > BAD_FIT) + 1
        if len(bad):
            warnings.warn(
                f"{path}: poses=kiss_icp: {len(bad)} of {len(self.fits) + 1} scans hardly fit the one before, scan {bad[0]} first; "
                "their poses are probably wrong. Scans closer together help",
                stacklevel=4,
            )

    def _start(self, points: np.ndarray) -> None:
        config = _kiss_icp("config").KISSConfig()
        lengths = np.sqrt(np.square(points).sum(axis=1))
        self._range_m = max(float(np.quantile(lengths, RANGE_QUANTILE)), SMALLEST_RANGE_M)
        self._voxel_m = self._range_m / 100
        config.data.max_range, config.data.min_range, config.data.deskew = self._range_m, 0.0, False
        config.mapping.voxel_size = self._voxel_m
        config.registration.max_num_threads = 1  # the same bits on every machine
        self._kiss = _kiss_icp("kiss_icp").KissICP(config)
        self._standing = _kiss_icp("mapping").get_voxel_hash_map(config)

    def _move(self, source: np.ndarray, upright: np.ndarray) -> None:
        """A step of `KissICP.register_frame`, by what stands `upright` in `source`, and with more than one start where the fit is bad."""
        kiss, tried, expected = self._kiss, [], self._kiss.last_delta
        for x, y in STARTS:
            guess = expected.copy()
            guess[:2, 3] += np.array([x, y]) * self._range_m
            motion = self._aligned(upright, self._standing, guess)
            motion = in_the_plane(motion, self._aligned(source, kiss.local_map, motion))
            tried.append((self._fit(upright, motion), motion))
            if tried[-1][0] < GOOD_FIT and self.fits:  # none before the first motion foretells it
                break
        fit, motion = min(tried, key=lambda each: each[0])
        self.fits.append(fit)
        if len(tried) == 1:  # a jump says nothing of how well motions are foreseen
            kiss.adaptive_threshold.update_model_deviation(np.linalg.inv(expected) @ motion)
        kiss.last_delta, kiss.last_pose = motion, kiss.last_pose @ motion

    def _aligned(self, points: np.ndarray, into, guess: np.ndarray) -> np.ndarray:
        """(4, 4), the motion from the pose before that fits points into a map, from a guess."""
        kiss = self._kiss
        sigma = kiss.adaptive_threshold.get_threshold()
        pose = kiss.registration.align_points_to_map(
            points=points, voxel_map=into, initial_guess=kiss.last_pose @ guess, max_correspondance_distance=3 * sigma, kernel=sigma
        )
        if not np.isfinite(pose).all():
            raise InputError("poses=kiss_icp: KISS-ICP found no pose; are these scans of one place, in the order of travel?")
        return np.linalg.inv(kiss.last_pose) @ pose

    def _fit(self, source: np.ndarray, motion: np.ndarray) -> float:
        """The mean distance from a scan's points, moved, to the nearest of the scan before; in voxels, and none counts more than one."""
        distance, _ = self._before.query(source @ motion[:3, :3].T + motion[:3, 3], distance_upper_bound=self._voxel_m)
        return float(np.minimum(distance, self._voxel_m).mean() / self._voxel_m)


def _kiss_icp(module: str) -> ModuleType:
    return extra_module("poses", f"kiss_icp.{module}", "poses=kiss_icp needs Python below 3.14 and")  # the extra is empty on newer ones


def stands(points: np.ndarray) -> np.ndarray:
    """(N,) bool: which `points (N, 3)` lie in a column with more in it than a floor and a ceiling: walls, trunks, cars, not open ground."""
    _, column = np.unique(np.floor(points[:, :2] / COLUMN_M), axis=0, return_inverse=True)
    column, height = column.ravel(), points[:, 2]
    low, high = np.full(column.max() + 1, np.inf), np.full(column.max() + 1, -np.inf)
    np.minimum.at(low, column, height)
    np.maximum.at(high, column, height)
    between = (height > low[column] + LEVEL_M) & (height < high[column] - LEVEL_M)
    return (np.bincount(column[between], minlength=len(low)) > 1)[column]


def in_the_plane(motion: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(4, 4): x, y and heading of one motion (4, 4), height, pitch and roll of another."""
    heading = Rotation.from_matrix(motion[:3, :3]).as_euler("ZYX")[0]
    _, pitch, roll = Rotation.from_matrix(other[:3, :3]).as_euler("ZYX")
    found = motion.copy()
    found[:3, :3] = Rotation.from_euler("ZYX", [heading, pitch, roll]).as_matrix()
    found[2, 3] = other[2, 3]
    return found
