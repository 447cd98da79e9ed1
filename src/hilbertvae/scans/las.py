"""Reader of LAS files, and of LAZ files through laspy in a process of its own."""

from __future__ import annotations

import os
import struct
import warnings
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np

from hilbertvae.checks import InputError, extra_module
from hilbertvae.scans.apart import read_apart
from hilbertvae.scans.file_points import FilePoints, check_expansion, check_fits, reading
from hilbertvae.scans.las_units import EXTENDED_HEAD, metres_per_unit, system_records

HEADER_BYTES = 375
RECORD_BYTES = (20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67)
"""The shortest record of each point format."""
LAZ_TIMEOUT_S = 60.0
"""What unpacking may take beyond a second per megabyte, at which even a slow machine has long finished."""
WITHHELD_BYTE, OLD_WITHHELD, NEW_WITHHELD = 15, 0x80, 0x04
"""Where a record has the flag of a point that counts as deleted, and its bit in formats 0 to 5 and in those from 6."""
COPIES = 6
"""How often the records and what is made of them may be in memory at once."""


@dataclass(frozen=True)
class _Header:
    size: int
    start: int
    count: int
    record_bytes: int
    withheld: int
    scale: np.ndarray
    offset: np.ndarray
    packed: bool
    unit_m: np.ndarray


def read_las(path: str | os.PathLike) -> FilePoints:
    """The points, metres, file frame (often UTM: float64 keeps the centimetre). LAS has no place for an origin. Feet, where the file says
    that its coordinates are such, become metres, with a warning; degrees are refused.

    Points marked as withheld, which the format's specification takes as deleted, are NaN: they keep their place in the file's order.
    No backend of laspy stands a damaged LAZ file: laszip writes where it should not and lazrs ends the interpreter. So LAZ is
    unpacked in a process of its own with a limit on memory and time. Raises `InputError` for files that are missing, foreign or damaged.
    """
    path = Path(path)
    with reading(path, "a LAS or LAZ file"), open(path, "rb") as file:
        header = _header(path, file)
        if header.packed:
            counts, withheld = _unpacked_apart(path, file, header)
        else:
            check_fits(path, "the header's points", header.count * header.record_bytes, header.size - header.start)
            names, kinds, places = ["x", "y", "z", "flags"], ["<i4"] * 3 + ["u1"], [0, 4, 8, WITHHELD_BYTE]
            record = np.dtype({"names": names, "formats": kinds, "offsets": places, "itemsize": header.record_bytes})
            file.seek(header.start)
            rows = np.fromfile(file, record, header.count)
            counts = np.column_stack([rows[axis] for axis in "xyz"])
            withheld = rows["flags"] & header.withheld != 0
        points = counts * header.scale + header.offset
        if (header.unit_m != 1).any():
            points *= header.unit_m
            warnings.warn(f"{path}: its coordinates are in feet, as its header says, and are made metres", stacklevel=3)
        points[withheld] = np.nan
        return FilePoints(points)


def _header(path: Path, file) -> _Header:
    start, size = file.read(HEADER_BYTES), os.fstat(file.fileno()).st_size
    if not start.startswith(b"LASF"):
        raise InputError(f"{path}: expected a LAS or LAZ file, which starts with 'LASF'")
    check_fits(path, "the header", 227, len(start))
    major, minor = start[24], start[25]
    header_bytes, data_start, blocks, form, record_bytes, count = struct.unpack_from("<HIIBHI", start, 94)
    if major != 1 or minor > 4:
        raise InputError(f"{path}: expected LAS 1.0 to 1.4, got {major}.{minor}")
    if minor == 4:
        check_fits(path, "the header", HEADER_BYTES, len(start))
        (count,) = struct.unpack_from("<Q", start, 247)
    if not header_bytes <= data_start <= size or blocks * 54 > data_start:
        raise InputError(f"{path}: truncated or forged; the points start at byte {data_start} after {blocks} blocks, of {size} bytes")
    # Bit 7 marks packed points; bit 6 stays set while a file is being packed.
    packed, form = bool(form & 0xC0), form & 0x3F
    if form >= len(RECORD_BYTES) or record_bytes < RECORD_BYTES[form]:
        raise InputError(f"{path}: expected a point format of 0 to 10 and its record, got format {form} of {record_bytes} bytes")
    numbers = np.frombuffer(start, "<f8", 6, 131)
    if not np.isfinite(numbers).all() or (numbers[:3] <= 0).any() or np.abs(numbers).max() > 1e12:
        raise InputError(f"{path}: expected positive scales and finite offsets, got {numbers.tolist()}")
    withheld = OLD_WITHHELD if form < 6 else NEW_WITHHELD
    behind_start, behind = struct.unpack_from("<QI", start, 235) if minor == 4 else (size, 0)
    records = system_records(file, header_bytes, blocks, end=data_start), system_records(file, behind_start, behind, EXTENDED_HEAD)
    unit_m = metres_per_unit(chain(*records), path)
    return _Header(size, data_start, count, record_bytes, withheld, numbers[:3], numbers[3:], packed, unit_m)


def _unpacked_apart(path: Path, file, header: _Header) -> tuple[np.ndarray, np.ndarray]:
    """(N, 3) int32, counts of scale, and (N,) bool, withheld points, of a LAZ file whose claims are sound enough to try."""
    extra_module("points", "laspy"), extra_module("points", "lazrs")
    unpacked = header.count * header.record_bytes
    check_expansion(path, "the header's points", unpacked, header.size - header.start)
    if not header.count:
        return np.empty((0, 3), np.int32), np.empty(0, bool)
    _check_chunks(path, file, header)
    found = read_apart(path, "LAZ file", "laz_process.py", COPIES * unpacked, LAZ_TIMEOUT_S + unpacked / 1e6)
    if len(found) != 13 * header.count:
        raise InputError(f"{path}: damaged LAZ file, can't be unpacked ({header.count} points declared, {len(found)} bytes came out)")
    counts = np.frombuffer(found, np.int32, 3 * header.count).reshape(3, -1).T
    return counts, np.frombuffer(found, np.uint8, offset=12 * header.count) != 0


def _check_chunks(path: Path, file, header: _Header) -> None:
    """An `InputError` unless the table of chunks is in the file and has no more chunks than there are points."""
    check_fits(path, "the place of the chunk table", 8, header.size - header.start)
    file.seek(header.start)
    (table,) = struct.unpack("<q", file.read(8))
    if table == -1:  # written as a stream: the place is at the end
        file.seek(header.size - 8)
        (table,) = struct.unpack("<q", file.read(8))
    if not header.start + 8 <= table <= header.size - 8:
        raise InputError(f"{path}: truncated or forged; the chunk table would be at byte {table} of {header.size}")
    file.seek(table)
    _, chunks = struct.unpack("<II", file.read(8))
    if chunks > header.count:
        raise InputError(f"{path}: damaged LAZ file; {chunks} chunks claimed for {header.count} points")
