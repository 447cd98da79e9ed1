import re
import struct
import subprocess
import sys

import numpy as np
import pytest
from point_writers import POINTS, UTM, write_e57

from hilbertvae.checks import InputError
from hilbertvae.scans import e57
from hilbertvae.scans.e57 import read_e57
from hilbertvae.scans.point_files import read_point_file

pytest.importorskip("pye57")
HALF = np.sqrt(0.5)
TURN = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
"""A quarter turn to the left, as the quaternion w x y z (HALF, 0, 0, HALF)."""


def test_each_scan_has_its_pose(tmp_path):
    clouds, places = POINTS.reshape(3, 20, 3), UTM + np.array([[0, 0, 0], [5, 0, 0], [0, 5, 1]])
    path = write_e57(tmp_path / "a.e57", *[(cloud, (HALF, 0, 0, HALF), place) for cloud, place in zip(clouds, places, strict=True)])
    scans = read_point_file(path, max_range_m=1000)
    for number in range(3):
        chosen = scans.scan == number
        np.testing.assert_allclose(scans.points[chosen], clouds[number] @ TURN.T + places[number], rtol=0, atol=1e-6)
        np.testing.assert_allclose(scans.origins[chosen], np.tile(places[number], (20, 1)), rtol=0, atol=1e-9)
        np.testing.assert_array_equal(scans.beam[chosen], np.arange(20))
    second = read_point_file(path, max_range_m=1000, every=2)
    np.testing.assert_array_equal(second.points, scans.points[scans.scan != 1])


def test_scans_without_a_pose_do_not_say_where_the_sensor_stood(tmp_path):
    path = write_e57(tmp_path / "a.e57", (POINTS, None, None))
    found = read_e57(path)
    assert found.origins is None
    np.testing.assert_array_equal(found.points, POINTS)
    with pytest.raises(InputError, match="a.e57: says not where its beams started"):
        read_point_file(path)
    # One of several is often the frame of the others: then its identity is meant.
    found = read_e57(write_e57(tmp_path / "b.e57", (POINTS, None, None), (POINTS, None, (1, 2, 3))))
    np.testing.assert_array_equal(found.origins[[0, 60]], [[0, 0, 0], [1, 2, 3]])


def test_points_that_are_marked_invalid_are_no_returns(tmp_path):
    invalid = np.arange(len(POINTS)) % 7 == 3
    found = read_e57(write_e57(tmp_path / "a.e57", (POINTS, None, (1, 2, 3)), invalid=invalid))
    np.testing.assert_array_equal(np.isnan(found.points).all(axis=1), invalid)
    scans = read_point_file(tmp_path / "a.e57", max_range_m=1000)
    np.testing.assert_array_equal(scans.beam, np.flatnonzero(~invalid))


def test_spherical_coordinates(tmp_path):
    found = read_e57(write_spherical(tmp_path / "a.e57", POINTS))
    np.testing.assert_allclose(found.points, POINTS, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(found.origins, np.zeros_like(POINTS))


def write_spherical(path, points, count=None):
    """One scan without a pose, of ranges, azimuths and elevations as float64, through the library beneath pye57."""
    from pye57 import E57, libe57

    x, y, z = points.T
    values = {"Range": np.linalg.norm(points, axis=1), "Azimuth": np.arctan2(y, x), "Elevation": np.arctan2(z, np.hypot(x, y))}
    with E57(str(path), "w") as file:
        image, buffers, kept = file.image_file, libe57.VectorSourceDestBuffer(), []
        scan, prototype = libe57.StructureNode(image), libe57.StructureNode(image)
        scan.set("guid", libe57.StringNode(image, "{0}"))
        for name, column in values.items():
            prototype.set(f"spherical{name}", libe57.FloatNode(image, 0.0, libe57.E57_DOUBLE, -1e3, 1e3))
            kept.append(np.ascontiguousarray(column))
            buffers.append(libe57.SourceDestBuffer(image, f"spherical{name}", kept[-1], len(points), True, True))
        vector = libe57.CompressedVectorNode(image, prototype, libe57.VectorNode(image, True))
        scan.set("points", vector)
        file.data3d.append(scan)
        writer = vector.writer(buffers)
        writer.write(len(points))
        writer.close()
    return path


def checksummed(content):
    """The bytes with the checksum of each page of 1024 set right, CRC-32C, as a forger would: the library looks at it first."""
    table = []
    for value in range(256):
        for _ in range(8):
            value = (value >> 1) ^ (0x82F63B78 if value & 1 else 0)
        table.append(value)
    content = bytearray(content)
    for start in range(0, len(content) - 1023, 1024):
        crc = 0xFFFFFFFF
        for byte in content[start : start + 1020]:
            crc = table[(crc ^ byte) & 255] ^ (crc >> 8)
        struct.pack_into(">I", content, start + 1020, crc ^ 0xFFFFFFFF)
    return bytes(content)


def forged(path, old, new):
    """The file with other text in its XML; what is longer by it is taken from the scan's guid."""
    content = path.read_bytes()
    assert checksummed(content) == content
    plain = b"".join(content[start : start + 1020] for start in range(0, len(content), 1024))
    assert plain.count(old) == 1
    guid = re.findall(rb"CDATA\[\{(.{36})\}", plain)[-1]
    plain = plain.replace(old, new).replace(guid, guid[len(new) - len(old) :])
    path.write_bytes(checksummed(b"".join(plain[start : start + 1020] + bytes(4) for start in range(0, len(plain), 1020))))
    return path


def test_a_forged_count(tmp_path):
    path = write_e57(tmp_path / "a.e57", (POINTS, None, (1, 2, 3)))
    for old, new, message in [
        (b"60", b"59", ""),
        (b"59", b"99", "damaged E57 file"),
        (b"99", b"1000000000", "truncated or forged: 1000000000 points claimed in [0-9]* bytes"),
    ]:
        forged(path, b'recordCount="' + old, b'recordCount="' + new)
        if message:
            with pytest.raises(InputError, match=f"a.e57: .*{message}"):
                read_e57(path)
        else:
            assert len(read_e57(path).points) == 59


@pytest.mark.parametrize(
    ("place", "form", "value", "message"),
    [
        (0, "8s", b"ASTM-E58", "starts with 'ASTM-E57'"),
        (8, "<I", 2, "expected E57 version 1, got 2"),
        (16, "<Q", 10**12, "truncated or forged; the header's pages need 1000000000000 bytes"),
        (24, "<Q", 10**12, "truncated or forged; the header's XML"),
        (32, "<Q", 10**12, "truncated or forged; the header's XML"),
        (40, "<Q", 10**12, "damaged E57 file"),
    ],
)
def test_bad_headers_are_named(tmp_path, place, form, value, message):
    path = write_e57(tmp_path / "a.e57", (POINTS, None, (1, 2, 3)))
    content = bytearray(path.read_bytes())
    struct.pack_into(form, content, place, value)
    path.write_bytes(checksummed(content))
    with pytest.raises(InputError, match=f"a.e57.*{message}"):
        read_e57(path)


def test_a_rotation_that_is_none(tmp_path):
    path = write_e57(tmp_path / "a.e57", (POINTS, (0.5, 0, 0, 0.5), (1, 2, 3)))
    with pytest.raises(InputError, match="a.e57, scan 0: expected a rigid pose"):
        read_e57(path)


def test_reading_that_does_not_end(tmp_path, monkeypatch):
    monkeypatch.setattr(e57, "E57_TIMEOUT_S", 0.01)
    with pytest.raises(InputError, match="unpacking it did not end within 0 s"):
        read_e57(write_e57(tmp_path / "a.e57"))


def test_a_missing_extra_is_named(tmp_path, monkeypatch):
    path = write_e57(tmp_path / "a.e57")
    monkeypatch.setitem(sys.modules, "pye57", None)
    with pytest.raises(InputError, match=r"pip install 'hilbertvae\[points\]'"):
        read_e57(path)


DAMAGE = """
import random, sys
from pathlib import Path
sys.path.insert(0, sys.argv[3])
from test_e57 import checksummed
from hilbertvae.checks import InputError
from hilbertvae.scans.e57 import read_e57
content, path = Path(sys.argv[1]).read_bytes(), Path(sys.argv[1]).with_name("damaged.e57")
for seed in range(int(sys.argv[2])):
    rng, damaged = random.Random(seed), bytearray(content)
    for _ in range(rng.choice([1, 2, 5, 30])):
        damaged[rng.randrange(48, len(damaged))] = rng.choice([0, 48, 57, 255, rng.randrange(256)])
    path.write_bytes(checksummed(damaged) if seed % 4 else damaged)
    try:
        read_e57(path)
    except InputError as error:
        assert str(path) in str(error)
print("survived")
"""


def test_damaged_files_end_no_interpreter(tmp_path):
    """In a process of its own: a crash here would be one of whoever reads the file."""
    path = write_e57(tmp_path / "a.e57", (POINTS, None, (1, 2, 3)))
    here = __file__.rsplit("/", 1)[0]
    done = subprocess.run([sys.executable, "-c", DAMAGE, str(path), "25", here], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0 and done.stdout == "survived\n", done.stderr
