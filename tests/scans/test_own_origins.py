import numpy as np
import pytest
from point_writers import POINTS, write_drive, write_e57, write_npz, write_pcd

from hilbertvae.checks import InputError
from hilbertvae.scans import scan_folder
from hilbertvae.scans.scan_folder import read_scan_folder

SCANS = POINTS.reshape(3, 20, 3)

MOVING = np.tile(np.eye(3, 4), (3, 1, 1))
MOVING[:, :, 3] = np.arange(3)[:, None] * [3.0, 1.0, 0.0]


def write_viewpoints(folder, places):
    places = iter(places)
    write_drive(folder, SCANS, MOVING, "{}.pcd", lambda path, points: write_pcd(path, points, viewpoint=(*next(places), 1, 0, 0, 0)))


@pytest.fixture
def odometry(monkeypatch):
    """Finds `MOVING`, whatever it sees."""
    found = iter(MOVING)
    monkeypatch.setattr(scan_folder.KissOdometry, "register", lambda self, points: next(found))


def test_an_origin_that_is_the_poses_place_is_one_in_the_map(tmp_path):
    """ROS's `pointcloud_to_pcd` leaves points in the sensor's frame and says where that is in a fixed one."""
    write_viewpoints(tmp_path, MOVING[:, :, 3])
    with pytest.warns(UserWarning, match="2 scans say that they were taken where poses.txt places them"):
        scans = read_scan_folder(tmp_path)
    np.testing.assert_allclose(scans.origins, MOVING[scans.scan, :, 3], rtol=0, atol=1e-12)


def test_an_origin_that_moves_is_none_in_the_frame_that_moves_with_it(tmp_path, odometry):
    write_viewpoints(tmp_path, MOVING[:, :, 3])
    with pytest.warns(UserWarning, match="taken at different places; so those are none in the sensor's own frame"):
        scans = read_scan_folder(tmp_path, poses="kiss_icp")
    np.testing.assert_allclose(scans.origins, MOVING[scans.scan, :, 3], rtol=0, atol=1e-12)


def test_an_origin_that_stays_counts_beside_poses_that_are_found(tmp_path, odometry, recwarn):
    write_viewpoints(tmp_path, [(0.1, 0.2, 0.3)] * 3)
    scans = read_scan_folder(tmp_path, poses="kiss_icp")
    np.testing.assert_allclose(scans.origins, MOVING[scans.scan, :, 3] + [0.1, 0.2, 0.3], rtol=0, atol=1e-12)
    assert not recwarn.list


@pytest.mark.parametrize("place", [(3.0, 1.0, 0.5), (0.0, 0.0, 0.0)])
def test_stations_that_are_in_the_map_already_are_not_moved_again(tmp_path, place):
    pose = np.column_stack([[[0.0, -1, 0], [1, 0, 0], [0, 0, 1]], place])
    quaternion = (np.sqrt(0.5), 0, 0, np.sqrt(0.5))
    write_drive(tmp_path, SCANS[:1], [pose], "{}.e57", lambda path, points: write_e57(path, (points, quaternion, place)))
    with pytest.warns(UserWarning, match="1 scans are where poses.txt would place them; so they are taken as they are"):
        scans = read_scan_folder(tmp_path)
    np.testing.assert_allclose(scans.points, SCANS[0] @ pose[:, :3].T + place, rtol=0, atol=1e-5)
    np.testing.assert_allclose(scans.origins, np.broadcast_to(place, (20, 3)), rtol=0, atol=1e-12)
    pose[:, 3] += 7  # of the scanner's frame, then
    write_drive(tmp_path, [], [pose])
    np.testing.assert_allclose(read_scan_folder(tmp_path).origins, np.broadcast_to(pose[:, :3] @ place + pose[:, 3], (20, 3)), atol=1e-12)


QUARTER = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
DRIFT = np.array([[0.0, 0, 0], [0.1, 0.1, 0], [0.2, -0.2, 0]])


@pytest.mark.parametrize("turn", [np.eye(3), QUARTER])
def test_an_origin_that_drifts_from_the_poses_is_one_in_the_map(tmp_path, turn):
    """VIEWPOINTs of odometry, beside poses of a SLAM, whose frames may be turned to each other."""
    write_viewpoints(tmp_path, MOVING[:, :, 3] @ turn.T + DRIFT)
    far = np.linalg.norm(MOVING[:, :, 3] @ (turn.T - np.eye(3)) + DRIFT, axis=1).max()
    said = f"2 scans say that they were taken up to {far:.3g} m from where poses.txt places them, and move as its poses do; so that is no"
    with pytest.warns(UserWarning, match=said):
        scans = read_scan_folder(tmp_path)
    np.testing.assert_allclose(scans.origins, MOVING[scans.scan, :, 3], rtol=0, atol=1e-12)


def test_an_origin_for_each_beam_that_is_the_poses_place_is_one_in_the_map(tmp_path):
    places = iter(MOVING[:, :, 3] + DRIFT)
    write_drive(tmp_path, SCANS, MOVING, "{}.npz", lambda path, points: write_npz(path, points, origins=np.tile(next(places), (20, 1))))
    with pytest.warns(UserWarning, match="3 scans say that they were taken up to 0.283 m from where"):
        scans = read_scan_folder(tmp_path)
    np.testing.assert_allclose(scans.origins, MOVING[scans.scan, :, 3], rtol=0, atol=1e-12)


@pytest.mark.parametrize("places", [[(3.0, 1.0, 0.0)] * 3, [(0.1, 0.2, 0.3), (0.1, 0.2, 0.4), (0.1, 0.3, 0.3)]])
def test_an_origin_that_does_not_move_with_the_poses_is_the_sensors(tmp_path, places, recwarn):
    """A place that stays, although the second pose is there, and one of a sensor that tilts."""
    write_viewpoints(tmp_path, places)
    scans = read_scan_folder(tmp_path)
    np.testing.assert_allclose(scans.origins, MOVING[scans.scan, :, 3] + np.array(places)[scans.scan], rtol=0, atol=1e-12)
    assert not recwarn.list


def test_stations_whose_poses_were_refined_are_placed_by_those(tmp_path):
    """A survey's own poses in the files, in `poses.txt` those that were made from them: 3 cm beside, and turned by a few milliradians."""
    own, poses = np.tile(np.eye(3, 4), (2, 3, 1, 1))
    own[:, :, :3], own[:, :, 3] = QUARTER, [[1.0, 2, 0], [5, 2, 0], [9, 3, 0]]
    cos, sin = np.cos(0.003), np.sin(0.003)
    poses[:, :, :3] = [[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]] @ QUARTER
    poses[:, :, 3] = own[:, :, 3] + [0.03, 0, 0]
    places = iter(own[:, :, 3])
    write_drive(
        tmp_path, SCANS, poses, "{}.e57", lambda path, points: write_e57(path, (points, (np.sqrt(0.5), 0, 0, np.sqrt(0.5)), next(places)))
    )
    with pytest.warns(UserWarning, match="3 scans are up to 0.03 m from where poses.txt places them; so its poses are taken, not theirs"):
        scans = read_scan_folder(tmp_path)
    for number in range(3):
        chosen = scans.scan == number
        turn, place = poses[number, :, :3], poses[number, :, 3]
        np.testing.assert_allclose(scans.points[chosen], SCANS[number] @ turn.T + place, rtol=0, atol=1e-5)
        np.testing.assert_allclose(scans.origins[chosen], np.tile(place, (20, 1)), rtol=0, atol=1e-9)


def write_stations(folder, places):
    """E57 files of one scan each, turned by a quarter; no place is no pose. There is no `poses.txt`."""
    for number, place in enumerate(places):
        write_e57(folder / f"{number}.e57", (SCANS[number], None if place is None else (np.sqrt(0.5), 0, 0, np.sqrt(0.5)), place))


@pytest.mark.parametrize("first", [(1.0, 2.0, 0.5), None])
def test_stations_without_a_file_of_poses_are_where_they_say(tmp_path, recwarn, first):
    """One may be in the frame of the others."""
    places = [first, (5.0, 2.0, 0.0), (9.0, 3.0, 0.0)]
    write_stations(tmp_path, places)
    scans = read_scan_folder(tmp_path, every=2)
    for number in (0, 2):
        turn, place = (np.eye(3), np.zeros(3)) if places[number] is None else (QUARTER, places[number])
        chosen = scans.scan == number // 2
        np.testing.assert_allclose(scans.points[chosen], SCANS[number] @ turn.T + place, rtol=0, atol=1e-5)
        np.testing.assert_allclose(scans.origins[chosen], np.tile(place, (20, 1)), rtol=0, atol=1e-9)
    assert not recwarn.list


@pytest.mark.parametrize(("places", "named"), [([None, (5.0, 2.0, 0.0), None], "0.e57 and 2.e57"), ([None], "0.e57")])
def test_stations_of_which_several_say_nothing_are_refused(tmp_path, places, named):
    write_stations(tmp_path, places)
    said = f"poses.txt: no such file; expected a pose for each of {len(places)} scans, .* of the others; no pose is in {named}$"
    with pytest.raises(InputError, match=said):
        read_scan_folder(tmp_path)
