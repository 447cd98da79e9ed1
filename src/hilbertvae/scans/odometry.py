"""Poses of 3D scans that come without any: lidar odometry by KISS-ICP.

Vizzo, Guadagnino, Mersch, Wiesmann, Behley, Stachniss, *KISS-ICP: In Defense of Point-to-Point ICP*, RA-L 2023, through its own package.
"""

from __future__ import annotations

import os
import warnings

import numpy as np
from scipy.spatial import cKDTree

from hilbertvae.checks import InputError, extra_module
from hilbertvae.scans.deskewing import Beams, deskewed

KISS_ICP = "kiss_icp"
FINDING = "Finding poses by KISS-ICP"
"""What progress is called."""
RANGE_QUANTILE = 0.99
"""Voxels are a hundredth of the range, as KISS-ICP has them; the range is the data's, since a room wants smaller ones than a street."""
SMALLEST_RANGE_M = 5.0
STARTS = ((0, 0), (0.05, 0), (-0.05, 0), (0, 0.05), (0, -0.05), (0.1, 0), (-0.1, 0), (0, 0.1), (0, -0.1))
"""Where a motion is tried from: KISS-ICP's guess, and these shares of the range beside it, along each axis."""
GOOD_FIT, BAD_FIT = 0.6, 0.7
"""Scans of KITTI, nuScenes and simulated streets fit with 0.4 to 0.66 where they are matched right, 1 to 7 m apart, and with 0.68 to
0.9 where they are not. From the first on, a motion is tried from elsewhere; from the second on, poses get a warning."""

LONGEST_SWEEP = 2.0
"""In times from scan to scan. If beams are farther from their message's time, then one of the two times is wrong."""


def check_poses_choice(poses: str | None) -> None:
    """An `InputError` unless `poses` is None or names the one way there is to find poses."""
    if poses not in (None, KISS_ICP):
        raise InputError(f"reading.poses: expected {KISS_ICP} or nothing, got {poses!r}")


class KissOdometry:
    """One scan after the other, in the order of travel; the map frame is that of the first.

    KISS-ICP guesses each motion from the one before, and the first from standing still: a sensor that moves 4 m from scan to scan is
    then taken to stand, and so is one that left scans out. So the first motion is tried from several places, since ground and straight
    fronts fit well enough where nothing moved, and so is a scan that fits the one before badly.
    """

    def __init__(self):
        self._kiss = self._voxel_m = self._range_m = None
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
        kiss = self._kiss
        source, thinned = kiss.voxelize(points)
        if self._before is not None:
            self._move(source)
        kiss.local_map.update(thinned, kiss.last_pose)
        self._before = cKDTree(thinned)
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
        config = extra_module("poses", "kiss_icp.config").KISSConfig()
        lengths = np.sqrt(np.square(points).sum(axis=1))
        self._range_m = max(float(np.quantile(lengths, RANGE_QUANTILE)), SMALLEST_RANGE_M)
        self._voxel_m = self._range_m / 100
        config.data.max_range, config.data.min_range, config.data.deskew = self._range_m, 0.0, False
        config.mapping.voxel_size = self._voxel_m
        config.registration.max_num_threads = 1  # the same bits on every machine
        self._kiss = extra_module("poses", "kiss_icp.kiss_icp").KissICP(config)

    def _move(self, source: np.ndarray) -> None:
        """A step of `KissICP.register_frame`, with more than one start where the fit is bad."""
        kiss, tried = self._kiss, []
        sigma, back, expected = kiss.adaptive_threshold.get_threshold(), np.linalg.inv(kiss.last_pose), kiss.last_delta
        for x, y in STARTS:
            guess = expected.copy()
            guess[:2, 3] += np.array([x, y]) * self._range_m
            motion = back @ kiss.registration.align_points_to_map(
                points=source,
                voxel_map=kiss.local_map,
                initial_guess=kiss.last_pose @ guess,
                max_correspondance_distance=3 * sigma,
                kernel=sigma,
            )
            if not np.isfinite(motion).all():
                raise InputError("poses=kiss_icp: KISS-ICP found no pose; are these scans of one place, in the order of travel?")
            tried.append((self._fit(source, motion), motion))
            if tried[-1][0] < GOOD_FIT and self.fits:  # none before the first motion foretells it
                break
        fit, motion = min(tried, key=lambda each: each[0])
        self.fits.append(fit)
        if len(tried) == 1:  # a jump says nothing of how well motions are foreseen
            kiss.adaptive_threshold.update_model_deviation(np.linalg.inv(expected) @ motion)
        kiss.last_delta, kiss.last_pose = motion, kiss.last_pose @ motion

    def _fit(self, source: np.ndarray, motion: np.ndarray) -> float:
        """The mean distance from a scan's points, moved, to the nearest of the scan before; in voxels, and none counts more than one."""
        distance, _ = self._before.query(source @ motion[:3, :3].T + motion[:3, 3], distance_upper_bound=self._voxel_m)
        return float(np.minimum(distance, self._voxel_m).mean() / self._voxel_m)
