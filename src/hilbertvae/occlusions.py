"""Occlusions to learn from: what is left of a drive when some of its scans, or a part of each scan, are not there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hilbertvae.scans.scan import Scans

MOST_SPARSE = 16
"""At most every n-th scan is kept."""
STRETCH_SHARE = (0.3, 0.7)
"""Share of the drive that a stretch has."""
SECTOR_RAD = (np.pi / 3, np.pi)
"""Width of the sector that is lost from every scan."""
MOST_DRAWS = 100


def random_occlusion(scans: Scans, seed: int) -> np.ndarray:
    """(N,) bool: the returns that are kept: some and not all, or all where hardly any draw can do that, as of returns in one direction.

    One of three ways, drawn from `seed`: every k-th scan (a robot that drives by fast), a stretch of the drive (one that has not been
    everywhere), or every scan without one sector of bearings (one that does not look back). A site of a single scan has the last alone.
    Numbers count from the drive's first scan.
    """
    rng = np.random.default_rng([seed, 0x0CC1])
    if len(scans):  # as frames of a recording may begin at 4000, and a stretch from 0 on would mostly hold all or nothing
        scans = replace(scans, scan=scans.scan.astype(np.int64) - scans.scan.min())
    count = int(scans.scan.max()) + 1 if len(scans) else 0
    ways = [_sparse, _sparse, _stretch, _sector] if count > 1 else [_sector]
    for _ in range(MOST_DRAWS):
        kept = ways[rng.integers(len(ways))](scans, count, rng)
        if kept.any() and not kept.all():
            return kept
    return np.ones(len(scans), bool)


def _sparse(scans: Scans, count: int, rng: np.random.Generator) -> np.ndarray:
    step = rng.integers(2, max(2, min(MOST_SPARSE, count // 2)) + 1)
    return scans.scan % step == rng.integers(min(step, count))


def _stretch(scans: Scans, count: int, rng: np.random.Generator) -> np.ndarray:
    length = np.clip(round(rng.uniform(*STRETCH_SHARE) * count), 1, count - 1)
    first = rng.integers(count - length + 1)
    return (scans.scan >= first) & (scans.scan < first + length)


def _sector(scans: Scans, count: int, rng: np.random.Generator) -> np.ndarray:
    """The same sector of the map's bearings in every scan: where others would fill it in, nothing would be hidden."""
    x, y = (scans.points - scans.origins)[:, :2].T
    start, width = rng.uniform(0, 2 * np.pi), rng.uniform(*SECTOR_RAD)
    return (np.arctan2(y, x) - start) % (2 * np.pi) >= width
