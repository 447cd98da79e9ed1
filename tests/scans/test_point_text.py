import numpy as np
import pytest

from hilbertvae.checks import InputError
from hilbertvae.scans import point_text
from hilbertvae.scans.file_points import NoRows
from hilbertvae.scans.point_text import read_point_text


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1 2 3\n4 5 6\n", [[1, 2, 3], [4, 5, 6]]),
        ("1 2\n4 5", [[1, 2], [4, 5]]),
        ("2\n1 2 3 7\n4 5 6 8\n", [[1, 2, 3], [4, 5, 6]]),  # PTS
        ("//t X Y Z\n2\n9 1 2 3\n9 4 5 6\n", [[1, 2, 3], [4, 5, 6]]),  # CloudCompare
        ("2\r\n1;2;3\r\n4;5;6\r\n", [[1, 2, 3], [4, 5, 6]]),
        ("2\nx y z r\n1 2 3 7\n4 5 6 8\n", [[1, 2, 3], [4, 5, 6]]),
        ("  1\t2   3 0.5 255\n\n4 5 6 0.1 0\n", [[1, 2, 3], [4, 5, 6]]),
        ("# a comment\n\n//X Y Z\n1 2 3\n", [[1, 2, 3]]),
        ("1,2,3\r\n4,5,6\r\n", [[1, 2, 3], [4, 5, 6]]),
        ("1e2;-2.5;nan\n", [[100, -2.5, np.nan]]),
        ('name,Z,"Y",x\nfirst,3,2,1\nsecond,6,5,4\n', [[1, 2, 3], [4, 5, 6]]),
        ('"intensity","Points_m_XYZ:0","Points_m_XYZ:1","Points_m_XYZ:2"\n9,1,2,3\n', [[1, 2, 3]]),  # VeloView
        ('"Points:1","Points:2","Points:0","Normals:0"\n2,3,1,9\n', [[1, 2, 3]]),  # ParaView
        ("t;X [m];Y [m];Z [m]\n9;1;2;3\n", [[1, 2, 3]]),
        ("# z_m y_m x_m\n3 2 1\n", [[1, 2, 3]]),
        ("points_0 x_m x y z_m\n8 9 1 2 3\n", [[1, 2, 3]]),  # what is called just x is x
        ("x y r\n1 2 9\n", [[1, 2]]),
        ("# t x y z\n9 1 2 3\n", [[1, 2, 3]]),
        ("# a log\n#T X Y Z\n\n9 1 2 3\n# x y t z\n9 4 5 6\n", [[1, 2, 3], [4, 5, 6]]),
        ("//Intensity;X;Y;Z\n9;1;2;3\n", [[1, 2, 3]]),
        ("# t x y z\n9,1,2,3\n", [[1, 2, 3]]),
        ("# t, x, y, z,\n9,1,2,3,\n", [[1, 2, 3]]),
        ("# z y x\n# of a room\n1 2 3\n", [[3, 2, 1]]),
        ("# x y of rooms\n1 2 3\n", [[1, 2, 3]]),
        ("\ufeffz;y;x\n3;2;1\n", [[1, 2, 3]]),
        ("\ufeff1 2 3\n", [[1, 2, 3]]),
        ("\ufeff# t x y z\n9 1 2 3\n", [[1, 2, 3]]),
        ("x,y,z,\r\n1,2,3,\r\n\r\n4,5,6,\r\n", [[1, 2, 3], [4, 5, 6]]),
        ("1;2;3;\n4;5;6\n", [[1, 2, 3], [4, 5, 6]]),
        ("x,y,z\n1,2,3,\n", [[1, 2, 3]]),
        (",x,y,z\n0,1,2,3\n1,,,\n2,4,5,6\n", [[1, 2, 3], [np.nan] * 3, [4, 5, 6]]),  # as pandas writes it
        ("x;y;t\n1;2;3\n ; ;4;  # none\n5;6;7;\n", [[1, 2], [np.nan] * 2, [5, 6]]),
        ("x,y,z,t\n1,2,3,4\n,,,\n , , , \n5,6,7,8\n,,,,\n", [[1, 2, 3], [np.nan] * 3, [np.nan] * 3, [5, 6, 7], [np.nan] * 3]),
        ("x;y\n;\n", [[np.nan, np.nan]]),
        ("GPS time\tx\ty\tz\tintensity\n\n# a note\n100.5\t1\t2\t3\t50 # good\n", [[1, 2, 3]]),
        ("# GPS time\tx\ty\tz\tintensity\n100.5\t1\t2\t3\t50\n", [[1, 2, 3]]),
        ("t\tx\ty\tz\n9 1 2 3\n", [[1, 2, 3]]),
        ("x,y,z,i\n1,2,3,\n4,5,6,7\n", [[1, 2, 3], [4, 5, 6]]),
        ("i,x,y,z\n,1,2,3\n4,5,6,7\n", [[1, 2, 3], [5, 6, 7]]),
        ("i\tx\ty\tz\tw\n9\t1\t2\t3\t\n\t5\t6\t7\t8\n", [[1, 2, 3], [5, 6, 7]]),
        ("i\tx\ty\tz\tw\n9\t1\t2\t3\t\n\t5\t6\t7\t8 // c\n\t\t\t\t\n", [[1, 2, 3], [5, 6, 7], [np.nan] * 3]),
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
        ("3\n1 2 3\n4 5 6\n", "truncated; its first line says 3 points, 2 are there"),
        ("3\n1 2\n", "can't be read as a text file of points"),
        ("1\n2\n", "expected 2 or more columns, found 1"),
        ("1 2 3\n4 5\n", "can't be read as a text file of points"),
        ("1,2,3\n4,5,\n", "can't be read as a text file of points"),
        ("# t x y z\n9 1 2 3\n9 1 2 3 4\n", "can't be read as a text file of points"),
        ("1,2,,\n", "expected numbers, or a first line that names columns"),
        ("1,2,3\n4,,6\n", "can't be read as a text file of points"),
        ("1 2 3\n4 five 6\n", "can't be read as a text file of points"),
        ("1,5 2,5 3,5\n", "expected decimal points, got decimal commas, '1,5 2,5 3,5'; write the numbers as 1.5"),
        ("# a hall\n1,5;-2,5e3;3\n", "expected decimal points, got decimal commas"),
        ("x;y;z\n1,5;2,5;3,5;\n", "expected decimal points, got decimal commas"),
        ("x\ty\tz\n\n1,5\t2,5\t3,5\n", "expected decimal points, got decimal commas"),
        ("a,b,c\n1,2,3\n", "expected numbers, or a first line that names columns x, y"),
        ("x,y,z\n", "expected lines of numbers, found none"),
        ("x y z\n", "expected lines of numbers, found none"),
        ("x\ty\tz\n# a note\n", "expected lines of numbers, found none"),
        (",x,y,z\n0,1,2,3\n1,4,,\n", "can't be read as a text file of points"),
        (",x,y,z\n0,1,2,3\n1,,4,\n", "can't be read as a text file of points"),
        ("x,y,z\n1,,3\n", "can't be read as a text file of points"),
        ("x,y,z\n1,2\n", r"line 2: expected as many columns as its first line names, 3 \(x y z\), the row has 2"),
        ("x,y,z\n1,0.5,0.6,0.7\n", r"line 2: expected as many columns as its first line names, 3 \(x y z\), the row has 4"),
        ("x y z\n1 0.5 0.6 0.7\n", "the row has 4"),  # as R writes it, with names of rows
        ("Point ID X Y Z R\n7 0.5 0.6 0.7 9\n", "names, 6 .*, the row has 5"),
        ("x,y,z\n1,2,3\n17.5,4,5,6\n", "line 3: .* the row has 4"),  # times in front, from here on
        ("# a log\nt,x,y,z\n0.1,1,2,3\n0.2,1,5,2,5,3,5\n", "line 4: .* the row has 7"),  # decimal commas
        ("x,y,z,t\n1,2,3,.1\n\n4,5,6\n", "line 4: .* the row has 3"),
        ("x y z\n1 2 3\n9 4 5 6 // c\n", "line 3: .* the row has 4"),
        ("x\ty\tz\n1\t2\t3\n9\t4\t5\t6\n", "line 3: .* the row has 4"),
        ('"x","y","z"\n"1,5","2,5","0,3"\n', "can't be read as a text file of points .*could not convert"),
        ('x,y,z,name\n1,2,3,"a\n4,5,6,b"\n7,8,9\n', "line 4: .* the row has 3"),
    ],
)
def test_bad_files_are_named(tmp_path, text, message):
    path = tmp_path / "a.xyz"
    path.write_text(text)
    with pytest.raises(InputError, match=f"a.xyz.*{message}"):
        read_point_text(path)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('"x","y","z","i"\n1.5,2.5,0.3,4\n,,,4\n2.5,3.5,0.1,4\n', [[1.5, 2.5, 0.3], [np.nan] * 3, [2.5, 3.5, 0.1]]),  # VeloView
        ('"x","y","z"\n"1.5","2.5","0.3"\n"","",""\n"2.5","3.5","0.1"\n', [[1.5, 2.5, 0.3], [np.nan] * 3, [2.5, 3.5, 0.1]]),
        ('"","x","y","z"\n"1",1.5,2.5,0.3\n"2",2,3,4 # a note\n', [[1.5, 2.5, 0.3], [2, 3, 4]]),  # R
        ('"x","y","z","name"\n1,2,3,"a, b"\n4,5,6,"see http://a#b"\n', [[1, 2, 3], [4, 5, 6]]),
        ('"name, first","x","y"\n"a",1,2\n', [[1, 2]]),
        ('x,y,z,name\n1,2,3,"a\n4,5,6,b"\n', [[1, 2, 3], [4, 5, 6]]),  # a quote that is not closed ends with its line
        ('"1.5";"2";"3"\n"4";"5";"6"\n', [[1.5, 2, 3], [4, 5, 6]]),
        ('"x [m]"\t"y [m]"\t"z [m]"\n1\t2\t3\n', [[1, 2, 3]]),
    ],
)
def test_fields_in_quotes(tmp_path, text, expected):
    (tmp_path / "a.csv").write_text(text)
    np.testing.assert_array_equal(read_point_text(tmp_path / "a.csv").points, expected)


ROWS = ["1 2 3 4", "x y z t", "# t x y z", "//1 2 3 4", "# note", "", "   ", "nan 2 3 4", "1 2 3 4 # end", "1 2 3 4 // end", "1 2 3"]
ROWS += ['"1" "2" 3 4', '"x" y "z" t', '1 2 3 "4', '1 2 3 "a//"']
ROWS += ["1 2", "a 2 3 4", "1  2 3 4 ", "1 2 3 4 5", "//a 2 3 4", "   # 1"]


def answer(path):
    try:
        return read_point_text(path).points.tolist()
    except InputError as error:
        return str(error)


def test_files_that_numpy_reads_by_itself_have_the_same_answers(tmp_path, monkeypatch):
    """Random files of sound and unsound rows, with all delimiters and ends of lines, read both ways."""
    rng, quick = np.random.default_rng(0), point_text._plain_table
    path = tmp_path / "a.xyz"
    for _ in range(1500):
        sound = ["1 2 3 4", "-5.5 6e2 7 8"] * (2 * rng.integers(4))
        rows = [*rng.choice(ROWS, rng.integers(1, 3)), *sound, *rng.choice(ROWS, rng.integers(3))]
        mark, end, last = rng.choice([" ", ",", ";", "\t"]), rng.choice(["\n", "\r\n", "\n", "\r"]), rng.choice(["", ",", ",,,"])
        text = "\ufeff" * (rng.random() < 0.1) + end.join(row.replace(" ", mark) for row in [*rows, last.replace(",", mark)])
        path.write_text(text, newline="", encoding="utf-8")
        found = answer(path)
        monkeypatch.setattr(point_text, "_plain_table", lambda *given: None)
        expected = answer(path)
        monkeypatch.setattr(point_text, "_plain_table", quick)
        assert repr(found) == repr(expected), text


@pytest.mark.parametrize(
    "text", ["1 2 3\n4 5 6\n", "x,y,z\r\n1,2,3\r\n", "x y z\n1 2 3\n\n", "x;y;z;\r\n1;2;3;\r\n4;5;6", "# t x y z\n\n9 1 2 3\n"]
)
def test_a_plain_file_is_left_to_numpy(tmp_path, monkeypatch, text):
    (tmp_path / "a.xyz").write_text(text, newline="")
    monkeypatch.setattr(point_text, "number_table", None)
    assert len(read_point_text(tmp_path / "a.xyz").points)


@pytest.mark.parametrize(
    "text",
    ["x,y,z # metres\n1,2,3\n", "x y z // metres\n1 2 3 // first\n", "x\ty\tz\t# a\n1\t2\t3\n", "1,2,3 # first\n", "1 2 3# first\n",
     '"x","y","z"\n"1","2","3"\n', '"1";"2";"3"\n', "\tx\ty\tz\n0\t1\t2\t3\n", "\t1 2 3\n", "ring#,x,y,z\n7,1,2,3\n"],
)  # fmt: skip
def test_comments_and_quotes_and_an_index(tmp_path, text):
    (tmp_path / "a.csv").write_text(text)
    assert read_point_text(tmp_path / "a.csv").points.tolist() == [[1, 2, 3]]


@pytest.mark.parametrize("name", ["z (mm)", "z_mm", "Z-coordinate", "z [ft]"])
def test_a_height_in_other_words_is_not_passed_over(tmp_path, name):
    (tmp_path / "a.csv").write_text(f"x,y,{name}\n1,2,3\n")
    with pytest.raises(InputError, match="a.csv: expected a column z, z_m or z .m. beside x and y"):
        read_point_text(tmp_path / "a.csv")


def test_what_may_be_a_height_is_told_of(tmp_path, recwarn):
    for name in ("zone", "time"):
        (tmp_path / "a.csv").write_text(f"x,y,{name}\n1,2,3\n")
        assert read_point_text(tmp_path / "a.csv").points.tolist() == [[1, 2]]
    assert not recwarn.list
    (tmp_path / "a.csv").write_text("x,y,Height\n1,2,3\n")
    with pytest.warns(UserWarning, match="points are of the plane, by x and y; call 'height' z if"):
        assert read_point_text(tmp_path / "a.csv").points.tolist() == [[1, 2]]


def test_a_count_of_no_points_is_a_file_without_any(tmp_path):
    (tmp_path / "a.pts").write_text("0\n")
    with pytest.raises(NoRows):
        read_point_text(tmp_path / "a.pts")


@pytest.mark.parametrize("block", [1, 2, 3, 100])
@pytest.mark.parametrize("odd", ["//", "\r"])
def test_what_is_odd_is_seen_across_blocks(tmp_path, monkeypatch, block, odd):
    monkeypatch.setattr(point_text, "BLOCK", block)
    for place in range(4):
        (tmp_path / "a.xyz").write_text("1 2 3\r\n" + " " * place + odd + " 4\r\n", newline="")
        assert point_text._plain_table(tmp_path / "a.xyz", None, None, 3, 0) is None
    (tmp_path / "a.xyz").write_text("1 2 3\r\n4 5 6\r\n", newline="")
    assert point_text._plain_table(tmp_path / "a.xyz", None, None, 3, 0).tolist() == [[1, 2, 3], [4, 5, 6]]


@pytest.mark.parametrize("block", [1, 5, 1000])
def test_columns_are_counted_as_line_by_line(tmp_path, monkeypatch, block):
    """`_has_columns` says yes to no file that has a row of others, and to all that are nothing but such rows."""
    monkeypatch.setattr(point_text, "BLOCK", block)
    rng = np.random.default_rng(1)
    for _ in range(300):
        mark = rng.choice([" ", ",", "\t"])
        rows = [mark.join(["1"] * width) for width in rng.choice([3, 3, 3, 3, 3, 2, 4], rng.integers(1, 8))]
        ends = ["" if mark == " " else mark * (rng.random() < 0.2) for _ in rows]
        (tmp_path / "a.xyz").write_text("\n".join(row + end for row, end in zip(rows, ends, strict=True)) + "\n" * rng.integers(2))
        with open(tmp_path / "a.xyz", "rb") as file:
            found = point_text._has_columns(file, None if mark == " " else mark, 3)
        widths = [row.count("1") + (row.count("1") < 3 and end != "") for row, end in zip(rows, ends, strict=True)]
        assert found == (set(widths) == {3}), (rows, ends)


@pytest.mark.parametrize("start", [0, 1])
def test_numbers_of_rows_ahead_of_the_coordinates_are_told(tmp_path, start):
    """As pandas writes its index without names of columns; once for all files of a folder."""
    rows = np.column_stack([np.arange(start, start + 5), np.random.default_rng(0).normal(size=(5, 3))])
    for name in ("a.csv", "b.csv"):
        np.savetxt(tmp_path / name, rows, delimiter=",")
    told = f"{tmp_path.name}: the first column of .csv files counts rows from {start}, and is taken as x, .*; leave it out, or name"
    with pytest.warns(UserWarning, match=told) as found:
        for name in ("a.csv", "b.csv"):
            np.testing.assert_array_equal(read_point_text(tmp_path / name).points, rows[:, :3])
    assert len({str(warning.message) for warning in found}) == 1


@pytest.mark.parametrize(("columns", "count", "header"), [(3, 9, ""), (4, 3, ""), (4, 9, "x,y,z,t"), (4, 9, "# x,y,z,t")])
def test_other_first_columns_are_coordinates(tmp_path, columns, count, header, recwarn):
    rows = np.column_stack([np.arange(count), np.ones((count, columns - 1))])
    np.savetxt(tmp_path / "a.csv", rows, delimiter=",", header=header, comments="")
    rows[1] += 0.5
    np.savetxt(tmp_path / "b.csv", np.column_stack([rows, rows[:, 1]]), delimiter=",")
    for name in ("a.csv", "b.csv"):
        read_point_text(tmp_path / name)
    assert not recwarn.list
