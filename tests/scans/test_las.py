import struct
import subprocess
import sys

import numpy as np
import pytest
from point_writers import POINTS, UTM, write_las

from hilbertvae.checks import InputError
from hilbertvae.scans import las
from hilbertvae.scans.las import read_las

KINDS = pytest.mark.parametrize("name", ["a.las", "a.laz"])


@KINDS
@pytest.mark.parametrize(("point_format", "version"), [(0, "1.2"), (3, "1.2"), (5, "1.3"), (6, "1.4"), (7, "1.4"), (8, "1.4")])
def test_utm_coordinates_keep_the_millimetre_and_agree_with_laspy(tmp_path, name, point_format, version):
    laspy = pytest.importorskip("laspy")
    path = write_las(tmp_path / name, POINTS + UTM, point_format=point_format, version=version)
    points = read_las(path).points
    np.testing.assert_allclose(points, POINTS + UTM, rtol=0, atol=0.000501)
    np.testing.assert_array_equal(points, laspy.read(path).xyz)


@KINDS
@pytest.mark.parametrize(("point_format", "version"), [(0, "1.2"), (3, "1.2"), (6, "1.4"), (7, "1.4")])
def test_withheld_points_are_left_out(tmp_path, name, point_format, version):
    """And no others: not the synthetic, the key points, nor those of any class."""
    laspy = pytest.importorskip("laspy")
    las = laspy.read(write_las(tmp_path / name, POINTS, point_format=point_format, version=version))
    las.withheld[[3, 4, 40]] = 1
    las.synthetic[4:9], las.key_point[7:12] = 1, 1
    las.classification[:] = np.arange(len(POINTS)) % 32
    las.write(str(tmp_path / name))
    points = read_las(tmp_path / name).points
    assert np.flatnonzero(np.isnan(points).any(axis=1)).tolist() == [3, 4, 40]
    kept = np.isfinite(points).all(axis=1)
    np.testing.assert_array_equal(points[kept], las.xyz[kept])


def test_many_chunks(tmp_path):
    points = np.random.default_rng(0).normal(0, 20, (120_000, 3))
    np.testing.assert_allclose(read_las(write_las(tmp_path / "a.laz", points)).points, points, rtol=0, atol=0.000501)


def changed(path, place, form, *values):
    content = bytearray(path.read_bytes())
    struct.pack_into(form, content, place, *values)
    path.write_bytes(content)
    return path


@KINDS
@pytest.mark.parametrize(
    ("place", "form", "values", "message"),
    [
        (0, "4s", (b"LOSF",), "starts with 'LASF'"),
        (24, "<BB", (2, 0), "expected LAS 1.0 to 1.4, got 2.0"),
        (96, "<I", (4_000_000_000,), "the points start at byte 4000000000"),
        (100, "<I", (4_000_000_000,), "after 4000000000 blocks"),
        (104, "<B", (11,), "expected a point format of 0 to 10"),
        (105, "<H", (33,), "got format 3 of 33 bytes"),
        (107, "<I", (1_000_000_000,), "truncated or forged; the header's points"),
        (131, "<d", (0.0,), "expected positive scales"),
        (139, "<d", (np.nan,), "expected positive scales"),
        (155, "<d", (1e300,), "expected positive scales and finite offsets"),
    ],
)
def test_bad_headers_are_named(tmp_path, name, place, form, values, message):
    with pytest.raises(InputError, match=f"{name}.*{message}"):
        read_las(changed(write_las(tmp_path / name), place, form, *values))


def test_a_forged_count_of_a_new_header(tmp_path):
    for name in ("a.las", "a.laz"):
        path = changed(write_las(tmp_path / name, point_format=6, version="1.4"), 247, "<Q", 10**18)
        with pytest.raises(InputError, match=f"{name}.*truncated or forged; the header's points"):
            read_las(path)


def test_forged_chunks(tmp_path):
    path = write_las(tmp_path / "a.laz")
    content = path.read_bytes()
    (start,) = struct.unpack_from("<I", content, 96)
    (table,) = struct.unpack_from("<q", content, start)
    for place, form, value, message in [
        (start, "<q", 10**12, "the chunk table would be at byte 1000000000000"),
        (start, "<q", -2, "the chunk table would be at byte -2"),
        (table + 4, "<I", 2**32 - 1, "4294967295 chunks claimed for 60 points"),
    ]:
        path.write_bytes(content)
        with pytest.raises(InputError, match=message):
            read_las(changed(path, place, form, value))


def test_a_layer_that_claims_gigabytes(tmp_path):
    """The layers of a chunk say their sizes in the open, and lazrs takes memory for them before it looks: this ends its process."""
    path = write_las(tmp_path / "a.laz", point_format=6, version="1.4")
    (start,) = struct.unpack_from("<I", path.read_bytes(), 96)
    with pytest.raises(InputError, match="damaged LAZ file, can't be unpacked"):
        read_las(changed(path, start + 8 + 30 + 4, "<I", 2**32 - 1))


def test_unpacking_that_does_not_end(tmp_path, monkeypatch):
    monkeypatch.setattr(las, "LAZ_TIMEOUT_S", 0.01)
    with pytest.raises(InputError, match="unpacking it did not end within 0 s"):
        read_las(write_las(tmp_path / "a.laz"))


def test_no_points(tmp_path):
    laspy = pytest.importorskip("laspy")
    for name in ("a.las", "a.laz"):
        laspy.LasData(laspy.LasHeader(point_format=3, version="1.2")).write(str(tmp_path / name))
        assert read_las(tmp_path / name).points.shape == (0, 3)


def test_a_missing_extra_is_named(tmp_path, monkeypatch):
    path = write_las(tmp_path / "a.laz")
    monkeypatch.setitem(sys.modules, "lazrs", None)
    with pytest.raises(InputError, match=r"pip install 'hilbertvae\[points\]'"):
        read_las(path)


DAMAGE = """
import random, sys
from pathlib import Path
from hilbertvae.checks import InputError
from hilbertvae.scans.las import read_las
content, path = Path(sys.argv[1]).read_bytes(), Path(sys.argv[1]).with_name("damaged.laz")
for seed in range(int(sys.argv[2])):
    rng, damaged = random.Random(seed), bytearray(content)
    for _ in range(rng.choice([1, 2, 5, 30])):
        damaged[rng.randrange(len(damaged)) if rng.random() < 0.5 else rng.randrange(500)] = rng.choice([0, 255, rng.randrange(256)])
    path.write_bytes(damaged)
    try:
        read_las(path)
    except InputError:
        pass
print("survived")
"""


@pytest.mark.parametrize(("point_format", "version"), [(3, "1.2"), (7, "1.4")])
def test_damaged_files_end_no_interpreter(tmp_path, point_format, version):
    """In a process of its own, under 6 GB of address space: a crash here would be one of whoever reads the file."""
    pytest.importorskip("resource")
    path = write_las(tmp_path / "a.laz", point_format=point_format, version=version)
    limit = "import resource; resource.setrlimit(resource.RLIMIT_AS, (6 * 2**30,) * 2)"
    done = subprocess.run([sys.executable, "-c", limit + DAMAGE, str(path), "15"], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0 and done.stdout == "survived\n", done.stderr
