import struct

import numpy as np
import pytest
from point_writers import POINTS, write_pcd

from hilbertvae.checks import InputError
from hilbertvae.scans.pcd import read_pcd

WRITTEN_M = {"ascii": 1e-10, "binary": 0.0, "binary_compressed": 0.0}
"""How well: the text that is written has ten digits behind the point."""
ENCODINGS = pytest.mark.parametrize("encoding", ["ascii", "binary", "binary_compressed"])


@ENCODINGS
def test_an_organised_cloud_with_no_returns(tmp_path, encoding):
    points = POINTS.copy()
    points[::7] = np.nan
    found = read_pcd(write_pcd(tmp_path / "a.pcd", points, encoding, width=12)).points
    np.testing.assert_allclose(found, points, rtol=0, atol=WRITTEN_M[encoding])


@ENCODINGS
def test_a_viewpoint_is_the_origin_and_turns_nothing(tmp_path, encoding):
    found = read_pcd(write_pcd(tmp_path / "a.pcd", POINTS, encoding, viewpoint=(1.5, -2.0, 0.25, 0.0, 0.0, 0.0, 1.0)))
    np.testing.assert_allclose(found.points, POINTS, rtol=0, atol=WRITTEN_M[encoding])
    np.testing.assert_array_equal(found.origins, [1.5, -2.0, 0.25])
    assert read_pcd(write_pcd(tmp_path / "b.pcd", POINTS, encoding)).origins is None


@ENCODINGS
def test_a_viewpoint_of_zeros_says_nothing(tmp_path, encoding):
    assert read_pcd(write_pcd(tmp_path / "a.pcd", POINTS, encoding, viewpoint=(0.0,) * 7)).origins is None
    placed = read_pcd(write_pcd(tmp_path / "b.pcd", POINTS, encoding, viewpoint=(1.0, *(0.0,) * 6)))
    np.testing.assert_array_equal(placed.origins, [1, 0, 0])


def write(tmp_path, data, **changed):
    lines = {"VERSION": "0.7", "FIELDS": "x y z", "SIZE": "4 4 4", "TYPE": "F F F", "COUNT": "1 1 1", "WIDTH": "2", "HEIGHT": "1"}
    lines |= {"VIEWPOINT": "0 0 0 1 0 0 0", "POINTS": "2", "DATA": "ascii"} | changed
    path = tmp_path / "a.pcd"
    path.write_bytes("".join(f"{key} {value}\n" for key, value in lines.items() if value).encode() + data)
    return path


def test_other_fields_and_two_dimensions(tmp_path):
    path = write(tmp_path, b"9 1 2 7 7\n9 3 4 7 7\n", FIELDS="t y x rgb", SIZE="8 4 4 4", TYPE="F F F U", COUNT="1 1 1 2")
    np.testing.assert_array_equal(read_pcd(path).points, [[2, 1], [4, 3]])
    path = write(tmp_path, b"1 2 3\n", WIDTH="1", POINTS="1", VIEWPOINT="4 5 6 1 0 0 0")
    found = read_pcd(path)
    np.testing.assert_array_equal(found.points, [[1, 2, 3]])
    np.testing.assert_array_equal(found.origins, [4, 5, 6])


@pytest.mark.parametrize("row", [b"9 4 5 6", b"4.25 5.125"])
def test_rows_of_other_numbers_than_fields_are_refused(tmp_path, row):
    """Cut to the coordinates, each would have those of another point or field."""
    told = "expected 3 numbers a point, as its fields say, found"
    with pytest.raises(InputError, match=f"a.pcd: {told}"):
        read_pcd(write(tmp_path, row + b"\n" + row + b"\n"))
    with pytest.raises(InputError, match="a.pcd: can't be read as a PCD file"):
        read_pcd(write(tmp_path, b"1 2 3\n" + row + b"\n"))


@ENCODINGS
def test_odd_comments_and_names_of_fields_are_read_past(tmp_path, encoding):
    """pypcd4 takes comments in UTF-8 alone, and names without marks."""
    rows = np.array([(7, 1, 2, 3, 8), (9, 4, 5, 6, 10)], np.dtype("<f4, <f4, <f4, <f4, <f4").descr)
    packed = np.concatenate([rows[name] for name in rows.dtype.names]).tobytes()
    data = {"ascii": b"7 1 2 3 8\n9 4 5 6 10\n", "binary": rows.tobytes()}
    data["binary_compressed"] = struct.pack("<II", len(packed) + 2, len(packed)) + b"".join(
        bytes([len(part) - 1]) + part for part in (packed[:32], packed[32:])
    )
    changed = {"FIELDS": "scan:time x y z Scalar#1", "SIZE": "4 4 4 4 4", "TYPE": "F F F F F", "COUNT": "1 1 1 1 1", "WIDTH": "2"}
    path = write(tmp_path, data[encoding], **changed, DATA=encoding)
    path.write_bytes(b"# caf\xe9\n" + path.read_bytes())
    np.testing.assert_array_equal(read_pcd(path).points, [[1, 2, 3], [4, 5, 6]])


OLD = {"COUNT": None, "VIEWPOINT": None}


@pytest.mark.parametrize("changed", [OLD, OLD | {"VERSION": ".5"}, OLD | {"VERSION": "0.6"}, {"VERSION": ".6"}, {"COUNT": None}])
@ENCODINGS
def test_versions_without_count(tmp_path, encoding, changed):
    points = np.tile(POINTS[:5], (12, 1))  # pypcd4 packs only what gets shorter
    new = write_pcd(tmp_path / "b.pcd", points, encoding).read_bytes()
    assert f"DATA {encoding}\n".encode() in new
    data = new[new.index(b"DATA") :].split(b"\n", 1)[1]
    path = write(tmp_path, data, WIDTH="60", POINTS="60", DATA=encoding, **changed)
    np.testing.assert_allclose(read_pcd(path).points, points, rtol=0, atol=WRITTEN_M[encoding])


def test_a_viewpoint_and_gaps_without_count(tmp_path):
    path = write(
        tmp_path, b"7 1 2 3\n8 4 5 6\n", FIELDS="_ x y z", SIZE="4 4 4 4", TYPE="F F F F", COUNT=None, VIEWPOINT="4 5 1e-5 1 0 0 0"
    )
    found = read_pcd(path)
    np.testing.assert_array_equal(found.points, [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_array_equal(found.origins, [4, 5, 1e-5])


@ENCODINGS
def test_a_byte_order_mark_is_read_past(tmp_path, encoding):
    path = write_pcd(tmp_path / "a.pcd", POINTS, encoding)
    path.write_bytes(b"\xef\xbb\xbf# .PCD\n" + path.read_bytes())
    np.testing.assert_allclose(read_pcd(path).points, POINTS, rtol=0, atol=WRITTEN_M[encoding])


def test_files_of_something_else(tmp_path):
    (tmp_path / "a.pcd").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(100))
    with pytest.raises(InputError, match="a.pcd: expected a PCD file's header, found no line FIELDS, SIZE, TYPE, WIDTH, POINTS$"):
        read_pcd(tmp_path / "a.pcd")


PACKED = {"DATA": "binary_compressed"}


@pytest.mark.parametrize(
    ("data", "changed", "message"),
    [
        (b"1 2 3\n", {}, "truncated"),
        (b"1 2 3\n4 5 6\n7 8 9\n", {}, "2 points declared, 3 found"),
        (b"1 2 3\n4 five 6\n", {}, "can't be read as a PCD file"),
        (b"1 2 3\n4 5 6\n", {"POINTS": "3"}, "POINTS is 3, WIDTH times HEIGHT 2"),
        (b"1 2 3\n4 5 6\n", {"FIELDS": "a b c"}, "expected fields x, y"),
        (b"1 2 3\n4 5 6\n", {"COUNT": "1 1"}, "of one length"),
        (b"1 2 3\n4 5 6\n", {"COUNT": "1 1 1000000000"}, "at most 1024 numbers a point"),
        (b"1 2 3\n4 5 6\n", {"SIZE": "4 4 3"}, "can't be read as a PCD file"),
        (b"1 2 3\n4 5 6\n", {"TYPE": "F F S"}, "can't be read as a PCD file"),
        (b"1 2 3\n4 5 6\n", {"VIEWPOINT": "0 0"}, "can't be read as a PCD file"),
        (b"1 2 3\n4 5 6\n", {"VIEWPOINT": "nan 0 0 1 0 0 0"}, "expected a finite VIEWPOINT"),
        (b"1 2 3\n4 5 6\n", {"WIDTH": None}, "expected a PCD file's header, found no line WIDTH"),
        (b"1 2 3\n4 5 6\n", {"DATA": "tape"}, "can't be read as a PCD file"),
        (bytes(23), {"DATA": "binary"}, "the header's points need 24 bytes, 23 are there"),
        (bytes(23), {"DATA": "binary", "COUNT": None}, "the header's points need 24 bytes, 23 are there"),
        (b"1 2 3\n", {"COUNT": None}, "truncated"),
        (b"1 2 3\n4 5 6\n", {"COUNT": None, "SIZE": "4 4"}, "of one length"),
        (b"1 2 3\n4 5 6\n", {"VERSION": "0.4"}, "can't be read as a PCD file"),
        (b"1 2 3\n4 5 6\n", {"COUNT": None, "FIELDS": " ".join(["x"] * 1025)}, "of one length"),
        (bytes(7), PACKED, "need 8 bytes, 7 are there"),
        (struct.pack("<II", 9, 24) + bytes(8), PACKED, "the packed points need 9 bytes, 8 are there"),
        (struct.pack("<II", 8, 25) + bytes(8), PACKED, "take 24 bytes, the packed ones claim 25"),
        (struct.pack("<II", 8, 24) + b"\xff" * 8, PACKED, "can't be read as a PCD file"),
        (struct.pack("<II", 8, 1_200_000_000) + bytes(8), PACKED | {"WIDTH": "100000000", "POINTS": "100000000"}, "claim to unpack from 8"),
    ],
)
def test_bad_files_are_named(tmp_path, data, changed, message):
    with pytest.raises(InputError, match=f"a.pcd.*{message}"):
        read_pcd(write(tmp_path, data, **changed))


def test_text_is_read_as_it_stands_whatever_size_the_header_gives(tmp_path):
    """A northing in four bytes is off by up to a quarter of a metre."""
    path = write(tmp_path, b"412345.678 5400000.456 1.5\n412345.679 5400000.457 1.5\n")
    np.testing.assert_array_equal(read_pcd(path).points, [[412345.678, 5400000.456, 1.5], [412345.679, 5400000.457, 1.5]])


@ENCODINGS
def test_fields_in_capitals(tmp_path, encoding):
    path = write_pcd(tmp_path / "a.pcd", POINTS, encoding)
    path.write_bytes(path.read_bytes().replace(b"FIELDS x y z", b"FIELDS X Y Z"))
    np.testing.assert_allclose(read_pcd(path).points, POINTS, rtol=0, atol=WRITTEN_M[encoding])
