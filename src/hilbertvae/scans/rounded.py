"""Whether coordinates were rounded before they came, by the bits or digits that they were kept in, so far that walls are moved by it."""

from __future__ import annotations

import math
import os
import warnings

import numpy as np

ROUNDED_M = 0.025
"""Numbers that are kept to more than this move walls: a quarter of the smallest cell that maps have unless told otherwise."""
PRECISIONS = ((np.float16, "half"), (np.float32, "single"))
LOOKED_AT = 64
"""Numbers that settle nearly always that others have more digits."""
DIGITS = (6, 7)
"""As `std::cout` and `%g` write numbers unless told otherwise, and as KITTI's `%e`."""


class RoundedCheck:
    """Sees coordinates, scan by scan, and warns of those that were kept in so few bits, so far off (UTM), that walls are moved by it."""

    def __init__(self, what: str = "coordinates"):
        self._what, self._worst = what, (0.0, 0.0, "")

    def see(self, points: np.ndarray) -> None:
        """Coordinates (N, D), metres, of a scan in the frame that they were kept in; those without a return may be inf or NaN."""
        far_m = float(np.abs(points).max(initial=0.0, where=np.isfinite(points)))
        for kind, name in PRECISIONS:
            with np.errstate(over="ignore", invalid="ignore"):
                step_m = float(np.spacing(kind(far_m)))
            if step_m > self._worst[0] and step_m > ROUNDED_M and _is_kept_in(points, kind, step_m):
                self._worst = step_m, far_m, name

    def warn(self, path: str | os.PathLike) -> None:
        """One `UserWarning` about the coarsest of what was seen."""
        step_m, far_m, name = self._worst
        if step_m:
            text = f"{path}: its {self._what}, up to {far_m:.7g} m, are in {name} precision, which keeps them to {step_m:.2g} m"
            warnings.warn(f"{text}; take an offset away before they are made so, or keep float64", stacklevel=4)


def _is_kept_in(points: np.ndarray, kind: type, step_m: float) -> bool:
    """Whether all finite coordinates are numbers of this precision. Whole metres are of any that has them, and say nothing."""
    finite = points[np.isfinite(points)]
    with np.errstate(over="ignore"):
        alike = all((part == part.astype(kind)).all() for part in (finite[:LOOKED_AT], finite))
    return bool(alike and (step_m >= 1 or (finite != np.round(finite)).any()))


def warn_if_rounded(points: np.ndarray, path: str | os.PathLike, what: str = "coordinates") -> None:
    """`RoundedCheck` of one scan (N, D)."""
    check = RoundedCheck(what)
    check.see(points)
    check.warn(path)


def few_digits(places: np.ndarray) -> str:
    """What to say of places (S, 3) so far off (UTM), in so few digits, that walls are moved by it; else nothing."""
    far_m = np.abs(places).max()
    highest = math.floor(math.log10(far_m)) if far_m else -math.inf
    for digits in range(1, max(DIGITS) + 1):
        step_m = 10.0 ** (highest + 1 - digits)
        if step_m > ROUNDED_M and all(float(f"{number:.{digits - 1}e}") == number for number in places.flat):
            said = f"its places, up to {far_m:.7g} m, have at most {digits} digits, which keep them to {step_m:g} m"
            return said if digits in DIGITS else ""  # fewer are of places that somebody thought of
    return ""
