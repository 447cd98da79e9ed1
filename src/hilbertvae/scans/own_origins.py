"""Where the files of a folder say that their beams started, and whether that is in the frame of their points."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np

from hilbertvae.scans.file_points import FilePoints
from hilbertvae.scans.point_files import read_points

SAME_PLACE_M = 0.01
SAME_TURN = 1e-3
LOOKED_AT = 5
"""Files whose origins are compared before odometry: enough that a robot that moved has moved in one of them."""


class OwnOrigins:
    """The origins of one folder's files, scan after scan.

    A file's origin counts in the frame of its points. Two kinds of files say another: ROS's `pointcloud_to_pcd` leaves points in the
    sensor's frame and writes where that was in a fixed one, and an E57 station has taken its points to that one already.

    files: those of the folder. poses_path: what gives their poses; None where odometry finds them.
    """

    def __init__(self, files: list[Path], poses_path: Path | None):
        self.folder, self.poses_path = files[0].parent, poses_path
        self.moving = poses_path is None and _move(files)
        self.repeated = self.placed = 0

    def place(self, found: FilePoints, points: np.ndarray, pose: np.ndarray | None, beam_origins: Callable) -> tuple:
        """(where beams started (N, 3), the pose (3, 4) that takes them and `points (N, 3)` to the map frame, None as given)."""
        if found.origins is None or (self.moving and found.pose is None):
            return beam_origins(points), pose
        start = np.broadcast_to(in_space(found.origins), points.shape)
        if pose is None:
            return start, None
        if found.pose is not None:
            if _same_pose(found.pose, pose):
                self.placed += 1
                return start, np.eye(3, 4)
        elif np.linalg.norm(pose[:, 3]) > SAME_PLACE_M and (np.abs(start - pose[:, 3]) < SAME_PLACE_M).all():
            self.repeated += 1
            return beam_origins(points), pose
        return start, pose

    def warn(self) -> None:
        """Warnings of what was not taken at its word."""
        if self.moving:
            text = "scans say that they were taken at different places; so those are none in the sensor's own frame"
            warnings.warn(f"{self.folder}: {text}", stacklevel=4)
        if self.repeated:
            text = f"{self.repeated} scans say that they were taken where {self.poses_path.name} places them; so that is no place in them"
            warnings.warn(f"{self.folder}: {text}", stacklevel=4)
        if self.placed:
            text = f"{self.placed} scans are where {self.poses_path.name} would place them; so they are taken as they are"
            warnings.warn(f"{self.folder}: {text}", stacklevel=4)


def in_space(points: np.ndarray) -> np.ndarray:
    """(N, 3) or (3,): points of two coordinates at height 0."""
    return points if points.shape[-1] == 3 else np.concatenate([points, np.zeros_like(points[..., :1])], axis=-1)


def _move(files: list[Path]) -> bool:
    """Whether scans of one origin each have different ones, where one that says nothing is at 0."""
    chosen = np.unique(np.linspace(0, len(files) - 1, LOOKED_AT).astype(int))
    places = []
    for found in (read_points(files[index], may_be_empty=True) for index in chosen):
        if len(found.points) and found.pose is None and (found.origins is None or found.origins.ndim == 1):
            places.append(np.zeros(3) if found.origins is None else in_space(found.origins))
    return len(places) > 1 and bool((np.ptp(places, axis=0) > SAME_PLACE_M).any())


def _same_pose(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether both place a scan alike; how they turn it counts where neither moves it, since conventions of angles differ."""
    near = np.linalg.norm(one[:, 3] - other[:, 3]) < SAME_PLACE_M
    return bool(near and (np.linalg.norm(one[:, 3]) > SAME_PLACE_M or np.abs(one[:, :3] - other[:, :3]).max() < SAME_TURN))
