"""Bags in which several topics of transforms say where a frame was."""

import re
import warnings

import numpy as np
import pytest
from bag_scene import CLOUDS, LIDAR_ON_BASE, MAP_ODOM, base_in_odom
from bag_writers import bag, moved, turned

from hilbertvae.checks import InputError
from hilbertvae.scans.bags import read_bag
from hilbertvae.scans.transform_topics import topic_beside

pytest.importorskip("rosbags")


@pytest.mark.parametrize(
    ("scan_topic", "topics", "expected"),
    [
        ("/robot1/scan", ["/robot1/tf", "/robot2/tf"], "/robot1/tf"),
        ("/robot1/front/scan", ["/robot1/tf", "/tf", "/robot1/rear/tf"], "/robot1/tf"),
        ("/robot1/scan", ["/robot10/tf", "/tf"], "/tf"),
        ("/robots/one/scan", ["/robots/two/tf", "/tf"], "/tf"),
        ("/scan", ["/robot1/tf", "/tf", "/tf_old"], "/tf"),
        ("/robot1/scan", ["/robot1/tf_old", "/robot1/tf"], "/robot1/tf"),
        ("/robot1/laser/scan", ["/robot1/slam/tf", "/robot2/slam/tf"], "/robot1/slam/tf"),
        ("/robot1/scan", ["/tf_static_old", "/tf_static"], "/tf_static"),
        ("scan", ["tf_old", "tf"], "tf"),
        ("/scan", ["/robot1/tf", "/robot2/tf"], None),
        ("/scan", ["/tf_new", "/tf_old"], None),
        ("/robot3/scan", ["/robot1/tf", "/robot2/tf_old"], None),
    ],
)
def test_the_topic_of_the_sensor_s_own_robot(scan_topic, topics, expected):
    assert topic_beside(topics, scan_topic) == topic_beside(topics[::-1], scan_topic) == expected


ELSEWHERE = (5.0, -7.0, 0.3), turned(0.2)
OTHER_MOUNT = (0.1, 0.0, 2.0), turned(-0.3)


def robots(path, names, scans=None, maps=()):
    """Robots whose frames have the same names, the second one elsewhere and with another mount, each with a cloud at 1.35 s."""
    with bag(path) as made:
        for number, name in enumerate(names):
            made.transform(f"{name}/tf_static", 0, "base", "lidar", OTHER_MOUNT if number else LIDAR_ON_BASE)
            for second in range(4):
                made.transform(f"{name}/tf", second + 0.01 * number, "odom", "base", ELSEWHERE if number else base_in_odom(second))
                if name in maps:
                    made.transform(f"{name}/tf", second, "map", "odom", MAP_ODOM)
        for name in scans or names:
            made.cloud(f"{name}/points", 1.35, "lidar", CLOUDS[0])
    return path


def test_each_robot_goes_its_own_way(tmp_path):
    path = robots(tmp_path / "a.bag", ["/one", "/two"], maps=["/two"])
    said = "transforms of base are those of {0}/tf; .*in {1}/tf; transforms of lidar are those of {0}/tf_static; .*in {1}/tf_static"
    with pytest.warns(UserWarning, match=said.format("/one", "/two")):
        found = read_bag(path, topic="/one/points")  # in odom: the map is the other's
    np.testing.assert_allclose(found.points, moved(CLOUDS[0], LIDAR_ON_BASE, base_in_odom(1.35)), rtol=0, atol=1e-9)
    with pytest.warns(UserWarning, match=said.format("/two", "/one")):
        found = read_bag(path, topic="/two/points")
    np.testing.assert_allclose(found.points, moved(CLOUDS[0], OTHER_MOUNT, ELSEWHERE, MAP_ODOM), rtol=0, atol=1e-6)


def test_where_no_topic_stands_out_they_are_named(tmp_path):
    path = robots(tmp_path / "a.bag", ["/one", "/two"], scans=["/lidars"])
    with pytest.raises(InputError, match=re.escape("a.bag: transforms: lidar is elsewhere in each of /one/tf_static and /two/tf_static")):
        read_bag(path)


def alone_or_beside(path, topics, static=()):
    """A lidar by /tf, and the same or other transforms on further topics, by name: seconds later, and the pose of base."""
    with bag(path) as made:
        for topic, (later, pose) in topics.items():
            for second in range(4):
                made.transform(topic, second + later, "odom", "base", pose or base_in_odom(second))
        made.transform("/tf_static", 0, "base", "lidar", LIDAR_ON_BASE)
        for topic, pose in static:
            made.transform(topic, 1, "base", "lidar", pose)
        made.cloud("/points", 1.35, "lidar", CLOUDS[0])
    return path


TRUE = moved(CLOUDS[0], LIDAR_ON_BASE, base_in_odom(1.35))


@pytest.mark.parametrize("names", [("/tf", "/tf_old"), ("/tf", "/old/tf")])
def test_what_was_put_aside_is_passed_over(tmp_path, names):
    path = alone_or_beside(tmp_path / "a.bag", dict(zip(names, [(0, None), (0.01, ELSEWHERE)], strict=True)))
    with pytest.warns(UserWarning, match=f"a.bag: transforms of base are those of /tf; passed over are other ones in {names[1]}$"):
        found = read_bag(path)
    np.testing.assert_allclose(found.points, TRUE, rtol=0, atol=1e-9)


def test_what_was_put_aside_of_static_ones_is_passed_over(tmp_path):
    path = alone_or_beside(tmp_path / "a.bag", {"/tf": (0, None)}, static=[("/tf_static_old", OTHER_MOUNT)])
    with pytest.warns(UserWarning, match="transforms of lidar are those of /tf_static; passed over are other ones in /tf_static_old$"):
        found = read_bag(path)
    np.testing.assert_allclose(found.points, TRUE, rtol=0, atol=1e-9)


@pytest.mark.parametrize("topics", [["/whatever"], ["/tf", "/tf_again"], ["/one/tf", "/two/tf"]])
def test_one_topic_of_any_name_and_several_that_say_the_same(tmp_path, topics):
    path = alone_or_beside(tmp_path / "a.bag", dict.fromkeys(topics, (0, None)), static=[("/one/tf_static", LIDAR_ON_BASE)])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        np.testing.assert_allclose(read_bag(path).points, TRUE, rtol=0, atol=1e-9)


def test_topics_that_differ_about_what_is_not_needed_do_no_harm(tmp_path):
    with bag(tmp_path / "a.bag") as made:
        for second in range(4):
            made.transform("/robot/tf", second, "odom", "lidar", base_in_odom(second))
            for number, topic in enumerate(("/left/tf", "/right/tf")):
                made.transform(topic, second, "mount", "gripper", ((number, 0, 0), turned(0)))
        made.cloud("/points", 1.35, "lidar", CLOUDS[0])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        np.testing.assert_allclose(read_bag(tmp_path / "a.bag").points, moved(CLOUDS[0], base_in_odom(1.35)), rtol=0, atol=1e-9)
