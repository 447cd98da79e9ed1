"""Reader of the layout of KITTI odometry: `velodyne/NNNNNN.bin` and `poses.txt`."""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from pathlib import Path

from hilbertvae.checks import InputError
from hilbertvae.scans.poses import read_calibration
from hilbertvae.scans.scan import Scans
from hilbertvae.scans.scan_folder import POSES, read_posed_scans, scan_files

VELODYNE = "velodyne"
CALIBRATION = "calib.txt"


def is_kitti(folder: str | os.PathLike) -> bool:
    """Whether a folder has this layout."""
    return (Path(folder) / VELODYNE).is_dir()


def read_kitti(
    folder: str | os.PathLike,
    beam_origin: str | Sequence[float] = "centre",
    max_range_m: float = 80.0,
    min_range_m: float = 2.5,
    every: int = 1,
    poses: str | None = None,
) -> Scans:
    """The scans of a drive, as `read_scan_folder` reads them; `beam_origin='hdl64'` is KITTI's own sensor.

    Beams of up to `min_range_m` ended on the car that carries the sensor. KITTI's own poses are the left camera's: where `calib.txt` says
    how the lidar stands to it, they are turned into the lidar's; without that file poses take the lidar's frame to the map's.
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
    if there and calibration is None and poses is None:
        warnings.warn(f"{folder / CALIBRATION}: no line Tr:, so {POSES} is taken to have the lidar's poses, not the camera's", stacklevel=3)
    return read_posed_scans(files, folder / POSES, beam_origin, max_range_m, min_range_m, every, poses, calibration)
