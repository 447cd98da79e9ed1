from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hilbertvae.checks import InputError
from hilbertvae.scans.pose_track import PoseTrack
from hilbertvae.scans.transform_tree import TransformTree


def xyz(place):
    return SimpleNamespace(**dict(zip("xyz", map(float, place), strict=True)))


def xyzw(rotation):
    return SimpleNamespace(**dict(zip("xyzw", map(float, rotation.as_quat()), strict=True)))


def matrix(place, rotation):
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = rotation.as_matrix(), place
    return found


def random_pose(seed):
    rng = np.random.default_rng(seed)
    return rng.uniform(-9, 9, 3), Rotation.random(rng=rng)


def put(tree, parent, child, pose, stamp=0, static=True):
    tree.add(parent, child, stamp, xyz(pose[0]), xyzw(pose[1]), static)


def test_a_chain_up_and_down_a_branch():
    poses = {name: random_pose(seed) for seed, name in enumerate(["odom", "base", "arm", "lidar"])}
    tree = TransformTree()
    put(tree, "map", "odom", poses["odom"])
    put(tree, "odom", "base", poses["base"])
    put(tree, "/base", "/arm", poses["arm"])
    put(tree, "base", "lidar", poses["lidar"])
    odom, base, arm, lidar = (matrix(*poses[name]) for name in poses)
    np.testing.assert_allclose(tree.pose("map", "lidar", 5), odom @ base @ lidar, atol=1e-12)
    np.testing.assert_allclose(tree.pose("arm", "lidar", 5), np.linalg.inv(arm) @ lidar, atol=1e-12)
    np.testing.assert_allclose(tree.pose("lidar", "map", 5), np.linalg.inv(odom @ base @ lidar), atol=1e-12)
    np.testing.assert_array_equal(tree.pose("base", "base", 5), np.eye(4))
    assert tree.frames == ["arm", "base", "lidar", "map", "odom"]
    assert tree.connects("arm", "lidar") and not tree.connects("map", "camera") and tree.pose("map", "camera", 5) is None


def test_places_of_utm_keep_their_bits_on_the_way_down():
    tree = TransformTree()
    put(tree, "utm", "map", ((456_789.125, 5_428_345.25, 118.5), Rotation.from_euler("z", 0.4)))
    put(tree, "utm", "lidar", ((456_790.125, 5_428_345.25, 118.5), Rotation.identity()))
    np.testing.assert_allclose(tree.pose("map", "lidar", 0)[:3, 3], [np.cos(0.4), -np.sin(0.4), 0], rtol=0, atol=2e-9)


def test_between_two_samples():
    track = PoseTrack("track")
    stamps = [10, 30, 20, 60]
    for stamp in stamps:  # out of order, as several recorders leave them
        track.add(stamp, xyz((stamp, -stamp, 0)), xyzw(Rotation.from_euler("z", 0.02 * stamp)))
    for stamp in (10, 13, 20, 29, 47, 60):
        np.testing.assert_allclose(track.at(stamp), matrix((stamp, -stamp, 0), Rotation.from_euler("z", 0.02 * stamp)), atol=1e-12)
    assert track.at(9) is None and track.at(61) is None


@pytest.mark.parametrize(
    ("step_s", "hole_s", "holds"), [(1, 9.9, True), (1, 10.1, False), (1, 98, False), (30, 149, True), (30, 151, False)]
)
def test_in_a_hole_there_is_no_pose(step_s, hole_s, holds):
    """A recording that stalled, or a robot that was carried, is no straight way; what comes once in half a minute has no hole there."""
    track, before, after = PoseTrack("track"), np.arange(4) * step_s, (3 * step_s + hole_s) + np.arange(4) * step_s
    for second in (*before, *after):
        track.add(int(second * 1e9), xyz((second, 0, 0)), xyzw(Rotation.identity()))
    assert (track.at(int((before[-1] + hole_s / 2) * 1e9)) is not None) == holds
    for second in (before[-1], before[1] + step_s / 2, after[0], after[2] + step_s / 2):
        np.testing.assert_allclose(track.at(int(second * 1e9))[0, 3], second)


def test_of_one_time_the_last_sample_counts_and_a_single_one_holds_always():
    track = PoseTrack("track")
    track.add(5, xyz((1, 0, 0)), xyzw(Rotation.identity()))
    assert track.at(-1)[0, 3] == track.at(10**18)[0, 3] == 1
    track.add(5, xyz((2, 0, 0)), xyzw(Rotation.identity()))
    assert track.at(7)[0, 3] == 2


def test_what_moves_counts_before_what_is_static():
    tree = TransformTree()
    put(tree, "map", "base", ((1, 0, 0), Rotation.identity()))
    put(tree, "map", "base", ((2, 0, 0), Rotation.identity()))
    assert tree.pose("map", "base", 7)[0, 3] == 2
    put(tree, "map", "base", ((3, 0, 0), Rotation.identity()), stamp=4, static=False)
    put(tree, "map", "base", ((4, 0, 0), Rotation.identity()), stamp=6, static=False)
    assert tree.pose("map", "base", 5)[0, 3] == 3.5 and tree.pose("map", "base", 7) is None


def test_of_several_parents_the_one_on_the_way_counts():
    tree = TransformTree()
    put(tree, "odom", "base", ((1, 0, 0), Rotation.identity()))
    put(tree, "odom_combined", "base", ((2, 0, 0), Rotation.identity()))
    assert tree.pose("odom", "base", 0)[0, 3] == 1 and tree.pose("odom_combined", "base", 0)[0, 3] == 2
    put(tree, "map", "odom_combined", ((5, 0, 0), Rotation.identity()))
    assert tree.pose("map", "base", 0)[0, 3] == 7
    put(tree, "map", "odom", ((5, 0, 0), Rotation.identity()))
    with pytest.raises(InputError, match=r"expected one chain from base to map, found several \(base in odom and in odom_combined\)"):
        tree.pose("map", "base", 0)


@pytest.mark.parametrize("place", [(np.nan, 0, 0), (1e300, 0, 0)])
def test_a_bad_place_counts_where_it_is_used(place):
    tree = TransformTree()
    put(tree, "map", "lidar", (place, Rotation.identity()))
    put(tree, "map", "base", ((0, 0, 0), Rotation.identity()))
    np.testing.assert_array_equal(tree.pose("map", "base", 0), np.eye(4))
    with pytest.raises(InputError, match="transform from lidar to map: expected a place in metres"):
        tree.pose("map", "lidar", 0)


class Unset(SimpleNamespace):
    """As drivers send it before they know."""

    def __init__(self):
        super().__init__(x=0.0, y=0.0, z=0.0, w=0.0)


def test_samples_that_were_never_set_are_left_out():
    track = PoseTrack("odometry")
    for stamp in (0, 5, 20):
        track.add(stamp, xyz((0, 0, 0)), Unset())
    track.add(10, xyz((1, 0, 0)), xyzw(Rotation.identity()))
    track.add(30, xyz((3, 0, 0)), xyzw(Rotation.identity()))
    with pytest.warns(UserWarning, match="odometry: 3 of 5 have a quaternion of zeros and are left out"):
        assert track.at(20)[0, 3] == 2
    assert track.at(5) is None and track.at(10)[0, 3] == 1


def test_no_sample_that_was_set():
    track = PoseTrack("odometry")
    track.add(0, xyz((0, 0, 0)), Unset())
    with pytest.raises(InputError, match="odometry: expected a place in metres and a unit quaternion"):
        track.at(0)


def test_few_samples_that_are_no_motion_are_left_out():
    track = PoseTrack("odometry")
    for stamp in (10, 20, 30):
        track.add(stamp, xyz((stamp, 0, 0)), xyzw(Rotation.identity()))
    track.add(24, xyz((np.nan, 0, 0)), xyzw(Rotation.identity()))
    track.add(26, xyz((0, 0, 0)), SimpleNamespace(x=0.0, y=0.0, z=0.0, w=0.5))
    with pytest.warns(UserWarning, match=r"odometry: 2 of 5 are left out; expected a place in metres and a unit quaternion, got \[nan"):
        assert track.at(25)[0, 3] == 25
    track.add(28, xyz((0, 0, np.inf)), xyzw(Rotation.identity()))
    with pytest.raises(InputError, match="odometry: expected a place in metres"):  # of six only half are left
        track.at(25)


@pytest.mark.parametrize(("z", "w"), [(0.71, 0.71), (0.0, 1.002)])
def test_quaternions_with_few_digits_are_made_unit_ones_as_tf2_does(z, w):
    track = PoseTrack("odometry")
    track.add(0, xyz((1, 2, 3)), SimpleNamespace(x=0.0, y=0.0, z=z, w=w))
    np.testing.assert_allclose(track.at(0)[:3, :3], Rotation.from_quat([0, 0, z, w]).as_matrix(), rtol=0, atol=1e-12)
