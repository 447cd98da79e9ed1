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
