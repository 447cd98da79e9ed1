"""Deskewing: a planar laser turns while its robot moves, so each beam of a sweep has a pose of its own."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

LONGEST_SWEEP_S = 1.0
"""Planar lasers turn 5 to 50 times a second; a message that says more than this has its times in another unit."""


def sweep_ns(message) -> int:
    """Nanoseconds from the first to the last beam of a `sensor_msgs/LaserScan`; 0 where its `time_increment` is not set, or nonsense."""
    with np.errstate(over="ignore"):
        seconds = float(message.time_increment) * (len(message.ranges) - 1)
    return round(seconds * 1e9) if 0 < seconds <= LONGEST_SWEEP_S else 0


def deskewed(points: np.ndarray, starts: np.ndarray, first: np.ndarray, last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Both (N, 3), metres, as the sensor's frame had them at the first beam, from where each beam k had them at its own time.

    first, last: (4, 4), the sensor's poses at the first beam and at the last. Between them it goes on a line and turns at a constant rate.
    """
    shares = np.linspace(0.0, 1.0, len(points))[:, None]
    back = first[:3, :3].T
    turns = Rotation.from_rotvec(shares * Rotation.from_matrix(back @ last[:3, :3]).as_rotvec()).as_matrix()
    shifts = shares * (back @ (last[:3, 3] - first[:3, 3]))
    return tuple(np.einsum("nij,nj->ni", turns, part) + shifts for part in (points, starts))
