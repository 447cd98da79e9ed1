"""What every reader of a point file returns, and the guards between what a file claims and the memory it may take."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from hilbertvae.checks import InputError

LIDAR_RANGE_M = 80.0
"""What beams in 3D are as long as, and dropped, unless told otherwise."""
SMALL_BYTES = 64 * 2**20
"""Packed files may grow to this size whatever their own: runs of equal numbers pack a thousandfold."""
MAX_EXPANSION = 100
"""Beyond `SMALL_BYTES`, packed coordinates that claim to grow more than this are forged; scans pack 2 to 25 times."""


@dataclass(frozen=True)
class FilePoints:
    """The returns of one file, in the order of the file.

    points: (N, D) float64, metres, the file's frame. A row with NaN or inf is a beam without a return, as organised clouds have.
    origins: (N, D) or (D,) float64, metres, the file's frame: where the beams started; None where the file does not say.
    scan: (N,) integers, the sweep a return belongs to; None where the file is one sweep.
    pose: (3, 4), what the reader has taken the points of its one sweep to the file's frame by; None where it moved none.
    origin_type: as which the file has the origins; float64 if not told.
    named: False for a table without names, of whose columns the first ones were taken as x, y and z.
    """

    points: np.ndarray
    origins: np.ndarray | None = None
    scan: np.ndarray | None = None
    pose: np.ndarray | None = None
    named: bool = True
    origin_type: np.dtype = field(default=np.dtype(np.float64))


class NoRows(InputError):
    """A sound text file without a single row, as of a scan without returns."""


@contextmanager
def reading(path: Path, kind: str) -> Iterator[None]:
    """Turns whatever goes wrong inside the block into an `InputError` that names the file; `kind` says what was expected."""
    try:
        with np.errstate(invalid="ignore", over="ignore"):  # a signalling NaN warns when it is widened to float64
            yield
    except InputError:
        raise
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file; expected {kind}") from error
    except Exception as error:  # parsers raise anything at all on damaged files, and a damaged file is always the caller's business
        raise InputError(f"{path}: can't be read as {kind} ({type(error).__name__}: {' '.join(str(error).split())[:200]})") from error


def check_fits(path: Path, what: str, needed: int, there: int) -> None:
    """An `InputError` where `what` needs more bytes than are there, before memory is taken for it."""
    if needed > there:
        raise InputError(f"{path}: truncated or forged; {what} need {needed} bytes, {there} are there")


def check_expansion(path: Path, what: str, unpacked: int, packed: int) -> None:
    """An `InputError` where `packed` bytes claim to unpack to more than coordinates ever do, before memory is taken for it."""
    if unpacked > max(SMALL_BYTES, MAX_EXPANSION * packed):
        raise InputError(f"{path}: truncated or forged; {what} claim to unpack from {packed} to {unpacked} bytes")


def check_reading(min_range_m: float, max_range_m: float, every: int) -> None:
    """An `InputError` unless 0 <= min_range_m < max_range_m and `every` is a whole number from 1."""
    if not 0 <= min_range_m < max_range_m:
        raise InputError(f"reading.max_range_m: expected more than min_range_m, which is 0 or more, got {max_range_m} and {min_range_m}")
    if int(every) != every or every < 1:
        raise InputError(f"reading.every: expected a whole number from 1, got {every}")


def axis_names(names: Sequence[str]) -> list[str]:
    """What x, y and z are called among a file's names, in small letters or capitals; those that are there."""
    return [name for axis in "xyz" for name in (axis, axis.upper()) if name in names and (name == axis or axis not in names)]
