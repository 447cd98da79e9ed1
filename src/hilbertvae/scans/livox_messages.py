"""Messages of Livox' own type, `CustomMsg`, as the `sensor_msgs/PointCloud2` that says the same; Livox' drivers and most odometry for their
sensors record nothing else. The definition is that of livox_ros_driver (https://github.com/Livox-SDK/livox_ros_driver, msg/)."""

from __future__ import annotations

import struct
from types import SimpleNamespace

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.scans.bag_messages import POINT_CLOUD

POINT = np.dtype([("offset_time", "<u4"), ("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("rest", "3u1")])
"""rest: how much of the beam came back, a tag, and which laser it was."""
PADDED_BYTES = 20
"""From one point to the next in ROS 2, where numbers of four bytes begin at multiples of four."""
FIELDS = tuple(
    SimpleNamespace(name=name, offset=POINT.fields[name][1], datatype=7 if name in "xyz" else 6, count=1) for name in POINT.names[:4]
)


def livox_cloud(data: bytes | memoryview, is_ros1: bool) -> SimpleNamespace:
    """The message whose bytes are `data`, of ROS 1 or of ROS 2: its header, and points with `offset_time`, nanoseconds after the header's.

    Raises `InputError` for bytes that end too early or are no such message, before memory is taken for them.
    """
    data, start = memoryview(data), 0 if is_ros1 else 4
    if not is_ros1 and bytes(data[:2]) != b"\0\1":
        raise InputError(f"expected a CustomMsg in the plain encoding of ROS 2, little-endian, got {bytes(data[:2]).hex() or 'none'}")
    try:
        *_, seconds, nanoseconds, letters = struct.unpack_from("<4I" if is_ros1 else "<iII", data, start)
        place = start + (16 if is_ros1 else 12)
        frame = bytes(data[place : place + letters]).rstrip(b"\0").decode(errors="replace")
        place += letters
        if not is_ros1:
            place += (start - place) % 8
        count = struct.unpack_from("<I", data, place + 16)[0]  # behind a time base of 8 bytes, the number of points, and four of one byte
    except struct.error:
        raise InputError(f"truncated: a CustomMsg of {len(data)} bytes") from None
    points, step = data[place + 20 :], POINT.itemsize if is_ros1 else PADDED_BYTES
    needed = step * (count - 1) + POINT.itemsize if count else 0  # behind the last one nothing is filled up
    if needed > len(points):
        raise InputError(f"truncated or forged: a CustomMsg of {count} points needs {needed} bytes for them, {len(points)} are there")
    packed = np.ndarray(count, POINT, points, strides=(step,)) if count else np.empty(0, POINT)
    header = SimpleNamespace(stamp=SimpleNamespace(sec=seconds, nanosec=nanoseconds), frame_id=frame)
    values = np.ascontiguousarray(packed).view(np.uint8)
    sizes = {"height": 1, "width": count, "point_step": POINT.itemsize, "row_step": POINT.itemsize * count}
    return SimpleNamespace(__msgtype__=POINT_CLOUD, header=header, fields=FIELDS, is_bigendian=False, data=values, **sizes)
