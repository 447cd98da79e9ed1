"""Deskewing: a laser turns while its robot moves, so each beam of a sweep has a pose of its own."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from hilbertvae.scans.rigid_motion import motion_between

PIECES = 8
"""Of a sweep, each on a line and at a constant rate: a robot's transforms come 10 to 100 times a second."""

Beams = tuple[np.ndarray, np.ndarray]


def deskewed(points: np.ndarray, starts: np.ndarray, shares: np.ndarray, motion: np.ndarray) -> Beams:
    """Both (N, 3), metres, as the sensor's frame had them at first, from where each beam had them at its own time.

    shares: (N,), how much of the motion was done at that time. motion: (4, 4), the sensor's pose after all of it in its first frame; it
    goes on a line and turns at a constant rate, before and after, too.
    """
    turns = Rotation.from_rotvec(shares[:, None] * Rotation.from_matrix(motion[:3, :3]).as_rotvec()).as_matrix()
    shifts = shares[:, None] * motion[:3, 3]
    return tuple(np.einsum("nij,nj->ni", turns, part) + shifts for part in (points, starts))


def deskewed_along(
    points: np.ndarray, starts: np.ndarray, times_ns: np.ndarray, pose_at: Callable[[int], np.ndarray | None], pose: np.ndarray
) -> Beams | None:
    """Both (N, 3), metres, in the sensor's frame at `pose` (4, 4), from where each beam had them at its own time (N,) int64.

    pose_at: (4, 4) at such a time, or None where none is known. Then there is no answer: a bag may end, or transforms pause, in a sweep.
    """
    knots = times_ns.min() + np.unique(np.linspace(0, np.ptp(times_ns), PIECES + 1).round().astype(np.int64))
    poses = [pose_at(int(knot)) for knot in knots]
    if any(each is None for each in poses):
        return None
    if len(knots) == 1:
        knots, poses = np.append(knots, knots + 1), poses * 2
    points, starts = points.copy(), starts.copy()
    piece = np.clip(np.searchsorted(knots, times_ns, side="right") - 1, 0, len(knots) - 2)
    for number in np.unique(piece):
        chosen = np.flatnonzero(piece == number)
        shares = (times_ns[chosen] - knots[number]) / (knots[number + 1] - knots[number])
        moved = deskewed(points[chosen], starts[chosen], shares, motion_between(poses[number], poses[number + 1]))
        back = motion_between(pose, poses[number])
        points[chosen], starts[chosen] = (part @ back[:3, :3].T + back[:3, 3] for part in moved)
    return points, starts
