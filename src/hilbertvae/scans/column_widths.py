"""How many numbers the returns of a file without a header have, by what is in its columns: this needs no order of the returns."""

from __future__ import annotations

import math

import numpy as np

READ, OTHERS = 4, (3, 5, 6, 7)
"""The width that is expected, and those told from it by distributions."""
LEAST_ROWS, MOST_VALUES = 50, 2**16
"""Shorter columns say little, and more numbers say the same."""
LEVELS = 64
"""At so many places distributions are compared."""
ALIKE, UNLIKE = 0.05, 0.2
"""The largest difference of distributions that are one, and the smallest of those that are not. Those of real scans of 4 differ by 0.49 and
more."""
ALIKE_BY_CHANCE, UNLIKE_BY_CHANCE = 2.0, 3.0
"""The same for short columns, in units of sqrt(2 / rows), of which chance makes more than 2 in 1 of 1000 pairs."""
UNIT = 1e-3
"""How far the length of a normal may be from 1."""


def width_by_columns(values: np.ndarray) -> int | None:
    """3, 5, 6, 7 or 8 if returns plainly have so many numbers and not 4, in any order of them. values: (4 N,) float32, the whole file.

    Under a wrong width all columns are the same mixture of the true ones, or of every second one where both widths are even, and their
    distributions are one; under the true width they differ. Of 8 numbers, pairs of returns of 4 differ in the same way where two sensors,
    or lasers, take turns, so those are told by what no coordinate is.
    """
    if len(values) % 8 == 0 and len(values) >= 8 * LEAST_ROWS and _is_eight(values.reshape(-1, 8)):
        return 8
    found = {width: unlike for width in OTHERS if len(values) % width == 0 and (unlike := _other_unlikeness(values, width))}
    if not found:
        return None
    width = max(found, key=found.get)
    if width in (3, 6) and len(values) % 6 == 0:  # 3 is seen as two returns in 6, and 6 as a mixture in 3
        rows = _some(values, 6)
        return 6 if _unlikeness(rows, 3) >= _limit(UNLIKE, UNLIKE_BY_CHANCE, rows) else 3
    return width


def _other_unlikeness(values: np.ndarray, width: int) -> float:
    """How unlike the columns of `width` are where it is plainly that one; else 0."""
    apart = math.gcd(width, READ)
    block = _some(values, math.lcm(width, READ))
    read, other = block.reshape(-1, READ), block.reshape(-1, width)
    if len(other) < LEAST_ROWS or _unlikeness(read, apart) > _limit(ALIKE, ALIKE_BY_CHANCE, read):
        return 0.0
    unlike = _unlikeness(other, apart)
    return unlike if unlike >= _limit(UNLIKE, UNLIKE_BY_CHANCE, other) else 0.0


def _limit(least: float, by_chance: float, rows: np.ndarray) -> float:
    return max(least, by_chance * math.sqrt(2 / len(rows)))


def _some(values: np.ndarray, width: int) -> np.ndarray:
    """Some rows of `width`, of all parts of the file."""
    rows = values[: len(values) // width * width].reshape(-1, width)
    chosen = np.random.default_rng(0).permutation(len(rows))[: MOST_VALUES // width]
    return rows[chosen].astype(np.float64)


def _unlikeness(rows: np.ndarray, apart: int) -> float:
    """The largest difference between the cumulative distributions of columns that are a multiple of `apart` places from each other, as
    Kolmogorov and Smirnov have it, 0 to 1."""
    rows = np.sort(np.where(np.isnan(rows), np.inf, rows), axis=0)
    levels = np.sort(rows, axis=None)[:: max(1, rows.size // LEVELS)]
    below = np.array([np.searchsorted(column, levels, side="right") for column in rows.T]) / len(rows)
    return max(float(np.ptp(below[first::apart], axis=0).max()) for first in range(apart))


def _is_eight(rows: np.ndarray) -> bool:
    """Whether the second half of `rows (N, 8)` is no return of its own: with columns of whole numbers, which its first half's aren't, such
    as rings or the zeros that fill PCL's points, or with a normal."""
    if not rows[:, 4:7].any():  # returns and beams without one in turn
        return False
    whole = (rows == np.floor(rows)).all(axis=0)
    if (whole[4:7] & ~whole[:3]).any():
        return True
    return any((np.abs(np.square(rows[:, first : first + 3].astype(np.float64)).sum(axis=1) - 1) < UNIT).all() for first in (3, 4))
