import math
import re
import warnings
from pathlib import Path

import numpy as np
import pytest
from point_writers import POINTS, random_poses, write_drive, write_npz

from hilbertvae.checks import InputError
from hilbertvae.scans.formats import read_scans_path
from hilbertvae.scans.kitti import is_kitti, read_kitti

SCANS, NAME = POINTS.reshape(3, 20, 3), "velodyne/{:06d}.bin"


@pytest.mark.parametrize(("beam_origin", "heights"), [("centre", (0.0, 0.0)), ("hdl64", (0.20, 0.12)), ([0.0, 0.0, 1.5], (1.5, 1.5))])
@pytest.mark.parametrize("every", [1, 2])
def test_a_drive_one_return_at_a_time(tmp_path, beam_origin, heights, every):
    poses = random_poses(3)
    scans = read_kitti(write_drive(tmp_path, SCANS, poses, NAME), beam_origin, max_range_m=40.0, min_range_m=12.0, every=every)
    row = 0
    for number, index in enumerate(range(0, 3, every)):
        for beam, (x, y, z) in enumerate(SCANS[index].tolist()):
            above = math.degrees(math.atan2(z, math.hypot(x, y))) > -8.3
            origin = [0, 0, heights[0] if above else heights[1]]
            if not 12.0 < math.dist((x, y, z), origin) < 40.0:
                continue
            turn, place = poses[index, :, :3], poses[index, :, 3]
            np.testing.assert_allclose(scans.points[row], turn @ [x, y, z] + place, rtol=0, atol=1e-9)
            np.testing.assert_allclose(scans.origins[row], turn @ origin + place, rtol=0, atol=1e-9)
            assert (scans.scan[row], scans.beam[row]) == (number, beam)
            row += 1
    assert 0 < row == len(scans) < 60


def test_poses_of_a_camera_are_turned_into_the_lidar_s(tmp_path):
    """A camera looks along z with y down, and stands 0.3 m ahead of the lidar: 5 m along its z is 5 m ahead for the lidar."""
    ahead = np.eye(3, 4)
    ahead[2, 3] = 5.0
    turn = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
    calibration = np.column_stack([turn, turn @ [-0.3, 0, 0]])
    write_drive(tmp_path, [[[10.0, 2, -1.7]]] * 2, [np.eye(3, 4), ahead], NAME)
    (tmp_path / "calib.txt").write_text("P0: " + " ".join(["1"] * 12) + "\nTr: " + " ".join(map(str, calibration.ravel())) + "\n")
    scans = read_kitti(tmp_path)
    np.testing.assert_allclose(scans.points, [[10, 2, -1.7], [15, 2, -1.7]], atol=1e-6)
    np.testing.assert_allclose(scans.origins, [[0, 0, 0], [5, 0, 0]], atol=1e-6)


def test_poses_where_kitti_s_odometry_has_them(tmp_path, monkeypatch):
    """They are the camera's, so nothing is read without a calibration; a file of the drive's own comes first."""
    poses = around_a_corner(2.0, camera=True)[:3]
    drive = write_drive(tmp_path / "sequences" / "07", SCANS, poses, NAME)
    own, apart, calibration = drive / "poses.txt", tmp_path / "poses" / "07.txt", drive / "calib.txt"
    calibration.write_text("Tr: 0 -1 0 0 0 0 -1 0 1 0 0 0\n")
    expected = read_kitti(drive).points
    apart.parent.mkdir()
    own.rename(apart)
    np.testing.assert_array_equal(read_kitti(drive).points, expected)
    monkeypatch.chdir(drive)
    np.testing.assert_array_equal(read_kitti(".").points, expected)
    with pytest.raises(InputError, match=r"poses.txt: no such file, but there is .*poses.07.txt: to read KITTI's layout, give .*07$"):
        read_scans_path(drive / "velodyne")
    with pytest.raises(InputError, match=r"found none; in sequences.07.velodyne there are 3 .bin"):
        read_scans_path(tmp_path)
    calibration.rename(drive / "away.txt")
    told = (
        r"poses.07.txt: these are poses of KITTI's camera, for which .*calib.txt is expected to have a line Tr:, and there is no such file"
    )
    with pytest.raises(InputError, match=told):
        read_kitti(drive)
    np.savetxt(own, np.tile(np.eye(3, 4).ravel(), (3, 1)))
    np.testing.assert_array_equal(read_kitti(drive).points, SCANS[np.linalg.norm(SCANS, axis=2) > 2.5])


def around_a_corner(step_m, camera):
    """Poses of a car that goes ten steps, turns left and goes ten more; x ahead, or z for a camera."""
    poses = np.tile(np.eye(4), (20, 1, 1))
    for number in range(1, 20):
        turn = math.pi / 2 if number == 10 else 0.0
        cos, sin = math.cos(turn), math.sin(turn)
        poses[number] = poses[number - 1] @ [[cos, -sin, 0, step_m], [sin, cos, 0, 0], [0, 0, 1, 0.05 * step_m], [0, 0, 0, 1]]
    axes = np.eye(4)
    axes[:3, :3] = [[0, -1, 0], [0, 0, -1], [1, 0, 0]]
    return (axes @ poses @ axes.T if camera else poses)[:, :3]


@pytest.mark.parametrize(("step_m", "camera", "warned"), [(2.0, True, True), (2.0, False, False), (0.1, True, False)])
def test_a_camera_s_poses_without_a_calibration_are_told(tmp_path, step_m, camera, warned):
    write_drive(tmp_path, [[[10.0, 2, -1.7]]] * 20, around_a_corner(step_m, camera), NAME)
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        read_kitti(tmp_path)
    message = r"poses.txt: poses go up rather than ahead: are they the camera's\? Put KITTI's calib.txt beside them"
    assert [bool(re.search(message, str(each.message))) for each in found] == [True] * warned
    (tmp_path / "calib.txt").write_text("Tr: 0 -1 0 0 0 0 -1 0 1 0 0 0\n")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read_kitti(tmp_path)


def test_what_there_is_to_say_of_poses_is_said_once(tmp_path):
    write_drive(tmp_path, [[[10.0, 2, -1.7]]] * 3, random_poses(3), NAME)
    times = (3.0, 2.0, 1.0)
    (tmp_path / "poses.txt").write_text("".join(f"{time} {k} 0 0 0 0 0 1\n" for k, time in enumerate(times)))  # TUM's format
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        read_kitti(tmp_path)
    said = [str(each.message) for each in found]
    assert said and len(said) == len(set(said))


@pytest.mark.parametrize("line", ["Tr: 1 2 3", "Tr: " + "x " * 12, "Tr: " + "2 " * 12])
def test_a_calibration_that_is_none(tmp_path, line):
    write_drive(tmp_path, SCANS, random_poses(3), NAME)
    (tmp_path / "calib.txt").write_text(f"P0: 1\n{line}\n")
    with pytest.raises(InputError, match="calib.txt, line 2: expected"):
        read_kitti(tmp_path)


def test_the_car_is_left_out(tmp_path):
    write_drive(tmp_path, [[[1.0, 1, 1], [2.0, 2, 2]]], [np.eye(3, 4)], NAME)
    np.testing.assert_array_equal(read_kitti(tmp_path).points, [[2, 2, 2]])


def test_other_layouts(tmp_path):
    with pytest.raises(InputError, match="expected KITTI's layout"):
        read_kitti(tmp_path)
    write_drive(tmp_path, SCANS, random_poses(3), "velodyne/{}.npz", write_npz)
    assert is_kitti(tmp_path)
    with pytest.raises(InputError, match="velodyne: expected .bin scans, found .npz"):
        read_kitti(tmp_path)


def test_a_drive_without_poses(tmp_path):
    write_drive(tmp_path, SCANS, random_poses(3), NAME)
    (tmp_path / "poses.txt").unlink()
    with pytest.raises(InputError, match="poses.txt: no such file"):
        read_kitti(tmp_path)


@pytest.fixture(scope="module")
def drive0005(real_data) -> Path:
    folder = real_data / "3d" / "kitti_drive0005"
    if not folder.is_dir():
        pytest.skip("kitti_drive0005 is not here; set HILBERTVAE_DATA to a folder that has it")
    return folder


def test_a_real_drive(drive0005):
    scans = read_kitti(drive0005, beam_origin="hdl64", every=4)
    assert scans.scan.max() == 4 and scans.dimension == 3
    assert (np.bincount(scans.scan) > 100_000).all()
    centre = read_kitti(drive0005, every=4)
    lift = np.sqrt(np.square(scans.origins.mean(axis=0) - centre.origins.mean(axis=0)).sum())
    assert 0.12 < lift < 0.20
    # Scans of a fixed place overlap: most returns of the last lie within half a metre of one of the first, so the poses are taken right.
    first, last = (set(map(tuple, np.floor(scans.points[scans.scan == number] / 0.5).astype(int).tolist())) for number in (0, 1))
    assert len(first & last) > 0.3 * len(last)


def test_a_calibration_without_the_lidar_s_line_is_told(tmp_path):
    """Then nothing says whether poses are the camera's."""
    write_drive(tmp_path, SCANS, random_poses(3), NAME)
    plain = read_kitti(tmp_path)
    (tmp_path / "calib.txt").write_text("P0: " + " ".join(["1"] * 12) + "\n")
    with pytest.warns(UserWarning, match="calib.txt: no line Tr:"):
        np.testing.assert_array_equal(read_kitti(tmp_path).points, plain.points)
