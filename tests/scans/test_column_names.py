import warnings

import numpy as np
import pytest

from hilbertvae.checks import InputError
from hilbertvae.scans.column_names import commented_columns
from hilbertvae.scans.point_text import read_point_text

NAMED = [
    ("t x y z", "9 1 2 3"),
    ("t x y z\nunits: s m m m", "9 1 2 3"),
    ("t x y z\n\nrecorded in a hall\nby hand", "9 1 2 3"),
    ("x y z t\nt x y z", "9 1 2 3"),  # the latest
    ("timestamp [s] x [m] y [m] z [m]", "9 1 2 3"),
    ("timestamp (s), x (m), y (m), z (m)", "9 1 2 3"),
    ("timestamp [s], x [m], y [m], z [m]", "9,1,2,3"),
    ("t [s] x [metres] y [metres] z [metres]", "9 1 2 3"),
    ("time [ s ] x[m] y [m] z[m] intensity (0 to 255)", "9 1 2 3 7"),
    ("z y x (in the frame of the sensor)", "3 2 1"),
]


@pytest.mark.parametrize(("header", "row"), NAMED)
@pytest.mark.parametrize("mark", ["# ", "//"])
def test_a_comment_above_others_or_with_units_names_columns(tmp_path, header, row, mark):
    (tmp_path / "a.txt").write_text("".join(f"{mark}{line}\n" for line in header.split("\n")) + f"{row}\n")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = read_point_text(tmp_path / "a.txt")
    assert found.points.tolist() == [[1, 2, 3]] and found.named


@pytest.mark.parametrize("header", ["t [s] x [mm] y [mm] z [mm]", "t x_mm y_mm z_mm", "t;x (ft);y (ft);z (ft)", "t x [m] y [m] z [ft]"])
def test_other_units_than_metres_are_refused(tmp_path, header):
    (tmp_path / "a.txt").write_text(f"# {header}\n" + (";" if ";" in header else " ").join("9123") + "\n")
    with pytest.raises(InputError, match=r"a.txt: expected .* in metres, .*(mm|ft)"):
        read_point_text(tmp_path / "a.txt")


@pytest.mark.parametrize(
    ("header", "row"), [("x y z intensity", "7 1 2 3 9"), ("x y of rooms", "1 2 3"), ("x ahead, y left, z up", "1 2 3 4")]
)
def test_a_comment_with_x_and_y_that_names_no_columns_is_told_of(tmp_path, header, row):
    for name in ("a.txt", "b.txt"):
        (tmp_path / name).write_text(f"# {header}\n# of a hall\n{row}\n")
    with pytest.warns(
        UserWarning, match=f"{tmp_path.name}: the comment '{header}' above the numbers of .txt files has x and y, but"
    ) as found:
        for name in ("a.txt", "b.txt"):
            read = read_point_text(tmp_path / name)
    np.testing.assert_array_equal(read.points, [[float(number) for number in row.split()[:3]]])
    assert not read.named and len({str(warning.message) for warning in found}) == 1  # of a folder, one


@pytest.mark.parametrize("header", ["units: m", "exported by a program", "yaw x", ""])
def test_other_comments_are_passed_over(tmp_path, header):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert commented_columns(tmp_path / "a.txt", [f"# {header}".encode()], None, 3) is None
