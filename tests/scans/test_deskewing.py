import warnings

import numpy as np
import pytest
from bag_writers import START_NS, bag, moved, turned
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from hilbertvae.scans.bags import read_bag
from hilbertvae.scans.deskewing import deskewed, deskewed_along
from hilbertvae.scans.formats import ReadingSettings, read_scans_path

pytest.importorskip("rosbags")

RANGES = np.random.default_rng(3).uniform(1, 20, 181).astype(np.float32).astype(np.float64)


def matrix(place, quaternion):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.from_quat(quaternion).as_matrix(), place
    return pose


def robot(seconds):
    """Drives and turns at constant rates, far from the origin as UTM is."""
    return (456_789.0 + 2.0 * seconds, 5_428_345.5 - 0.7 * seconds, 0.0), turned(1.5 * seconds - 1.0)


def test_each_beam_has_the_pose_of_its_time():
    """Before the first pose and after the second, too."""
    points, starts = np.random.default_rng(1).normal(0, 5, (2, 11, 3))
    points[4] = np.nan
    first, last = matrix(*robot(0.2)), matrix(*robot(0.3))
    shares = np.linspace(-0.5, 1.25, 11)
    found = deskewed(points, starts, shares, np.linalg.inv(first) @ last)
    for part, one in zip((points, starts), found, strict=True):
        for beam, share in enumerate(shares):
            expected = moved(part[beam : beam + 1], robot(0.2 + 0.1 * share))[0]
            np.testing.assert_allclose(first[:3, :3] @ one[beam] + first[:3, 3], expected, rtol=0, atol=1e-8)


@pytest.mark.parametrize("count", [1, 2, 7, 500])
def test_along_a_way_each_beam_has_the_pose_of_its_time(count):
    """A wheel that speeds up, at 13 rad/s in the end, to the chords' half millimetre; times in any order."""

    def pose_at(time_ns):
        seconds = time_ns / 1e9
        return matrix((456_789.0 + 3.0 * seconds, 5_428_345.5 + 20.0 * seconds**2, 0.0), turned(40.0 * seconds**2))

    rng = np.random.default_rng(count)
    points, starts, times = rng.normal(0, 5, (count, 3)), rng.normal(0, 1, (count, 3)), rng.integers(60_000_000, 160_000_000, count)
    found = deskewed_along(points, starts, times, pose_at, pose_at(100_000_000))
    for part, back in zip((points, starts), found, strict=True):
        for beam in range(count):
            there, here = pose_at(int(times[beam])), pose_at(100_000_000)
            expected = there[:3, :3] @ part[beam] + there[:3, 3]
            np.testing.assert_allclose(here[:3, :3] @ back[beam] + here[:3, 3], expected, rtol=0, atol=0.02)


def test_without_a_pose_there_is_no_answer():
    nothing = deskewed_along(np.ones((3, 3)), np.zeros((3, 3)), np.array([0, 5, 9]), lambda ns: np.eye(4) if ns < 8 else None, np.eye(4))
    assert nothing is None


def write(path):
    """Four sweeps of 0.09 s, the last of which goes on after the last transform."""
    with bag(path) as made:
        made.transform("/tf_static", 0, "base", "laser", ((0.25, 0.0, 0.3), turned(0.4, 0.0, np.pi)))
        for stamp in np.arange(0, 81) / 20:
            made.transform("/tf", stamp, "odom", "base", robot(stamp))
        for stamp in (0.31, 1.33, 2.36, 3.97):
            made.laser("/scan", stamp, "laser", RANGES, time_step=0.0005)
    return path


def test_a_laser_is_turned_beam_by_beam(tmp_path):
    """To a millimetre: the laser, ahead of the robot's axis, goes on an arc, and between the sweep's ends on its chord."""
    with pytest.warns(UserWarning, match="transforms don't cover the whole sweep of 1 of 4 scans; these are taken as if measured at once"):
        scans = read_bag(write(tmp_path / "a.bag"))
    angle, wide = float(np.float32(-np.pi / 2)), float(np.float32(np.pi / 180))
    for number, stamp in enumerate((0.31, 1.33, 2.36, 3.97)):
        chosen = np.flatnonzero(scans.scan == number)
        assert scans.beam[chosen].tolist() == list(range(181))
        for beam in range(0, 181, 20):
            seconds = stamp + (0.0005 * beam if number < 3 else 0.0)
            chain = ((0.25, 0.0, 0.3), turned(0.4, 0.0, np.pi)), robot(seconds)
            turn = angle + wide * beam
            end = [[RANGES[beam] * np.cos(turn), RANGES[beam] * np.sin(turn), 0.0]]
            np.testing.assert_allclose(scans.points[chosen[beam]], moved(end, *chain)[0, :2], rtol=0, atol=1e-3)
            np.testing.assert_allclose(scans.origins[chosen[beam]], moved(np.zeros((1, 3)), *chain)[0, :2], rtol=0, atol=1e-3)


def test_a_laser_whose_message_has_the_time_of_its_last_beam(tmp_path):
    """It says so by a time between beams below 0; one that says nonsense is taken as it is, with a warning."""
    with bag(tmp_path / "a.bag") as made:
        for stamp in np.arange(0, 81) / 20:
            made.transform("/tf", stamp, "odom", "laser", robot(stamp))
        for stamp, step in ((0.31, -0.0005), (1.33, 0.01)):
            made.laser("/scan", stamp, "laser", RANGES, time_step=step)
    with pytest.warns(UserWarning, match="the times of points in 1 of 2 scans make no sweep of 0.002 to 1 s"):
        scans = read_bag(tmp_path / "a.bag")
    for beam in (0, 90, 180):
        seconds = 0.31 - float(np.float32(0.0005)) * beam
        turn = float(np.float32(-np.pi / 2)) + float(np.float32(np.pi / 180)) * beam
        end = moved([[RANGES[beam] * np.cos(turn), RANGES[beam] * np.sin(turn), 0.0]], robot(seconds))
        np.testing.assert_allclose(scans.points[(scans.scan == 0) & (scans.beam == beam)][0], end[0, :2], rtol=0, atol=1e-3)
    assert (scans.origins[scans.scan == 1] == scans.origins[scans.scan == 1][0]).all()


def lidar_sweep(stamp, first_s=0.0, count=400):
    """What a lidar on `robot` sees of 400 places around it, one after the other in 0.1 s: places, measured points, times after `stamp`."""
    rng = np.random.default_rng(7)
    times = first_s + np.linspace(0.0, 0.1, count)
    centre = np.array(robot(0.0)[0])
    places = centre + np.column_stack([rng.uniform(-20, 20, (count, 2)), rng.uniform(-1, 3, count)])
    measured = [matrix(*robot(stamp + time)) for time in times]
    return places, np.array([pose[:3, :3].T @ (place - pose[:3, 3]) for pose, place in zip(measured, places, strict=True)]), times


@pytest.mark.parametrize("name", ["t", "time", "timestamp"])
def test_clouds_are_turned_point_by_point(tmp_path, name):
    """As Ouster, Velodyne (a sweep that ends at its message's time) and Hesai say it; and not where that is asked for."""
    first_s = -0.1 if name == "time" else 0.0
    with bag(tmp_path / "a.bag") as made:
        for stamp in np.arange(0, 81) / 20:
            made.transform("/tf", stamp, "odom", "lidar", robot(stamp))
        for stamp in (0.31, 1.33):
            _, points, times = lidar_sweep(stamp, first_s)
            numbers = {"t": np.round(times * 1e9).astype("<u4"), "time": times.astype("<f4"), "timestamp": START_NS / 1e9 + stamp + times}[
                name
            ]
            made.cloud("/points", stamp, "lidar", points, rows=4, padding=12, times=(name, numbers))
    scans = read_bag(tmp_path / "a.bag")
    for number, stamp in enumerate((0.31, 1.33)):
        places, points, times = lidar_sweep(stamp, first_s)
        chosen = scans.scan == number
        np.testing.assert_allclose(scans.points[chosen], places, rtol=0, atol=1e-3)
        np.testing.assert_allclose(scans.origins[chosen], [robot(stamp + time)[0] for time in times], rtol=0, atol=1e-3)
    skewed = read_scans_path(tmp_path / "a.bag", ReadingSettings(deskew=False))
    np.testing.assert_allclose(skewed.points[chosen], moved(points, robot(1.33)), rtol=0, atol=1e-3)


def test_times_that_make_no_sweep_are_told(tmp_path):
    with bag(tmp_path / "a.bag") as made:
        made.transform("/tf", 0.0, "map", "lidar", robot(0.0))
        made.cloud("/points", 0.0, "lidar", np.ones((12, 3)) * 5, padding=12, times=("time", np.linspace(0, 1.5, 12)))
        made.cloud("/points", 1.0, "lidar", np.ones((12, 3)) * 5, padding=12, times=("time", np.zeros(12)))
    with pytest.warns(UserWarning, match="the times of points in 1 of 2 scans make no sweep of 0.002 to 1 s"):
        read_bag(tmp_path / "a.bag")


@pytest.mark.parametrize("poses", [None, "kiss_icp"])
def test_times_that_are_shares_of_the_sweep_are_told(tmp_path, poses):
    """From 0 to 1, they look like a sweep of a second; clouds come ten times in one."""
    if poses:
        pytest.importorskip("kiss_icp")
    with bag(tmp_path / "a.bag") as made:
        for stamp in np.arange(0, 61) / 20:
            made.transform("/tf", stamp, "odom", "lidar", robot(stamp))
        for stamp in (0.5, 0.6, 0.7, 1.0, 1.1):
            _, points, _ = lidar_sweep(stamp)
            made.cloud("/points", stamp, "lidar", points, padding=12, times=("time", np.linspace(0, 1, 400).astype("<f4")))
    said = "the times of points in 5 of 5 scans make no sweep .* or one more than 2 times as long as the time from scan to scan; these"
    with pytest.warns(UserWarning, match=said), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*hardly fit the one before")
        scans = read_bag(tmp_path / "a.bag", poses=poses)
    if not poses:
        np.testing.assert_allclose(scans.points[scans.scan == 4], moved(points, robot(1.1)), rtol=0, atol=1e-3)


def wall_m(points):
    """The mean distance of returns to the nearest wall of a room of 16 x 12 m, none more than 0.5, where the room lies as fits them best:
    the map's frame is that of a first scan that nothing turns back."""

    def distance(pose):
        cosine, sine = np.cos(pose[2]), np.sin(pose[2])
        placed = np.abs(points @ [[cosine, sine], [-sine, cosine]] + pose[:2])
        return np.minimum(np.abs(placed - [8, 6]).min(axis=1), 0.5).mean()

    return minimize(
        distance, np.zeros(3), method="Nelder-Mead", options={"initial_simplex": [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.05]]}
    ).fun


def test_odometry_turns_clouds_back_as_they_moved_before(tmp_path):
    """At 2 m/s and 1.5 rad/s walls are a fifth as thick as without, 2.5 cm for 12, though a scan was dropped."""
    pytest.importorskip("kiss_icp")
    rng = np.random.default_rng(3)
    side, along, height = rng.integers(0, 4, 6000), rng.uniform(-1, 1, 6000), rng.uniform(-1, 2, 6000)
    walls = np.where(
        (side < 2)[:, None], np.column_stack([8 * (2 * side - 1), 6 * along]), np.column_stack([8 * along, 6 * (2 * side - 5)])
    )
    places = np.column_stack([walls, height])[np.argsort(np.arctan2(walls[:, 1], walls[:, 0]))]
    with bag(tmp_path / "a.bag") as made:
        for number in (0, 1, 2, 3, 4, 6, 7, 8, 9):
            seen, times = places[np.sort(rng.choice(6000, 3000, replace=False))], np.linspace(0, 0.1, 3000)
            poses = [matrix((2.0 * s - 1, 0.3 * s, 0.0), turned(1.5 * s)) for s in 0.1 * number + times]
            points = np.array([pose[:3, :3].T @ (place - pose[:3, 3]) for pose, place in zip(poses, seen, strict=True)])
            made.cloud("/points", 0.1 * number, "lidar", points, padding=12, times=("t", np.round(times * 1e9).astype("<u4")))
    found = {}
    for deskew in (True, False):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a room of bare walls is hard to tell the way in
            scans = read_bag(tmp_path / "a.bag", poses="kiss_icp", deskew=deskew)
        found[deskew] = wall_m(scans.points[scans.scan > 2, :2] - [1, 0])
    assert found[True] < 0.05 < 0.1 < found[False]


def test_a_sensor_that_turns_in_place_is_no_fixed_cloud(tmp_path):
    with bag(tmp_path / "a.bag") as made:
        for number in range(6):
            made.transform("/tf", number, "map", "lidar", ((1.0, 2.0, 0.0), turned(0.2 * number)))
        for number in range(6):
            made.cloud("/points", number, "lidar", np.random.default_rng(number).uniform(-20, 20, (12, 3)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert read_bag(tmp_path / "a.bag").scan.max() == 5
