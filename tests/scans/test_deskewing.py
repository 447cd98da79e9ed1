import warnings
from types import SimpleNamespace

import numpy as np
import pytest
from bag_writers import bag, moved, turned
from scipy.spatial.transform import Rotation

from hilbertvae.scans.bags import read_bag
from hilbertvae.scans.deskewing import deskewed, sweep_ns

pytest.importorskip("rosbags")

RANGES = np.random.default_rng(3).uniform(1, 20, 181).astype(np.float32).astype(np.float64)


def matrix(place, quaternion):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.from_quat(quaternion).as_matrix(), place
    return pose


def robot(seconds):
    """Drives and turns at constant rates, far from the origin as UTM is."""
    return (456_789.0 + 2.0 * seconds, 5_428_345.5 - 0.7 * seconds, 0.0), turned(1.5 * seconds - 1.0)


@pytest.mark.parametrize(
    ("step", "beams", "expected"),
    [(0.001, 101, 100_000_000), (0.0, 101, 0), (-0.001, 101, 0), (np.nan, 101, 0), (np.inf, 101, 0), (17.4, 101, 0), (0.001, 1, 0),
     (0.001, 0, 0)],
)  # fmt: skip
def test_how_long_a_sweep_takes(step, beams, expected):
    assert sweep_ns(SimpleNamespace(time_increment=step, ranges=np.ones(beams))) == expected


def test_each_beam_has_the_pose_of_its_time():
    points, starts = np.random.default_rng(1).normal(0, 5, (2, 11, 3))
    points[4] = np.nan
    first, last = matrix(*robot(0.2)), matrix(*robot(0.3))
    found = deskewed(points, starts, first, last)
    for part, one in zip((points, starts), found, strict=True):
        for beam in range(11):
            expected = moved(part[beam : beam + 1], robot(0.2 + 0.01 * beam))[0]
            np.testing.assert_allclose(first[:3, :3] @ one[beam] + first[:3, 3], expected, rtol=0, atol=1e-8)


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


def test_a_sensor_that_turns_in_place_is_no_fixed_cloud(tmp_path):
    with bag(tmp_path / "a.bag") as made:
        for number in range(6):
            made.transform("/tf", number, "map", "lidar", ((1.0, 2.0, 0.0), turned(0.2 * number)))
        for number in range(6):
            made.cloud("/points", number, "lidar", np.random.default_rng(number).uniform(-20, 20, (12, 3)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert read_bag(tmp_path / "a.bag").scan.max() == 5
