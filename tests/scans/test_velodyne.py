import struct

import numpy as np
import pytest

from hilbertvae.checks import InputError
from hilbertvae.scans.velodyne import read_velodyne


def test_little_endian_float32(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(struct.pack("<8f", 1, 2, 3, 0.5, -4, 5.5, np.nan, 0))
    np.testing.assert_array_equal(read_velodyne(path).points, [[1, 2, 3], [-4, 5.5, np.nan]])


@pytest.mark.parametrize("size", [0, 1, 15, 17])
def test_parts_of_returns(tmp_path, size):
    (tmp_path / "a.bin").write_bytes(bytes(size))
    with pytest.raises(InputError, match=f"a.bin: truncated or foreign; .* got {size} bytes"):
        read_velodyne(tmp_path / "a.bin")


RNG = np.random.default_rng(5)
FIVE = np.column_stack([RNG.normal(0, 20, (400, 3)), RNG.integers(0, 256, 400), np.arange(400) % 32]).astype("<f4")
"""As nuScenes has them: x, y, z, intensity, ring. 8000 bytes are whole returns of 16 bytes as well."""


@pytest.mark.parametrize("name", ["a.pcd.bin", "A.PCD.BIN"])
def test_five_numbers_a_return_by_name(tmp_path, name):
    FIVE.tofile(tmp_path / name)
    np.testing.assert_array_equal(read_velodyne(tmp_path / name).points, FIVE[:, :3])
    (tmp_path / name).write_bytes(bytes(16))
    with pytest.raises(InputError, match=r"expected float32 x, y, z, intensity, ring \(20 bytes a return\), got 16 bytes"):
        read_velodyne(tmp_path / name)


@pytest.mark.parametrize("count", [400, 399])
def test_five_numbers_a_return_under_kittis_name(tmp_path, count):
    FIVE[:count].tofile(tmp_path / "a.bin")
    with pytest.raises(InputError, match="a.bin: expected 4 numbers a return; it looks like 5, as nuScenes writes them: name it .pcd.bin"):
        read_velodyne(tmp_path / "a.bin")


@pytest.mark.parametrize("scale", [0, 1])
def test_four_numbers_a_return_whatever_the_size(tmp_path, scale):
    """Whole intensities and an empty file of zeros among them."""
    four = (scale * FIVE[:, :4]).astype("<f4")
    four.tofile(tmp_path / "a.bin")
    assert four.nbytes % 80 == 0
    np.testing.assert_array_equal(read_velodyne(tmp_path / "a.bin").points, four[:, :3])
    whole = np.arange(80, dtype="<f4").reshape(-1, 4)
    whole.tofile(tmp_path / "b.bin")
    np.testing.assert_array_equal(read_velodyne(tmp_path / "b.bin").points, whole[:, :3])
