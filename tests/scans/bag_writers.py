"""ROS bags of each kind, written by rosbags' own writers, message by message."""

from contextlib import contextmanager

import numpy as np

KINDS = {"ros1": "a.bag", "sqlite": "sqlite", "mcap": "mcap"}
"""By kind, the name of the file, or of the folder that ROS 2 makes."""
START_NS = 1_700_000_000 * 10**9


def nanoseconds(seconds):
    """A time of the bag, `seconds` after its start."""
    return START_NS + round(seconds * 1e9)


@contextmanager
def bag(path, kind="ros1", compression=None):
    """A `BagOf` messages at `path`; rosbags finishes the file when the block ends."""
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    if kind == "ros1":
        writer = rosbag1.Writer(path)
        if compression:
            writer.set_compression(rosbag1.Writer.CompressionFormat[compression])
    else:
        plugin = rosbag2.StoragePlugin[{"sqlite": "SQLITE3", "mcap": "MCAP"}[kind]]
        writer = rosbag2.Writer(path, version=9, storage_plugin=plugin)
        if compression:
            mode = rosbag2.CompressionMode
            writer.set_compression(mode.STORAGE if kind == "mcap" else mode.MESSAGE, rosbag2.CompressionFormat[compression])
    store = get_typestore(Stores.ROS1_NOETIC if kind == "ros1" else Stores.ROS2_HUMBLE)
    if kind == "ros1":
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
    with writer:
        yield BagOf(writer, store, kind == "ros1")


class BagOf:
    """Messages by what they say. Times are seconds after `START_NS`; a pose is a place (3,) and a quaternion (4,) x y z w."""

    def __init__(self, writer, store, is_ros1):
        self.writer, self.store, self.is_ros1 = writer, store, is_ros1
        self.connections = {}

    def put(self, topic, seconds, message, kind=None):
        """A message, recorded at its time; `kind` is the type it is said to have, if not its own."""
        if topic not in self.connections:
            self.connections[topic] = self.writer.add_connection(topic, message.__msgtype__, typestore=self.store)
        serialize = self.store.serialize_ros1 if self.is_ros1 else self.store.serialize_cdr
        self.writer.write(self.connections[topic], nanoseconds(seconds), serialize(message, message.__msgtype__))

    def make(self, name, *values, **named):
        """A message of a type, as `std_msgs/Header`."""
        package, kind = name.split("/")
        return self.store.types[f"{package}/msg/{kind}"](*values, **named)

    def header(self, frame, seconds):
        stamp = self.make("builtin_interfaces/Time", *map(int, divmod(nanoseconds(seconds) if seconds is not None else 0, 10**9)))
        return self.make("std_msgs/Header", *([0] if self.is_ros1 else []), stamp, frame)

    def laser(self, topic, seconds, frame, ranges, first=-np.pi / 2, step=np.pi / 180, low=0.1, high=30.0, recorded=None, time_step=0.0):
        angles = dict(angle_min=first, angle_max=first + step * len(ranges), angle_increment=step, time_increment=time_step, scan_time=0.1)
        empty = np.empty(0, np.float32)
        ranges = np.asarray(ranges, np.float32)
        message = self.make(
            "sensor_msgs/LaserScan",
            self.header(frame, seconds), **angles, range_min=low, range_max=high, ranges=ranges, intensities=empty,
        )  # fmt: skip
        self.put(topic, seconds if recorded is None else recorded, message)

    def cloud(self, topic, seconds, frame, points, kind="<f4", rows=1, padding=4, times=None, **changes):
        """Points (N, 3) with a gap after them and at the end of each row, as drivers have it; `changes` overwrite fields.

        times: the name of a field of times and its numbers (N,), which go into the gap; `padding` is to have room for them.
        """
        kind = np.dtype(kind)
        width, size = len(points) // rows, kind.itemsize
        step = 3 * size + padding
        data = np.zeros((rows, width * step + padding), np.uint8)
        cells = data[:, : width * step].reshape(rows, width, step)
        cells[..., : 3 * size] = np.asarray(points, kind).reshape(rows, width, 3).view(np.uint8).reshape(rows, width, 3 * size)
        number = {4: 7, 8: 8}[size]
        fields = [self.make("sensor_msgs/PointField", name, size * place, number, 1) for place, name in enumerate("xyz")]
        if times:
            (name, numbers), codes = times, {"i4": 5, "u4": 6, "f4": 7, "f8": 8}
            fields.append(self.make("sensor_msgs/PointField", name, 3 * size, codes[numbers.dtype.str[1:]], 1))
            cells[..., 3 * size : 3 * size + numbers.itemsize] = numbers.reshape(rows, width, 1).view(np.uint8)
        values = dict(
            header=self.header(frame, seconds), height=rows, width=width, fields=fields, is_bigendian=kind.str[0] == ">",
            point_step=step, row_step=data.shape[1], data=data.reshape(-1), is_dense=True,
        ) | changes  # fmt: skip
        self.put(topic, seconds, self.make("sensor_msgs/PointCloud2", **values))

    def transform(self, topic, seconds, parent, child, pose, recorded=None):
        place, quaternion = self._pose(pose)
        move = self.make("geometry_msgs/Transform", self.make("geometry_msgs/Vector3", *place), quaternion)
        each = self.make("geometry_msgs/TransformStamped", self.header(parent, seconds), child, move)
        self.put(topic, seconds if recorded is None else recorded, self.make("tf2_msgs/TFMessage", [each]))

    def odometry(self, topic, seconds, parent, child, pose):
        place, quaternion = self._pose(pose)
        still, none = self.make("geometry_msgs/Vector3", 0.0, 0.0, 0.0), np.zeros(36)
        pose = self.make("geometry_msgs/Pose", self.make("geometry_msgs/Point", *place), quaternion)
        pose = self.make("geometry_msgs/PoseWithCovariance", pose, none)
        twist = self.make("geometry_msgs/TwistWithCovariance", self.make("geometry_msgs/Twist", still, still), none)
        self.put(topic, seconds, self.make("nav_msgs/Odometry", self.header(parent, seconds), child, pose, twist))

    def stamped_pose(self, topic, seconds, parent, child, pose, kind="PoseStamped"):
        """A pose of another type of geometry_msgs; `TransformStamped` alone says of what it is."""
        place, quaternion = self._pose(pose)
        if kind == "TransformStamped":
            said = child, self.make("geometry_msgs/Transform", self.make("geometry_msgs/Vector3", *place), quaternion)
        else:
            said = [self.make("geometry_msgs/Pose", self.make("geometry_msgs/Point", *place), quaternion)]
            said = [self.make("geometry_msgs/PoseWithCovariance", *said, np.zeros(36))] if "Covariance" in kind else said
        self.put(topic, seconds, self.make(f"geometry_msgs/{kind}", self.header(parent, seconds), *said))

    def path(self, topic, seconds, parent, poses):
        """A path of `{seconds: pose}`."""
        found = []
        for each, pose in poses.items():
            place, quaternion = self._pose(pose)
            pose = self.make("geometry_msgs/Pose", self.make("geometry_msgs/Point", *place), quaternion)
            found.append(self.make("geometry_msgs/PoseStamped", self.header(parent, each), pose))
        self.put(topic, seconds, self.make("nav_msgs/Path", self.header(parent, seconds), found))

    def _pose(self, pose):
        place, quaternion = pose
        return map(float, place), self.make("geometry_msgs/Quaternion", *map(float, quaternion))


def turned(yaw, pitch=0.0, roll=0.0):
    """The quaternion x y z w of yaw, pitch and roll in radians."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_quat()


def moved(points, *poses):
    """Points (N, 3) taken through poses, the first one first: each is a place and a quaternion."""
    from scipy.spatial.transform import Rotation

    for place, quaternion in poses:
        points = Rotation.from_quat(quaternion).apply(points) + np.asarray(place)
    return points
