"""Reader of a PLY file's vertices, ASCII or binary.

The header has to be read here in any case, to check its counts before memory is taken; the vertices are then one call to numpy.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.scans.file_points import FilePoints, axis_names, check_fits, reading
from hilbertvae.scans.point_text import number_table

MAX_HEADER = 65536
MOST_BLANKS = 2
"""Bytes of an end of a line."""
BYTE_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_BASIC = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4", "double": "f8"}
_SIZED = {f"{kind}{bits}": f"{kind[0]}{bits // 8}" for kind in ("int", "uint") for bits in (8, 16, 32, 64)}
NUMBER_TYPES = {**_BASIC, **_SIZED, "float32": "f4", "float64": "f8"}


@dataclass
class _Element:
    """One `element` of the header: how many, and the name and type of each property. A list's type is that of its length; `lists` has their
    names."""

    name: str
    count: int
    properties: list[tuple[str, str]] = field(default_factory=list)
    lists: list[str] = field(default_factory=list)

    def dtype(self, order: str) -> np.dtype:
        return np.dtype([(name, order + kind) for name, kind in self.properties])


def read_ply(path: str | os.PathLike) -> FilePoints:
    """The vertices, metres, file frame; faces and other properties are passed over. PLY has no place for an origin.

    Raises `InputError` for a file that is missing, foreign, or not as long as its header says.
    """
    path = Path(path)
    with reading(path, "a PLY file"), open(path, "rb") as file:
        order, elements, start = _header(path, file.read(MAX_HEADER))
        names = [element.name for element in elements]
        if "vertex" not in names:
            raise InputError(f"{path}: expected an element vertex, the header has {', '.join(names) or 'none'}")
        before, vertex = elements[: names.index("vertex")], elements[names.index("vertex")]
        if vertex.lists:
            raise InputError(f"{path}: expected vertices of single numbers, they have lists {', '.join(vertex.lists)[:60]}")
        if len(_axes(vertex)) < 3:
            found = " ".join(name for name, _ in vertex.properties)
            raise InputError(f"{path}: expected vertices with x, y and z, they have {found[:60] or 'no properties'}")
        there = os.fstat(file.fileno()).st_size - start
        file.seek(start)
        return FilePoints((_binary if order else _ascii)(path, file, order, elements, before, vertex, there))


def _axes(vertex: _Element) -> list[str]:
    return axis_names([name for name, _ in vertex.properties])


def _binary(path, file, order, elements, before, vertex, there) -> np.ndarray:
    needed = sum(element.count * element.dtype(order).itemsize for element in elements)
    check_fits(path, "the header's elements", needed, there)
    if needed != there and not any(element.lists for element in elements) and not _ends_in_blanks(file, there - needed):
        raise InputError(f"{path}: the header's elements take {needed} bytes, {there} are there")
    if any(element.lists for element in before):
        raise InputError(f"{path}: expected the vertices ahead of elements that have lists")
    file.seek(sum(element.count * element.dtype(order).itemsize for element in before), os.SEEK_CUR)
    rows = np.fromfile(file, vertex.dtype(order), vertex.count)
    return np.column_stack([rows[name].astype(np.float64) for name in _axes(vertex)])


def _ends_in_blanks(file, count: int) -> bool:
    """Whether the last `count` bytes are an end of a line, as some writers put it behind binary data, too. The file's place stays."""
    place = file.tell()
    file.seek(-count, os.SEEK_END)
    last = file.read(MOST_BLANKS + 1)
    file.seek(place)
    return len(last) <= MOST_BLANKS and not last.strip()


def _ascii(path, file, order, elements, before, vertex, there) -> np.ndarray:
    # A line takes a byte, a number and what parts it from the next two; the last may lack its line end.
    needed = sum(element.count * max(1, 2 * len(element.properties)) for element in elements)
    check_fits(path, "the header's elements", needed, there + 1)
    for _ in range(sum(element.count for element in before)):
        file.readline()
    rows = number_table(file, max_rows=vertex.count) if vertex.count else np.empty((0, len(vertex.properties)))
    if rows.shape != (vertex.count, len(vertex.properties)):
        raise InputError(f"{path}: truncated; {vertex.count} vertices of {len(vertex.properties)} numbers declared, found {rows.shape}")
    names = [name for name, _ in vertex.properties]
    return rows[:, [names.index(axis) for axis in _axes(vertex)]]


def _header(path: Path, start: bytes) -> tuple[str, list[_Element], int]:
    """The byte order ('' for ASCII), the elements, and where the data start."""
    if not start.startswith((b"ply\n", b"ply\r")):
        raise InputError(f"{path}: expected a PLY file, which starts with 'ply'")
    end = start.find(b"\nend_header") + 1  # a comment may have the word, too
    stop = start.find(b"\n", end)
    if not end or stop < 0:
        raise InputError(f"{path}: truncated; expected end_header within {MAX_HEADER} bytes")
    order, elements = None, []
    for line in start[:end].splitlines()[1:]:  # of text, letters of other languages are ends of lines, too
        match line.decode("latin1").split():
            case ["format", name, _] if name in BYTE_ORDERS:
                order = BYTE_ORDERS[name]
            case ["element", name, count] if count.isdecimal() and len(count) < 19:
                elements.append(_Element(name, int(count)))
            case ["property", "list", length, kind, name] if elements and {length, kind} <= NUMBER_TYPES.keys():
                elements[-1].properties.append((name, NUMBER_TYPES[length]))
                elements[-1].lists.append(name)
            case ["property", kind, name] if elements and kind in NUMBER_TYPES:
                elements[-1].properties.append((name, NUMBER_TYPES[kind]))
            case [] | ["comment", *_] | ["obj_info", *_]:
                pass
            case _:
                raise InputError(f"{path}: expected a line of a PLY header, got {line.decode('latin1')[:60]!r}")
    if order is None:
        raise InputError(f"{path}: expected a format line, one of {', '.join(BYTE_ORDERS)}")
    return order, elements, stop + 1
