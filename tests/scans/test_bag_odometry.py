"""Which odometry says where a sensor was, where a bag has several, or one beside transforms."""

import warnings
from types import SimpleNamespace

import numpy as np
import pytest
from bag_scene import CLOUDS, LIDAR_ON_BASE, MAP_ODOM, RANGES, base_in_odom
from bag_writers import KINDS, bag, moved, turned

from hilbertvae.checks import InputError
from hilbertvae.scans.bags import read_bag
from hilbertvae.scans.formats import ReadingSettings, read_scans_path
from hilbertvae.scans.pose_track import PoseTrack

pytest.importorskip("rosbags")

ELSEWHERE = ((5.0, -7.0, 0.3), turned(0.2))


@pytest.fixture(autouse=True)
def _warnings_are_told():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def write(path, *tracks, transforms=()):
    """A lidar on its base, a cloud at 1.35 s, and odometry: (topic, frame, base, pose at a time, messages a second)."""
    with bag(path) as made:
        made.transform("/tf_static", 0, "base", "lidar", LIDAR_ON_BASE)
        for parent, child, pose in transforms:
            made.transform("/tf", 0, parent, child, pose)
        for topic, frame, base, pose, often in tracks:
            for number in range(3 * often):
                made.odometry(topic, number / often, frame, base, pose(number / often))
        made.cloud("/points", 1.35, "lidar", CLOUDS[0])
    return path


WHEELS = ("/odom", "odom", "base", base_in_odom, 1)
CAMERA = ("/camera/odom", "camera_odom", "camera", lambda second: ELSEWHERE, 4)
DRIFTING = ("/wheel/odom", "odom", "base", lambda second: ELSEWHERE, 4)
TRUE = moved(CLOUDS[0], LIDAR_ON_BASE, base_in_odom(1.35))


@pytest.mark.parametrize("fixed", [None, "odom"])
def test_that_of_the_sensor_s_own_robot(tmp_path, fixed):
    """A tracking camera's comes four times as often, and no transform leads from it to the lidar."""
    path = write(tmp_path / "a.bag", WHEELS, CAMERA)
    np.testing.assert_allclose(read_bag(path, fixed_frame=fixed).points, TRUE, rtol=0, atol=1e-9)
    with pytest.raises(InputError, match="odometry in camera_odom, odom"):
        read_bag(path, fixed_frame="utm")


def test_of_two_the_one_that_is_asked_for_else_that_with_most_messages_and_a_warning(tmp_path):
    path = write(tmp_path / "a.bag", WHEELS, DRIFTING)
    with pytest.warns(UserWarning, match="poses are those of /wheel/odom, which has most messages. Set reading.odometry for another: /o"):
        found = read_bag(path).points
    np.testing.assert_allclose(found, moved(CLOUDS[0], LIDAR_ON_BASE, ELSEWHERE), rtol=0, atol=1e-9)
    for topic in ("/odom", "odom"):
        found = read_scans_path(path, ReadingSettings(odometry=topic)).points
        np.testing.assert_allclose(found, TRUE, rtol=0, atol=1e-9)
    with pytest.raises(
        InputError, match="a.bag: reading.odometry: expected a topic of nav_msgs/Odometry or .*, got /x; found /odom, /wheel"
    ):
        read_bag(path, odometry="/x")
    with pytest.raises(InputError, match="reading.odometry: with reading.poses=kiss_icp none is read"):
        read_bag(path, odometry="/odom", poses="kiss_icp")


def test_transforms_lead_on_from_where_odometry_ends(tmp_path):
    """SLAM says where odom is in the map, and a topic alone where the robot is in odom."""
    path = write(tmp_path / "a.bag", WHEELS, transforms=[("map", "odom", MAP_ODOM)])
    for fixed in (None, "map"):
        found = read_bag(path, fixed_frame=fixed).points
        np.testing.assert_allclose(found, moved(CLOUDS[0], LIDAR_ON_BASE, base_in_odom(1.35), MAP_ODOM), rtol=0, atol=1e-6)
    np.testing.assert_allclose(read_bag(path, fixed_frame="odom").points, TRUE, rtol=0, atol=1e-9)


def test_odometry_that_is_asked_for_counts_before_transforms(tmp_path):
    path = write(tmp_path / "a.bag", WHEELS, transforms=[("odom", "base", ELSEWHERE)])
    np.testing.assert_allclose(read_bag(path).points, moved(CLOUDS[0], LIDAR_ON_BASE, ELSEWHERE), rtol=0, atol=1e-9)
    np.testing.assert_allclose(read_bag(path, odometry="/odom").points, TRUE, rtol=0, atol=1e-9)


@pytest.mark.parametrize("again", [True, False])
def test_times_that_fall_back_to_where_a_frame_was_elsewhere_are_told(tmp_path, again):
    """Of a simulator that was set back; a recording that was played twice says the same twice."""
    with bag(tmp_path / "a.bag") as made:
        for run in range(2):
            for second in range(6):
                place, turn = base_in_odom(second)
                moved_on = place if again else (place[0], place[1] + 4 * run, place[2])
                made.transform("/tf", second, "map", "lidar", (moved_on, turn), recorded=10 * run + second)
        made.cloud("/points", 1.35, "lidar", CLOUDS[0])
    if again:
        read_bag(tmp_path / "a.bag")
    else:
        with pytest.warns(UserWarning, match="transform from lidar to map: its times fall back by 5 s, to when it was 4 m away before"):
            read_bag(tmp_path / "a.bag")


def test_a_laser_s_own_code_for_no_return_is_told(tmp_path):
    ranges = np.concatenate([RANGES, np.full((4, 20), 25.0)], axis=1)
    with bag(tmp_path / "a.bag") as made:
        made.transform("/tf", 0, "map", "laser", ((0, 0, 0), turned(0)))
        for number, each in enumerate(ranges):
            made.laser("/scan", number, "laser", each, high=100.0)
    with pytest.warns(UserWarning, match="a.bag: 39 % of all ranges are the largest, 25.0 m.*Set reading.max_range_m=25.0 to drop them"):
        read_bag(tmp_path / "a.bag")
    assert len(read_bag(tmp_path / "a.bag", max_range_m=25.0)) == RANGES.size


def test_beams_that_are_not_side_by_side_are_refused(tmp_path):
    for name, step in (("a.bag", 0.0), ("b.bag", 2.0)):
        with bag(tmp_path / name) as made:
            made.transform("/tf", 0, "map", "laser", ((0, 0, 0), turned(0)))
            made.laser("/scan", 0, "laser", RANGES[0], step=step)
        with pytest.raises(InputError, match=f"a message of /scan: expected beams side by side, got 31 that are {step} rad apart"):
            read_bag(tmp_path / name)


def test_a_publisher_that_is_late_is_no_other_drive():
    """Every second sample falls back then, and all of them are looked at in a moment."""
    track = PoseTrack("a")
    for number in range(20_000):
        stamp_ns = int(1e9 * (100 + 0.02 * number - 3 * (number % 2)))
        track.add(stamp_ns, SimpleNamespace(x=1e-12 * stamp_ns, y=0.0, z=0.0), SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0))
    assert track.at(int(200e9))[0, 3] == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("frame", "fixed", "transforms"),
    [("camera_init", None, []), ("odom", None, []), ("odom", "odom", []), ("robot/odom", None, []), ("odom", "odom", [("odom", "base", 0)]),
     ("odom", None, [("map", "odom", MAP_ODOM)])],
)  # fmt: skip
def test_clouds_that_a_slam_has_put_in_the_frame_of_its_odometry(tmp_path, frame, fixed, transforms):
    """They stay where they are, also those that still have the times of their points, and beams start where the odometry was."""
    with bag(tmp_path / "a.bag") as made:
        for second in range(4):
            for parent, child, pose in transforms:
                made.transform("/tf", second, parent, child, pose or base_in_odom(second))
            made.odometry("/lio/odometry", second, frame, "body", base_in_odom(second))
        for number in range(3):
            times = "time", np.linspace(0, 0.1, 12).astype("<f4")
            made.cloud("/cloud_registered", number + 0.35, frame, CLOUDS[number], padding=8, times=times)
    said = f"a.bag: scans in {frame} are where /lio/odometry has its poses: they stay there, and their beams start where it has body$"
    with pytest.warns(UserWarning, match=said) as found:
        scans = read_bag(tmp_path / "a.bag", fixed_frame=fixed, beam_origin=(0, 0, 1.5))
    assert len(found) == 1
    to_map = [pose for parent, _, pose in transforms if parent == "map"]
    for number in range(3):
        chosen = scans.scan == number
        np.testing.assert_allclose(scans.points[chosen], moved(CLOUDS[number], *to_map), rtol=0, atol=1e-6)
        starts = moved([[0, 0, 1.5]] * 12, base_in_odom(number + 0.35), *to_map)
        np.testing.assert_allclose(scans.origins[chosen], starts, rtol=0, atol=1e-6)


def test_registered_clouds_are_cut_by_how_far_they_were_seen_and_left_out_without_a_pose(tmp_path):
    with bag(tmp_path / "a.bag") as made:
        for second in range(3):
            made.odometry("/odometry", second, "camera_init", "body", ((500.0, 0, 0), turned(0)))
        for second in (0.5, 1.5, 2.5):
            made.cloud("/cloud_registered", second, "camera_init", [[510.0, 0, 0], [490, 0, 0], [500, 10, 0], [530, 0, 0]])
    with pytest.warns(UserWarning, match="a.bag: 1 of 3 scans of /cloud_registered have no pose at their time"):
        scans = read_bag(tmp_path / "a.bag", max_range_m=20.0)
    np.testing.assert_array_equal(scans.points, [[510.0, 0, 0], [490, 0, 0], [500, 10, 0]] * 2)


@pytest.mark.parametrize(("frame", "base"), [("", ""), ("laser", "laser")])
def test_a_sensor_s_own_frame_is_no_fixed_one(tmp_path, frame, base):
    """Drivers leave frames empty, and planar scans are always the sensor's."""
    with bag(tmp_path / "a.bag") as made:
        for second in range(3):
            made.odometry("/odom", second, frame, base, base_in_odom(second))
        made.cloud("/points", 1.35, frame, CLOUDS[0])
    np.testing.assert_allclose(read_bag(tmp_path / "a.bag").points, moved(CLOUDS[0], base_in_odom(1.35)), rtol=0, atol=1e-9)


def test_planar_scans_are_never_in_a_fixed_frame(tmp_path):
    with bag(tmp_path / "a.bag") as made:
        for second in range(3):
            made.odometry("/odom", second, "odom", "base", base_in_odom(second))
        made.laser("/scan", 1.35, "odom", RANGES[0])
    warnings.filterwarnings("ignore", message=".* in the frame odom, which stands still")
    with pytest.warns(UserWarning, match="no transform says where odom is on base"):
        found = read_bag(tmp_path / "a.bag")
    np.testing.assert_allclose(found.origins[0], base_in_odom(1.35)[0][:2], rtol=0, atol=1e-9)


@pytest.mark.parametrize("kind", ["PoseStamped", "PoseWithCovarianceStamped", "TransformStamped"])
def test_poses_of_other_types_are_those_of_the_sensor_s_robot_where_they_are_asked_for(tmp_path, kind):
    """Of motion capture, or of a SLAM: only the last type says of what they are, so that transforms lead on to the sensor."""
    with bag(tmp_path / "a.bag") as made:
        made.transform("/tf_static", 0, "base", "lidar", LIDAR_ON_BASE)
        made.transform("/tf", 0, "map", "base", ELSEWHERE)
        for second in range(4):
            made.stamped_pose("/vicon", second, "map", "base", base_in_odom(second), kind)
        made.cloud("/points", 1.35, "lidar", CLOUDS[0])
    np.testing.assert_allclose(read_bag(tmp_path / "a.bag").points, moved(CLOUDS[0], LIDAR_ON_BASE, ELSEWHERE), rtol=0, atol=1e-9)
    if kind == "TransformStamped":
        found, on_base = read_bag(tmp_path / "a.bag", odometry="vicon"), [LIDAR_ON_BASE]
    else:
        with pytest.warns(UserWarning, match="a.bag: no transform says where lidar is on the robot; taken to be its origin$"):
            found, on_base = read_bag(tmp_path / "a.bag", odometry="vicon"), []
    np.testing.assert_allclose(found.points, moved(CLOUDS[0], *on_base, base_in_odom(1.35)), rtol=0, atol=1e-9)


def test_poses_that_are_not_read_are_named_where_others_are_missing(tmp_path):
    for name, topics in (("a.bag", ()), ("b.bag", ("/vicon", "/slam"))):
        with bag(tmp_path / name) as made:
            made.cloud("/points", 0, "lidar", CLOUDS[0])
            for topic in topics:
                made.stamped_pose(topic, 0, "map", "lidar", base_in_odom(0))
        told = "nothing says where 'lidar' was in map or odom .*no odometry" + (
            "; not read are the poses of /slam, /vicon: set reading.odometry to one of these for them" if topics else r"\)"
        )
        with pytest.raises(InputError, match=told):
            read_bag(tmp_path / name)


@pytest.mark.parametrize("kind", KINDS)
def test_the_last_message_of_a_path_corrects_those_before(tmp_path, kind):
    """As a SLAM's does that has closed a loop: what it had said of the same times is left behind."""
    with bag(tmp_path / KINDS[kind], kind) as made:
        for last in range(1, 4):
            made.path("/slam/path", last, "map", {second: base_in_odom(second + 5) for second in range(last + 1)})
        made.path("/slam/path", 4, "map", {second: base_in_odom(second) for second in range(4)})
        made.cloud("/points", 1.35, "lidar", CLOUDS[0])
    with pytest.warns(UserWarning, match="no transform says where lidar is on the robot; taken to be its origin$"):
        found = read_bag(tmp_path / KINDS[kind], odometry="/slam/path")
    np.testing.assert_allclose(found.points, moved(CLOUDS[0], base_in_odom(1.35)), rtol=0, atol=1e-9)


@pytest.mark.parametrize(("poses", "got"), [({}, "got 0 at 0 times"), ({0: 0, 1: 5}, "got 2 at 1 times")])
def test_a_path_without_times_is_refused(tmp_path, poses, got):
    """A planner's may have one time for all that it means to drive through; of such poses each would hold for ever."""
    with bag(tmp_path / "a.bag") as made:
        made.header = lambda frame, seconds, header=made.header: header(frame, 0 if frame == "map" else seconds)
        made.path("/plan", 0, "map", {key: base_in_odom(second) for key, second in poses.items()})
        made.cloud("/points", 0.5, "lidar", CLOUDS[0])
    with pytest.raises(InputError, match=f"a.bag: /plan: expected a path of poses that have each a time, {got}"):
        read_bag(tmp_path / "a.bag", odometry="plan")
