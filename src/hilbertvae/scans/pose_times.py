"""Times of poses beside those in the names of their scans: both say when a scan was, and poses go by place, not by time."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import numpy as np

TIME = re.compile(r"[0-9]+(\.[0-9]+)?")
SCALES = (1.0, 1e3, 1e6, 1e9)
"""Names are in seconds as TUM's times are, or in milli-, micro- or nanoseconds."""
FIRST_TIME = 1e6
"""Whole numbers below count scans."""
SAME_EPOCH = 1e-6
"""Of times since 1970 half an hour: two recorders of one drive start closer together."""


def warn_of_other_times(files: list[Path], times: np.ndarray, poses_path: Path) -> None:
    """One `UserWarning` where scans have times for names, by the same clock as the poses' `times (S,)`, and some pose is plainly another's.

    That is by more than half a step from scan to scan; a clock that differs altogether, or names that count, say nothing.
    """
    if len(files) < 2 or not all(TIME.fullmatch(path.stem) for path in files):
        return
    numbers = np.array([float(path.stem) for path in files])
    if not any("." in path.stem for path in files) and numbers.max() < FIRST_TIME:
        return
    named = next((numbers / scale for scale in SCALES if _one_clock(numbers / scale, times)), None)
    if named is None:
        return
    apart, step = np.abs(named - times), float(np.median(np.abs(np.diff(times))))
    worst = int(np.argmax(apart))
    if apart[worst] > step / 2:
        warnings.warn(
            f"{poses_path}: the time of pose {worst + 1} is {apart[worst]:.4g} s off that in the name of its scan, {files[worst].name}, "
            f"where scans are {step:.4g} s apart. Poses are those of scans by their place; leave out those of other scans",
            stacklevel=5,
        )


def _one_clock(named: np.ndarray, times: np.ndarray) -> bool:
    span, other = np.ptp(named), np.ptp(times)
    if not 0 < span < 2 * other < 4 * span:
        return False
    return abs(named.mean() - times.mean()) < max(other, SAME_EPOCH * abs(times.mean()))
