"""Scans that come one after the other, each in its sensor's frame and with a pose, put together in the map frame."""

from __future__ import annotations

import os

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.scans.beam_lengths import UnitCheck, within_range
from hilbertvae.scans.rounded import RoundedCheck
from hilbertvae.scans.scan import Scans


class ScanCollector:
    """`len` says how many scans there are; they are numbered from 0, and beams by their place in their scan. Beams of `min_range_m` and
    less and of `max_range_m` and more are left out."""

    def __init__(self, min_range_m: float, max_range_m: float):
        self._range_m = min_range_m, max_range_m
        self._unit, self._rounded = UnitCheck(max_range_m, min_range_m=min_range_m), RoundedCheck()
        self._parts: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]] = []

    def within(self, lengths: np.ndarray) -> np.ndarray:
        """(K,) which beams of a scan are kept, by the `lengths (N,)` of all, in metres; NaN or inf for those without a return."""
        self._unit.see(lengths)
        return np.flatnonzero(within_range(lengths, *self._range_m))

    def add(self, points: np.ndarray, starts: np.ndarray, kept: np.ndarray, pose: np.ndarray, dimension: int = 3) -> None:
        """The next scan: the returns at `kept (K,)` of `points` and `starts (N, 3)`, metres, sensor frame. pose: (3, 4) or (4, 4), from
        there to the map frame, of whose axes the first `dimension` stay."""
        self._rounded.see(points[kept])
        turn, shift = pose[:3, :3].T, pose[:3, 3]
        placed = ((part[kept] @ turn + shift)[:, :dimension] for part in (points, starts))
        self._parts.append((*placed, np.full(len(kept), len(self), np.int32), kept.astype(np.int32)))

    def warn(self, path: str | os.PathLike) -> None:
        """One warning where the beams of all scans, kept or not, can't be metres, and one where returns were rounded before they came."""
        self._unit.warn(path)
        self._rounded.warn(path)

    def __len__(self) -> int:
        return len(self._parts)

    def whole(self, path: str | os.PathLike, seen: int, where: str = "") -> Scans:
        """All of them; an `InputError` where none of `seen` scans has a beam, which names the path and `where` in it they are."""
        if not sum(len(points) for points, *_ in self._parts):
            low, high = self._range_m
            raise InputError(f"{path}: expected beams of {low} to {high} m{where}, found none in {seen} scans{self._unit.hint(high)}")
        return Scans(*map(np.concatenate, zip(*self._parts, strict=True)), left_out=self._unit.left_out)
