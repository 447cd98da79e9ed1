"""Reader of the layout of KITTI odometry: `velodyne/NNNNNN.bin`, and `poses.txt` or, beside `sequences`, `poses/NN.txt`."""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.scans.file_points import LIDAR_RANGE_M
from hilbertvae.scans.poses import read_calibration, read_poses
from hilbertvae.scans.scan import Scans
from hilbertvae.scans.scan_folder import POSES, VELODYNE, kitti_poses, read_posed_scans, scan_files

CALIBRATION = "calib.txt"
OWN_CAR_M = 2.5
"""As far as the car that carries the sensor reaches."""
MOST_UPWARD = 0.8
"""No car goes more of its way along its lidar's z axis, which is a camera's way ahead."""
SHORTEST_PATH_M = 5.0
"""Shorter paths may be those of a sensor that is moved by hand, or of one that stands and whose poses are not steady."""


def is_kitti(folder: str | os.PathLike) -> bool:
    """Whether a folder has this layout."""
    return (Path(folder) / VELODYNE).is_dir()


def read_kitti(
    folder: str | os.PathLike,
    beam_origin: str | Sequence[float] = "centre",
    max_range_m: float = LIDAR_RANGE_M,
    min_range_m: float = OWN_CAR_M,
    every: int = 1,
    poses: str | None = None,
) -> Scans:
    """The scans of a drive, as `read_scan_folder` reads them; `beam_origin='hdl64'` is KITTI's own sensor.

    Beams of up to `min_range_m` ended on the car that carries the sensor. KITTI's own poses are the left camera's: where `calib.txt` says
    how the lidar stands to it, they are turned into the lidar's; without that file poses take the lidar's frame to the map's, and a
    `UserWarning` says so where they would take the car up into the air. Poses where KITTI's odometry has them, in `../../poses`, are the
    camera's for certain, so they need that file.
    Raises `InputError` for a folder of another layout, for another number of poses than of scans, and for files that can't be read.
    """
    folder = Path(folder)
    if not is_kitti(folder):
        raise InputError(f"{folder}: expected KITTI's layout, {VELODYNE}/NNNNNN.bin and {POSES}; there is no folder {VELODYNE}")
    files = scan_files(folder / VELODYNE)
    if files[0].suffix.lower() != ".bin":
        raise InputError(f"{folder / VELODYNE}: expected .bin scans, found {files[0].suffix}")
    there = (folder / CALIBRATION).is_file()
    calibration = read_calibration(folder / CALIBRATION) if there else None
    poses_path = kitti_poses(folder)
    if poses_path.name != POSES and calibration is None and poses is None:
        raise InputError(
            f"{poses_path}: these are poses of KITTI's camera, for which {folder / CALIBRATION} is expected to have a line Tr:, and "
            f"{'has none' if there else 'there is no such file'}; if they are the lidar's, copy them to {folder / POSES}"
        )
    if there and calibration is None and poses is None:
        warnings.warn(f"{folder / CALIBRATION}: no line Tr:, so {POSES} is taken to have the lidar's poses, not the camera's", stacklevel=3)
    scans = read_posed_scans(files, poses_path, beam_origin, max_range_m, min_range_m, every, poses, calibration)
    if calibration is None and poses is None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what there is to say of the file was said when the scans were placed
            path = read_poses(poses_path)
        if _goes_up(path):
            warnings.warn(
                f"{folder / POSES}: poses go up rather than ahead: are they the camera's? Put KITTI's {CALIBRATION} beside them",
                stacklevel=3,
            )
    return scans


def _goes_up(poses: np.ndarray) -> bool:
    """Whether most of the path of `poses (S, 3, 4)` lies along the z axis of the sensor, each step seen from where it starts."""
    # Not along the first sensor's axis: a camera that turns a corner goes along the first one's x.
    steps = np.diff(poses[:, :, 3], axis=0)
    path_m = np.sqrt(np.square(steps).sum(axis=1)).sum()
    upward_m = np.abs((steps * poses[:-1, :, 2]).sum(axis=1)).sum()
    return bool(path_m > SHORTEST_PATH_M and upward_m > MOST_UPWARD * path_m)
