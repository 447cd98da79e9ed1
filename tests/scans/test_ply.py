import io

import numpy as np
import pytest
from point_writers import POINTS, write_ply

from hilbertvae.checks import InputError
from hilbertvae.scans.ply import read_ply


def test_vertices_of_a_mesh_agree_with_trimesh(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    box = trimesh.creation.icosphere(subdivisions=2)
    for encoding in ("ascii", "binary"):
        content = trimesh.exchange.ply.export_ply(box, encoding=encoding, vertex_normal=True)
        (tmp_path / "a.ply").write_bytes(content)
        twin = trimesh.exchange.ply.load_ply(io.BytesIO(content))["vertices"]
        np.testing.assert_allclose(read_ply(tmp_path / "a.ply").points, twin, rtol=0, atol=1e-7)


def written(tmp_path, header, data=b""):
    path = tmp_path / "a.ply"
    path.write_bytes(f"ply\nformat {header}\nend_header\n".encode() + data)
    return path


XYZ = "property double x\nproperty double y\nproperty double z"


def test_elements_ahead_of_the_vertices_and_lists_behind_them(tmp_path):
    data = bytes(2 * 5) + POINTS.astype("<f8").tobytes() + b"\x03" + bytes(12) + b"\x04" + bytes(16)
    camera = "property uchar kind\nproperty float32 zoom\nelement vertex 60\n" + XYZ
    header = f"binary_little_endian 1.0\ncomment made by hand\nelement camera 2\n{camera}\n"
    path = written(tmp_path, header + "element face 2\nproperty list uchar int vertex_indices", data)
    np.testing.assert_array_equal(read_ply(path).points, POINTS)
    rows = "1 2\n" + "\n".join(" ".join(map(repr, row)) for row in POINTS.tolist()) + "\n"
    path = written(tmp_path, f"ascii 1.0\nelement camera 1\n{camera}", rows.encode())
    np.testing.assert_array_equal(read_ply(path).points, POINTS)


@pytest.mark.parametrize("said", ["comment scanned in Ålesund", "obj_info C:\\Scans\\Åland, \x0c\x1c"])
def test_letters_of_other_languages_end_no_line(tmp_path, said):
    path = tmp_path / "a.ply"
    path.write_bytes(f"ply\nformat ascii 1.0\n{said}\nelement vertex 1\n{XYZ}\nend_header\n1 2 3\n".encode())
    np.testing.assert_array_equal(read_ply(path).points, [[1, 2, 3]])


def test_a_comment_that_has_the_word_does_not_end_the_header(tmp_path):
    path = written(tmp_path, f"ascii 1.0\ncomment points follow end_header\nelement vertex 1\n{XYZ}", b"1 2 3\n")
    np.testing.assert_array_equal(read_ply(path).points, [[1, 2, 3]])


@pytest.mark.parametrize(("names", "taken"), [("XYZ", [0, 1, 2]), ("xYZ", [0, 1, 2]), ("XYZxyz", [3, 4, 5]), ("zXY", [1, 2, 0])])
def test_names_in_capitals(tmp_path, names, taken):
    """Those in small letters are meant where both are there."""
    rows = np.resize(POINTS, (20, len(names)))
    header = "element vertex 20\n" + "\n".join(f"property double {name}" for name in names)
    binary = written(tmp_path, f"binary_little_endian 1.0\n{header}", rows.astype("<f8").tobytes())
    np.testing.assert_array_equal(read_ply(binary).points, rows[:, taken])
    text = "\n".join(" ".join(map(repr, row)) for row in rows.tolist()) + "\n"
    np.testing.assert_array_equal(read_ply(written(tmp_path, f"ascii 1.0\n{header}", text.encode())).points, rows[:, taken])


@pytest.mark.parametrize("end", [b"\n", b"\r\n", b" "])
def test_an_end_of_a_line_behind_binary_data(tmp_path, end):
    for encoding in ("binary_little_endian", "binary_big_endian"):
        path = write_ply(tmp_path / "a.ply", encoding=encoding)
        path.write_bytes(path.read_bytes() + end)
        np.testing.assert_array_equal(read_ply(path).points, POINTS)


def test_carriage_returns(tmp_path):
    path = write_ply(tmp_path / "a.ply", encoding="ascii")
    path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    np.testing.assert_allclose(read_ply(path).points, POINTS, rtol=0, atol=1e-7)


@pytest.mark.parametrize(
    ("header", "data", "message"),
    [
        ("ascii 1.0\nelement face 1\nproperty int a", b"1\n", "expected an element vertex, the header has face"),
        ("ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y", b"1 2\n", "expected vertices with x, y and z, they have x y"),
        ("ascii 1.0\nelement vertex 1", b"1 2\n", "with x, y and z, they have no properties"),
        ("ascii 1.0\nelement vertex 1\nproperty quad x", b"1\n", "expected a line of a PLY header, got 'property quad x'"),
        ("ascii 1.0\nelement vertex -1", b"", "got 'element vertex -1'"),
        ("ascii 1.0\nproperty float x", b"", "got 'property float x'"),
        ("morse 1.0\nelement vertex 1", b"", "got 'format morse 1.0'"),
        (f"ascii 1.0\nelement vertex 2\n{XYZ}", b"1 2 3\n", "truncated"),
        (f"ascii 1.0\nelement vertex 3\n{XYZ}", b"1.0 2.0 3.0\n4.00000 5.00000 6.0000\n", "truncated; 3 vertices"),
        (f"ascii 1.0\nelement vertex 2\n{XYZ}", b"1 2 3\n4 5\n6 7 8 \n", "can't be read as a PLY file"),
        (f"ascii 1.0\nelement vertex 2\n{XYZ}", b"1 2 3\n4 a 5\n", "can't be read as a PLY file"),
        (f"ascii 1.0\nelement void 1000000000000\nelement vertex 1\n{XYZ}", b"1 2 3\n", "truncated or forged"),
        (f"binary_little_endian 1.0\nelement vertex 1\n{XYZ}", bytes(25), "take 24 bytes, 25 are there"),
        (f"binary_little_endian 1.0\nelement vertex 1\n{XYZ}", bytes(24) + b"\n\n\n", "take 24 bytes, 27 are there"),
        (f"binary_little_endian 1.0\nelement face 1\nproperty list uchar int a\nelement vertex 1\n{XYZ}", bytes(30), "the vertices ahead"),
        (
            f"binary_little_endian 1.0\nelement vertex 1\n{XYZ}\nproperty list uchar int a",
            bytes(30),
            "vertices of single numbers, they have lists a",
        ),
        (f"binary_little_endian 1.0\nelement vertex 1\n{XYZ}\nproperty double x", bytes(32), "can't be read as a PLY file"),
    ],
)
def test_bad_files_are_named(tmp_path, header, data, message):
    with pytest.raises(InputError, match=f"a.ply.*{message}"):
        read_ply(written(tmp_path, header, data))


def test_no_format_and_no_end(tmp_path):
    path = tmp_path / "a.ply"
    path.write_bytes(b"ply\nelement vertex 0\nend_header\n")
    with pytest.raises(InputError, match="expected a format line"):
        read_ply(path)
    path.write_bytes(b"ply\nformat ascii 1.0\n")
    with pytest.raises(InputError, match="end_header within"):
        read_ply(path)
