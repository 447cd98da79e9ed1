import re
import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from point_writers import random_poses
from scipy.spatial.transform import Rotation

from hilbertvae.checks import InputError
from hilbertvae.scans.poses import read_calibration, read_poses

LINE = "1 0 0 5 0 1 0 6 0 0 1 7\n"


def test_kitti_and_tum_say_the_same(tmp_path):
    poses = random_poses(20)
    path = tmp_path / "poses.txt"
    path.write_text("# made\n\n" + "".join(" ".join(map(repr, pose)) + "\n" for pose in poses.reshape(20, 12).tolist()))
    np.testing.assert_array_equal(read_poses(path), poses)
    quaternions = Rotation.from_matrix(poses[:, :, :3]).as_quat()
    rows = np.column_stack([1.7e18 + np.arange(20), poses[:, :, 3], quaternions])
    path.write_text("".join(" ".join(map(repr, row)) + "\n" for row in rows.tolist()))
    np.testing.assert_allclose(read_poses(path), poses, rtol=0, atol=1e-12)


def test_a_byte_order_mark_is_no_number(tmp_path):
    (tmp_path / "poses.txt").write_text(LINE, encoding="utf-8-sig")
    assert read_poses(tmp_path / "poses.txt")[0, :, 3].tolist() == [5, 6, 7]
    (tmp_path / "calib.txt").write_text("Tr: 1 0 0 7 0 1 0 8 0 0 1 9\n", encoding="utf-8-sig")
    assert read_calibration(tmp_path / "calib.txt")[:, 3].tolist() == [7, 8, 9]


def test_times_that_go_back_are_said(tmp_path):
    path = tmp_path / "poses.txt"
    path.write_text("1.5 0 0 0 0 0 0 1\n2.5 1 0 0 0 0 0 1\n2 2 0 0 0 0 0 1\n1 3 0 0 0 0 0 1\n")
    with pytest.warns(UserWarning, match="poses.txt, line 3: its time is before that of the line above"):
        assert read_poses(path)[:, 0, 3].tolist() == [0, 1, 2, 3]


def test_poses_in_the_plane(tmp_path):
    (tmp_path / "poses.txt").write_text("1 2 0.5\n-3 4 -2.5\n")
    expected = [Rotation.from_euler("z", heading).as_matrix() for heading in (0.5, -2.5)]
    found = read_poses(tmp_path / "poses.txt")
    np.testing.assert_allclose(found[:, :, :3], expected, atol=1e-15)
    np.testing.assert_array_equal(found[:, :, 3], [[1, 2, 0], [-3, 4, 0]])


def tum(path, rotations, order):
    quaternions = rotations.as_quat()[:, order]
    rows = np.column_stack([np.arange(len(quaternions)), np.zeros((len(quaternions), 3)), quaternions])
    np.savetxt(path, rows, "%.9f")
    return path


@pytest.mark.parametrize("headings", [np.zeros(5), np.linspace(0, 2 * np.pi, 40), np.linspace(-1, 1, 20)])
def test_quaternions_that_begin_with_qw_are_told(tmp_path, headings):
    """By all who stand upright, a hand-held sensor among them; read so, scans would lie on their backs."""
    leaning = np.random.default_rng(0).uniform(-0.3, 0.3, (len(headings), 2))
    rotations = Rotation.from_euler("ZYX", np.column_stack([headings, leaning]))
    with pytest.warns(UserWarning, match=r"poses.txt: in \d+ of \d+ poses scans lie upside down; are the quaternions qw first\?"):
        read_poses(tum(tmp_path / "poses.txt", rotations, [3, 0, 1, 2]))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read_poses(tum(tmp_path / "poses.txt", rotations, [0, 1, 2, 3]))


@pytest.mark.parametrize("mounted", ["upside down", "as a camera"])
def test_sensors_that_are_mounted_otherwise_are_not_taken_for_it(tmp_path, mounted):
    turn = Rotation.from_euler("x", 180 if mounted == "upside down" else -90, degrees=True)
    rotations = Rotation.from_euler("z", np.linspace(0, 2 * np.pi, 40)[:, None]) * turn
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read_poses(tum(tmp_path / "poses.txt", rotations, [0, 1, 2, 3]))


@pytest.mark.parametrize(("form", "step"), [("%e", "1 m"), ("%g", "10 m")])
def test_too_few_digits_of_far_places_are_told(tmp_path, form, step):
    """As `%e` writes them, and as `std::cout` does unless told otherwise."""
    poses = np.tile(np.eye(3, 4), (5, 1, 1))
    poses[:, :, 3] = [500000.4, 5400000.4, 300.1] + np.arange(5.0)[:, None]
    np.savetxt(tmp_path / "poses.txt", poses.reshape(-1, 12), form)
    with pytest.warns(
        UserWarning, match=f"poses.txt: its places, up to 5400.* m, have at most .* digits, which keep them to {step}; write"
    ):
        read_poses(tmp_path / "poses.txt")


@pytest.mark.parametrize(
    ("form", "place"), [("%.7e", 5400000.4), ("%.10g", 5400000.4), ("%e", 1234.5678), ("%g", 1234.5678), ("%e", 20000.0)]
)
def test_enough_digits_are_not(tmp_path, form, place):
    poses = np.tile(np.eye(3, 4), (5, 1, 1))
    poses[:, 0, 3] = place + 1000.0 * np.arange(5)
    np.savetxt(tmp_path / "poses.txt", poses.reshape(-1, 12), form)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read_poses(tmp_path / "poses.txt")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected poses, found none"),
        ("# nothing\n", "expected poses, found none"),
        (LINE + "1 0 0 5 0 1 0 6 0 0 1\n", "line 2: expected 12 numbers, got 11"),
        ("1 0\n", "line 1: expected 12, 16, 8 or 3 numbers, got 2"),
        (LINE + "0 1 2 3 0 0 0 1\n", "line 2: expected 12 numbers, got 8"),
        (LINE + "\n" + LINE.replace("6", "six"), "line 3: expected numbers"),
        (LINE + LINE.replace("6", "nan"), "line 2: expected finite numbers"),
        (LINE + LINE.replace("6", "1e300"), "line 2: expected a place in metres"),
        (LINE + LINE.replace("1 0 0 5", "-1 0 0 5"), "line 2: expected a rigid motion"),
        (LINE + LINE.replace("1 0 0 5", "1.01 0 0 5"), "line 2: expected a rigid motion"),
        (LINE + LINE.replace("1 0 0 5", "1e200 1e300 0 5"), "line 2: expected a rigid motion"),
        (LINE + LINE.replace("1 0 0 5", "0 1 0 5"), "line 2: expected a rigid motion"),
        ("0 1 2 3 0 0 0 1.1\n", "line 1: expected a rigid motion, the quaternion has length 1.1"),
        ("0 1 2 3 0 0 0 0\n", "line 1: expected a rigid motion, the quaternion has length 0"),
    ],
)
def test_bad_lines_are_named(tmp_path, text, message):
    path = tmp_path / "poses.txt"
    path.write_text(text)
    with pytest.raises(InputError, match=f"poses.txt.*{message}"):
        read_poses(path)


def test_missing_poses(tmp_path):
    with pytest.raises(InputError, match="poses.txt: no such file"):
        read_poses(tmp_path / "poses.txt")


@settings(max_examples=200, suppress_health_check=[HealthCheck.differing_executors])
@given(content=st.binary(max_size=80) | st.text("0123456789.e-+ \nnainf#", max_size=120).map(str.encode))
def test_foreign_bytes_raise_nothing_but_input_errors(tmp_path_factory, content):
    path = tmp_path_factory.getbasetemp() / "poses.txt"
    path.write_bytes(content)
    with pytest.raises(InputError, match=re.escape(str(path))):
        read_poses(path)


def test_matrices_of_four_rows_and_numbers_with_commas(tmp_path):
    pose = [0, -1, 0, 1.5, 1, 0, 0, -2.0, 0, 0, 1, 0.25]
    lines = {"12": pose, "16": [*pose, 0, 0, 0, 1]}
    for name, values in lines.items():
        (tmp_path / f"{name}.txt").write_text(" ".join(map(str, values)) + "\n")
        (tmp_path / f"{name}.csv").write_text(", ".join(map(str, values)) + "\n")
        for ending in ("txt", "csv"):
            np.testing.assert_array_equal(read_poses(tmp_path / f"{name}.{ending}"), np.reshape(pose, (1, 3, 4)))
    (tmp_path / "bad.txt").write_text(" ".join(map(str, [*pose, 0, 0, 1, 0])) + "\n")
    with pytest.raises(InputError, match="line 1: expected 0 0 0 1 at the end of a 4 x 4 matrix"):
        read_poses(tmp_path / "bad.txt")
