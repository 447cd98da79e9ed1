"""Reader of CARMEN laser logs (`FLASER` lines with corrected poses), plain or gzipped."""

from __future__ import annotations

import gzip
import os
import warnings
from pathlib import Path

import numpy as np

from hilbertvae.checks import InputError, check_positive
from hilbertvae.scans.beam_lengths import UnitCheck
from hilbertvae.scans.scan import Scans

MAX_BEAMS = 4096
MAX_LINE = 1 << 20
"""More beams than any planar laser of this format has; a larger count is a forged line."""
MIN_RANGE_M = 0.02
"""Shorter ranges are the sensor's own housing or an error code of 0."""


LAYOUTS_DEG = {180: 1.0, 181: 1.0, 360: 0.5, 361: 0.5, 541: 0.5, 721: 0.25, 1081: 0.25}
"""Degrees between beams by how many there are: half circles of SICK's LMS, and 270 degrees of SICK's and Hokuyo's (541, 1081)."""
HALF_CIRCLES = (180, 360)
"""Counts whose last beam is one step short of 90 degrees."""


def beam_step_deg(beams: int) -> float:
    """Degrees between beams, as `LAYOUTS_DEG` has it; 1 or 0.5 for other counts. Beams run counter-clockwise.

    Spreading 180 beams over exactly 180 degrees gives maps 2 to 12 % blurrier on the catalogue's logs.
    """
    return LAYOUTS_DEG.get(beams, 1.0 if beams <= 181 else 0.5)


def first_beam_deg(beams: int, step_deg: float) -> float:
    """The bearing of beam 0: -90 for a half circle, and in general as far to the right as the last one is to the left."""
    return -90.0 if beams in HALF_CIRCLES and step_deg == LAYOUTS_DEG[beams] else -step_deg * (beams - 1) / 2


def read_carmen(path: str | os.PathLike, max_range_m: float = 30.0, every: int = 1, step_deg: float | None = None) -> Scans:
    """The returns of a log's `FLASER` lines, in the order of lines (timestamps are useless in some logs).

    A range at or above `max_range_m`, no-return codes among them, is an error or a miss: it is skipped and carves nothing.
    `every` keeps each so many-th scan. step_deg: between beams, as many scans have them unless given; a count that no known laser has
    gives a warning then. Raises `InputError` for a missing, truncated or foreign file.
    """
    path = Path(path)
    check_positive(max_range_m, "max_range_m")
    if every < 1:
        raise InputError(f"every: expected at least 1, got {every}")
    points, origins, scan, beam = [], [], [], []
    kept = seen = 0
    unit, strange = UnitCheck(), set()
    for number, line in _lines(path):
        if not line.startswith(b"FLASER "):
            continue
        seen += 1
        if (seen - 1) % every:
            continue
        ranges, (x, y, heading) = _parse(path, number, line)
        step = beam_step_deg(len(ranges)) if step_deg is None else step_deg
        strange |= {len(ranges)} - LAYOUTS_DEG.keys()
        unit.see(ranges)
        chosen = np.flatnonzero((ranges > MIN_RANGE_M) & (ranges < max_range_m))
        angle = heading + np.deg2rad(first_beam_deg(len(ranges), step) + chosen * step)
        end = np.column_stack([x + ranges[chosen] * np.cos(angle), y + ranges[chosen] * np.sin(angle)])
        points.append(end)
        origins.append(np.broadcast_to([x, y], end.shape))
        scan.append(np.full(len(chosen), kept, np.int32))
        beam.append(chosen.astype(np.int32))
        kept += 1
    if not seen:
        raise InputError(f"{path}: expected a CARMEN log with FLASER lines, found none")
    unit.warn(path)
    if strange and step_deg is None:
        counts = ", ".join(f"{count} beams taken to be {beam_step_deg(count):g} degrees apart" for count in sorted(strange)[:3])
        warnings.warn(f"{path}: {counts}, which no known laser has; set reading.beam_step_deg", stacklevel=3)
    if not sum(map(len, points)):
        raise InputError(f"{path}: expected ranges below {max_range_m} m, found none in {seen} scans{unit.hint(max_range_m)}")
    return Scans(np.concatenate(points), np.concatenate(origins), np.concatenate(scan), np.concatenate(beam))


def _lines(path: Path):
    """Numbered raw lines of a plain or gzipped file."""
    try:
        with open(path, "rb") as raw:
            packed = raw.read(2) == b"\x1f\x8b"
        with gzip.open(path, "rb") if packed else open(path, "rb") as file:
            for number, line in enumerate(iter(lambda: file.readline(MAX_LINE + 1), b""), start=1):
                if len(line) > MAX_LINE:  # a packed file of a megabyte can hold a line of a gigabyte
                    raise InputError(f"{path}, line {number}: expected a CARMEN log, got a line of more than {MAX_LINE} bytes")
                yield number, line
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file; expected a CARMEN log (.log or .log.gz)") from error
    except EOFError as error:
        raise InputError(f"{path}: truncated; the gzip stream ends before its end marker") from error
    except OSError as error:
        raise InputError(f"{path}: can't be read as a CARMEN log ({error})") from error
    except Exception as error:
        if type(error).__module__ == "zlib":
            raise InputError(f"{path}: damaged gzip stream ({error})") from error
        raise


def _parse(path: Path, number: int, line: bytes) -> tuple[np.ndarray, np.ndarray]:
    """The ranges (n,) and the laser's pose (x, y, heading) of one `FLASER n r_1 .. r_n x y theta ...` line."""
    fields = line.split()
    if len(fields) < 2 or not fields[1].isdigit() or len(fields[1]) > 18:
        raise InputError(f"{path}, line {number}: expected 'FLASER <number of ranges> ...', got {line[:40]!r}")
    count = int(fields[1])
    if not 0 < count <= MAX_BEAMS:
        raise InputError(f"{path}, line {number}: expected 1 to {MAX_BEAMS} ranges, the line claims {count}")
    if len(fields) < count + 5:
        raise InputError(f"{path}, line {number}: truncated; {count} ranges and a pose claimed, {len(fields) - 2} numbers found")
    try:
        values = np.array(fields[2 : count + 5], dtype=np.float64)
    except ValueError as error:
        raise InputError(f"{path}, line {number}: expected numbers ({error})") from error
    ranges, pose = values[:count], values[count:]
    if not np.isfinite(pose).all():
        raise InputError(f"{path}, line {number}: expected a finite pose, got {pose.tolist()}")
    return np.nan_to_num(ranges, nan=np.inf), pose
