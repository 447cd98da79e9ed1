"""Arrays of numpy's `.npz` archives, whose declared sizes are checked before memory is taken."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np

from hilbertvae.checks import InputError

HEADER_BYTES = 16384
"""More than the header of an array of numbers takes."""


def array_header(path: Path, archive: zipfile.ZipFile, name: str, kinds: str = "fiu") -> tuple[tuple[int, ...], np.dtype]:
    """The shape and dtype of an array `name`, checked against the size of its member of the archive; kinds: numpy's letters of types.

    Raises `InputError` for a type of another kind, sizes that do not agree, and packing that numpy does not use.
    """
    member = archive.getinfo(f"{name}.npy")
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise InputError(f"{path}: expected members that are stored or deflated, {name} is neither")
    with archive.open(member) as file:
        start = io.BytesIO(file.read(HEADER_BYTES))
    version = np.lib.format.read_magic(start)
    if version not in ((1, 0), (2, 0)):
        raise InputError(f"{path}: {name} has npy version {version}, expected 1.0 or 2.0 as arrays of numbers have")
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(start)
    if dtype.kind not in kinds:
        raise InputError(f"{path}: expected {name} of numbers, got dtype {dtype}")
    needed = dtype.itemsize
    for length in shape:
        needed *= int(length)
    there = member.file_size - start.tell()
    if min(shape, default=0) < 0 or needed != there:
        raise InputError(f"{path}: truncated or forged; {name} {shape} {dtype} take {needed} bytes, {there} are there")
    return shape, dtype


def read_array(archive: zipfile.ZipFile, name: str) -> np.ndarray:
    """The array; nothing is unpickled."""
    with archive.open(f"{name}.npy") as file:
        return np.lib.format.read_array(file, allow_pickle=False)
