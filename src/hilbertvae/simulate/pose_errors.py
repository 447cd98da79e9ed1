"""Errors of poses as scan matching leaves them: they wander slowly, so that a wall seen again later lies beside itself."""

from __future__ import annotations

import numpy as np

MEMORY = 0.9
"""What an error keeps from scan to scan: it wanders over about ten of them."""


def wandering(shocks: np.ndarray) -> np.ndarray:
    """(S, N) errors, the first of which is the first of `shocks (S, N)`, and all of which spread as these do (an AR(1) process)."""
    error = shocks.copy()
    for k in range(1, len(error)):
        error[k] = MEMORY * error[k - 1] + np.sqrt(1 - MEMORY**2) * shocks[k]
    return error
