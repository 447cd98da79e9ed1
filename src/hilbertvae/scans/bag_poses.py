"""Where a sensor of a ROS bag was: by its transforms (/tf, /tf_static), else by odometry."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.scans.transform_tree import PoseTrack, TransformTree

TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
"""Two names of one type: the second is that of old ROS 1 bags."""
ODOMETRY = "nav_msgs/msg/Odometry"
FIXED_FRAMES = ("map", "odom")
"""What REP 105 calls the fixed frames, the better one first."""


@dataclass
class BagPoses:
    """The transforms and the odometry of a bag, and which of them say where a sensor was.

    fixed_frame: the frame that poses are in; None takes the first of `FIXED_FRAMES` that a chain of transforms leads to from the
    sensor, and else odometry's frame. A sensor that stood still has its own frame as `fixed_frame`.
    """

    fixed_frame: str | None = None
    tree: TransformTree = field(default_factory=TransformTree)
    odometry: PoseTrack | None = None
    odometry_frame: str = ""
    base_frame: str = ""
    """What odometry says the pose of."""
    assumed: set[str] = field(default_factory=set)
    """Sensors that no transform places on the base frame, taken to be there."""
    _by_odometry: dict[str, bool] = field(default_factory=dict)

    def add_transforms(self, transforms: Iterable, static: bool) -> None:
        """The transforms of one message; static ones hold at all times."""
        for each in transforms:
            stamp, move = each.header.stamp, each.transform
            self.tree.add(each.header.frame_id, each.child_frame_id, nanoseconds(stamp), move.translation, move.rotation, static)

    def add_odometry(self, message) -> None:
        """One message of the topic of odometry."""
        if self.odometry is None:
            self.odometry_frame, self.base_frame = message.header.frame_id.lstrip("/"), message.child_frame_id.lstrip("/")
            self.odometry = PoseTrack("odometry")
        self.odometry.add(nanoseconds(message.header.stamp), message.pose.pose.position, message.pose.pose.orientation)

    def at(self, sensor: str, stamp_ns: int) -> np.ndarray | None:
        """(4, 4): takes points of the sensor's frame to the fixed frame; None where nothing says so for that time.

        Raises `InputError`, with the frames there are, where nothing says so at all.
        """
        sensor = sensor.lstrip("/")
        if sensor not in self._by_odometry:
            self._by_odometry[sensor] = self._choose(sensor)
        if not self._by_odometry[sensor]:
            return self.tree.pose(self.fixed_frame, sensor, stamp_ns)
        base = self.odometry.at(stamp_ns)
        if base is None or sensor in self.assumed:
            return base
        mounted = self.tree.pose(self.base_frame, sensor, stamp_ns)
        return None if mounted is None else base @ mounted

    def _choose(self, sensor: str) -> bool:
        """Whether a sensor's poses are odometry's; settles `fixed_frame` for all sensors."""
        wanted = (self.fixed_frame.lstrip("/"),) if self.fixed_frame else FIXED_FRAMES
        for fixed in wanted:
            if self.tree.connects(fixed, sensor) and (fixed != sensor or self.fixed_frame):
                self.fixed_frame = fixed
                return False
        if self.odometry is None or (self.fixed_frame and self.odometry_frame != wanted[0]):
            known = f"frames of transforms: {', '.join(self.tree.frames) or 'none'}"
            known += f"; odometry in {self.odometry_frame}" if self.odometry else "; no odometry"
            still = f", or to {sensor} if the sensor stood still" if sensor else ""
            raise InputError(
                f"nothing says where {sensor!r} was in {' or '.join(wanted)} ({known}). Set reading.fixed_frame to another frame{still}; "
                "for clouds, reading.poses=kiss_icp finds the way"
            )
        self.fixed_frame = self.odometry_frame
        if sensor != self.base_frame and not self.tree.connects(self.base_frame, sensor):
            self.assumed.add(sensor)
        return True


def nanoseconds(stamp) -> int:
    """A ROS time as one whole number."""
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)
