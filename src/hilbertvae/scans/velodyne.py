"""Reader of `.bin` scans, float32 without a header: x, y, z, intensity as KITTI has them, and in nuScenes' `.pcd.bin` a ring."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.scans.file_points import FilePoints, reading

NUSCENES = ".pcd.bin"
MOST_RINGS = 128
"""Lasers of the largest spinning lidars; rings count from 0."""


def read_velodyne(path: str | os.PathLike) -> FilePoints:
    """The returns of one scan, metres, sensor frame; the file has no origin.

    A name that ends in `.pcd.bin` has five numbers a return (20 bytes), as nuScenes writes them; any other four (16 bytes). Raises
    `InputError` unless the file is whole returns, and where four are expected and the file looks like five.
    """
    path = Path(path)
    with reading(path, "a KITTI scan (.bin)"):
        size = path.stat().st_size
        numbers, names = (5, "x, y, z, intensity, ring") if path.name.lower().endswith(NUSCENES) else (4, "x, y, z, intensity")
        # Nothing in the file says how many numbers a return has, so five taken for four would be a wrong map, not an error.
        if numbers == 4 and size and size % 20 == 0 and _has_rings(np.fromfile(path, "<f4").reshape(-1, 5)):
            raise InputError(f"{path}: expected 4 numbers a return; it looks like 5, as nuScenes writes them: name it {NUSCENES}")
        if size == 0 or size % (4 * numbers):
            raise InputError(f"{path}: truncated or foreign; expected float32 {names} ({4 * numbers} bytes a return), got {size} bytes")
        return FilePoints(np.fromfile(path, "<f4").reshape(-1, numbers)[:, :3].astype(np.float64))


def _has_rings(rows: np.ndarray) -> bool:
    """Whether the last column of `rows (N, 5)` counts lasers: whole numbers, several of them, and not because all numbers are whole."""
    rings = rows[:, 4]
    if not ((rings >= 0) & (rings < MOST_RINGS) & (rings == np.floor(rings))).all():
        return False
    return bool((rings != rings[0]).any() and (rows[:, :4] != np.floor(rows[:, :4])).any())
