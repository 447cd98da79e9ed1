import numpy as np
import pytest

from hilbertvae.checks import InputError
from hilbertvae.scans.point_text import read_point_text


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1 2 3\n4 5 6\n", [[1, 2, 3], [4, 5, 6]]),
        ("1 2\n4 5", [[1, 2], [4, 5]]),
        ("  1\t2   3 0.5 255\n\n4 5 6 0.1 0\n", [[1, 2, 3], [4, 5, 6]]),
        ("# a comment\n\n//X Y Z\n1 2 3\n", [[1, 2, 3]]),
        ("1,2,3\r\n4,5,6\r\n", [[1, 2, 3], [4, 5, 6]]),
        ("1e2;-2.5;nan\n", [[100, -2.5, np.nan]]),
        ('name,Z,"Y",x\nfirst,3,2,1\nsecond,6,5,4\n', [[1, 2, 3], [4, 5, 6]]),
        ("x y r\n1 2 9\n", [[1, 2]]),
        ("# t x y z\n9 1 2 3\n", [[1, 2, 3]]),
        ("# a log\n#T X Y Z\n\n9 1 2 3\n# x y t z\n9 4 5 6\n", [[1, 2, 3], [4, 5, 6]]),
        ("//Intensity;X;Y;Z\n9;1;2;3\n", [[1, 2, 3]]),
        ("# t x y z\n9,1,2,3\n", [[1, 2, 3]]),
        ("# t, x, y, z,\n9,1,2,3,\n", [[1, 2, 3]]),
        ("# z y x\n# of a room\n1 2 3\n", [[1, 2, 3]]),
        ("# x y of rooms\n1 2 3\n", [[1, 2, 3]]),
        ("\ufeffz;y;x\n3;2;1\n", [[1, 2, 3]]),
        ("\ufeff1 2 3\n", [[1, 2, 3]]),
        ("\ufeff# t x y z\n9 1 2 3\n", [[1, 2, 3]]),
        ("x,y,z,\r\n1,2,3,\r\n\r\n4,5,6,\r\n", [[1, 2, 3], [4, 5, 6]]),
        ("1;2;3;\n4;5;6\n", [[1, 2, 3], [4, 5, 6]]),
        ("x,y,z\n1,2,3,\n", [[1, 2, 3]]),
        ("x,y,z,t\n1,2,3,4\n,,,\n , , , \n5,6,7,8\n,,,,\n", [[1, 2, 3], [np.nan] * 3, [np.nan] * 3, [5, 6, 7], [np.nan] * 3]),
        ("x;y\n;\n", [[np.nan, np.nan]]),
    ],
)
def test_tables(tmp_path, text, expected):
    path = tmp_path / "a.xyz"
    path.write_text(text, newline="", encoding="utf-8")
    np.testing.assert_array_equal(read_point_text(path).points, np.array(expected, float))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected lines of numbers, found none"),
        ("# nothing\n// at all\n", "expected lines of numbers, found none"),
        ("1\n2\n", "expected 2 or more columns, found 1"),
        ("1 2 3\n4 5\n", "can't be read as a text file of points"),
        ("1,2,3\n4,5,\n", "can't be read as a text file of points"),
        ("# t x y z\n9 1 2 3\n9 1 2 3 4\n", "can't be read as a text file of points"),
        ("1,2,,\n", "expected numbers, or a first line that names columns"),
        ("1,2,3\n4,,6\n", "can't be read as a text file of points"),
        ("1 2 3\n4 five 6\n", "can't be read as a text file of points"),
        ("1,5 2,5 3,5\n", "expected numbers, or a first line that names columns"),
        ("a,b,c\n1,2,3\n", "expected numbers, or a first line that names columns x, y"),
        ("x,y,z\n", "expected lines of numbers, found none"),
        ("x,y,z\n1,,3\n", "can't be read as a text file of points"),
        ("x,y,z\n1,2\n", "can't be read as a text file of points"),
    ],
)
def test_bad_files_are_named(tmp_path, text, message):
    path = tmp_path / "a.xyz"
    path.write_text(text)
    with pytest.raises(InputError, match=f"a.xyz.*{message}"):
        read_point_text(path)
