"""`hilbertvae-query`: what it may replace, and that coordinates come out as they went in."""

import errno
import io
import warnings

import numpy as np
import octomap
import pytest
from map_command_toys import npz_of

from hilbertvae.commands import query
from hilbertvae.mappers import saved_map
from hilbertvae.mappers.octomap_mapper import read_octree
from hilbertvae.mapping import MapSettings, make_map


@pytest.fixture
def tree(tmp_path):
    """An OctoMap of one wall."""
    tree = octomap.OcTree(0.5)
    for y in np.arange(-3.75, 4, 0.5):
        tree.updateNode(np.array([2.25, y, 0.25]), True)
        tree.updateNode(np.array([1.75, y, 0.25]), False)
    tree.updateInnerOccupancy()
    tree.writeBinary(str(tmp_path / "wall.bt").encode())
    return tmp_path / "wall.bt"


@pytest.fixture(scope="module")
def folder(room, tmp_path_factory):
    made = tmp_path_factory.mktemp("map")
    return make_map(MapSettings(scans=str(npz_of(room, made / "room.npz")), output=str(made / "out"), fill=False, exports=["npz"]))


def files(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize("name", ["asked.csv", "./asked.csv", "../{}/asked.csv", "link.csv"])
def test_the_points_are_not_replaced(tree, tmp_path, monkeypatch, capsys, name):
    """By whatever path: columns that this command does not write would be lost."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "asked.csv").write_text("x,y,z,label\n1.0,2.0,0.25,7\n")
    (tmp_path / "link.csv").symlink_to("asked.csv")
    before = files(tmp_path)
    assert query.main([f"map={tree}", f"points={tmp_path / 'asked.csv'}", f"output={name.format(tmp_path.name)}"]) == 2
    assert "is what points= is read from, and would be replaced" in capsys.readouterr().err
    assert files(tmp_path) == before and (tmp_path / "link.csv").is_symlink()


def test_a_closed_standard_output_is_named(tree, tmp_path, monkeypatch, capsys):
    (tmp_path / "asked.csv").write_text("x,y,z\n1.0,2.0,0.25\n")
    monkeypatch.setattr("sys.stdout", None)
    assert query.main([f"map={tree}", f"points={tmp_path / 'asked.csv'}"]) == 2
    assert "output: expected a name, since the standard output is closed" in capsys.readouterr().err


@pytest.mark.parametrize("rows, warned", [(1, False), (3, False), (20, True)])
def test_a_few_typed_places_far_off_are_those_that_were_meant(tree, tmp_path, capsys, rows, warned):
    """A cloud whose coordinates all have seven digits was rounded on its way."""
    lines = [f"{448251 + row}.5 {5411932 + row} 0.25" for row in range(rows)]
    (tmp_path / "asked.txt").write_text("\n".join(lines))
    assert query.main([f"map={tree}", f"points={tmp_path / 'asked.txt'}"]) == 0
    assert ("digits" in capsys.readouterr().err) == warned


@pytest.mark.parametrize("summary", [True, False])
def test_no_file_of_a_map_is_replaced(folder, tmp_path, capsys, summary):
    """Neither of the one that is asked nor of another; beside them answers may be written, also a second time."""
    np.savetxt(tmp_path / "asked.csv", np.zeros((3, 2)), delimiter=",")
    other = tmp_path / "other"
    other.mkdir()
    for name, content in files(folder).items():
        if summary or name != "summary.json":
            (other / name).write_bytes(content)
    before = files(other)
    for asked in (other, other / "map.safetensors", folder):
        assert query.main([f"map={asked}", f"points={tmp_path / 'asked.csv'}", f"output={other / 'map.npz'}"]) == 2
        assert "map.npz is a file of the map in that folder" in capsys.readouterr().err
    assert files(other) == before
    for _ in range(2):
        assert query.main([f"map={other}", f"points={tmp_path / 'asked.csv'}", f"output={other / 'said.npz'}"]) == 0
    assert files(other).keys() == before.keys() | {"said.npz"}


def test_a_map_of_another_name_is_not_replaced(folder, tmp_path, capsys):
    """One that a user named as an answer."""
    (tmp_path / "map.csv").write_bytes((folder / "map.safetensors").read_bytes())
    np.savetxt(tmp_path / "asked.csv", np.zeros((3, 2)), delimiter=",")
    before = files(tmp_path)
    assert query.main([f"map={tmp_path / 'map.csv'}", f"points={tmp_path / 'asked.csv'}", f"output={tmp_path / 'map.csv'}"]) == 2
    assert "is what map= is read from" in capsys.readouterr().err and files(tmp_path) == before


def test_coordinates_come_out_as_they_went_in(tree, tmp_path, capsys):
    """In text as in numbers, of any size."""
    lines = ["412345.123456,5432109.000001,0.25", "-1.75,1e-05,0.1", "2.25,0.3333333333333333,123.456789"]
    (tmp_path / "asked.csv").write_text("x,y,z\n" + "\n".join(lines) + "\n")
    assert query.main([f"map={tree}", f"points={tmp_path / 'asked.csv'}"]) == 0
    head, *said = capsys.readouterr().out.splitlines()
    assert head == "x,y,z,probability,std,observed"
    assert [line.rsplit(",", 3)[0] for line in said] == lines
    assert query.main([f"map={tree}", f"points={tmp_path / 'asked.csv'}", f"output={tmp_path / 'said.csv'}"]) == 0
    assert (tmp_path / "said.csv").read_text().splitlines() == [head, *said]
    # Answers can be asked about again: they are a file of points.
    assert query.main([f"map={tree}", f"points={tmp_path / 'said.csv'}"]) == 0
    assert [line.rsplit(",", 3)[0] for line in capsys.readouterr().out.splitlines()[1:]] == lines


@pytest.mark.parametrize("height", [0.0, 0.3])
def test_a_third_coordinate_of_a_plan_is_left_out_with_a_word(folder, tmp_path, capsys, height):
    """A plan's own PLY has zeros there; anything else may be a heading or a label."""
    np.savetxt(tmp_path / "asked.csv", [[1, 2, height]] * 2, delimiter=",")
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        assert query.main([f"map={folder}", f"points={tmp_path / 'asked.csv'}"]) == 0
    told = f"hilbertvae-query: {tmp_path / 'asked.csv'}: the map is a plan, so the third coordinate, 0.3 m, is left out\n"
    assert capsys.readouterr().err == (told if height else "")
    np.savetxt(tmp_path / "asked.csv", [[1, 2, height], [1, 2, height + 1]], delimiter=",")
    assert query.main([f"map={folder}", f"points={tmp_path / 'asked.csv'}"]) == 2


def test_a_warning_is_a_line(tree, tmp_path, monkeypatch, capsys):
    """As other commands' are, and not the source of whoever gave it."""
    np.savetxt(tmp_path / "asked.csv", [[2.25, 0, 0.25]], delimiter=",")
    monkeypatch.setattr(saved_map, "read_octree", lambda path: (warnings.warn("was filled before", stacklevel=2), read_octree(path))[1])
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        assert query.main([f"map={tree}", f"points={tmp_path / 'asked.csv'}"]) == 0
    assert capsys.readouterr().err == "hilbertvae-query: was filled before\n"


def test_rows_without_a_place_keep_theirs(folder, tmp_path, capsys):
    """As an organised cloud has them, whose rows and columns are those of a camera or a lidar."""
    (tmp_path / "asked.csv").write_text("x,y\n1.0,2.0\nnan,nan\n2.0,inf\n2.5,1.5\n")
    (tmp_path / "placed.csv").write_text("x,y\n1.0,2.0\n2.5,1.5\n")
    assert query.main([f"map={folder}", f"points={tmp_path / 'placed.csv'}"]) == 0
    head, *placed = capsys.readouterr().out.splitlines()
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        assert query.main([f"map={folder}", f"points={tmp_path / 'asked.csv'}"]) == 0
    told = capsys.readouterr()
    assert told.out.splitlines() == [head, placed[0], "nan,nan,nan,nan,0", "2.0,inf,nan,nan,0", placed[1]]
    assert "2 of 4 points have NaN or inf for a place" in told.err
    assert query.main([f"map={folder}", f"points={tmp_path / 'asked.csv'}", f"output={tmp_path / 'said.npz'}"]) == 0
    said = np.load(tmp_path / "said.npz")
    assert np.isnan(said["probability"]).tolist() == [False, True, True, False] and said["observed"].dtype == bool
    (tmp_path / "nowhere.csv").write_text("x,y\nnan,nan\n")
    assert query.main([f"map={folder}", f"points={tmp_path / 'nowhere.csv'}"]) == 2


@pytest.mark.parametrize("far", [True, False])
@pytest.mark.parametrize("kind", ["folder", "tree"])
def test_points_off_the_map_are_told(kind, far, request, tmp_path, capsys):
    """As those of another frame; some that lie a little beside it are not."""
    asked, dimension = request.getfixturevalue(kind), 2 if kind == "folder" else 3
    np.savetxt(tmp_path / "asked.csv", np.array([[0.0, 0, 0], [3.0, 1, 0]])[:, :dimension] + (500 if far else 0), delimiter=",")
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        assert query.main([f"map={asked}", f"points={tmp_path / 'asked.csv'}"]) == 0
    told = capsys.readouterr()
    assert len(told.out.splitlines()) == 3
    assert ("all points lie off the map (x 500 to 503 m, y 500 to 501 m" in told.err) == far and told.err.count("\n") == far
    if kind == "tree" and far:
        assert "the map x 1.5 to 2.5 m, y -4 to 4 m, z 0 to 0.5 m)" in told.err


def test_another_file_of_a_map_is_told_where_the_map_is(folder, tmp_path, capsys):
    np.savetxt(tmp_path / "asked.csv", np.zeros((3, 2)), delimiter=",")
    for name in ("map.npz", "map.png"):
        assert query.main([f"map={folder / name}", f"points={tmp_path / 'asked.csv'}"]) == 2
        assert f"the map in this folder is {folder / 'map.safetensors'}" in capsys.readouterr().err
    (tmp_path / "floor.yaml").write_text("image: floor.pgm")
    assert query.main([f"map={tmp_path / 'floor.yaml'}", f"points={tmp_path / 'asked.csv'}"]) == 2
    assert "hilbertvae-map scans= makes one of a ROS map" in capsys.readouterr().err


def test_the_ending_alone_says_how_answers_are_written(tree, tmp_path):
    (tmp_path / "asked.csv").write_text("x,y,z\n2.25,0,0.25\n")
    assert query.main([f"map={tree}", f"points={tmp_path / 'asked.csv'}", f"output={tmp_path / 'said.npz'}/"]) == 0
    assert np.load(tmp_path / "said.npz")["observed"].tolist() == [True]


def test_answers_that_can_not_be_written_leave_no_folder(tree, tmp_path, monkeypatch, capsys):
    (tmp_path / "asked.csv").write_text("x,y,z\n2.25,0,0.25\n")
    before = {*tmp_path.iterdir()}

    def full(*given, **more):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(np, "savetxt", full)
    assert query.main([f"map={tree}", f"points={tmp_path / 'asked.csv'}", f"output={tmp_path / 'new' / 'deep' / 'said.csv'}"]) == 2
    assert "No space left" in capsys.readouterr().err and {*tmp_path.iterdir()} == before
    assert query.main([f"map={tree}", f"points={tmp_path / 'asked.csv'}", f"output={tmp_path / 'asked.csv' / 'said.csv'}"]) == 2
    assert "asked.csv is a file" in capsys.readouterr().err


def test_points_are_read_from_the_standard_input(folder, tmp_path, monkeypatch, capsys):
    (tmp_path / "asked.csv").write_text("x,y\n0.5,0.25\n-0.5,0.125\n")
    assert query.main([f"map={folder}", f"points={tmp_path / 'asked.csv'}"]) == 0
    expected = capsys.readouterr().out
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO((tmp_path / "asked.csv").read_bytes())))
    assert query.main([f"map={folder}", "points=-"]) == 0
    assert capsys.readouterr().out == expected
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(b"no numbers\n")))
    assert query.main([f"map={folder}", "points=-"]) == 2
    assert "hilbertvae-query: standard input" in capsys.readouterr().err
