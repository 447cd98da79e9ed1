"""Scans that come one after the other, each in its sensor's frame and with a pose, put together in the map frame."""

from __future__ import annotations

import numpy as np

from hilbertvae.scans.scan import Scans


class ScanCollector:
    """`len` says how many scans there are; they are numbered from 0, and beams by their place in their scan."""

    def __init__(self):
        self._parts: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]] = []

    def add(self, points: np.ndarray, starts: np.ndarray, kept: np.ndarray, pose: np.ndarray, dimension: int = 3) -> None:
        """The next scan: the returns at `kept (K,)` of `points` and `starts (N, 3)`, metres, sensor frame. pose: (3, 4) or (4, 4), from
        there to the map frame, of whose axes the first `dimension` stay."""
        turn, shift = pose[:3, :3].T, pose[:3, 3]
        placed = ((part[kept] @ turn + shift)[:, :dimension] for part in (points, starts))
        self._parts.append((*placed, np.full(len(kept), len(self), np.int32), kept.astype(np.int32)))

    def __len__(self) -> int:
        return len(self._parts)

    def returns(self) -> int:
        """How many beams there are in all scans together."""
        return sum(len(points) for points, *_ in self._parts)

    def whole(self) -> Scans:
        """All of them, of which there is one at least."""
        return Scans(*map(np.concatenate, zip(*self._parts, strict=True)))
