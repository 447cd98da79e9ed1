import warnings

import numpy as np
import pytest
from point_writers import POINTS, WRITERS, random_poses, write_drive, write_npz, write_pcd

from hilbertvae.checks import InputError
from hilbertvae.scans import scan_folder
from hilbertvae.scans.scan_folder import read_scan_folder

SCANS = POINTS.reshape(3, 20, 3)


@pytest.mark.parametrize("name", ["a.ply", "a.pcd", "a.las", "a.laz", "a.npz", "a.csv", "a.txt", "a.bin"])
def test_one_format_like_another(tmp_path, name):
    poses = random_poses(3)
    write_drive(tmp_path, SCANS, poses, "scan{}" + name[1:], WRITERS[name])
    scans = read_scan_folder(tmp_path, beam_origin=[0.1, 0.2, 0.3], max_range_m=1000)
    row = 0
    for number in range(3):
        for beam in range(20):
            turn, place = poses[number, :, :3], poses[number, :, 3]
            np.testing.assert_allclose(scans.points[row], turn @ SCANS[number, beam] + place, rtol=0, atol=0.002)
            np.testing.assert_allclose(scans.origins[row], turn @ [0.1, 0.2, 0.3] + place, rtol=0, atol=1e-12)
            assert (scans.scan[row], scans.beam[row]) == (number, beam)
            row += 1
    assert row == len(scans) and scans.points.dtype == np.float64 and scans.scan.dtype == scans.beam.dtype == np.int32


def test_names_are_sorted_by_their_numbers(tmp_path):
    poses = np.tile(np.eye(3, 4), (12, 1, 1))
    poses[:, 0, 3] = 1000.0 * np.arange(12)
    write_drive(tmp_path, np.full((12, 1, 3), 2.0), poses, "scan_{}.bin")
    (tmp_path / "times.txt").write_text("0\n")
    (tmp_path / ".hidden.bin").write_bytes(b"")
    np.testing.assert_array_equal(read_scan_folder(tmp_path).points[:, 0], 2.0 + 1000.0 * np.arange(12))
    second = read_scan_folder(tmp_path, every=5)
    np.testing.assert_array_equal(second.points[:, 0], [2.0, 5002.0, 10002.0])
    np.testing.assert_array_equal(second.scan, [0, 1, 2])


def test_a_files_own_origin_comes_first(tmp_path):
    pose = random_poses(1)
    write_drive(tmp_path, [POINTS], pose, "{}.pcd", lambda path, points: write_pcd(path, points, viewpoint=(1.0, 2, 3, 1, 0, 0, 0)))
    expected = pose[0, :, :3] @ [1, 2, 3] + pose[0, :, 3]
    with pytest.warns(UserWarning, match="1 scans say themselves where their beams started; reading.beam_origin is not used for them"):
        found = read_scan_folder(tmp_path, "hdl64")
    np.testing.assert_allclose(found.origins, np.broadcast_to(expected, POINTS.shape), rtol=0, atol=1e-12)


@pytest.mark.parametrize("poses", [2, 4])
def test_both_counts_are_named(tmp_path, poses):
    write_drive(tmp_path, SCANS, random_poses(poses))
    with pytest.raises(InputError, match=rf"poses.txt: expected a pose for each scan, got {poses} poses for 3 scans \(.*\)"):
        read_scan_folder(tmp_path)


def test_mixed_formats_none_and_no_folder(tmp_path):
    write_drive(tmp_path, SCANS, random_poses(3))
    write_npz(tmp_path / "more.npz")
    with pytest.raises(InputError, match="expected scans of one format .*, found 3 .bin, 1 .npz"):
        read_scan_folder(tmp_path)
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="empty: expected scans of one format .*, found none$"):
        read_scan_folder(tmp_path / "empty")
    for name, count in (("image_00/data", 1), ("velodyne_points/data", 2)):  # as KITTI's raw data lie
        (tmp_path / "empty" / name).mkdir(parents=True)
        for number in range(count):
            (tmp_path / "empty" / name / f"{number}.bin").touch()
    with pytest.raises(InputError, match="found none; in velodyne_points/data there are 2 .bin$"):
        read_scan_folder(tmp_path / "empty")
    with pytest.raises(InputError, match="nowhere: no such file; expected a folder of scans"):
        read_scan_folder(tmp_path / "nowhere")
    with pytest.raises(InputError, match="poses.txt: can't be read as a folder of scans"):
        read_scan_folder(tmp_path / "poses.txt")


def test_a_bad_scan_and_a_bad_pose_are_named(tmp_path):
    write_drive(tmp_path, SCANS, random_poses(3))
    whole = (tmp_path / "000001.bin").read_bytes()
    (tmp_path / "000001.bin").write_bytes(whole[:-1])
    with pytest.raises(InputError, match="000001.bin: truncated"):
        read_scan_folder(tmp_path)
    (tmp_path / "000001.bin").write_bytes(whole)
    lines = (tmp_path / "poses.txt").read_text().splitlines()
    (tmp_path / "poses.txt").write_text("\n".join([lines[0], "1 0 0 0 0 2 0 0 0 0 1 0", lines[2]]))
    with pytest.raises(InputError, match="poses.txt, line 2: expected a rigid motion"):
        read_scan_folder(tmp_path)


def test_files_that_are_not_one_scan(tmp_path):
    write_drive(tmp_path, [POINTS], random_poses(1), "{}.npz", write_npz)
    write_npz(tmp_path / "0.npz", scan=np.arange(len(POINTS)) % 2)
    with pytest.raises(InputError, match="0.npz: expected one scan, since"):
        read_scan_folder(tmp_path)


def test_planar_scans_stay_in_the_plane(tmp_path):
    """As a robot has them: two coordinates, and poses of x, y and heading."""
    headings, places = np.array([0.3, -2.0]), np.array([[1.0, 2.0], [-3.0, 0.5]])
    write_drive(tmp_path, [POINTS[:, :2], POINTS[:40, :2]], random_poses(2), "{}.npz", write_npz)
    (tmp_path / "poses.txt").write_text("".join(f"{x} {y} {turn}\n" for (x, y), turn in zip(places, headings, strict=True)))
    found = read_scan_folder(tmp_path)
    assert found.dimension == 2 and np.bincount(found.scan).tolist() == [len(POINTS), 40]
    for scan, (turn, place) in enumerate(zip(headings, places, strict=True)):
        cos, sin = np.cos(turn), np.sin(turn)
        expected = [[cos * x - sin * y + place[0], sin * x + cos * y + place[1]] for x, y in POINTS[: (len(POINTS), 40)[scan], :2]]
        np.testing.assert_allclose(found.points[found.scan == scan], expected, atol=1e-12)
        np.testing.assert_allclose(found.origins[found.scan == scan], np.broadcast_to(place, (len(expected), 2)), atol=1e-12)


def test_planar_scans_that_make_no_plan(tmp_path):
    write_drive(tmp_path, [POINTS[:, :2]], random_poses(1), "{}.npz", write_npz)
    (tmp_path / "poses.txt").write_text("1 0 0 0 0 0 -1 0 0 1 0 0\n")
    with pytest.raises(InputError, match="pose 1: expected less than 15 degrees of tilt"):
        read_scan_folder(tmp_path)
    with pytest.raises(InputError, match="0.npz: expected 3D points to find poses from, got 2D ones"):
        read_scan_folder(tmp_path, poses="kiss_icp")
    write_drive(tmp_path, [POINTS[:, :2], POINTS], random_poses(2), "{}.npz", write_npz)
    (tmp_path / "poses.txt").write_text("0 0 0\n0 0 0\n")
    with pytest.raises(InputError, match="1.npz: expected 2D points as in 0.npz, got 3D ones"):
        read_scan_folder(tmp_path)
    write_drive(tmp_path, [POINTS[:0], POINTS[:, :2], POINTS], random_poses(3), "{}.npz", write_npz)
    (tmp_path / "poses.txt").write_text("0 0 0\n" * 3)
    with pytest.raises(InputError, match="2.npz: expected 2D points as in 1.npz, got 3D ones"):  # the first scan has none
        read_scan_folder(tmp_path)


def test_nothing_within_range(tmp_path):
    write_drive(tmp_path, SCANS, random_poses(3))
    with pytest.raises(InputError, match="expected beams of 0.0 to 0.1 m, found none in 3 scans"):
        read_scan_folder(tmp_path, max_range_m=0.1)


def test_no_return_is_at_no_place(tmp_path):
    """Drivers write (0, 0, 0): with beams that start elsewhere that is 0.2 m away, and would be an obstacle on the sensor."""
    clouds = np.array([[[0.0, 0, 0], [3, 0, 0], [0, 4, 0]]])
    write_drive(tmp_path, clouds, random_poses(1), "{}.bin")
    np.testing.assert_array_equal(read_scan_folder(tmp_path, beam_origin=[0.0, 0.0, 0.2]).beam, [1, 2])


def test_a_scan_without_returns_is_left_out(tmp_path):
    poses = np.tile(np.eye(3, 4), (3, 1, 1))
    poses[:, 0, 3] = [0, 10, 20]
    write_drive(tmp_path, np.full((3, 1, 3), 2.0), poses, "{}.bin")
    (tmp_path / "1.bin").write_bytes(np.full(4, np.nan, np.float32).tobytes())
    with pytest.warns(UserWarning, match="1 of 3 scans have no return"):
        scans = read_scan_folder(tmp_path)
    np.testing.assert_array_equal(scans.points[:, 0], [2, 22])
    np.testing.assert_array_equal(scans.scan, [0, 1])


def test_points_at_zero_are_no_returns_under_a_files_own_origin(tmp_path):
    """Several of them; a single one may be a true place, which it is not where the beams start there."""
    clouds = np.stack([POINTS, POINTS])
    clouds[0, [4, 9]] = clouds[1, 7] = 0
    viewed = (1.0, 2, 3, 1, 0, 0, 0)
    write_drive(tmp_path, clouds, random_poses(2), "{}.pcd", lambda path, points: write_pcd(path, points, viewpoint=viewed))
    found = read_scan_folder(tmp_path)
    assert set(range(60)) - set(found.beam[found.scan == 0].tolist()) == {4, 9}
    assert found.beam[found.scan == 1].tolist() == list(range(60))
    write_drive(tmp_path / "plain", clouds, random_poses(2), "{}.pcd", write_pcd)
    found = read_scan_folder(tmp_path / "plain", beam_origin=[0, 0, 0.5])
    assert np.bincount(found.scan).tolist() == [58, 59]


@pytest.mark.parametrize("poses", [None, "kiss_icp"])
@pytest.mark.parametrize("name", ["1.bin", "1.xyz"])
def test_a_scan_of_no_bytes_is_left_out(tmp_path, monkeypatch, name, poses):
    write_drive(tmp_path, np.full((3, 1, 3), 2.0), np.tile(np.eye(3, 4), (3, 1, 1)), "{}.bin")
    (tmp_path / "1.bin").unlink()
    (tmp_path / name).touch()
    if name.endswith("xyz"):
        for scan in (0, 2):
            (tmp_path / f"{scan}.bin").unlink()
            (tmp_path / f"{scan}.xyz").write_text("2 2 2\n")
    monkeypatch.setattr(scan_folder.KissOdometry, "register", lambda self, points: np.eye(3, 4))
    with pytest.warns(UserWarning, match="1 of 3 scans have no return"):
        scans = read_scan_folder(tmp_path, poses=poses)
    np.testing.assert_array_equal(scans.scan, [0, 1])


@pytest.mark.parametrize("text", ["x,y,z\n", "# of no return\n", "x,y,z\n,,\n"])
def test_a_table_of_no_rows_is_a_scan_without_returns(tmp_path, text):
    write_drive(tmp_path, np.full((3, 1, 3), 2.0), np.tile(np.eye(3, 4), (3, 1, 1)), "{}.csv", WRITERS["a.csv"])
    (tmp_path / "1.csv").write_text(text)
    with pytest.warns(UserWarning, match="1 of 3 scans have no return"):
        scans = read_scan_folder(tmp_path)
    np.testing.assert_array_equal(scans.scan, [0, 1])


def test_times_of_several_lengths_are_in_order(tmp_path):
    times = [1305031102.1753, 1305031102.175804, 1305031102.2, 1305031102.25, 1305031102.300001, 1305031103.0]
    poses = np.tile(np.eye(3, 4), (len(times), 1, 1))
    poses[:, 0, 3] = 1000.0 * np.arange(len(times))
    write_drive(tmp_path, np.full((len(times), 1, 3), 2.0), poses, "{}.csv", WRITERS["a.csv"])
    for number, time in enumerate(times):
        (tmp_path / f"{number}.csv").rename(tmp_path / f"{time}.csv")
    with pytest.warns(UserWarning, match="are read as decimals"):  # with few names it is not sure
        scans = read_scan_folder(tmp_path)
    np.testing.assert_allclose(scans.points[:, 0], 2.0 + 1000.0 * np.arange(len(times)))


@pytest.mark.parametrize(
    ("head", "poses", "told"),
    [
        ("", "0 0 0.1\n1 0 0.2\n", True),
        ("", "0 0 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n", True),
        ("x,y,intensity\n", "0 0 0.1\n1 0 0.2\n", False),
        ("# x,y,z\n", "0 0 0.1\n1 0 0.2\n", False),
        ("", "0 0 0 0 0 0 0 1\n1 1 0 0.5 0 0 0 1\n", False),
        ("", "0 0 0\n0 0 0\n", False),
    ],
)
def test_a_third_column_without_a_name_is_told_under_poses_in_the_plane(tmp_path, head, poses, told):
    """It may be an intensity. Clouds that stand in the map's frame already, and poses that climb, are 3D."""
    for number in range(2):
        (tmp_path / f"{number}.csv").write_text(head + "1.5,2,1.2\n2,1,0.9\n1,3,nan\n")
    (tmp_path / "poses.txt").write_text(poses)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        read_scan_folder(tmp_path, max_range_m=1000)
    said = f"{tmp_path / '0.csv'}: its columns have no names, so the first three are taken as x, y and z"
    assert [str(one.message).startswith(said) for one in caught] == [True] * told


def test_a_third_column_of_one_value_is_no_intensity(tmp_path):
    (tmp_path / "0.csv").write_text("1.5,2,0\n2,1,0\n")
    (tmp_path / "poses.txt").write_text("0 0 0.1\n")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read_scan_folder(tmp_path)


@pytest.mark.parametrize("given", ["velodyne", "."])
def test_the_inner_folder_of_kitti_s_layout_names_the_outer_one(tmp_path, monkeypatch, given):
    write_drive(tmp_path, SCANS, random_poses(3), "velodyne/{:06d}.bin")
    monkeypatch.chdir(tmp_path / "velodyne" if given == "." else tmp_path)
    with pytest.raises(InputError, match=f"poses.txt: no such file, but .* to read KITTI's layout, give {tmp_path}$"):
        read_scan_folder(given)
    (tmp_path / "poses.txt").unlink()
    with pytest.raises(InputError, match="poses.txt: no such file; expected a pose for each of 3 scans.*kiss_icp"):
        read_scan_folder(given)
