"""Whether coordinates were rounded before they came, by the bits or digits that they were kept in, so far that walls are moved by it."""

from __future__ import annotations

import os
import warnings

import numpy as np

ROUNDED_M = 0.025
"""Numbers that are kept to more than this move walls: a quarter of the smallest cell that maps have unless told otherwise."""
PRECISIONS = ((np.float16, "half"), (np.float32, "single"))
FEW_PLACES = 8
"""Changes from place to place, below which origins in float64 are too few to tell rounded ones from round ones."""
LOOKED_AT = 64
"""Numbers that settle nearly always that others have more digits."""
DIGITS = (6, 7)
"""As `std::cout` and `%g` write numbers unless told otherwise, and as KITTI's `%e`."""
LEFT_OVER_M = 1e-200
"""Less is what arithmetic left of a zero: no place, and too small for a power of ten to bring its digits before the point."""


class RoundedCheck:
    """Sees coordinates, scan by scan, and warns of those that were kept in so few bits or digits, so far off (UTM), that walls are moved
    by it."""

    def __init__(self, what: str = "coordinates", digits: bool = True):
        self._what, self._digits, self._worst = what, digits, (0.0, 0.0, "")

    def see(self, points: np.ndarray) -> None:
        """Coordinates (N, D), metres, of a scan in the frame that they were kept in; those without a return may be inf or NaN."""
        far_m = float(np.abs(points).max(initial=0.0, where=np.isfinite(points)))
        for kind, name in PRECISIONS:
            with np.errstate(over="ignore", invalid="ignore"):
                step_m = float(np.spacing(kind(far_m)))
            if step_m > self._worst[0] and step_m > ROUNDED_M and _is_kept_in(points, kind, step_m):
                said = f"are in {name} precision, which keeps them to {step_m:.2g} m; take an offset away before they are made so"
                self._worst = step_m, far_m, f"{said}, or keep float64"
        step_m, said = _few_digits(points) if self._digits else (0.0, "")
        if step_m > self._worst[0]:
            self._worst = step_m, far_m, said

    def warn(self, path: str | os.PathLike, stacklevel: int = 4) -> None:
        """One `UserWarning` about the coarsest of what was seen."""
        step_m, far_m, said = self._worst
        if step_m:
            warnings.warn(f"{path}: its {self._what}, up to {far_m:.7g} m, {said}", stacklevel=stacklevel)


def _is_kept_in(points: np.ndarray, kind: type, step_m: float) -> bool:
    """Whether all finite coordinates are numbers of this precision, and not round ones. Whole metres are of any that has them, and say
    nothing; neither do whole steps of the farthest coordinate, if those that are nearer, and were kept to finer ones, are such, too."""
    finite = points[np.isfinite(points)]
    with np.errstate(over="ignore"):
        alike = all((part == part.astype(kind)).all() for part in (finite[:LOOKED_AT], finite))
    if not alike or (step_m < 1 and (finite == np.round(finite)).all()):
        return False
    nearer = finite[np.abs(finite) < np.abs(finite).max() / 2]
    return len(np.unique(nearer)) < FEW_PLACES or bool((nearer % step_m != 0).any())


def warn_if_single(came: object, points: np.ndarray, what: str) -> None:
    """A `UserWarning` where what `came`, as an array or a tensor, in single or half precision, and is `points` (N, D) now, is so far off
    that walls are moved by it."""
    if str(getattr(came, "dtype", "")).endswith(("float32", "float16")):
        check = RoundedCheck(digits=False)
        check.see(points)
        check.warn(what, stacklevel=5)


def warn_if_rounded(points: np.ndarray, path: str | os.PathLike, what: str = "coordinates", came_as: np.dtype | None = None) -> None:
    """`RoundedCheck` of one scan (N, D). came_as: their type in a file or an array, where that is known: of a few places in float64, or in
    whole numbers, nothing is asked, since round ones have few bits and digits, too."""
    if came_as is not None and (np.dtype(came_as).itemsize >= 8 or np.dtype(came_as).kind in "iu"):
        places = np.atleast_2d(points)
        if np.count_nonzero((places[1:] != places[:-1]).any(axis=1)) < FEW_PLACES:
            return
    check = RoundedCheck(what)
    check.see(points)
    check.warn(path)


def warn_of_few_digits(places: np.ndarray, path: str | os.PathLike) -> None:
    """One `UserWarning` about finite places (S, D), of a text, in so few digits, so far off, that walls are moved by it. Whether they are
    of few bits is not asked: some few places, each half a metre, are."""
    step_m, said = _few_digits(places)
    if step_m:
        warnings.warn(f"{path}: its places, up to {np.abs(places).max():.7g} m, {said}", stacklevel=4)


def _few_digits(places: np.ndarray) -> tuple[float, str]:
    """To how many metres `DIGITS` keep places that have no more, and what to say of it; 0 where that moves no wall."""
    step_m, digits = digits_kept(places)
    if step_m <= ROUNDED_M or digits not in DIGITS:  # fewer are of places that somebody thought of
        return 0.0, ""
    return step_m, f"have at most {digits} digits, which keep them to {step_m:g} m; write more digits, or take an offset away first"


def digits_kept(places: np.ndarray) -> tuple[float, int]:
    """The metres of the last digit that the largest of the finite places has where all are written with few, and how many these are; zeros
    where some have more than `DIGITS`."""
    finite = places[np.isfinite(places) & (np.abs(places) >= LEFT_OVER_M)]
    if not len(finite):
        return 0.0, 0
    highest = int(np.floor(np.log10(np.abs(finite).max())))
    for digits in range(1, max(DIGITS) + 1):
        if all(_has_digits(part, digits) for part in (finite[:LOOKED_AT], finite)):
            return 10.0 ** (highest + 1 - digits), digits
    return 0.0, 0


def _has_digits(numbers: np.ndarray, digits: int) -> bool:
    """Whether none of the numbers, each of `LEFT_OVER_M` or more, has more significant digits than these."""
    scaled = numbers * 10.0 ** (digits - 1 - np.floor(np.log10(np.abs(numbers))))
    return bool((np.abs(scaled - np.round(scaled)) <= 1e-14 * np.abs(scaled)).all())
