"""The unit that a LAS file says its coordinates are in, in its coordinate system's GeoTIFF keys or WKT (LAS 1.4 R15, 2.5)."""

from __future__ import annotations

import os
import re
import struct
import warnings
from collections.abc import Iterable, Iterator
from typing import BinaryIO

import numpy as np

from hilbertvae.checks import InputError

USER = b"LASF_Projection"
GEO_KEYS, WKT = 34735, 2112
LINEAR_UNITS, VERTICAL_UNITS = 3076, 4099
"""GeoTIFF's keys `ProjLinearUnitsGeoKey` and `VerticalUnitsGeoKey`."""
MODEL, GEOGRAPHIC = 1024, 2
"""`GTModelTypeGeoKey`, and its value for longitudes and latitudes."""
PROJECTED, OWN = 3072, (0, 32767)
"""`ProjectedCSTypeGeoKey`, EPSG's code of a system, which has a unit of its own; and its values for none and for one that is not EPSG's."""
IN_METRES = (range(25828, 25839), range(26901, 26924), range(32601, 32661), range(32701, 32761))
"""EPSG's codes of UTM: ETRS89, NAD83, WGS 84 north and south."""
METRES = {9001: 1.0, 9002: 0.3048, 9003: 1200 / 3937}
"""By EPSG's code: metre, foot, US survey foot; others are rare, and count as metres."""
UNIT = re.compile(r'(?:LENGTHUNIT|UNIT)\s*\[\s*"([^"]*)"\s*,\s*([0-9.eE+-]+)')
VERTICAL = re.compile(r"\bVERT(?:_CS|CS|CRS|ICALCRS)\s*\[")
"""`VERTCS` is ESRI's."""
GEOGRAPHIC_WKT, PROJECTED_WKT = re.compile(r"\bGEOG(?:CS|CRS|RAPHICCRS)\s*\["), re.compile(r"PROJ(?:CS|CRS|ECTEDCRS)\s*\[")
"""A projected system has a geographic one in it."""
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


def metres_per_unit(records: Iterable[tuple[int, bytes]], path: str | os.PathLike) -> np.ndarray:
    """(3,) metres in a unit of x, y and z, from the `system_records` of the file at `path`; ones where they don't say.

    Raises `InputError` where x and y are degrees, and warns where a code alone says what they are, which may be of a system in feet.
    """
    keys, text = {}, ""
    for record, content in records:
        if record == GEO_KEYS:
            keys = _geo_keys(content) | keys
        elif record == WKT:
            text = content.decode("latin1").strip(" \0")
    if _in_degrees(keys, text):
        raise InputError(f"{path}: its coordinates are degrees, as its header says, and metres are expected; project them first (UTM, say)")
    units = ((name, keys.get(key)) for name, key in (("level", LINEAR_UNITS), ("height", VERTICAL_UNITS)))
    found = {name: METRES.get(unit, 1.0) for name, unit in units if unit is not None} | _of_wkt(text)
    code = keys.get(PROJECTED, 0)
    if "level" not in found and not text and code not in OWN and not any(code in codes for codes in IN_METRES):
        warnings.warn(
            f"{path}: its header has EPSG's code {code} and no unit; metres are taken. If they are feet, say so in its header "
            f"(GeoTIFF's key {LINEAR_UNITS}: 9002 for feet, 9003 for US survey feet), or make them metres",
            stacklevel=5,
        )
    level = found.get("level", 1.0)
    return np.array([level, level, found.get("height", level)])


def _in_degrees(keys: dict[int, int], text: str) -> bool:
    """Whether x and y are longitude and latitude, by the WKT `text` or, where there is none, by GeoTIFF's keys."""
    bare = re.sub(r'"[^"]*"', '""', text)  # names may have anything in them
    return bool(GEOGRAPHIC_WKT.search(bare) and not PROJECTED_WKT.search(bare)) if text else keys.get(MODEL) == GEOGRAPHIC


def _geo_keys(content: bytes) -> dict[int, int]:
    numbers = np.frombuffer(content[: len(content) // 2 * 2], "<u2")
    keys = numbers[4 : 4 + len(numbers[4:]) // 4 * 4].reshape(-1, 4)
    # One whose second number is not 0 has its value elsewhere.
    return {int(key): int(value) for key, elsewhere, _, value in keys if not elsewhere}


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
