"""Reader of one array of points in numpy's `.npy`. Nothing is unpickled."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.scans.file_points import FilePoints, reading

KINDS = "fiu"
"""numpy's letters of numbers that coordinates may be."""


def read_npy(path: str | os.PathLike) -> FilePoints:
    """An array (N, 2) or (N, 3), metres; it has no place for origins.

    Raises `InputError` for a file that is missing, truncated or foreign, and for other shapes or types.
    """
    path = Path(path)
    with reading(path, "a .npy file"):
        with open(path, "rb") as file:
            foreign = not file.read(6).startswith(b"\x93NUMPY")
        if foreign:
            raise InputError(f"{path}: expected a .npy file, which starts with '\\x93NUMPY'")
        found = np.load(path, mmap_mode="r", allow_pickle=False)  # mapped, so that a forged shape takes no memory
        if found.shape[:1] == (0,) and found.ndim < 3:  # numpy makes (0,) of an empty list
            return FilePoints(np.empty((0, 3)))
        if found.ndim != 2 or found.shape[1] not in (2, 3):
            more = ": write its first columns, points[:, :3], if these are x, y, z" if found.ndim == 2 and found.shape[1] > 3 else ""
            raise InputError(f"{path}: expected points of shape (N, 2) or (N, 3), got {found.shape}{more}")
        if found.dtype.kind not in KINDS:
            raise InputError(f"{path}: expected points of numbers, got dtype {found.dtype}")
        return FilePoints(np.array(found, dtype=np.float64))
