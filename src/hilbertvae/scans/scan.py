"""Laser scans in one map frame: what every reader returns and the simulator makes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hilbertvae.checks import InputError, check_points


class LeftOut(NamedTuple):
    """How many of the returns that were `seen` a reader left out as too `near` or too `far`; what is known to be a code for no return is
    none."""

    near: int = 0
    far: int = 0
    seen: int = 0


HELD_OUT_EVERY = 10
"""Each tenth beam is given to no mapper and scores what was observed (METHOD 7)."""


@dataclass(frozen=True)
class Scans:
    """The returns of one drive, in the order of travel. Beams without a return are not here.

    points: (N, D) float64, metres, map frame: where each beam ended.
    origins: (N, D) float64, metres, map frame: where each beam started.
    scan: (N,) int32, the sweep a return belongs to, counted on by one from each to the next (one that returned nothing has a number, too):
        by it and `beam` a tenth of the beams is held out, and scans are hidden.
    beam: (N,) int32, the beam's number within its sweep.
    left_out: what the reader's ranges left out, to be told to who reads them.
    """

    points: np.ndarray
    origins: np.ndarray
    scan: np.ndarray
    beam: np.ndarray
    left_out: LeftOut = LeftOut()

    def __post_init__(self):
        points = check_points(self.points, "scans.points", allow_empty=True)
        origins = check_points(self.origins, "scans.origins", dimension=points.shape[1], allow_empty=True)
        numbers = (_numbers(self.scan, "scans.scan"), _numbers(self.beam, "scans.beam"))
        for name, value in zip(("points", "origins", "scan", "beam"), (points, origins, *numbers), strict=True):
            object.__setattr__(self, name, value)  # as what they were given as, float32 would move voxels and uint8 wrap around
        lengths = {len(self.points), len(self.origins), len(self.scan), len(self.beam)}
        if len(lengths) > 1:
            raise InputError(f"scans: expected points, origins, scan and beam of one length, got {sorted(lengths)}")

    def __len__(self) -> int:
        return len(self.points)

    @property
    def dimension(self) -> int:
        return self.points.shape[1]

    def select(self, chosen: np.ndarray) -> Scans:
        """The returns at `chosen`, a mask or indices."""
        return Scans(self.points[chosen], self.origins[chosen], self.scan[chosen], self.beam[chosen])

    def held_out(self) -> np.ndarray:
        """(N,) bool: the returns of each tenth beam, a different tenth in each sweep so that no bearing is always missing.

        Where beams are numbered firing by firing, lasers of one parity alone give those of a sweep, and the others those of the next.
        """
        return (self.beam + self.scan) % HELD_OUT_EVERY == 0


def _numbers(values: np.ndarray, name: str) -> np.ndarray:
    values = np.asarray(values)
    if values.ndim != 1 or (len(values) and values.dtype.kind not in "iu"):
        raise InputError(f"{name}: expected (N,) whole numbers, got {values.dtype} of shape {values.shape}")
    if len(values) and not -(2**31) <= values.min() <= values.max() < 2**31:
        raise InputError(f"{name}: expected numbers of 32 bits, got {values.min()} to {values.max()}")
    return values.astype(np.int32, copy=False)
