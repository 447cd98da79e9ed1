"""Where a sensor of a ROS bag was: by its transforms (/tf, /tf_static), else by odometry."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import reduce

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.scans.pose_track import PoseTrack
from hilbertvae.scans.transform_tree import TransformTree

TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
"""Two names of one type: the second is that of old ROS 1 bags."""
ODOMETRY = "nav_msgs/msg/Odometry"
PATH = "nav_msgs/msg/Path"
"""The whole way so far in each message: a SLAM's corrects the ones before, so that the last one counts."""
POSES = (*(f"geometry_msgs/msg/{kind}" for kind in ("PoseStamped", "PoseWithCovarianceStamped", "TransformStamped")), PATH)
"""Types of messages that have poses, and don't say of what in a way that holds everywhere: they are read where they are asked for."""
FIXED_FRAMES = ("map", "odom")
"""What REP 105 calls the fixed frames, the better one first."""
STANDING = {*FIXED_FRAMES, "world", "earth", "camera_init"}
"""Frames that stand still, the last one LOAM's."""


@dataclass
class Odometry:
    """The poses that one topic has, in `frame`, of `base`."""

    frame: str
    base: str
    track: PoseTrack
    count: int = 0


@dataclass
class BagPoses:
    """The transforms and the odometry of a bag, and which of them say where a sensor was.

    fixed_frame: the frame that poses are in; None takes the first of `FIXED_FRAMES` that a chain leads to from the sensor, of transforms
    or of odometry and transforms, and else odometry's frame. A sensor that stood still has its own frame as `fixed_frame`. odometry: the
    topic whose odometry is wanted, also where transforms say where the sensor was; None takes, where it is needed, one that transforms
    connect to the sensor, and of several the one with most messages. clouds: whether scans are clouds, which a SLAM may have registered:
    put in the fixed frame of its odometry already. Where beams started, such a cloud doesn't say, and the odometry does.
    """

    fixed_frame: str | None = None
    odometry: str | None = None
    clouds: bool = True
    tree: TransformTree = field(default_factory=TransformTree)
    tracks: dict[str, Odometry] = field(default_factory=dict)
    """By topic."""
    assumed: dict[str, str] = field(default_factory=dict)
    """Sensors that no transform places on the base frame, taken to be there, and that frame."""
    registered: dict[str, str] = field(default_factory=dict)
    """Fixed frames of odometry that clouds are in, and its topic."""
    others: dict[str, list[str]] = field(default_factory=dict)
    """By the topic whose odometry is used: those that would have done as well."""
    unread: list[str] = field(default_factory=list)
    """Topics of `POSES`, to be named where no other has the poses that are needed."""
    _by: dict[str, Odometry | None] = field(default_factory=dict)

    def add_odometry(self, topic: str, message) -> None:
        """One message of a topic of odometry, or of poses of another type."""
        if topic not in self.tracks:
            frames = message.header.frame_id.lstrip("/"), getattr(message, "child_frame_id", "").lstrip("/")
            self.tracks[topic] = Odometry(*frames, PoseTrack(f"odometry of {topic}"))
        one = self.tracks[topic]
        if move := getattr(message, "transform", None):
            one.track.add(nanoseconds(message.header.stamp), move.translation, move.rotation)
        else:
            pose = getattr(message.pose, "pose", message.pose)
            one.track.add(nanoseconds(message.header.stamp), pose.position, pose.orientation)
        one.count += 1

    def add_path(self, topic: str, message) -> None:
        """The poses of a path; an `InputError` where they have no times of their own, as those that a planner means to drive through."""
        for pose in message.poses:
            self.add_odometry(topic, pose)
        times = len({nanoseconds(pose.header.stamp) for pose in message.poses})
        if not message.poses or times == 1 < len(message.poses):
            raise InputError(f"{topic}: expected a path of poses that have each a time, got {len(message.poses)} at {times} times")
        self.tracks[topic].frame = message.header.frame_id.lstrip("/") or self.tracks[topic].frame

    def at(self, sensor: str, stamp_ns: int) -> np.ndarray | None:
        """(4, 4): takes points of the sensor's frame to the fixed frame; None where nothing says so for that time. Of a registered cloud
        the sensor's frame is the odometry's base; see `as_seen`.

        Raises `InputError`, with the frames there are, where nothing says so at all.
        """
        sensor = sensor.lstrip("/")
        if sensor not in self._by:
            self._by[sensor] = self._choose(sensor)
        by = self._by[sensor]
        if by is None:
            return self.tree.pose(self.fixed_frame, sensor, stamp_ns)
        steps = [by.track.at(stamp_ns)]
        if sensor != by.base and sensor not in self.assumed and sensor not in self.registered:
            steps.append(self.tree.pose(by.base, sensor, stamp_ns))
        if by.frame != self.fixed_frame:
            steps.insert(0, self.tree.pose(self.fixed_frame, by.frame, stamp_ns))
        return None if any(step is None for step in steps) else reduce(np.matmul, steps)

    def span_ns(self, sensor: str) -> tuple[int, int] | None:
        """From when to when there are samples of all that a sensor's poses are made of; the second is before the first where there is no
        such time. None where all of it holds at all times."""
        by = self._by.get(sensor.lstrip("/"))
        ways = [(by.base, sensor), (self.fixed_frame, by.frame)] if by else [(self.fixed_frame, sensor)]
        tracks = [track for fixed, frame in ways for track in self.tree.tracks(fixed, frame.lstrip("/"))] + ([by.track] if by else [])
        spans = [track.span_ns for track in tracks if track.span_ns]
        return (max(first for first, _ in spans), min(last for _, last in spans)) if spans else None

    def as_seen(self, frame: str, stamp_ns: int, points: np.ndarray) -> np.ndarray:
        """Points (N, 3) of a scan in `frame`, in the frame whose pose `at` has: a registered cloud's go back to where they were seen from,
        and are NaN where nothing says where that was."""
        frame = frame.lstrip("/")
        if frame not in self.registered:
            return points
        pose = self.tracks[self.registered[frame]].track.at(stamp_ns)
        return np.full_like(points, np.nan) if pose is None else (points - pose[:3, 3]) @ pose[:3, :3]

    def _choose(self, sensor: str) -> Odometry | None:
        """The odometry whose a sensor's poses are, or None where they are the transforms'; settles `fixed_frame` for all sensors."""
        wanted = (self.fixed_frame.lstrip("/"),) if self.fixed_frame else FIXED_FRAMES
        if found := self._registering(sensor, wanted):
            return found
        for fixed in wanted:
            if not self.odometry and self.tree.connects(fixed, sensor) and (fixed != sensor or self.fixed_frame):
                self.fixed_frame = fixed
                return None
            led = {topic: one for topic, one in self.tracks.items() if one.frame == fixed or self.tree.connects(fixed, one.frame)}
            if led and (self.fixed_frame or self._linked(led, sensor)):
                return self._of(led, sensor, fixed)
        if not self.tracks or self.fixed_frame:
            known = f"frames of transforms: {', '.join(self.tree.frames) or 'none'}"
            frames = sorted({one.frame for one in self.tracks.values()})
            known += f"; odometry in {', '.join(frames)}" if frames else "; no odometry"
            unread = ", ".join(self.unread)
            known += f"; not read are the poses of {unread}: set reading.odometry to one of these for them" if unread else ""
            still = f", or to {sensor} if the sensor stood still" if sensor else ""
            raise InputError(
                f"nothing says where {sensor!r} was in {' or '.join(wanted)} ({known}). Set reading.fixed_frame to another frame{still}; "
                "for clouds, reading.poses=kiss_icp finds the way"
            )
        return self._of(self.tracks, sensor)

    def _registering(self, frame: str, wanted: tuple[str, ...]) -> Odometry | None:
        """The odometry in whose fixed frame clouds are, if they are in one, and no sensor's."""
        if not self.clouds or not (frame in STANDING or (frame and frame not in self.tree.frames)):
            return None
        placed = {topic: one for topic, one in self.tracks.items() if one.frame == frame != one.base}
        fixed = next((name for name in wanted if self.tree.connects(name, frame)), None if self.fixed_frame else frame)
        if not placed or fixed is None:
            return None
        found = self._of(placed, frame, fixed)
        self.assumed.pop(frame, None)
        self.registered[frame] = next(topic for topic, one in placed.items() if one is found)
        return found

    def _linked(self, tracks: dict[str, Odometry], sensor: str) -> dict[str, Odometry]:
        """Those whose base a sensor is, or is connected to."""
        return {topic: one for topic, one in tracks.items() if one.base == sensor or self.tree.connects(one.base, sensor)}

    def _of(self, tracks: dict[str, Odometry], sensor: str, fixed: str | None = None) -> Odometry:
        """The best of these for a sensor: one that is connected to it, and of several the one with most messages."""
        linked = self._linked(tracks, sensor) or tracks
        topic = min(linked, key=lambda name: (-linked[name].count, name))
        if others := sorted({*linked} - {topic}):
            self.others[topic] = others
        found = linked[topic]
        self.fixed_frame = fixed or found.frame
        if not self._linked({topic: found}, sensor):
            self.assumed[sensor] = found.base
        return found


def nanoseconds(stamp) -> int:
    """A ROS time as one whole number."""
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)
