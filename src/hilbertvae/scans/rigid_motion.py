"""Rigid motions as matrices (4, 4), of a rotation and a place in metres."""

from __future__ import annotations

import numpy as np


def motion_between(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(4, 4): the pose `second` in the frame of the pose `first`. Exact to the last bits for places of UTM's size, too, which are
    subtracted before anything is turned."""
    found = np.eye(4)
    found[:3, :3] = first[:3, :3].T @ second[:3, :3]
    found[:3, 3] = first[:3, :3].T @ (second[:3, 3] - first[:3, 3])
    return found
