"""What a ROS message of scans says: `sensor_msgs/LaserScan` and `sensor_msgs/PointCloud2` as points in the sensor's frame."""

from __future__ import annotations

import numpy as np

from hilbertvae.checks import InputError

LASER_SCAN, POINT_CLOUD = "sensor_msgs/msg/LaserScan", "sensor_msgs/msg/PointCloud2"
LIVOX_CLOUDS = tuple(f"{package}/msg/CustomMsg" for package in ("livox_ros_driver", "livox_ros_driver2", "livox_interfaces"))
"""Read by `livox_messages`."""
DIMENSIONS = {LASER_SCAN: 2, POINT_CLOUD: 3, **dict.fromkeys(LIVOX_CLOUDS, 3)}
"""By type of message, in `rosbags`' spelling, which is ROS 2's for both."""
NUMBER_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""By `PointField.datatype`."""
MOST_TURN = 4 * np.pi
"""From a laser's first beam to its last: twice around, which none goes."""


def read_laser_scan(message) -> np.ndarray:
    """(N, 3) float64, metres, sensor frame, z = 0, one row a range: NaN where there is no return.

    No return is what the message's definition says, a range outside `range_min` to `range_max`, NaN and inf; besides 0, and
    `range_max` itself, which drivers write for it. A `range_max` that is not above `range_min` was never set, and is no limit.
    Raises `InputError` where angles or limits are no numbers.
    """
    ranges = np.asarray(message.ranges, dtype=np.float64)
    first, step, low, high = (float(getattr(message, name)) for name in ("angle_min", "angle_increment", "range_min", "range_max"))
    if not np.isfinite([first, step, low]).all() or np.isnan(high):
        raise InputError(f"expected angles and a range_min that are numbers, got {first}, {step} and {low}, range_max {high}")
    if len(ranges) > 1 and not 0 < abs(step) * (len(ranges) - 1) <= MOST_TURN:
        raise InputError(f"expected beams side by side, got {len(ranges)} that are {step} rad apart (angle_increment)")
    high = high if high > low else np.inf
    returned = np.isfinite(ranges) & (ranges > 0) & (ranges >= low) & (ranges < high)
    ranges = np.where(returned, ranges, np.nan)
    angles = first + step * np.arange(len(ranges))
    return np.column_stack([ranges * np.cos(angles), ranges * np.sin(angles), np.where(returned, 0.0, np.nan)])


def read_point_cloud(message) -> np.ndarray:
    """(N, 3) float64, metres, sensor frame, row by row; NaN where an organised cloud has no return.

    Raises `InputError` for a cloud without x, y and z, and for one whose sizes contradict each other or the data's, before memory is taken.
    """
    if not message.width * message.height:  # of a node that had seen nothing yet; it may lack its fields, too
        return np.empty((0, 3))
    names = [field.name for field in message.fields]
    if not {"x", "y", "z"} <= set(names):
        raise InputError(f"expected fields x, y, z, the cloud has {' '.join(names)[:60] or 'none'}")
    return np.column_stack([read_column(message, axis).astype(np.float64) for axis in "xyz"])


def read_column(message, name: str) -> np.ndarray:
    """(N,) of the numbers that a field of a `PointCloud2` has, row by row, as they are; errors as `read_point_cloud`'s."""
    field = {field.name: field for field in message.fields}[name]
    width, height, step = message.width, message.height, message.point_step
    data = np.asarray(message.data, dtype=np.uint8)
    # Drivers of clouds without rows leave the step of a row at 0, and others with rows that have nothing between them set it wrongly.
    row = message.row_step if height > 1 and len(data) != width * height * step else width * step
    needed = (height - 1) * row + width * step
    if width * height == 0:
        return np.empty(0)
    if width * step > row or needed > len(data):
        raise InputError(
            f"truncated or forged cloud; {width} x {height} points of {step} bytes in rows of {row} need {needed} bytes, "
            f"{len(data)} are there"
        )
    kind = np.dtype(NUMBER_TYPES.get(field.datatype, "V0")).newbyteorder(">" if message.is_bigendian else "<")
    if kind.kind == "V" or field.count not in (0, 1) or field.offset + kind.itemsize > step:
        raise InputError(  # a count of 0 is that of a writer who never set it
            f"expected {name} as one number within the {step} bytes of a point, got datatype {field.datatype}, count {field.count} "
            f"at byte {field.offset}"
        )
    return np.ndarray((height, width), kind, data, field.offset, (row, step)).reshape(-1)


READERS = {LASER_SCAN: read_laser_scan, POINT_CLOUD: read_point_cloud}
