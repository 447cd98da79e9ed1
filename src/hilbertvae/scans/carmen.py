"""Reader of CARMEN laser logs (`FLASER` or `ROBOTLASER1` messages with corrected poses), plain or gzipped."""

from __future__ import annotations

import codecs
import gzip
import os
import warnings
import zlib
from collections import Counter
from pathlib import Path

import numpy as np

from hilbertvae.checks import InputError, check_positive
from hilbertvae.scans.beam_lengths import ClippedCheck, UnitCheck
from hilbertvae.scans.carmen_messages import MESSAGES, beam_step_deg
from hilbertvae.scans.file_points import check_expansion, check_reading
from hilbertvae.scans.rounded import warn_of_few_digits
from hilbertvae.scans.scan import Scans

MAX_LINE = 1 << 20
"""Longer than any message; what is, is no log."""
REAR = (b"RLASER", b"ROBOTLASER2")
"""Messages of a second laser, which are not read."""
MIN_RANGE_M = 0.02
"""Shorter ranges are the sensor's own housing or an error code of 0."""


def read_carmen(
    path: str | os.PathLike, max_range_m: float = 30.0, every: int = 1, step_deg: float | None = None, min_range_m: float = 0.0
) -> Scans:
    """The returns of a log's front laser, in the order of lines (timestamps are useless in some logs).

    Read are the messages, `FLASER` or `ROBOTLASER1`, of which the first is: some loggers write each sweep as both; where these can't be
    the same sweeps, since they are not as many, there is a warning, and where there are those of a second laser. A range at or above
    `max_range_m`, or above what the message says the laser measures, no-return codes among them, is an error or a miss, as is one at or
    below `min_range_m`: it is skipped and carves nothing. Shorter codes can't be told from returns; ranges that end at one that many
    beams have give a warning. `every` keeps every n-th scan. step_deg: between beams, unless as the message says, or as many scans
    have so many beams; a count that this reader knows of no laser gives a warning then. A last line without an end, and with less in it
    than the one before, as of a logger that was stopped, is left out with a warning. Raises `InputError` for a missing, truncated or
    foreign file.
    """
    path = Path(path)
    check_reading(min_range_m, max_range_m, every)
    if step_deg is not None:
        check_positive(step_deg, "reading.beam_step_deg")
    points, origins, scan, beam, places = [], [], [], [], []
    kept, seen, others = 0, 0, Counter()
    unit, clipped, strange, chosen_kind = UnitCheck(max_range_m, min_range_m=min_range_m), ClippedCheck(max_range_m), set(), None
    before = b""
    for number, line in _lines(path):
        kind = line.split(maxsplit=1)[0] if line.strip() else b""
        if kind not in MESSAGES:
            others[kind] += kind in REAR
            continue
        if kind != (chosen_kind := chosen_kind or kind):
            others[kind] += 1
            continue
        if seen and not line.endswith(b"\n") and len(line.split()) < len(before.split()):
            warnings.warn(f"{path}, line {number}: the last line is cut off and left out", stacklevel=3)
            continue
        seen, before = seen + 1, line
        if (seen - 1) % every:
            continue
        sweep = MESSAGES[kind](path, number, line, step_deg)
        ranges, (x, y, heading) = sweep.ranges, sweep.pose
        places.append((x, y))
        if not sweep.known:
            strange.add(len(ranges))
        unit.see(ranges)
        clipped.see(ranges[ranges < sweep.farthest_m])
        chosen = np.flatnonzero((ranges > max(min_range_m, MIN_RANGE_M)) & (ranges < min(max_range_m, sweep.farthest_m)))
        angle = heading + np.deg2rad(sweep.first_deg + chosen * sweep.step_deg)
        end = np.column_stack([x + ranges[chosen] * np.cos(angle), y + ranges[chosen] * np.sin(angle)])
        points.append(end)
        origins.append(np.broadcast_to([x, y], end.shape))
        scan.append(np.full(len(chosen), kept, np.int32))
        beam.append(chosen.astype(np.int32))
        kept += 1
    if not seen:
        raise InputError(f"{path}: expected a CARMEN log with FLASER or ROBOTLASER1 lines, found none")
    unit.warn(path)
    clipped.warn(path)
    _warn_of_messages(path, chosen_kind.decode(), seen, others, strange)
    warn_of_few_digits(np.array(places), path)
    if not sum(map(len, points)):
        raise InputError(f"{path}: expected ranges of {min_range_m} to {max_range_m} m, found none in {seen} scans{unit.hint(max_range_m)}")
    return Scans(np.concatenate(points), np.concatenate(origins), np.concatenate(scan), np.concatenate(beam), unit.left_out)


def _warn_of_messages(path: Path, kind: str, seen: int, others: Counter[bytes], strange: set[int]) -> None:
    """Where sweeps of `others` than the kind that was read were passed over, and where beams are of a number that no known laser has."""
    for other, passed in sorted(others.items()):
        if passed and (other in REAR or abs(passed - seen) > 1):  # else each sweep is there as both
            whose = ", of a second laser" if other in REAR else ""
            warnings.warn(f"{path}: read are its {seen} {kind} messages alone, and not {passed} {other.decode()} ones{whose}", stacklevel=4)
    if strange:
        counts = ", ".join(f"{count} beams taken to be {beam_step_deg(count):g} degrees apart" for count in sorted(strange)[:3])
        warnings.warn(f"{path}: {counts}, a guess, since this reader knows no laser of so many; set reading.beam_step_deg", stacklevel=4)


def _lines(path: Path):
    """Numbered raw lines of a plain or gzipped file."""
    try:
        with open(path, "rb") as raw:  # once: a pipe can't be opened again
            packed, size, unpacked = raw.peek(2)[:2] == b"\x1f\x8b", os.fstat(raw.fileno()).st_size, 0
            file = gzip.GzipFile(fileobj=raw) if packed else raw
            for number, line in enumerate(iter(lambda: file.readline(MAX_LINE + 1), b""), start=1):
                if len(line) > MAX_LINE:  # a packed file of a megabyte can hold a line of a gigabyte
                    raise InputError(f"{path}, line {number}: expected a CARMEN log, got a line of more than {MAX_LINE} bytes")
                unpacked += len(line)
                if packed and size:  # of a pipe nobody knows
                    check_expansion(path, "its lines", unpacked, size)
                yield number, line.removeprefix(codecs.BOM_UTF8) if number == 1 else line
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file; expected a CARMEN log (.log or .log.gz)") from error
    except EOFError as error:
        raise InputError(f"{path}: truncated; the gzip stream ends before its end marker") from error
    except OSError as error:
        raise InputError(f"{path}: can't be read as a CARMEN log ({error})") from error
    except zlib.error as error:
        raise InputError(f"{path}: damaged gzip stream ({error})") from error
