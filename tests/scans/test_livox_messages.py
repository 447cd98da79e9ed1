"""Livox' own messages against rosbags' general, slow, reading of the same definition, in bags of each kind."""

import warnings
from types import SimpleNamespace

import numpy as np
import pytest
from bag_scene import LIDAR_ON_BASE, base_in_odom
from bag_writers import KINDS, bag, moved
from hypothesis import given
from hypothesis import strategies as st

from hilbertvae.checks import InputError
from hilbertvae.scans.bag_messages import LIVOX_CLOUDS, read_column, read_point_cloud
from hilbertvae.scans.bags import read_bag
from hilbertvae.scans.livox_messages import livox_cloud

pytest.importorskip("rosbags")

POINT = "uint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\nuint8 reflectivity\nuint8 tag\nuint8 line\n"
CLOUD = "std_msgs/Header header\nuint64 timebase\nuint32 point_num\nuint8 lidar_id\nuint8[3] rsvd\nCustomPoint[] points\n"
RNG = np.random.default_rng(7)
POINTS = RNG.uniform(-20, 20, (4, 30, 3)).astype(np.float32)
OFFSETS = np.linspace(0, 0.0999e9, 30).astype(np.uint32)


def register(store, package):
    from rosbags.typesys import get_types_from_msg

    for name, text in (("CustomPoint", POINT), ("CustomMsg", CLOUD)):
        store.register(get_types_from_msg(text, f"{package}/msg/{name}"))


def livox(made, package, seconds, points, offsets, frame="lidar"):
    kind = made.store.types[f"{package}/msg/CustomPoint"]
    rows = [kind(int(time), *map(float, point), 100, 16, line % 4) for line, (point, time) in enumerate(zip(points, offsets, strict=True))]
    return made.make(
        f"{package}/CustomMsg", made.header(frame, seconds), timebase=2**63 + 5, point_num=len(rows), lidar_id=1,
        rsvd=np.zeros(3, np.uint8), points=rows,
    )  # fmt: skip


@pytest.mark.parametrize("package", [kind.split("/")[0] for kind in LIVOX_CLOUDS])
@pytest.mark.parametrize("kind", KINDS)
def test_clouds_are_placed_and_turned_back_beam_by_beam(tmp_path, kind, package):
    with bag(tmp_path / KINDS[kind], kind) as made:
        register(made.store, package)
        made.transform("/tf_static", 0, "base", "lidar", LIDAR_ON_BASE)
        for second in range(6):
            made.transform("/tf", second, "odom", "base", base_in_odom(second))
        for number in range(4):
            made.put("/livox/lidar", 1 + 0.1 * number, livox(made, package, 1 + 0.1 * number, POINTS[number], OFFSETS))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found, at_once = read_bag(tmp_path / KINDS[kind]), read_bag(tmp_path / KINDS[kind], deskew=False)
    for number in range(4):
        for point, offset, where in zip(POINTS[number], OFFSETS, found.points[found.scan == number], strict=True):
            expected = moved([point], LIDAR_ON_BASE, base_in_odom(1 + 0.1 * number + offset / 1e9))
            np.testing.assert_allclose(where, expected[0], rtol=0, atol=1e-3)  # turned at a constant rate between a few times
        expected = moved(POINTS[number], LIDAR_ON_BASE, base_in_odom(1 + 0.1 * number))
        np.testing.assert_allclose(at_once.points[at_once.scan == number], expected, rtol=0, atol=1e-6)
    assert np.abs(found.points - at_once.points).max() > 0.1


def serialized(is_ros1, points, offsets, frame):
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    register(store, "livox_ros_driver2")

    def make(name, *values, **named):
        package, kind = name.split("/")
        return store.types[f"{package}/msg/{kind}"](*values, **named)

    stamp = make("builtin_interfaces/Time", 1_700_000_000, 5)
    header = make("std_msgs/Header", *([0] if is_ros1 else []), stamp, frame)
    message = livox(SimpleNamespace(store=store, make=make, header=lambda *_: header), "livox_ros_driver2", 0, points, offsets)
    return bytes((store.serialize_ros1 if is_ros1 else store.serialize_cdr)(message, message.__msgtype__))


@given(frame=st.text("abc_/é", max_size=12), count=st.integers(0, 9), is_ros1=st.booleans())
def test_whatever_the_frame_s_name_all_points_are_as_a_general_writer_has_them(frame, count, is_ros1):
    data = serialized(is_ros1, POINTS[0, :count], OFFSETS[:count], frame)
    cloud = livox_cloud(memoryview(data), is_ros1)
    assert (cloud.header.frame_id, cloud.header.stamp.sec, cloud.header.stamp.nanosec) == (frame, 1_700_000_000, 5)
    np.testing.assert_array_equal(read_point_cloud(cloud), POINTS[0, :count])
    np.testing.assert_array_equal(read_column(cloud, "offset_time"), OFFSETS[:count])


@pytest.mark.parametrize("is_ros1", [True, False])
def test_cut_off_and_forged_messages_are_refused(is_ros1):
    data = serialized(is_ros1, POINTS[0, :5], OFFSETS[:5], "lidar")
    whole = livox_cloud(data, is_ros1)
    assert whole.width == 5
    shortest = len(data) - (0 if is_ros1 else 3)  # ROS 2 may fill a message up to four bytes
    for size in range(shortest):
        with pytest.raises(InputError, match="truncated|forged|expected a CustomMsg"):
            livox_cloud(data[:size], is_ros1)
    at = data.index((5).to_bytes(4, "little") + b"\1\0\0\0") + 8
    forged = data[:at] + (2**31).to_bytes(4, "little") + data[at + 4 :]
    with pytest.raises(InputError, match="truncated or forged: a CustomMsg of 2147483648 points needs"):
        livox_cloud(forged, is_ros1)


def test_a_damaged_message_names_its_bag_and_topic_and_others_are_named(tmp_path):
    with bag(tmp_path / "a.bag") as made:
        register(made.store, "livox_ros_driver")
        message = livox(made, "livox_ros_driver", 0, POINTS[0], OFFSETS)
        made.put("/livox/lidar", 0, message)
        data = made.store.serialize_ros1(message, message.__msgtype__)
        made.writer.write(made.connections["/livox/lidar"], 1, bytes(data)[:-1])
    with pytest.raises(InputError, match="a.bag, a message of /livox/lidar: truncated or forged: a CustomMsg of 30 points needs 570 bytes"):
        read_bag(tmp_path / "a.bag", fixed_frame="lidar")
