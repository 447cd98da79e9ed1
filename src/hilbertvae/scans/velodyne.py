"""Reader of `.bin` scans, float32 without a header: x, y, z, intensity as KITTI has them, and in nuScenes' `.pcd.bin` a ring."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.scans.column_widths import width_by_columns
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
LEAST_NUMBER, MOST_NUMBER = 1e-4, 1e4
"""Between them lie the coordinates of scans, those apart that are 0."""
NEARLY_ALL, HARDLY = 0.99, 0.4
"""Shares of such numbers: of float64 read as what it is, and the most of its lower halves read as float32, of which 0.1 to 0.2 are so. Real
scans in float32 have 0.5 at most, and 0.99 and more."""
TRANSPOSED = 0.9
"""How unlike the numbers of a quarter of the file are, against those of every fourth place. Real scans have 1.27 and more, and stored
coordinate by coordinate 0.78 and less."""


def read_velodyne(path: str | os.PathLike) -> FilePoints:
    """The returns of one scan, metres, sensor frame; the file has no origin.

    A name that ends in `.pcd.bin` has five numbers a return (20 bytes), as nuScenes writes them; any other four (16 bytes). Raises
    `InputError` unless the file is whole returns, where four are expected and the file plainly has another number, where five are and the
    last are no rings, and for what is plainly float64, or stored coordinate by coordinate.
    """
    path = Path(path)
    with reading(path, "a KITTI scan (.bin)"):
        size = path.stat().st_size
        numbers, names = (5, "x, y, z, intensity, ring") if path.name.lower().endswith(NUSCENES) else (4, "x, y, z, intensity")
        if _is_double(path, size):
            raise InputError(f"{path}: expected float32 {names}; its numbers look like float64: write them as float32 (.astype('<f4'))")
        # Nothing in the file says how many numbers a return has, so five taken for four would be a wrong map, not an error.
        if numbers == 4 and size and size % 20 == 0 and _has_rings(np.fromfile(path, "<f4").reshape(-1, 5)):
            raise InputError(f"{path}: expected 4 numbers a return; it looks like 5, as nuScenes writes them: name it {NUSCENES}")
        if size == 0 or size % (4 * numbers):
            raise InputError(f"{path}: truncated or foreign; expected float32 {names} ({4 * numbers} bytes a return), got {size} bytes")
        values = np.fromfile(path, "<f4")
        if numbers == 4 and (width := _plainly_other_width(values) or width_by_columns(values)):
            raise InputError(
                f"{path}: expected 4 numbers a return (x, y, z, intensity); it looks like {width}: write these 4 (intensity may be 0)"
            )
        if _is_transposed(values, numbers):
            wanted = f"expected {names} return by return, an array (N, {numbers})"
            raise InputError(f"{path}: {wanted}; it looks like all x, then all y, as ({numbers}, N): write its transpose")
        if numbers == 5 and not _counts_rings(values.reshape(-1, 5)[:, 4]):
            raise InputError(f"{path}: expected 5 numbers a return ({names}); the fifth are no rings: name it .bin if it has 4 a return")
        return FilePoints(values.reshape(-1, numbers)[:, :3].astype(np.float64))


def _is_double(path: Path, size: int) -> bool:
    """Whether the file has the coordinates of returns of 3, 4 or 5 numbers in float64, and as float32 nothing that could be coordinates."""
    if size % 8 or size < 8 * LEAST_VALUES:
        return False
    halves = np.fromfile(path, "<f4", 2 * MOST_VALUES)
    if _could_be_coordinates(halves[::2]).mean() >= HARDLY:
        return False
    doubles = halves.view("<f8")
    for width in (width for width in (3, 4, 5) if size % (8 * width) == 0):
        places = doubles[: len(doubles) // width * width].reshape(-1, width)[:, :3]
        told = places[(places != 0) & ~np.isnan(places)]  # zeros and beams without a return say nothing
        if len(told) >= LEAST_VALUES / 4 and _could_be_coordinates(told).mean() >= NEARLY_ALL:
            return True
    return False


def _could_be_coordinates(numbers: np.ndarray) -> np.ndarray:
    return (np.abs(numbers) >= LEAST_NUMBER) & (np.abs(numbers) <= MOST_NUMBER)


def _is_transposed(values: np.ndarray, width: int) -> bool:
    """Whether values of the same part of the file, of `width` parts, are more alike than those of the same place in their returns."""
    if len(values) < LEAST_VALUES:
        return False
    count = len(values) // width
    # In random order: neighbours in a scan are alike whatever they are taken for.
    chosen = np.random.default_rng(0).permutation(count)[: MOST_VALUES // width]
    here = _unlikeness(values.reshape(count, width)[chosen].ravel().astype(np.float64), width)
    there = _unlikeness(values.reshape(width, count).T[chosen].ravel().astype(np.float64), width)
    return there < TRANSPOSED * here


def _has_rings(rows: np.ndarray) -> bool:
    """Whether the last column of `rows (N, 5)` counts lasers: whole numbers, several of them, and not because all numbers are whole."""
    rings = rows[:, 4]
    if not _counts_rings(rings):
        return False
    return bool((rings != rings[0]).any() and (rows[:, :4] != np.floor(rows[:, :4])).any())


def _counts_rings(rings: np.ndarray) -> bool:
    return bool(((rings >= 0) & (rings < MOST_RINGS) & (rings == np.floor(rings))).all())


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
