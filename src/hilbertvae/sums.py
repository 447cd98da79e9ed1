"""Sums of rows by group."""

from __future__ import annotations

import numpy as np


def sums_by(group: np.ndarray, values: np.ndarray, count: int, weight: np.ndarray | None = None) -> np.ndarray:
    """(count, D) sums of `values (P, D)`, each times its `weight (P,)` if there is one, over those whose `group (P,)` is 0, 1, ...;
    added in their order, so that the same rows give the same bits."""
    return np.stack([np.bincount(group, axis if weight is None else weight * axis, count) for axis in values.T], axis=1)
