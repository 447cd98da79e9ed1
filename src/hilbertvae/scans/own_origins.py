"""Where the files of a folder say that their beams started, and whether that is in the frame of their points."""

from __future__ import annotations

import warnings
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.spatial.distance import pdist

from hilbertvae.scans.beam_origins import BEAM_ORIGINS, BeamOrigins
from hilbertvae.scans.file_points import FilePoints
from hilbertvae.scans.point_files import read_points

SAME_PLACE_M = 0.01
SAME_TURN = 1e-3
LOOKED_AT = 5
"""Files whose origins are compared: enough that a robot that moved has moved in one of them."""


class OwnOrigins:
    """The origins of one folder's files, scan after scan.

    A file's origin counts in the frame of its points. Two kinds of files say another: ROS's `pointcloud_to_pcd` leaves points in the
    sensor's frame and writes where that was in a fixed one, and an E57 station has taken its points to that one already. Which kind they
    are is told by all of them together: origins are places in the map where they move as the poses do, however these were refined.

    files: those of the folder. given: (S, 3, 4), their poses, of `poses_path`; None where odometry finds them or files have their own.
    beam_origins: the rule for files that do not say.
    """

    def __init__(self, files: list[Path], given: np.ndarray | None, poses_path: Path, beam_origins: BeamOrigins):
        self.files, self.given, self.poses_name, self.beam_origins = files, given, poses_path.name, beam_origins
        self.said = self.moving = self.repeated = self.placed = self.replaced = 0
        self.apart_m = 0.0

    def place(self, index: int, found: FilePoints, points: np.ndarray) -> tuple:
        """(where beams started (N, 3), the pose (3, 4) that takes them and `points (N, 3)` of file `index` to the map frame; None for
        odometry)."""
        pose = None if self.given is None else self.given[index]
        if found.origins is None:
            return self.beam_origins(points), pose
        if found.pose is None and self._in_the_map:
            if pose is None:
                self.moving += 1
            else:
                self.repeated += 1
                self._compare(found, pose)
            return self.beam_origins(points), pose
        self.said += 1
        start = np.broadcast_to(in_space(found.origins), points.shape)
        if pose is not None and found.pose is not None and _same_pose(found.pose, pose):
            self.placed += 1
            return start, np.eye(3, 4)
        if pose is not None and found.pose is not None and self._in_the_map:
            self.replaced += 1
            self._compare(found, pose)
            turn = pose[:, :3] @ found.pose[:, :3].T
            pose = np.column_stack([turn, pose[:, 3] - turn @ found.pose[:, 3]])
        return start, pose

    def _compare(self, found: FilePoints, pose: np.ndarray) -> None:
        self.apart_m = max(self.apart_m, float(np.linalg.norm(_middle(found) - pose[:, 3])))

    @cached_property
    def _in_the_map(self) -> bool:
        """Whether origins are places in the map: where they are those of the poses, or move, and more like these than not at all.

        Beside odometry those are that move, of files of one origin each, where one that says nothing is at 0.
        """
        places, poses = [], []
        for index in np.unique(np.linspace(0, len(self.files) - 1, LOOKED_AT).astype(int)):
            found = read_points(self.files[index], may_be_empty=True)
            is_one = found.pose is None and (found.origins is None or found.origins.ndim == 1)
            if len(found.points) and (is_one or self.given is not None):
                places.append(_middle(found))
                poses.append(np.zeros(3) if self.given is None else self.given[index, :, 3])
        move = len(places) > 1 and bool((np.ptp(places, axis=0) > SAME_PLACE_M).any())
        if self.given is None or not places:
            return move
        if np.abs(poses).max() > SAME_PLACE_M and np.linalg.norm(np.subtract(places, poses), axis=1).max() < SAME_PLACE_M:
            return True
        # By distances, since the frames of an odometry and of the map may start at different places.
        between = pdist(places)
        return move and bool(np.abs(between - pdist(poses)).sum() < between.sum())

    def warn(self) -> None:
        """Warnings of what was not taken at its word."""
        name, far = self.poses_name, f"up to {self.apart_m:.3g} m from where"
        if self.moving:
            self._warn("scans say that they were taken at different places; so those are none in the sensor's own frame")
        if self.repeated and self.apart_m < SAME_PLACE_M:
            self._warn(f"{self.repeated} scans say that they were taken where {name} places them; so that is no place in them")
        elif self.repeated:
            text = f"{self.repeated} scans say that they were taken {far} {name} places them, and move as its poses do"
            self._warn(f"{text}; so that is no place in them")
        if self.replaced:
            self._warn(f"{self.replaced} scans are {far} {name} places them; so its poses are taken, not theirs")
        if self.placed:
            self._warn(f"{self.placed} scans are where {name} would place them; so they are taken as they are")
        if self.said and self.beam_origins is not BEAM_ORIGINS["centre"]:
            self._warn(f"{self.said} scans say themselves where their beams started; reading.beam_origin is not used for them")

    def _warn(self, text: str) -> None:
        warnings.warn(f"{self.files[0].parent}: {text}", stacklevel=5)


def in_space(points: np.ndarray) -> np.ndarray:
    """(N, 3) or (3,): points of two coordinates at height 0."""
    return points if points.shape[-1] == 3 else np.concatenate([points, np.zeros_like(points[..., :1])], axis=-1)


def _middle(found: FilePoints) -> np.ndarray:
    """(3,): where a file says that its beams started, on average; 0 where it does not say."""
    return np.zeros(3) if found.origins is None else in_space(found.origins).reshape(-1, 3).mean(axis=0)


def _same_pose(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether both place a scan alike; how they turn it counts where neither moves it, since conventions of angles differ."""
    near = np.linalg.norm(one[:, 3] - other[:, 3]) < SAME_PLACE_M
    return bool(near and (np.linalg.norm(one[:, 3]) > SAME_PLACE_M or np.abs(one[:, :3] - other[:, :3]).max() < SAME_TURN))
