"""The unit of length that a LAS file says its coordinates are in, in its coordinate system's GeoTIFF keys or WKT (LAS 1.4 R15, 2.5)."""

from __future__ import annotations

import os
import re
import struct
from collections.abc import Iterable, Iterator
from typing import BinaryIO

import numpy as np

USER = b"LASF_Projection"
GEO_KEYS, WKT = 34735, 2112
LINEAR_UNITS, VERTICAL_UNITS = 3076, 4099
"""GeoTIFF's keys `ProjLinearUnitsGeoKey` and `VerticalUnitsGeoKey`."""
METRES = {9001: 1.0, 9002: 0.3048, 9003: 1200 / 3937}
"""By EPSG's code: metre, foot, US survey foot; others are rare, and count as metres."""
UNIT = re.compile(r'(?:LENGTHUNIT|UNIT)\s*\[\s*"([^"]*)"\s*,\s*([0-9.eE+-]+)')
VERTICAL = re.compile(r"\bVERT(?:_CS|CS|CRS|ICALCRS)\s*\[")
"""`VERTCS` is ESRI's."""
HEAD, EXTENDED_HEAD = struct.Struct("<2x16sHH32x"), struct.Struct("<2x16sHQ32x")
"""Of a variable-length record ahead of the points, and of one behind them, where LAS 1.4 may have the WKT."""
MOST_BYTES = 1 << 20
"""Of a record that is read: a WKT has thousands; a record behind the points may be as long as a file."""


def system_records(
    file: BinaryIO, start: int, count: int, head: struct.Struct = HEAD, end: int | None = None
) -> Iterator[tuple[int, bytes]]:
    """The numbers and contents of those of `count` records from byte `start` on that say what the coordinates are. end: where records end
    at the latest, that of the file unless given."""
    end = file.seek(0, os.SEEK_END) if end is None else end
    for _ in range(count):
        if start + head.size > end:
            break
        file.seek(start)
        user, record, length = head.unpack(file.read(head.size))
        start += head.size
        if user.rstrip(b"\0") == USER:
            yield record, file.read(max(min(length, MOST_BYTES, end - start), 0))
        start += length


def metres_per_unit(records: Iterable[tuple[int, bytes]]) -> np.ndarray:
    """(3,) metres in a unit of x, y and z, from the `system_records` of a file; ones where they don't say."""
    found: dict[str, float] = {}
    for record, content in records:
        if record == GEO_KEYS:
            found = _of_geo_keys(content) | found
        elif record == WKT:
            found |= _of_wkt(content.decode("latin1"))
    level = found.get("level", 1.0)
    return np.array([level, level, found.get("height", level)])


def _of_geo_keys(content: bytes) -> dict[str, float]:
    numbers = np.frombuffer(content[: len(content) // 2 * 2], "<u2")
    keys = numbers[4 : 4 + len(numbers[4:]) // 4 * 4].reshape(-1, 4)
    # One whose second number is not 0 has its value elsewhere.
    units = {int(key): METRES.get(int(value), 1.0) for key, elsewhere, _, value in keys if not elsewhere}
    return {name: units[key] for name, key in (("level", LINEAR_UNITS), ("height", VERTICAL_UNITS)) if key in units}


def _of_wkt(text: str) -> dict[str, float]:
    parts = VERTICAL.split(text, maxsplit=1)
    found = {}
    for name, part in zip(("level", "height"), parts, strict=False):
        # The unit of a system stands behind those of what it is made of, which are degrees.
        for unit, metres in UNIT.findall(part)[-1:]:
            if re.search(r"foot|feet|\bft", unit, re.IGNORECASE) and 0.3 < float(metres) < 0.31:
                found[name] = float(metres)
    if "level" in found and len(parts) > 1:
        found.setdefault("height", 1.0)
    return found
