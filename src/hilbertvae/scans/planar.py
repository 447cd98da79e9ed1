"""Whether scans of three coordinates are those of a planar laser, whose map is a plan."""

from __future__ import annotations

import os
import warnings

import numpy as np

from hilbertvae.scans.scan import Scans

FLAT_M = 1e-3
"""Points of a planar laser in a format of three coordinates differ in height by rounding alone."""
MOST_LIFT_M = 0.5
"""Heights and leanings up to here are those of a robot on a floor, or of the errors of its poses; beyond, a planar laser is nodded or
lifted to see in three dimensions."""
MOST_LEAN_DEG = 2.0
TELLING = 4
"""Returns that a scan needs for its plane to say something: three beams lie in one nearly always."""
SPREAD = 0.01
"""Beams that fan out less, of their length, tell a plane's slope along them alone."""


def as_plan(scans: Scans, path: str | os.PathLike) -> Scans:
    """`scans` without heights where they are a planar laser's that stays level, as they are otherwise; a `UserWarning` says which.

    A scan is planar where its returns lie in one plane with where its beams start, however its pose lifts and turns it. Scans of a 3D
    lidar never do: those of a bare floor, say, lie in one plane, but not in one with the lidar.
    """
    slopes = _slopes(scans) if scans.dimension == 3 else None
    if slopes is None:
        return scans
    lift_m, lean_deg = np.ptp(scans.origins[:, 2]), np.rad2deg(np.arctan(np.linalg.norm(slopes, axis=1).max()))
    said = f"{path}: each scan is planar, at heights that differ by {lift_m:.2g} m, and leans by up to {lean_deg:.2g} degrees"
    if lift_m > MOST_LIFT_M or lean_deg > MOST_LEAN_DEG:
        limits = f"{MOST_LIFT_M:g} m or {MOST_LEAN_DEG:g} degrees"
        warnings.warn(f"{said}; beyond {limits} the map is of three dimensions. Poses of x, y and heading make it a plan", stacklevel=4)
        return scans
    warnings.warn(f"{said}, so that the map is of two dimensions", stacklevel=4)
    return Scans(scans.points[:, :2], scans.origins[:, :2], scans.scan, scans.beam, scans.left_out)


def _slopes(scans: Scans) -> np.ndarray | None:
    """(S, 2): how the plane of each scan's beams rises along x and y, the least where several fit; None if a scan has no such plane."""
    first = np.flatnonzero(np.diff(scans.scan, prepend=scans.scan[:1] - 1))
    counts = np.diff(first, append=len(scans))
    is_level = np.abs(scans.points[:, 2] - scans.origins[:, 2]).max() < FLAT_M
    if not is_level and 2 * counts[counts >= TELLING].sum() < len(scans):
        return None
    slopes = []
    for begin, count in zip(first, counts, strict=True):
        part = slice(begin, begin + count)
        beams = scans.points[part] - scans.origins[part]
        slopes.append(np.linalg.lstsq(beams[:, :2], beams[:, 2], rcond=SPREAD)[0])
        if np.abs(beams[:, :2] @ slopes[-1] - beams[:, 2]).max() > FLAT_M:
            return None
    return np.array(slopes)
