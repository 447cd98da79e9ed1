"""Readers of `poses.txt`, one pose a line in KITTI's (12 numbers) or TUM's form (8 numbers), or in the plane (3 numbers), and of KITTI's
`calib.txt`."""

from __future__ import annotations

import codecs
import math
import os
import warnings
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from hilbertvae.checks import InputError
from hilbertvae.scans.file_points import reading
from hilbertvae.scans.headings import warn_of_degrees
from hilbertvae.scans.rounded import warn_of_few_digits

RIGID = 1e-3
"""How far R R^T may be from 1, and a quaternion's length from 1: files are written with 6 digits and fewer."""
WIDTHS = (12, 16, 8, 3)
"""How many numbers a line may have."""
MOST_TILT_DEG = 15.0
"""A planar laser that leans further, on a tilting unit or a fallen robot, does not see the plan of a place."""
UPRIGHT, MANY, NEARLY_ALL = 0.5, 0.2, 0.9
"""The cosine of 60 degrees, and shares of poses, by which quaternions are told to have qw first."""
FARTHEST_M = 1e9
"""No place on Earth is as far from the origin of any frame; beyond, float64 loses the millimetre."""


def read_poses(path: str | os.PathLike) -> np.ndarray:
    """(S, 3, 4) float64: `read_timed_poses` without the times."""
    return read_timed_poses(path)[0]


def read_timed_poses(path: str | os.PathLike) -> tuple[np.ndarray, np.ndarray | None]:
    """(S, 3, 4) float64: rotation and translation in metres that take scan k from the sensor frame to the map frame. And their times
    (S,), seconds, where lines have them, else None.

    A line is a 3 x 4 matrix row by row, or a 4 x 4 one, `t x y z qx qy qz qw`, or `x y heading` with the heading in radians from the x
    axis, apart by blanks or commas; all lines are of one kind. Empty lines and those that start with # are passed over. Raises `InputError`
    with the line's number for anything else, and for a matrix or quaternion that is no rotation. Warns where times go back, where headings
    look like degrees, where quaternions look like qw qx qy qz, and where far places have too few digits.
    """
    path = Path(path)
    poses, times, headings, quaternions, width, back = [], [], [], [], None, 0
    with reading(path, "poses, 12 numbers a line (or 8, as TUM writes them; or 3, x y heading)"), open(path, "rb") as file:
        for number, line in enumerate(file, start=1):
            fields = (line.removeprefix(codecs.BOM_UTF8) if number == 1 else line).replace(b",", b" ").split()
            if not fields or fields[0].startswith(b"#"):
                continue
            where, width = f"{path}, line {number}", width or len(fields)
            if len(fields) not in WIDTHS or len(fields) != width:
                raise InputError(f"{where}: expected {width if width in WIDTHS else '12, 16, 8 or 3'} numbers, got {len(fields)}")
            try:
                values = np.array(fields, dtype=np.float64)
            except ValueError as error:
                raise InputError(f"{where}: expected numbers ({error})") from error
            if not np.isfinite(values).all():
                raise InputError(f"{where}: expected finite numbers, got {values.tolist()}")
            if width == 16 and values[12:].tolist() != [0, 0, 0, 1]:
                raise InputError(f"{where}: expected 0 0 0 1 at the end of a 4 x 4 matrix, got {values[12:].tolist()}")
            pose = values[:12].reshape(3, 4) if width in (12, 16) else _from_quaternion(where, values) if width == 8 else _in_plane(*values)
            _check(where, pose)
            poses.append(pose)
            if width == 8:
                back = back or (number if times and values[0] < times[-1] else 0)
                times.append(values[0])
                quaternions.append(values[4:])
            if width == 3:
                headings.append(values[2])
    if not poses:
        raise InputError(f"{path}: expected poses, found none")
    if back:
        warnings.warn(
            f"{path}, line {back}: its time is before that of the line above; poses are those of scans by their place", stacklevel=4
        )
    if headings:
        warn_of_degrees(np.array(poses)[:, :2, 3], np.array(headings), path)
    if turned := _upside_down(np.array(quaternions)):
        said = f"in {turned} of {len(poses)} poses scans lie upside down; are the quaternions qw first? qx qy qz qw are expected"
        warnings.warn(f"{path}: {said}", stacklevel=4)
    warn_of_few_digits(np.array(poses)[:, :, 3], path)
    return np.array(poses), np.array(times) if times else None


def read_calibration(path: str | os.PathLike) -> np.ndarray | None:
    """(3, 4) float64: the line `Tr:` of KITTI's `calib.txt`, which takes points from the lidar's frame to the camera's; None without one.

    Raises `InputError` for a line that is no rigid motion.
    """
    path = Path(path)
    with reading(path, "a calibration"), open(path, "rb") as file:
        for number, line in enumerate(file, start=1):
            name, *fields = line.removeprefix(codecs.BOM_UTF8).split()[:14] or [b""]
            if name != b"Tr:":
                continue
            try:
                transform = np.array(fields, dtype=np.float64).reshape(3, 4)
            except ValueError:
                raise InputError(f"{path}, line {number}: expected Tr: and 12 numbers") from None
            _check(f"{path}, line {number}", transform)
            return transform
    return None


def lidar_poses(camera_poses: np.ndarray, lidar_to_camera: np.ndarray) -> np.ndarray:
    """(S, 3, 4) lidar to map from KITTI's `camera_poses (S, 3, 4)`: its poses are the camera's, in the frame of the first camera.

    The map frame is that of the first lidar: x ahead, z up.
    """
    bottom = [[0.0, 0.0, 0.0, 1.0]]
    calibration = np.vstack([lidar_to_camera, bottom])
    square = np.concatenate([camera_poses, np.broadcast_to(bottom, (len(camera_poses), 1, 4))], axis=1)
    return (np.linalg.inv(calibration) @ square @ calibration)[:, :3]


def leans(pose: np.ndarray) -> bool:
    """Whether a planar laser under a pose (3, 4) leans more than `MOST_TILT_DEG`, upside down or not."""
    return pose[2, 2] ** 2 < math.cos(math.radians(MOST_TILT_DEG)) ** 2


def _check(where: str, pose: np.ndarray) -> None:
    rotation, place = pose[:, :3], pose[:, 3]
    # Entries beyond 2 come first: their squares may overflow.
    if np.abs(rotation).max() > 2 or np.abs(rotation @ rotation.T - np.eye(3)).max() > RIGID or np.linalg.det(rotation) < 0:
        raise InputError(f"{where}: expected a rigid motion, the 3 x 3 part is no rotation to {RIGID}")
    if np.abs(place).max() > FARTHEST_M:
        raise InputError(f"{where}: expected a place in metres, got {place.tolist()}")


def _from_quaternion(where: str, values: np.ndarray) -> np.ndarray:
    length = math.hypot(*values[4:])
    if abs(length - 1) > RIGID:
        raise InputError(f"{where}: expected a rigid motion, the quaternion has length {length:.6g}")
    return np.column_stack([Rotation.from_quat(values[4:]).as_matrix(), values[1:4]])


def _upside_down(quaternions: np.ndarray) -> int:
    """How many scans lie upside down by quaternions (S, 4), if read as qw qx qy qz they would nearly all stand upright; else 0.

    An upright sensor whose qw is read as qx seems to roll: it is upside down while it heads along x, and upright on the way back. One
    that hangs from a ceiling is upside down at any heading, and would not stand upright if read the other way.
    """
    if not len(quaternions):
        return 0
    squares = np.square(quaternions)
    up, other_up = 1 - 2 * (squares[:, 0] + squares[:, 1]), 1 - 2 * (squares[:, 1] + squares[:, 2])
    turned = int((up < -UPRIGHT).sum())
    return turned if turned >= MANY * len(up) and (other_up > UPRIGHT).mean() >= NEARLY_ALL else 0


def _in_plane(x: float, y: float, heading: float) -> np.ndarray:
    cos, sin = math.cos(heading), math.sin(heading)
    return np.array([[cos, -sin, 0.0, x], [sin, cos, 0.0, y], [0.0, 0.0, 1.0, 0.0]])
