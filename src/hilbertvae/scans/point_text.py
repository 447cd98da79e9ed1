"""Reader of points as plain text (`.xyz`, `.txt`, `.csv`, `.asc`, `.pts`): a point a line, columns apart by blanks or marks."""

from __future__ import annotations

import codecs
import os
import re
import warnings
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from pathlib import Path

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.scans.column_names import commented_columns, named_columns, split_fields
from hilbertvae.scans.file_points import FilePoints, NoRows, reading

MAX_LINE = 65536
"""Bytes of the longest first line: a table of points has tens of columns, a foreign file may have no line end at all."""
BLOCK = 2**20
"""Bytes that are looked through at a time."""
COMMENTS = ("#", "//")
COMMENT_AFTER = re.compile(rb"[ \t]+(?:#|//)|(?<=[\d.])(?:#|//)")
"""Where a comment begins behind the first row, or names, one of which may be `ring#`."""
MARGIN = b" \r\n"
"""What is around a row. Tabs may be its delimiters, and then stand beside an empty column."""
QUOTED = re.compile(rb'"([^"\r\n]*)"')
DECIMAL_COMMA = re.compile(rb"[+-]?\d+(,\d+)?([eE][+-]?\d+)?")
"""A number as it is written where a comma stands for the point, or a whole one."""
PLAIN = bytes.maketrans(b",;\t#/", b"?????")
"""What takes the place of marks that part columns or begin comments, in a text between quotes."""
LEAST_COUNTED = 4
"""Rows that a column counts by no chance."""
MOST_COMMENTS = 100
"""Of those above the numbers, the last: where names of columns are looked for."""


def number_table(
    lines: Iterable[bytes],
    delimiter: str | None = None,
    columns: Sequence[int] | None = None,
    max_rows: int | None = None,
) -> np.ndarray:
    """(N, C) float64 of lines of numbers, comments and empty lines left out; a ValueError for ragged rows or no numbers."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # numpy warns of empty lines and of no rows; the second is an error of the caller's
        return np.loadtxt(lines, np.float64, COMMENTS, delimiter, usecols=columns, max_rows=max_rows, ndmin=2, encoding="latin1")


def read_point_text(path: str | os.PathLike) -> FilePoints:
    """The points of a table, metres. Two columns are 2D; of three and more the first three are x, y, z.

    A first line that is not numbers names the columns, as many as rows have: x, y and, in 3D, z are then found by name, whatever stands
    beside them; `x_m`, `x [m]` and ParaView's `Points:0` are x, too. Names may have spaces in them where tabs, commas or semicolons stand
    between. So does the last of the comments ahead of the numbers that has a word for each column and x and y among them, as numpy and
    CloudCompare write it. Other lines that start with # or // are passed over, with a warning where they have x and y and none names the
    columns, and so is a first line with the count of points, of which there may not be fewer.
    Fields may be in quotes. Rows may end in a delimiter. `nan` is a beam without a return, as is a row of delimiters alone, and one of
    named columns whose coordinates are empty. Raises `InputError` for anything else.
    """
    path = Path(path)
    with reading(path, "a text file of points"), open(path, "rb") as file:
        if file.read(len(codecs.BOM_UTF8)) != codecs.BOM_UTF8:
            file.seek(0)
        start, first, comments, above, counted = file.tell(), b"", deque(maxlen=MOST_COMMENTS), 0, None
        for line in iter(lambda: file.readline(MAX_LINE), b""):
            first = line.strip(MARGIN)
            if counted is None and first.isdigit() and _is_wide(file):
                counted, first, start, above = int(first), b"", file.tell(), above + 1
                continue
            if first.strip() and not first.lstrip().startswith((b"#", b"//")):
                break
            comments += [first.strip()] if first.strip() else []
            start, first, above = file.tell(), b"", above + line.endswith(b"\n")
        if not first:
            raise NoRows(f"{path}: expected lines of numbers, found none")
        first = COMMENT_AFTER.split(_unquoted(first), maxsplit=1)[0]
        if first == b"0" and not _first_row(file):  # the count of no points
            raise NoRows(f"{path}: expected lines of numbers, found none")
        delimiter = next((mark for mark in (",", ";") if mark.encode() in first), None)
        fields = split_fields(first, delimiter)
        columns, commented = None, None
        if all(map(_is_number, fields)):
            commented = commented_columns(path, comments, delimiter, len(fields))
        else:
            _check_commas(path, first)
            start, above = file.tell(), above + line.endswith(b"\n")
            _check_commas(path, _first_row(file))
            file.seek(start)
            if delimiter is None and 0 < first.count(b"\t") == _first_row(file).count(b"\t"):
                delimiter = "\t"
                fields = split_fields(first, delimiter)
            columns = named_columns(path, fields)
        table = _plain_table(path, delimiter, columns, len(fields), above)
        if table is None:
            file.seek(start)
            rows = map(_unquoted, file)
            lines = rows if columns is None else _checked(path, rows, delimiter, fields, above)
            lines = lines if delimiter is None else (_filled(line, delimiter.encode(), len(fields), columns) for line in lines)
            table = number_table(lines, delimiter, columns)
        if not len(table):
            raise NoRows(f"{path}: expected lines of numbers, found none")
        if counted is not None and counted > len(table):
            raise InputError(f"{path}: truncated; its first line says {counted} points, {len(table)} are there")
        if table.shape[1] < 2:
            raise InputError(f"{path}: expected 2 or more columns, found {table.shape[1]}")
        if not (columns or commented) and table.shape[1] > 3:
            _warn_of_numbers(path, table[:, 0])
        return FilePoints(table[:, commented or slice(3)], named=bool(columns or commented))


def _warn_of_numbers(path: Path, first: np.ndarray) -> None:
    """A column that counts rows from 0 or 1 is no coordinate, as what pandas writes without names of columns; three columns may be a table
    of steps along x."""
    if len(first) >= LEAST_COUNTED and (first == first[0] + np.arange(len(first))).all() and first[0] in (0, 1):
        # The folder is named, so that a thousand scans of one make one warning.
        counted = f"the first column of {path.suffix} files counts rows from {first[0]:g}, and is taken as x, as none has a name"
        warnings.warn(f"{path.parent}: {counted}; leave it out, or name the columns (a first line number,x,y,z,...)", stacklevel=4)


def _check_commas(path: Path, row: bytes) -> None:
    """An `InputError` for a row of numbers with decimal commas, which elsewhere part columns."""
    fields = re.split(rb"[;\s]+", row.strip().removesuffix(b";"))
    if len(fields) > 1 and all(map(DECIMAL_COMMA.fullmatch, fields)) and any(b"," in field for field in fields):
        shown = row.strip()[:60].decode("latin1")
        raise InputError(f"{path}: expected decimal points, got decimal commas, {shown!r}; write the numbers as 1.5")


def _is_wide(file) -> bool:
    """Whether the next line has three columns or more, so that a whole number above it is their count, as PTS and CloudCompare write."""
    place = file.tell()
    columns = re.split(rb"[\s,;]+", file.readline(MAX_LINE).strip())
    file.seek(place)
    return len(columns) > 2


def _first_row(file) -> bytes:
    """The next line that has more than a comment, without that; empty at the end of the file."""
    return next((row for line in iter(lambda: file.readline(MAX_LINE), b"") if (row := _without_comment(line)).strip()), b"")


def _unquoted(line: bytes) -> bytes:
    """A line without quotes around its fields, nor in them what would part columns or begin a comment."""
    return QUOTED.sub(lambda found: found[1].translate(PLAIN), line) if b'"' in line else line


def _without_comment(line: bytes) -> bytes:
    return (re.split(rb"#|//", line, maxsplit=1)[0] if b"#" in line or b"//" in line else line).strip(MARGIN)


def _checked(path: Path, lines: Iterable[bytes], delimiter: str | None, names: list[str], above: int) -> Iterator[bytes]:
    """`lines` as they are; an `InputError` at a row of more or fewer columns than are named: x, y and z would be others'."""
    empty = (delimiter or " ").encode() + b" \t"
    for number, line in enumerate(lines, start=above + 1):
        row = _without_comment(line)
        found = row.count(delimiter.encode()) + 1 if delimiter else len(row.split())
        found -= delimiter is not None and found > len(names) and row.endswith(delimiter.encode())
        if found != len(names) and row.strip(empty):  # no row at all, or a beam without a return
            wanted = f"as many columns as its first line names, {len(names)} ({' '.join(names)[:60]})"
            raise InputError(f"{path}, line {number}: expected {wanted}, the row has {found}")
        yield line


def _plain_table(path: Path, delimiter: str | None, columns: Sequence[int] | None, count: int, above: int) -> np.ndarray | None:
    """`number_table` of a file below its first lines, in half the time, or None where rows need a closer look.

    numpy reads a file by itself twice as fast as line by line, but then knows comments of one kind alone, goes on behind the end of a line
    with a quote that is not closed, takes \\r as an end of lines, and where `columns` are chosen does not see that rows have others than
    `count`.
    """
    last = b""
    with open(path, "rb") as file:
        head = b"".join(file.readline() for _ in range(above))
        begin = file.tell()
        for block in chain([head.replace(b'"', b"")], iter(lambda: file.read(BLOCK), b"")):
            seen = last + block
            if b'"' in block or b"//" in seen or seen.removesuffix(b"\r").count(b"\r") != seen.count(b"\r\n"):
                return None
            last = seen[-1:]
        if columns is not None:
            file.seek(begin)
            if not _has_columns(file, delimiter, count):
                return None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return np.loadtxt(str(path), np.float64, "#", delimiter, skiprows=above, usecols=columns, ndmin=2, encoding="latin1")
    except ValueError:
        return None


def _has_columns(file, delimiter: str | None, count: int) -> bool:
    """Whether all rows from here on have `count` columns, a delimiter at their end left out; False for comments, too."""
    for block in iter(lambda: file.read(BLOCK) + file.readline(), b""):
        seen = np.frombuffer(block.replace(b"\r\n", b"\n").removesuffix(b"\n") + b"\n", np.uint8)
        ends = np.flatnonzero(seen == ord("\n"))
        if delimiter is None:
            blank = np.isin(seen, np.frombuffer(b" \t\n", np.uint8))
            found = np.diff(np.searchsorted(np.flatnonzero(~blank & np.r_[True, blank[:-1]]), ends), prepend=0)
        else:
            marks = np.flatnonzero(seen == ord(delimiter))
            found = np.diff(np.searchsorted(marks, ends), prepend=0) + 1
            found -= (found > count) & (seen[ends - 1] == ord(delimiter))
        empty = np.diff(ends, prepend=-1) == 1
        if (found[~empty] != count).any():
            return False
    return True


def _filled(line: bytes, delimiter: bytes, count: int, columns: Sequence[int] | None) -> bytes:
    """A row as numpy takes it. Spreadsheets end rows with a delimiter, which would be one more column, and tables leave NaN empty, of
    named columns beside a number or a time of the row; one with a part of its coordinates is a damaged one."""
    line = line.strip(MARGIN)
    if line.startswith(delimiter) and not line.strip(delimiter + b" \t"):
        return delimiter.join([b"nan"] * count)
    row = [] if columns is None else _without_comment(line).split(delimiter)
    if columns and len(row) >= count and not any(row[place].strip() for place in columns):
        return delimiter.join([b"nan"] * count)
    return line.removesuffix(delimiter)


def _is_number(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return False
    return True
