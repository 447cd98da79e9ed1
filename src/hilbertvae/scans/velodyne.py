"""Reader of `.bin` scans, float32 without a header: x, y, z, intensity as KITTI has them, and in nuScenes' `.pcd.bin` a ring."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.scans.file_points import FilePoints, reading

NUSCENES = ".pcd.bin"
MOST_RINGS = 128
"""Lasers of the largest spinning lidars; rings count from 0."""
LEAST_VALUES, MOST_VALUES = 400, 2**16
"""How many of a file's numbers are compared; fewer say little, more say the same."""
PLAIN, DOUBTFUL = 0.7, 0.9
"""How unlike neighbours under another width are, against 4: below the first 4 is plainly wrong, below the second where places are absurd.
Real scans of 4 have 1.3 and more, in any order of their returns; those of 6 read as 4 have 0.2 to 0.7."""
FARTHEST_RETURN_M = 1e5


def read_velodyne(path: str | os.PathLike) -> FilePoints:
    """The returns of one scan, metres, sensor frame; the file has no origin.

    A name that ends in `.pcd.bin` has five numbers a return (20 bytes), as nuScenes writes them; any other four (16 bytes). Raises
    `InputError` unless the file is whole returns, and where four are expected and the file plainly has another number.
    """
    path = Path(path)
    with reading(path, "a KITTI scan (.bin)"):
        size = path.stat().st_size
        numbers, names = (5, "x, y, z, intensity, ring") if path.name.lower().endswith(NUSCENES) else (4, "x, y, z, intensity")
        # Nothing in the file says how many numbers a return has, so five taken for four would be a wrong map, not an error.
        if numbers == 4 and size and size % 20 == 0 and _has_rings(np.fromfile(path, "<f4").reshape(-1, 5)):
            raise InputError(f"{path}: expected 4 numbers a return; it looks like 5, as nuScenes writes them: name it {NUSCENES}")
        if size == 0 or size % (4 * numbers):
            raise InputError(f"{path}: truncated or foreign; expected float32 {names} ({4 * numbers} bytes a return), got {size} bytes")
        values = np.fromfile(path, "<f4")
        if numbers == 4 and (width := _plainly_other_width(values)):
            raise InputError(
                f"{path}: expected 4 numbers a return (x, y, z, intensity); it looks like {width}: write these 4 (intensity may be 0)"
            )
        return FilePoints(values.reshape(-1, numbers)[:, :3].astype(np.float64))


def _has_rings(rows: np.ndarray) -> bool:
    """Whether the last column of `rows (N, 5)` counts lasers: whole numbers, several of them, and not because all numbers are whole."""
    rings = rows[:, 4]
    if not ((rings >= 0) & (rings < MOST_RINGS) & (rings == np.floor(rings))).all():
        return False
    return bool((rings != rings[0]).any() and (rows[:, :4] != np.floor(rows[:, :4])).any())


def _plainly_other_width(values: np.ndarray) -> int | None:
    """3, 5 or 6 if a return plainly has so many numbers and not 4: neighbours are alike, column by column, under the true width alone.

    What is 3 places on is in the same return of 4, where one number may follow from another, so 3 is first seen as two returns in 6.
    """
    widths = [width for width in (5, 6) if len(values) % width == 0]
    if len(values) < LEAST_VALUES or not widths:
        return None
    seen = values[:MOST_VALUES].astype(np.float64)
    found = min(widths, key=lambda width: _unlikeness(seen, width))
    share = DOUBTFUL if (np.abs(seen.reshape(-1, 4)[:, :3]) > FARTHEST_RETURN_M).mean() > 0.01 else PLAIN
    if _unlikeness(seen, found) >= share * _unlikeness(seen, 4):
        return None
    return 3 if found == 6 and _unlikeness(seen, 3) <= _unlikeness(seen, 6) else found


def _unlikeness(values: np.ndarray, width: int) -> float:
    """How much `values` differ from those `width` places on, 0 to 1: the mean of 1 - exp(-|difference|).

    Of returns in random order, no width makes it less on average than the true one: |x - x'| has this property, as the energy distance
    uses it (Szekely and Rizzo, *Energy statistics*, 2013), and so does this, which one absurd number can't rule.
    """
    here, there = values[:-width], values[width:]
    differences = np.where(np.isfinite(here) & np.isfinite(there), np.abs(here - there), np.inf)
    same = (here == there) | (np.isnan(here) & np.isnan(there))
    return float(np.where(same, 0.0, -np.expm1(-differences)).mean())
