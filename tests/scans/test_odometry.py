import sys
import warnings

import numpy as np
import pytest
from bag_writers import bag
from point_writers import write_drive, write_npz, write_pcd, write_velodyne
from scipy.spatial.transform import Rotation

from hilbertvae.checks import InputError
from hilbertvae.scans.formats import ReadingSettings, read_scans_path
from hilbertvae.scans.odometry import BAD_FIT, KissOdometry, in_the_plane, stands

pytest.importorskip("kiss_icp")
KISS = ReadingSettings(poses="kiss_icp")


def street(step_m, seed, scans):
    """Scans (n, 3) of a simulated street, each in its sensor's frame, and their true poses (S, 3, 4) in that of the first.

    The sensor turns by 3 degrees from scan to scan, so that there is more to find than a line.
    """
    for module in ("shapely", "trimesh", "embreex"):
        pytest.importorskip(module)
    from hilbertvae.simulate.street import StreetSettings, simulate_street

    settings = StreetSettings(
        character="residential", sensor="hdl64", azimuths=600, scans=10, single_scan_share=0.0, shortest_step_m=step_m,
        longest_step_m=step_m, pose_noise_m=0.0, heading_noise_deg=0.0, traffic=False,
    )  # fmt: skip
    found = simulate_street(settings, seed)
    clouds, poses = [], np.empty((scans, 3, 4))
    first = np.median(found.origins[found.scan == 0], axis=0)
    for number, pose in enumerate(poses):
        angle, mine = np.deg2rad(3.0 * number), found.scan == number
        pose[:, :3] = [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
        pose[:, 3] = np.median(found.origins[mine], axis=0) - first
        clouds.append((found.points[mine] - first - pose[:, 3]) @ pose[:, :3])
    return clouds, poses


@pytest.fixture(scope="module")
def drive():
    return street(1.0, seed=24, scans=6)


@pytest.fixture(scope="module")
def short_drive(drive):
    """Of a third of the beams, where it matters how scans reach the odometry and not how well it does."""
    return [cloud[::3] for cloud in drive[0][:3]], drive[1][:3]


def test_a_drive_is_found_to_centimetres(drive):
    clouds, poses = drive
    odometry = KissOdometry()
    found = np.array([odometry.register(cloud) for cloud in clouds])
    np.testing.assert_array_equal(found[0], np.eye(3, 4))
    assert np.linalg.norm(poses[-1, :, 3]) > 4.9
    assert np.linalg.norm(found[:, :, 3] - poses[:, :, 3], axis=1).max() < 0.1
    cosine = (np.trace(np.swapaxes(found[:, :, :3], 1, 2) @ poses[:, :, :3], axis1=1, axis2=2) - 1) / 2
    assert np.rad2deg(np.arccos(np.minimum(cosine, 1))).max() < 0.3
    assert len(odometry.fits) == 5 and max(odometry.fits) < BAD_FIT
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        odometry.warn("drive")
    again = KissOdometry()
    np.testing.assert_array_equal(found[:3], [again.register(cloud) for cloud in clouds[:3]])  # to the bit


def test_a_first_motion_is_not_taken_for_standing_still():
    """This street fits the scan before it with 0.53 where nothing moved, and with 0.43 where it did."""
    clouds, poses = street(1.0, seed=76, scans=3)
    odometry = KissOdometry()
    found = np.array([odometry.register(cloud) for cloud in clouds])
    assert np.linalg.norm(found[:, :, 3] - poses[:, :, 3], axis=1).max() < 0.1


def test_scans_far_apart_are_found_too(monkeypatch):
    """4 m from scan to scan: from a standing start alone KISS-ICP stays where it was."""
    clouds, poses = street(4.0, seed=11, scans=3)

    def farthest_off():
        odometry = KissOdometry()
        return max(np.linalg.norm(odometry.register(cloud) - pose) for cloud, pose in zip(clouds, poses, strict=True))

    assert farthest_off() < 0.15
    monkeypatch.setattr("hilbertvae.scans.odometry.STARTS", ((0, 0),))
    assert farthest_off() > 3


def test_scans_of_several_places_give_a_warning(drive):
    rng = np.random.default_rng(0)
    odometry = KissOdometry()
    for _ in range(3):
        odometry.register(rng.uniform(-20, 20, (2000, 3)))
    with pytest.warns(UserWarning, match=r"somewhere: poses=kiss_icp: 2 of 3 scans hardly fit the one before, scan 1 first"):
        odometry.warn("somewhere")


def test_a_scan_without_points_changes_nothing(short_drive):
    clouds, _ = short_drive
    one, other = KissOdometry(), KissOdometry()
    np.testing.assert_array_equal(other.register(np.empty((0, 3))), np.eye(3, 4))
    for cloud in clouds[:2]:
        expected = one.register(cloud)
        np.testing.assert_array_equal(other.register(cloud), expected)
        np.testing.assert_array_equal(other.register(np.empty((0, 3))), expected)


FOLDERS = {"kitti": ("velodyne/{:06d}.bin", write_velodyne), "pcd": ("{}.pcd", write_pcd), "npz": ("scan{}.npz", write_npz)}


@pytest.mark.parametrize("kind", FOLDERS)
def test_folders_without_poses(tmp_path, short_drive, kind):
    clouds, poses = short_drive
    name, write = FOLDERS[kind]
    write_drive(tmp_path, clouds, poses, name, write)
    expected = read_scans_path(tmp_path)
    (tmp_path / "poses.txt").unlink()
    with pytest.raises(InputError, match=r"poses.txt: no such file; expected a pose for each of 3 scans.*poses=kiss_icp"):
        read_scans_path(tmp_path)
    found = read_scans_path(tmp_path, KISS)
    np.testing.assert_array_equal(found.scan, expected.scan)
    np.testing.assert_array_equal(found.beam, expected.beam)
    assert np.median(np.linalg.norm(found.points - expected.points, axis=1)) < 0.1
    assert np.linalg.norm(found.origins - expected.origins, axis=1).max() < 0.1
    second = read_scans_path(tmp_path, ReadingSettings(poses="kiss_icp", every=2))  # the scan between still leads the way
    np.testing.assert_array_equal(second.points, found.points[found.scan != 1])


def test_clouds_of_a_bag(tmp_path, short_drive):
    pytest.importorskip("rosbags")
    clouds, poses = short_drive
    with bag(tmp_path / "a.bag") as made:
        for number in range(3):
            made.cloud("/points", number, "lidar", clouds[number])
    found = read_scans_path(tmp_path / "a.bag", KISS)
    for number in range(3):
        np.testing.assert_allclose(found.origins[found.scan == number][0], poses[number, :, 3], atol=0.1)
    with pytest.raises(InputError, match="reading.fixed_frame: with reading.poses=kiss_icp"):
        read_scans_path(tmp_path / "a.bag", ReadingSettings(poses="kiss_icp", fixed_frame="map"))
    second = read_scans_path(tmp_path / "a.bag", ReadingSettings(poses="kiss_icp", every=2))
    np.testing.assert_array_equal(second.points, found.points[found.scan != 1])


def test_bad_choices_and_a_missing_extra(tmp_path, drive, monkeypatch):
    write_drive(tmp_path, drive[0][:2], drive[1][:2])
    with pytest.raises(InputError, match="reading.poses: expected kiss_icp or nothing, got 'icp'"):
        read_scans_path(tmp_path, ReadingSettings(poses="icp"))
    monkeypatch.setitem(sys.modules, "kiss_icp.config", None)
    with pytest.raises(InputError, match=r"needs Python below 3.14 and the extra 'poses', .*pip install 'hilbertvae\[poses\]'"):
        read_scans_path(tmp_path, KISS)


FLOOR_M, CEILING_M = -1.5, 1.5
WALLS = [
    ((8, -6), (8.4, 6)),
    ((-9, -6), (-8.6, 6)),
    ((-9, 6), (8.4, 6.4)),
    ((-9, -6.4), (8.4, -6)),
    ((3, -3), (4, -2)),
    ((-4, 2), (-3.2, 3)),
]


def room(place, rings, rng, ceiling):
    """(N, 3), what a spinning lidar at `place (2,)` sees, from there: walls and pillars up to a ceiling, above a floor that has none."""
    around, up = np.meshgrid(np.linspace(-np.pi, np.pi, 512, endpoint=False), np.deg2rad(np.linspace(-30, 20, rings)))
    beams = np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], axis=-1).reshape(-1, 3)
    with np.errstate(divide="ignore"):
        length = np.where(beams[:, 2] > 0, CEILING_M if ceiling else np.inf, FLOOR_M) / beams[:, 2]
        for low, high in WALLS:
            sides = np.sort([(np.array(corner) - place) / beams[:, :2] for corner in (low, high)], axis=0)
            near, far = sides[0].max(axis=1), sides[1].min(axis=1)
            length = np.where((near < far) & (near > 0) & (near * beams[:, 2] < CEILING_M), np.minimum(length, near), length)
    seen = length < 40
    return beams[seen] * (length[seen] + rng.normal(0, 0.02, np.count_nonzero(seen)))[:, None]


@pytest.mark.parametrize("ceiling", [True, False])
def test_rings_on_a_floor_do_not_hold_the_sensor(ceiling):
    """They lie as they lay wherever it goes: by all points, these motions are found 0.2 to 1 m too short, with fits of 0.4 to 0.5."""
    rng, odometry = np.random.default_rng(0), KissOdometry()
    places = np.array([-4.0, -2.0]) + np.arange(4)[:, None] * [0.3, 0.1]
    found = np.array([odometry.register(room(place, 24, rng, ceiling)) for place in places])
    assert np.linalg.norm(found[:, :2, 3] - (places - places[0]), axis=1).max() < 0.08
    assert np.abs(found[:, 2, 3]).max() < 0.05 and max(odometry.fits) < 0.5


def test_what_stands_is_more_than_a_floor_and_a_ceiling():
    column = np.array([[0.1, 0.2], [0.3, 0.1], [0.2, 0.4]])
    floor, ceiling = np.c_[column, [-0.02, 0.0, 0.01]], np.c_[column, [2.0, 2.02, 1.98]]
    wall = np.c_[column, [0.5, 1.0, 1.5]] + [5, 0, 0]
    slope = np.c_[column, column[:, 0] * 0.3] + [9, 9, 0]
    points = np.concatenate([floor, ceiling, wall, wall - [0, 0, 1.0], slope])
    assert stands(points).tolist() == [False] * 6 + [True] * 6 + [False] * 3


def test_motions_are_put_together_by_their_axes():
    turns = Rotation.from_euler("ZYX", [[0.3, 0.02, -0.01], [-0.2, -0.04, 0.05]])
    first, second = (np.eye(4) for _ in range(2))
    first[:3, :3], second[:3, :3] = turns.as_matrix()
    first[:3, 3], second[:3, 3] = [1, 2, 3], [4, 5, 6]
    found = in_the_plane(first, second)
    np.testing.assert_allclose(found[:3, 3], [1, 2, 6])
    np.testing.assert_allclose(Rotation.from_matrix(found[:3, :3]).as_euler("ZYX"), [0.3, -0.04, 0.05], atol=1e-12)
    np.testing.assert_allclose(in_the_plane(first, first), first, atol=1e-15)
