"""Reader of PCD files (ASCII, binary or compressed), through pypcd4."""

from __future__ import annotations

import codecs
import io
import os
import re
import struct
from pathlib import Path

import numpy as np

from hilbertvae.checks import InputError, extra_module
from hilbertvae.scans.file_points import FilePoints, axis_names, check_expansion, check_fits, reading
from hilbertvae.scans.point_text import number_table

MAX_VALUES = 1024
"""Numbers a point may have; pypcd4 makes a name for each before it looks at the data."""
OLD_VERSIONS = {".5", "0.5", ".6", "0.6"}
"""Read like 0.7: the lines that files of these may lack, COUNT and VIEWPOINT, have defaults. pypcd4 knows 0.7 alone."""
NEEDED = ("FIELDS", "SIZE", "TYPE", "WIDTH", "POINTS")
"""Lines of a header without which there is no cloud."""
PLAIN_NAME = re.compile(r"[\w.-]+", re.ASCII)
DEFAULT_VIEWPOINT = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
NO_VIEWPOINTS = (DEFAULT_VIEWPOINT, (0.0,) * 7)
"""tx ty tz qw qx qy qz: what writers put that don't know where the sensor stood, some of them nothing but zeros."""


def read_pcd(path: str | os.PathLike) -> FilePoints:
    """The points, metres, file frame: NaN rows are the no-returns of an organised cloud. 2D where the file has no field z.

    A VIEWPOINT that is not the default gives the origin: the place of the sensor in the frame of the points, as PCL's normals and
    range images take it. Its quaternion says where the sensor looked, which rays don't need; the points are not turned by it.
    Raises `InputError` for a file that is missing, foreign, or shorter than its header says.
    """
    path, pypcd4 = Path(path), extra_module("points", "pypcd4.pypcd4")
    with reading(path, "a PCD file"):
        with open(path, "rb") as file:
            lines, is_plain = _header_lines(file)
            if not lines:
                raise InputError(f"{path}: expected a PCD file's header, found nothing")
            keywords = {line.split()[0].upper() for line in lines}
            if missing := [keyword for keyword in NEEDED if keyword not in keywords]:
                raise InputError(f"{path}: expected a PCD file's header, found no line {', '.join(missing)}")
            mended, start = _as_new(lines), file.tell()
            header = pypcd4.MetaData.parse_header(mended)
            names = _check(path, file, header)
            if header.data.value == "ascii":
                return FilePoints(_ascii(path, file, header, names), _given_origin(path, header, names))
            if is_plain and mended == lines:
                cloud = pypcd4.PointCloud.from_path(path)
            else:  # pypcd4 reads the header again, so it is given a new one
                file.seek(start)
                cloud = pypcd4.PointCloud.from_fileobj(io.BytesIO(header.compose_header().encode() + file.read()))
        rows = np.atleast_1d(cloud.pc_data)
        if len(rows) != header.points:
            raise InputError(f"{path}: truncated or forged; {header.points} points declared, {len(rows)} found")
        points = np.column_stack([rows[name].astype(np.float64) for name in names])
        return FilePoints(points, _given_origin(path, header, names))


def _ascii(path: Path, file, header, names: list[str]) -> np.ndarray:
    """(N, D) as the text has it: SIZE may say 4 bytes, which hold no northing to the centimetre."""
    if not header.points:
        return np.empty((0, len(names)))
    first = np.cumsum([0, *header.count])
    rows = number_table(file, max_rows=header.points + 1)
    if len(rows) != header.points:
        raise InputError(f"{path}: truncated or forged; {header.points} points declared, {len(rows)} found")
    if rows.shape[1] != first[-1]:  # x, y and z would be others'
        raise InputError(f"{path}: expected {first[-1]} numbers a point, as its fields say, found {rows.shape[1]}")
    return rows[:, [first[header.fields.index(name)] for name in names]]


def _header_lines(file) -> tuple[list[str], bool]:
    """The header's lines and the file at its data, as pypcd4 takes them: up to DATA, ten lines at most, comments left out. Also whether
    pypcd4 can read them itself, which takes comments in UTF-8 alone."""
    lines, is_plain = [], True
    if file.read(len(codecs.BOM_UTF8)) == codecs.BOM_UTF8:
        is_plain = False
    else:
        file.seek(0)
    for line in file:
        is_plain &= line.isascii()
        text = line.decode("latin1").strip()
        if text and not text.startswith("#"):
            lines.append(text)
            if text.startswith("DATA") or len(lines) >= 10:
                break
    return lines, is_plain


def _as_new(lines: list[str]) -> list[str]:
    """The header's lines as pypcd4 takes them: of version 0.7, where COUNT is 1 for each field if there is none, as PCL takes it, and with
    names of fields that have no marks but underscores, points and dashes."""
    lines = [_with_plain_names(line) if line.split()[0].upper() == "FIELDS" else line for line in lines]
    words = {line.split()[0].upper(): line.split()[1:] for line in lines}
    if OLD_VERSIONS.intersection(words.get("VERSION", [])[:1]):
        lines = [line for line in lines if line.split()[0].upper() != "VERSION"]
    if "COUNT" not in words and words.get("FIELDS"):
        lines = [*lines, "COUNT" + " 1" * len(words["FIELDS"])]
    return lines


def _with_plain_names(line: str) -> str:
    keyword, *names = line.split()
    return " ".join([keyword, *(name if PLAIN_NAME.fullmatch(name) else f"odd_{place}" for place, name in enumerate(names))])


def _check(path: Path, file, header) -> list[str]:
    """The names of the coordinates' fields; an `InputError` where the header contradicts itself or the file's size."""
    if len({len(header.fields), len(header.size), len(header.type), len(header.count)}) > 1:
        raise InputError(f"{path}: expected FIELDS, SIZE, TYPE and COUNT of one length")
    if sum(header.count) > MAX_VALUES:
        raise InputError(f"{path}: expected at most {MAX_VALUES} numbers a point, the header claims {sum(header.count)}")
    if header.points != header.width * header.height:
        raise InputError(f"{path}: POINTS is {header.points}, WIDTH times HEIGHT {header.width * header.height}")
    single = [field for field, count in zip(header.fields, header.count, strict=True) if count == 1]
    axes = axis_names(single)
    if [axis.lower() for axis in axes[:2]] != ["x", "y"]:
        raise InputError(f"{path}: expected fields x, y (and z), the header has {' '.join(header.fields)[:60]}")
    unpacked, there = header.points * header.build_dtype().itemsize, os.fstat(file.fileno()).st_size - file.tell()
    kind = header.data.value
    if kind == "ascii":
        check_fits(path, "the header's points", 2 * header.points * sum(header.count), there + 1)
    elif kind == "binary":
        check_fits(path, "the header's points", unpacked, there)
    elif header.points:
        check_fits(path, "the sizes of the packed points", 8, there)
        packed, claimed = struct.unpack("<II", file.read(8))
        check_fits(path, "the packed points", packed, there - 8)
        if claimed != unpacked:
            raise InputError(f"{path}: the header's points take {unpacked} bytes, the packed ones claim {claimed}")
        check_expansion(path, "the packed points", unpacked, packed)
    return axes


def _given_origin(path: Path, header, names: list[str]) -> np.ndarray | None:
    if header.viewpoint in NO_VIEWPOINTS:
        return None
    origin = np.array(header.viewpoint[: len(names)], dtype=np.float64)
    if not np.isfinite(origin).all():
        raise InputError(f"{path}: expected a finite VIEWPOINT, got {header.viewpoint}")
    return origin
