"""How long beams are: which of them are kept, and what their lengths say of the unit of the coordinates."""

from __future__ import annotations

import os
import warnings
from collections import Counter

import numpy as np

from hilbertvae.scans.scan import LeftOut

LONGEST_MEDIAN_M = 1000.0
"""No laser that maps surroundings has half of its beams longer; a room in millimetres has."""
LONGEST_PLANAR_M = 100.0
"""So it is with a planar one; a room in centimetres has longer ones."""
SHORTEST_M = 1e-3
"""No laser measures less; a beam without a return, which drivers write as (0, 0, 0), ends where it began, but for rounding."""

LONGEST_BEAM_M = 1000.0
UNLIKE_OTHERS = 20.0
"""A beam that is so many times as long as half of the others, and longer than `LONGEST_BEAM_M`, is hardly a return."""
MANY_CUT = 1 / 3
"""Of all beams. Where more are left out for their length, what is left is hardly what was scanned, as of a room in millimetres."""
MOST_LONGER = 0.01
"""Of as many as are alike: stray returns, or what interference made."""
MANY_ALIKE = 0.02
"""Of all ranges. Real logs, cut at 26 to 45 m, have their largest range in fewer than one of 10 000 beams."""

POINTS_APART_M = 0.01
"""What distances of points differ by that had one range, where coordinates are kept to the centimetre."""
MANY_POINTS, LEAST_POINTS = 0.05, 20
"""Of all points, and of any. Within `POINTS_APART_M` of the longest lie 1 of 10 000 in real clouds, and where a planar laser looks along a
corridor up to 300."""


def beam_lengths(points: np.ndarray, origins: np.ndarray) -> np.ndarray:
    """(N,) of `points (N, D)` and the `origins` of their beams; NaN or inf where there is no return."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.sqrt(np.square(points - origins).sum(axis=1))


def within_range(lengths: np.ndarray, min_range_m: float, max_range_m: float) -> np.ndarray:
    """(N,) bool: beams longer than `min_range_m` and shorter than `max_range_m`; those without a return (NaN, inf) are not."""
    with np.errstate(invalid="ignore"):
        return (lengths > min_range_m) & (lengths < max_range_m)


def without_zeros(points: np.ndarray, at_least: int = 1) -> np.ndarray:
    """`points (N, D)` of a sensor's frame with NaN where they are (0, 0, 0), as drivers write for a beam without a return.

    Fewer than `at_least` such points are left as they are: where beams start elsewhere, a single one may be a true place.
    """
    zero = (points == 0).all(axis=1)
    return np.where(zero[:, None], np.nan, points) if zero.sum() >= max(at_least, 1) else points


class UnitCheck:
    """Sees the lengths of all beams, dropped ones included, scan by scan, and warns where they can't be metres, or too many are dropped."""

    def __init__(self, max_range_m: float = np.inf, longest_m: float = LONGEST_MEDIAN_M, min_range_m: float = 0.0):
        """max_range_m and min_range_m: from and up to where beams are dropped. longest_m: what no laser's median beam is longer than."""
        self._max_range_m, self._min_range_m, self._longest_m = max_range_m, min_range_m, longest_m
        self._seen = self._cut = self._near = 0
        self._medians: list[float] = []
        self._code_m = 0.0

    def see(self, lengths: np.ndarray) -> None:
        """The lengths of a scan's beams (N,), those without a return among them."""
        lengths = lengths[np.isfinite(lengths)]
        # A length that many beams of a scan have to the centimetre says that there was no return.
        far = lengths >= self._max_range_m
        found, place, alike = np.unique(lengths[far].round(2), return_inverse=True, return_counts=True)
        code = alike >= max(2, MANY_ALIKE * len(lengths))
        self._cut += int(alike[~code].sum())
        self._near += int(((lengths > SHORTEST_M) & (lengths <= self._min_range_m)).sum())
        self._seen += len(lengths)
        code &= found <= self._longest_m  # no laser's; in millimetres it may be
        told = np.concatenate([lengths[~far], lengths[far][~code[place]]])
        if len(told):
            self._medians.append(float(np.median(told)))
        self._code_m = max([self._code_m, *found[code]])

    @property
    def left_out(self) -> LeftOut:
        """Of the returns seen, codes and beams of no length aside."""
        return LeftOut(self._near, self._cut, self._seen)

    def hint(self, max_range_m: float) -> str:
        """What to add to the news that no beam is short enough: half of them are too long, which another unit may explain, or all have the
        length of no return."""
        if not self._medians and self._code_m:
            return f"; all of them are {self._code_m:g} m long, as lasers write where there is no return"
        if (middle := self._middle()) < max_range_m:
            return ""
        asked = "are they in millimetres?" if middle > self._longest_m else "is max_range_m too short for them?"
        return f"; half of the beams are longer than {middle:.4g} m: {asked}"

    def _middle(self) -> float:
        return float(np.median(self._medians)) if self._medians else 0.0

    def doubt(self) -> str:
        """What to say where the median beam, over the scans seen, is longer than any laser's; empty where it is not."""
        if (middle := self._middle()) <= self._longest_m:
            return ""
        asked = "are the coordinates in millimetres or centimetres, or is the sensor's origin in another frame? Metres are expected"
        return f"half of the beams are longer than {middle:.0f} m; {asked}"

    def warn(self, path: str | os.PathLike) -> None:
        """One `UserWarning` where the median beam, over the scans seen, is longer than any laser's, or where so many are cut off."""
        if doubt := self.doubt():
            warnings.warn(f"{path}: {doubt}", stacklevel=4)
        elif self._cut > MANY_CUT * self._seen:
            far = f"{self._cut} of {self._seen} beams are {self._max_range_m:g} m or longer and are left out"
            warnings.warn(f"{path}: {far}; are they in millimetres, or is reading.max_range_m too short for them?", stacklevel=4)


class ClippedCheck:
    """Sees all ranges, scan by scan, and warns where they end at one that many beams have, which says that there was no return."""

    def __init__(self, max_range_m: float, of_points: bool = False):
        """max_range_m: from where ranges are dropped. of_points: they are distances of points, which rounded coordinates make uneven."""
        self._max_range_m, self._alike, self._scans = max_range_m, Counter(), 0
        self._digits, self._apart_m = (2, POINTS_APART_M) if of_points else (3, 0.0)
        self._least, self._least_share = (LEAST_POINTS, MANY_POINTS) if of_points else (2, MANY_ALIKE)

    def see(self, ranges: np.ndarray) -> None:
        """The ranges of a scan (N,), metres; those without a return may be inf or NaN."""
        # All that are dropped count as one range, so that a cloud far from its sensor's origin takes no memory for each of its points.
        seen = ranges[np.isfinite(ranges)]
        seen = np.where(seen < self._max_range_m, seen, np.inf)
        found, count = np.unique(seen.round(self._digits), return_counts=True)
        self._scans += len(found) > 0
        self._alike.update(dict(zip(found.tolist(), count.tolist(), strict=True)))

    def warn(self, path: str | os.PathLike, key: str = "reading.max_range_m") -> None:
        """One `UserWarning` where such ranges were not dropped, also where a few stray ones are longer; `key` drops them."""
        ranges = np.array(sorted(self._alike))
        count = np.array([self._alike[range_m] for range_m in ranges.tolist()])
        up_to = np.concatenate([[0], np.cumsum(count)])
        reach_m = 1.5 * self._apart_m
        shorter, not_longer = up_to[np.searchsorted(ranges, ranges - reach_m)], up_to[np.searchsorted(ranges, ranges + reach_m, "right")]
        alike, longer, seen = not_longer - shorter, up_to[-1] - not_longer, up_to[-1]
        # A sensor that stood still has one and the same longest range in each scan.
        many = (alike >= self._least) & (alike > self._scans) & (alike >= self._least_share * seen) & (alike < seen)
        codes = np.flatnonzero(many & (longer <= MOST_LONGER * alike) & (ranges < self._max_range_m))
        if not len(codes):
            return
        code = codes[np.argmax(count[codes])]
        code_m, limit_m = float(ranges[code]), round(float(ranges[code]) - reach_m, 3)
        which = f"{code_m} m, and hardly any is longer" if longer[code] else f"the largest, {code_m} m"
        warnings.warn(
            f"{path}: {100 * alike[code] / seen:.2g} % of all ranges are {which}: are they beams without a return? Set "
            f"{key}={limit_m} to drop them",
            stacklevel=4,
        )


def warn_of_long_beams(lengths: np.ndarray, path: str | os.PathLike) -> None:
    """A `UserWarning` where some of the beams are far longer than a laser's and than most: a stray return, which free space leads to."""
    lengths = lengths[np.isfinite(lengths)]
    limit = max(LONGEST_BEAM_M, UNLIKE_OTHERS * float(np.median(lengths))) if len(lengths) else np.inf
    if many := np.count_nonzero(lengths > limit):
        text = f"{path}: {many} of {len(lengths)} beams are longer than {limit:.0f} m, up to {lengths.max():.6g} m; are they returns? "
        warnings.warn(f"{text}max_range_m drops them", stacklevel=3)
