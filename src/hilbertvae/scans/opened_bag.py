"""A ROS bag that is open: its topics, which of them are scans, and the messages of one or several, in the order of the bag."""

from __future__ import annotations

import warnings
from collections import defaultdict, deque
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path

from hilbertvae.checks import InputError, extra_module, named
from hilbertvae.scans.bag_files import bag_parts, check_files, check_order
from hilbertvae.scans.bag_messages import DIMENSIONS, LASER_SCAN, LIVOX_CLOUDS
from hilbertvae.scans.bag_poses import ODOMETRY, PATH, POSES, TRANSFORMS, BagPoses, nanoseconds
from hilbertvae.scans.file_points import reading
from hilbertvae.scans.livox_messages import livox_cloud
from hilbertvae.scans.point_times import usual_step_ns
from hilbertvae.scans.transform_topics import TransformTopics

FIRST = 50
"""Messages, of a few seconds: they tell how often a sensor scans, whatever pauses it makes later."""


@contextmanager
def opened_bag(path: Path) -> Iterator[OpenedBag]:
    """The bag at a path, for as long as the block runs; an `InputError` for one that can't be read whole."""
    check_files(path)
    parts = bag_parts(path)
    is_ros1 = parts[0].suffix.lower() == ".bag" and not parts[0].is_dir()
    module = extra_module("bags", "rosbags.rosbag1" if is_ros1 else "rosbags.rosbag2")
    with ExitStack() as stack:
        readers = []
        for part in parts:
            with reading(part, "a ROS bag"):
                readers.append(stack.enter_context(module.Reader(part)))
        timed = [(part, reader) for part, reader in zip(parts, readers, strict=True) if reader.message_count]
        check_order([(part, reader.start_time, reader.end_time) for part, reader in timed])
        yield OpenedBag(path, readers, is_ros1)


@dataclass
class OpenedBag:
    """The topics of a bag and what they say; `readers` are rosbags' own, of each part of a recording that was split."""

    path: Path
    readers: Sequence[object]
    is_ros1: bool

    def __post_init__(self):
        typesys = extra_module("bags", "rosbags.typesys")
        # Never the definitions in the file: rosbags makes code of them.
        store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC if self.is_ros1 else typesys.Stores.ROS2_HUMBLE)
        if self.is_ros1:  # rosbags has no tf2_msgs among its ROS 1 types
            store.register(typesys.get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TRANSFORMS[0]))
        self._parse = store.deserialize_ros1 if self.is_ros1 else store.deserialize_cdr
        connections = [connection for reader in self.readers for connection in reader.connections]
        self.types = {connection.topic: connection.msgtype for connection in connections}
        self.counts = dict.fromkeys(self.types, 0)
        for connection in connections:
            self.counts[connection.topic] += int(connection.msgcount)

    def scan_topics(self) -> list[str]:
        """The topics of scans, by name."""
        return sorted(name for name, kind in self.types.items() if kind in DIMENSIONS)

    def scan_topic(self, wanted: str | None) -> str:
        """The topic of scans that is asked for, else the one with most messages; then warns of all others: a depth camera's may come three
        times as often as a lidar's. Those of the other type make a map of another dimension."""
        topics = {name: self.counts[name] for name in self.scan_topics() if self.counts[name] or name == wanted}
        if wanted is not None and wanted not in topics:
            wanted = next((name for name in topics if name.lstrip("/") == wanted.lstrip("/")), wanted)
        if not topics or (wanted is not None and wanted not in topics):
            found = ", ".join(f"{name} ({self.types[name]}, {count})" for name, count in sorted(self.counts.items())) or "none"
            asked = f"the topic {wanted}, of " if wanted is not None else ""
            raise InputError(
                f"{self.path}: expected {asked}sensor_msgs/LaserScan, sensor_msgs/PointCloud2 or Livox' CustomMsg, found topics {found}"
            )
        if wanted is not None:
            return wanted
        chosen = max(sorted(topics), key=topics.get)
        space = {name: DIMENSIONS[self.types[name]] for name in topics}
        others = [f"{name} ({topics[name]})" for name in topics if space[name] == space[chosen] and name != chosen]
        others += [f"{name} ({topics[name]}, for a map in {space[name]}D)" for name in topics if space[name] != space[chosen]]
        if others:
            warnings.warn(
                f"{self.path}: read are the {topics[chosen]} scans of {chosen} alone. Set reading.topic for another; other topics of "
                f"scans: {', '.join(others)}",
                stacklevel=3,
            )
        return chosen

    def poses(self, scan_topic: str, fixed_frame: str | None, odometry: str | None = None) -> BagPoses:
        """The transforms of the bag, as they are for the scans of a topic (see `TransformTopics.tree`), and its odometry; of that the
        wanted topic alone, if there is one, which may have poses of another type, too (`POSES`)."""
        kinds = (ODOMETRY,) if odometry is None else (ODOMETRY, *POSES)
        odometries = {name for name, count in self.counts.items() if self.types[name] in kinds and count}
        if odometry is not None:
            if not (asked := {name for name in odometries if name.lstrip("/") == odometry.lstrip("/")}):
                there = ", ".join(sorted(odometries)) or "none"
                wanted = f"a topic of {' or '.join(kind.replace('/msg', '') for kind in kinds)}"
                raise InputError(f"{self.path}: reading.odometry: expected {wanted}, got {odometry}; found {there}")
            odometries = asked
        found, transforms = BagPoses(fixed_frame, odometry, self.types[scan_topic] != LASER_SCAN), TransformTopics()
        found.unread = sorted(name for name, kind in self.types.items() if kind in POSES and self.counts[name] and name not in odometries)
        paths = {name for name in odometries if self.types[name] == PATH}
        used = {name for name, kind in self.types.items() if kind in TRANSFORMS} | odometries - paths
        for topic, _, message in self._messages(used):
            if topic in odometries:
                found.add_odometry(topic, message)
            else:
                transforms.add(topic, message.transforms)
        for topic in paths:
            with named(str(self.path)):
                found.add_path(topic, self._last(topic))
        found.tree = transforms.tree(scan_topic)
        return found

    def scans(self, topic: str, every: int = 1) -> Iterator[tuple[int, int, object]]:
        """Every n-th message of scans: its place, its time (that of the recording where it has none), and the message."""
        for index, (_, recorded_ns, message) in enumerate(self._messages({topic}, every)):
            yield index * every, nanoseconds(message.header.stamp) or recorded_ns, message

    def step_ns(self, topic: str) -> float:
        """The usual time from one message of scans to the next, by the first `FIRST` of them."""
        stamps = defaultdict(list)
        for _, stamp_ns, message in islice(self.scans(topic), FIRST):
            stamps[message.header.frame_id].append(stamp_ns)
        return usual_step_ns(stamps)

    def _messages(self, topics: set[str], every: int = 1) -> Iterator[tuple[str, int, object]]:
        for index, (connection, recorded_ns, data) in enumerate(self._raw(topics)):
            if index % every == 0:
                yield connection.topic, recorded_ns, self._message(connection, data)

    def _last(self, topic: str) -> object:
        """The last message of a topic that has some; those before are not parsed."""
        ((connection, _, data),) = deque(self._raw({topic}), maxlen=1)
        return self._message(connection, data)

    def _raw(self, topics: set[str]) -> Iterator[tuple[object, int, bytes]]:
        """rosbags' connection, the time of the recording, and the bytes of each message."""
        wanted = [(reader, [each for each in reader.connections if each.topic in topics]) for reader in self.readers]
        return chain.from_iterable(reader.messages(connections) for reader, connections in wanted if connections)

    def _message(self, connection, data: bytes) -> object:
        if connection.msgtype in LIVOX_CLOUDS:
            with named(f"{self.path}, a message of {connection.topic}"):
                return livox_cloud(data, self.is_ros1)
        return self._parse(data, TRANSFORMS[0] if connection.msgtype in TRANSFORMS else connection.msgtype)
