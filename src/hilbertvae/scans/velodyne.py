"""Reader of KITTI's `.bin` scans: x, y, z and intensity of each return, as little-endian float32."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.scans.file_points import FilePoints, reading

RETURN_BYTES = 16


def read_velodyne(path: str | os.PathLike) -> FilePoints:
    """The returns of one scan, metres, sensor frame; the file has no origin. `InputError` unless it is whole returns of 16 bytes."""
    path = Path(path)
    with reading(path, "a KITTI scan (.bin)"):
        size = path.stat().st_size
        if size == 0 or size % RETURN_BYTES:
            raise InputError(f"{path}: truncated or foreign; expected float32 x, y, z, intensity (16 bytes a return), got {size} bytes")
        return FilePoints(np.fromfile(path, "<f4").reshape(-1, 4)[:, :3].astype(np.float64))
