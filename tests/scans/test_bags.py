import re
import shutil
import tracemalloc
import warnings

import numpy as np
import pytest
from bag_scene import CLOUDS, LASER_ON_BASE, LIDAR_ON_BASE, MAP_ODOM, RANGES, base_in_odom, laser_points, write_scene
from bag_writers import KINDS, bag, moved, turned

from hilbertvae.checks import InputError
from hilbertvae.scans.bag_files import is_bag
from hilbertvae.scans.bags import read_bag
from hilbertvae.scans.formats import ReadingSettings, read_scans_path

pytest.importorskip("rosbags")

EACH_KIND = pytest.mark.parametrize("kind", KINDS)


@EACH_KIND
def test_clouds_are_in_the_map_frame(tmp_path, kind):
    scans = read_bag(write_scene(tmp_path / KINDS[kind], kind, lasers=0))
    assert scans.dimension == 3 and scans.points.dtype == np.float64 and scans.scan.dtype == scans.beam.dtype == np.int32
    for number in range(4):
        chain = LIDAR_ON_BASE, base_in_odom(number + 0.35), MAP_ODOM
        chosen = scans.scan == number
        np.testing.assert_allclose(scans.points[chosen], moved(CLOUDS[number], *chain), rtol=0, atol=1e-6)
        np.testing.assert_allclose(scans.origins[chosen], np.tile(moved(np.zeros((1, 3)), *chain), (12, 1)), rtol=0, atol=1e-6)
        np.testing.assert_array_equal(scans.beam[chosen], np.arange(12))


@EACH_KIND
def test_lasers_are_flat(tmp_path, kind):
    path = write_scene(tmp_path / KINDS[kind], kind, lasers=4, clouds=3, slash="/" if kind == "ros1" else "")
    scans = read_bag(path, every=2)
    assert scans.dimension == 2 and len(scans) == 62
    for number in range(2):
        chain = LASER_ON_BASE, base_in_odom(2 * number + 0.35), MAP_ODOM
        chosen = scans.scan == number
        np.testing.assert_allclose(scans.points[chosen], moved(laser_points(RANGES[2 * number]), *chain)[:, :2], rtol=0, atol=1e-6)
        np.testing.assert_allclose(scans.origins[chosen], np.tile(moved(np.zeros((1, 3)), *chain)[:, :2], (31, 1)), rtol=0, atol=1e-6)


@pytest.mark.parametrize(("kind", "compression"), [("ros1", "BZ2"), ("ros1", "LZ4"), ("sqlite", "ZSTD"), ("mcap", "ZSTD")])
def test_packed_bags(tmp_path, kind, compression):
    plain = read_bag(write_scene(tmp_path / ("b" + KINDS[kind]), kind, lasers=0))
    packed = read_bag(write_scene(tmp_path / KINDS[kind], kind, compression, lasers=0))
    np.testing.assert_array_equal(packed.points, plain.points)


@pytest.mark.parametrize("kind", ["sqlite", "mcap"])
def test_a_file_without_its_folder(tmp_path, kind):
    folder = write_scene(tmp_path / KINDS[kind], kind, lasers=0)
    file = next(path for path in folder.iterdir() if path.suffix in (".db3", ".mcap"))
    alone = shutil.copy(file, tmp_path / f"alone{file.suffix}")
    assert is_bag(alone) and is_bag(folder) and not is_bag(tmp_path)
    np.testing.assert_array_equal(read_bag(alone).points, read_bag(folder).points)


def test_settings_go_to_the_reader(tmp_path):
    path = write_scene(tmp_path / "a.bag", "ros1", clouds=2)
    assert read_scans_path(path).dimension == 2  # the laser has more messages
    options = {"topic": "points", "fixed_frame": "odom", "beam_origin": "0, 0, 1.5", "max_range_m": 25.0, "min_range_m": 12.0}
    scans = read_scans_path(path, ReadingSettings(**options))
    chain, row = (LIDAR_ON_BASE, base_in_odom(0.35)), 0
    for beam, point in enumerate(CLOUDS[0]):
        if 12.0 < sum((point - [0, 0, 1.5]) ** 2) ** 0.5 < 25.0:
            np.testing.assert_allclose(scans.points[row], moved(point[None], *chain)[0], rtol=0, atol=1e-6)
            np.testing.assert_allclose(scans.origins[row], moved([[0, 0, 1.5]], *chain)[0], rtol=0, atol=1e-6)
            assert scans.beam[row] == beam and scans.scan[row] == 0
            row += 1
    assert 0 < row == np.count_nonzero(scans.scan == 0) < 12
    for wrong in ({"sensor_origin_m": [0.0, 0.0, 0.0]}, {"beam_origin": "hdl64"}, {"poses": "kiss_icp"}):
        with pytest.raises(InputError, match=f"reading.{next(iter(wrong))}: .*a.bag"):
            read_scans_path(path, ReadingSettings(**wrong))


@EACH_KIND
def test_odometry_serves_where_no_transforms_do(tmp_path, kind):
    path = tmp_path / KINDS[kind]
    with bag(path, kind) as made:
        made.transform("/tf_static", 0, "base", "lidar", LIDAR_ON_BASE)
        for second in range(3):
            made.odometry("/odom", second, "odom", "base", base_in_odom(second))
        made.odometry("/rarely", 0, "elsewhere", "base", base_in_odom(0))
        made.cloud("/points", 1.35, "lidar", CLOUDS[0])
    scans = read_bag(path)
    np.testing.assert_allclose(scans.points, moved(CLOUDS[0], LIDAR_ON_BASE, base_in_odom(1.35)), rtol=0, atol=1e-9)


def test_a_sensor_that_no_transform_places_is_taken_to_be_the_base(tmp_path):
    with bag(tmp_path / "a.bag") as made:
        for second in range(3):
            made.odometry("/odom", second, "odom", "base", base_in_odom(second))
        made.cloud("/points", 1.35, "lidar", CLOUDS[0])
    with pytest.warns(UserWarning, match="no transform says where lidar is on base; taken to be its origin"):
        scans = read_bag(tmp_path / "a.bag")
    np.testing.assert_allclose(scans.points, moved(CLOUDS[0], base_in_odom(1.35)), rtol=0, atol=1e-9)


def test_a_sensor_that_stood_still(tmp_path):
    with bag(tmp_path / "a.bag") as made:
        made.cloud("/points", None or 0, "lidar", CLOUDS[0])
    with pytest.raises(InputError, match="nothing says where 'lidar' was in map or odom .*reading.fixed_frame.*kiss_icp"):
        read_bag(tmp_path / "a.bag")
    np.testing.assert_array_equal(read_bag(tmp_path / "a.bag", fixed_frame="lidar").points, CLOUDS[0])


def test_frames_that_are_not_there(tmp_path):
    path = write_scene(tmp_path / "a.bag", "ros1", lasers=0, fixed=False)
    assert read_bag(path).points.max() < 100  # odom, for want of map
    with pytest.raises(InputError, match="in utm .frames of transforms: base, laser, lidar, odom; no odometry"):
        read_bag(path, fixed_frame="utm")


def test_scans_beyond_the_transforms_are_left_out(tmp_path):
    with bag(tmp_path / "a.bag") as made:
        for second in (1, 2, 3):
            made.transform("/tf", second, "map", "lidar", base_in_odom(second))
        for number in range(4):
            made.cloud("/points", number + 0.5, "lidar", CLOUDS[number])
    with pytest.warns(UserWarning, match="2 of 4 scans of /points have no pose at their time and are left out"):
        scans = read_bag(tmp_path / "a.bag")
    np.testing.assert_allclose(scans.points[scans.scan == 0], moved(CLOUDS[1], base_in_odom(1.5)), rtol=0, atol=1e-9)
    assert scans.scan.max() == 1
    with pytest.raises(InputError, match="got none of 1: transforms in map don't cover"):
        read_bag(tmp_path / "a.bag", every=10)


@pytest.mark.parametrize("kind", ["transforms", "odometry"])
def test_times_of_two_clocks_are_told(tmp_path, kind):
    """A lidar's may count since it was switched on."""
    with bag(tmp_path / "a.bag") as made:
        for second in range(3):
            if kind == "odometry":
                made.odometry("/odom", second, "odom", "lidar", base_in_odom(second))
            else:
                made.transform("/tf", second, "odom", "lidar", base_in_odom(second))
        for number in range(3):
            stamp = made.make("builtin_interfaces/Time", 100 + number, 500_000_000)
            made.cloud("/points", number, "lidar", CLOUDS[0], header=made.make("std_msgs/Header", 0, stamp, "lidar"))
    said = (
        "scans in lidar are of 100.500 to 102.500 s, transforms of 1700000000.000 to 1700000002.000 s. For clouds, reading.poses=kiss_icp"
    )
    with pytest.raises(InputError, match=f"a.bag: .*got none of 3: transforms in odom don't cover their times: {said}"):
        read_bag(tmp_path / "a.bag")


def test_transforms_that_have_no_time_in_common_are_told(tmp_path):
    with bag(tmp_path / "a.bag") as made:
        for second in range(3):
            made.transform("/tf", second, "odom", "lidar", base_in_odom(second))
            made.transform("/tf", second + 10, "map", "odom", MAP_ODOM)
        made.cloud("/points", 1, "lidar", CLOUDS[0])
    with pytest.raises(InputError, match="scans in lidar are of 1700000001.000 to .*, transforms of no time that all of them have"):
        read_bag(tmp_path / "a.bag")


def test_a_laser_that_leans_in_all_scans_is_told(tmp_path):
    with bag(tmp_path / "a.bag") as made:
        made.transform("/tf", 0, "map", "laser", ((0, 0, 0), turned(0.0, 0.5)))
        made.laser("/scan", 0.0, "laser", RANGES[0])
    with pytest.raises(InputError, match="got none of 1: in 1 the laser leans more than 15 degrees$"):
        read_bag(tmp_path / "a.bag")


def test_a_stamp_of_zero_is_the_time_of_the_recording(tmp_path):
    with bag(tmp_path / "a.bag") as made:
        for second in range(3):
            made.transform("/tf", second, "map", "laser", base_in_odom(second))
        made.laser("/scan", None, "laser", RANGES[0], recorded=1.35)
    np.testing.assert_allclose(read_bag(tmp_path / "a.bag").points, moved(laser_points(RANGES[0]), base_in_odom(1.35))[:, :2], atol=1e-6)


def test_a_bag_without_scans_lists_its_topics(tmp_path):
    path = write_scene(tmp_path / "a.bag", "ros1", lasers=0, clouds=0)
    with pytest.raises(
        InputError, match=r"LaserScan, .* or Livox' CustomMsg, found topics /tf \(tf2_msgs/msg/TFMessage, 12\), /tf_static \(.*, 2\)"
    ):
        read_bag(path)
    path = write_scene(tmp_path / "b.bag", "ros1")
    with pytest.raises(InputError, match="expected the topic /front, of .*/points .*/scan "):
        read_bag(path, topic="/front")
    with pytest.raises(InputError, match="expected the topic /tf, of "):
        read_bag(path, topic="/tf")


@pytest.mark.parametrize("quaternion", [(0, 0, 0, 0), (0, 0, 0, np.nan), (0, 0, 0, 2), (1e200, 0, 0, 0)])
def test_a_transform_that_is_none(tmp_path, quaternion):
    with bag(tmp_path / "a.bag") as made:
        made.transform("/tf", 0, "map", "lidar", ((0, 0, 0), quaternion))
        made.cloud("/points", 0.0, "lidar", CLOUDS[0])
    with pytest.raises(InputError, match="transform from lidar to map: expected a place in metres and a unit quaternion"):
        read_bag(tmp_path / "a.bag")


def test_a_big_bag_is_read_a_chunk_at_a_time(tmp_path):
    cloud = np.random.default_rng(0).uniform(-20, 20, (20_000, 3))
    with bag(tmp_path / "a.bag") as made:
        made.transform("/tf", 0, "map", "lidar", ((0, 0, 0), turned(0)))
        for number in range(40):
            made.cloud("/points", number, "lidar", cloud)
    read_bag(tmp_path / "a.bag", every=40)
    tracemalloc.start()
    assert len(read_bag(tmp_path / "a.bag", every=20)) == 40_000
    assert tracemalloc.get_traced_memory()[1] < 8e6 < (tmp_path / "a.bag").stat().st_size / 1.5
    tracemalloc.stop()


def test_clouds_that_were_put_in_the_map_already_are_told(tmp_path):
    """As a SLAM leaves them: the cloud's frame has a pose, but it is not the sensor's."""
    with bag(tmp_path / "a.bag", "ros1") as made:
        for number in range(6):
            made.transform("/tf", number, "map", "odom", MAP_ODOM)
            made.transform("/tf", number, "odom", "lidar", base_in_odom(number))
        for number in range(6):
            made.cloud("/cloud_registered", number + 0.0, "odom", CLOUDS[0])
            made.cloud("/points", number + 0.0, "lidar", CLOUDS[0])
    with pytest.warns(UserWarning, match="cloud_registered are in the frame odom, which stands still.*Set reading.topic.*: /points"):
        read_bag(tmp_path / "a.bag", topic="/cloud_registered")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read_bag(tmp_path / "a.bag", topic="/points")


def test_many_scans_from_one_place_are_told(tmp_path):
    with bag(tmp_path / "a.bag", "ros1") as made:
        made.transform("/tf_static", 0, "map", "body", MAP_ODOM)
        for number in range(6):
            made.cloud("/points", number + 0.0, "body", CLOUDS[0])
    with pytest.warns(UserWarning, match="/points come from one place, all 6 of them"):
        read_bag(tmp_path / "a.bag")


def test_leaning_lasers_are_told_from_missing_poses(tmp_path):
    with bag(tmp_path / "a.bag", "ros1") as made:
        for number in range(4):
            made.transform("/tf", number, "map", "laser", ((float(number), 0.0, 0.0), turned(0.0, 0.5 if number == 2 else 0.0, 0.0)))
        for number in range(4):
            made.laser("/scan", float(number), "laser", RANGES[number])
    with pytest.warns(UserWarning, match="in 1 of 4 the laser leans more than 15 degrees"):
        assert len(np.unique(read_bag(tmp_path / "a.bag").scan)) == 3


def test_other_lasers_are_told_however_rarely_they_scan(tmp_path):
    with bag(tmp_path / "a.bag") as made:
        for name in ("front", "rear", "rare"):
            made.transform("/tf_static", 0, "base", name, LASER_ON_BASE)
        for second in range(5):
            made.transform("/tf", second, "odom", "base", base_in_odom(second))
        for number in range(4):
            made.laser("/front", number + 0.3, "front", RANGES[number])
            made.laser("/rear", number + 0.3, "rear", RANGES[number])
        made.laser("/rare", 0.3, "rare", RANGES[0])
    with pytest.warns(UserWarning, match=r"read are the 4 scans of /front alone. Set reading.topic .*: /rare \(1\), /rear \(4\)$"):
        assert read_bag(tmp_path / "a.bag").scan.max() == 3
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read_bag(tmp_path / "a.bag", topic="/front")


@pytest.mark.parametrize(
    ("lasers", "clouds", "read", "left"),
    [(4, 1, "4 scans of /scan", "/points (1, for a map in 3D)"), (1, 4, "4 scans of /points", "/scan (1, for a map in 2D)")],
)
def test_a_sensor_of_another_kind_is_told_however_rarely_it_scans(tmp_path, lasers, clouds, read, left):
    path = write_scene(tmp_path / "a.bag", "ros1", lasers=lasers, clouds=clouds)
    with pytest.warns(
        UserWarning, match=re.escape(f"read are the {read} alone. Set reading.topic for another; other topics of scans: {left}")
    ):
        read_bag(path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read_bag(path, topic="/points")
