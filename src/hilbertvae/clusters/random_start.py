"""Random start: points of the cloud, each as likely as any other (the plainest row of the paper's Fig. 2)."""

from __future__ import annotations

import numpy as np

from hilbertvae.checks import check_count, check_points, check_whole


def random_start(points: np.ndarray, count: int, seed: int = 0) -> np.ndarray:
    """(count, D) different ones of `points (N, D)`; an `InputError` for more than there are."""
    points = check_points(points, "points")
    count = check_count(count, "count", len(points))
    return points[np.random.default_rng(check_whole(seed, "seed")).choice(len(points), count, replace=False)]
