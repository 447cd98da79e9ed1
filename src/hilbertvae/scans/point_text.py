"""Reader of points as plain text (`.xyz`, `.txt`, `.csv`): one point a line, columns apart by spaces, tabs, commas or semicolons."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.scans.file_points import FilePoints, reading

MAX_LINE = 65536
"""Bytes of the longest first line: a table of points has tens of columns, a foreign file may have no line end at all."""
COMMENTS = ("#", "//")


def number_table(
    lines: Iterable[bytes], delimiter: str | None = None, columns: Sequence[int] | None = None, max_rows: int | None = None
) -> np.ndarray:
    """(N, C) float64 of lines of numbers, comments and empty lines left out; a ValueError for ragged rows or no numbers."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # numpy warns of empty lines and of no rows; the second is an error of the caller's
        return np.loadtxt(lines, np.float64, COMMENTS, delimiter, usecols=columns, max_rows=max_rows, ndmin=2, encoding="latin1")


def read_point_text(path: str | os.PathLike) -> FilePoints:
    """The points of a table, metres. Two columns are 2D; of three and more the first three are x, y, z.

    A first line that is not numbers names the columns: x, y and, in 3D, z are then found by name, whatever stands beside them.
    Lines that start with # or // are comments. `nan` is a beam without a return. Raises `InputError` for anything else.
    """
    path = Path(path)
    with reading(path, "a text file of points"), open(path, "rb") as file:
        start, first = 0, b""
        for line in iter(lambda: file.readline(MAX_LINE), b""):
            first = line.strip()
            if first and not first.startswith((b"#", b"//")):
                break
            start, first = file.tell(), b""
        if not first:
            raise InputError(f"{path}: expected lines of numbers, found none")
        delimiter = next((mark for mark in (",", ";") if mark.encode() in first), None)
        fields = [field.strip(' \t"') for field in first.decode("latin1").split(delimiter)]
        columns = None
        if not all(map(_is_number, fields)):
            columns = _named_columns(path, fields)
            start = file.tell()
        file.seek(start)
        table = number_table(file, delimiter, columns)
        if not len(table):
            raise InputError(f"{path}: expected lines of numbers, found none")
        if table.shape[1] < 2:
            raise InputError(f"{path}: expected 2 or more columns, found {table.shape[1]}")
        return FilePoints(table[:, :3])


def _is_number(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return False
    return True


def _named_columns(path: Path, fields: list[str]) -> list[int]:
    names = [field.lower() for field in fields]
    if not {"x", "y"} <= set(names):
        raise InputError(f"{path}: expected numbers, or a first line that names columns x, y (and z), got {' '.join(fields)[:60]!r}")
    return [names.index(name) for name in "xyz" if name in names]
