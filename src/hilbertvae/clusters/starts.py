"""The five ways to start (paper III-A, Fig. 2): which points of a cloud become the seeds of its clusters."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hilbertvae.checks import InputError, check_points, check_positive
from hilbertvae.clusters.ask_means import ask_means
from hilbertvae.clusters.clusters import Clusters, clusters_around
from hilbertvae.clusters.kmeans_parallel import kmeans_parallel
from hilbertvae.clusters.kmeans_plus_plus import kmeans_plus_plus
from hilbertvae.clusters.quick_means import check_radii, quick_means
from hilbertvae.clusters.random_start import random_start


def quick_means_seeds(points: np.ndarray, inner_radius_m: float, seed: int = 0) -> np.ndarray:
    """(M, D) all seeds that Quick-Means draws, however small their clusters."""
    check_positive(inner_radius_m, "inner_radius_m")
    return quick_means(points, inner_radius_m, inner_radius_m, minimum_points=0, seed=seed).seeds


def _ask_means(points: np.ndarray, inner_radius_m: float, seed: int) -> np.ndarray:
    return ask_means(points, inner_radius_m, seed=seed)


def _counted(start: Callable) -> Callable[[np.ndarray, float, int], np.ndarray]:
    """A start that is told how many seeds to find: as many as Quick-Means draws for the same cloud, radius and seed.

    So clusters are as dense whatever the start, and those with few points are dropped by the same rule afterwards.
    """

    def seeds(points: np.ndarray, inner_radius_m: float, seed: int) -> np.ndarray:
        return start(points, len(quick_means_seeds(points, inner_radius_m, seed)), seed=seed)

    return seeds


COUNTED = {"kmeans_parallel": kmeans_parallel, "kmeans_plus_plus": kmeans_plus_plus, "random": random_start}
"""Those that take a number of seeds."""
STARTS = {"quick_means": quick_means_seeds, "ask_means": _ask_means, **{name: _counted(start) for name, start in COUNTED.items()}}
"""All, by name: (points (N, D), inner_radius_m, seed) -> seeds (M, D)."""


def check_start(start: str, name: str = "start") -> str:
    """`start` if it is the name of one; an `InputError` otherwise."""
    if not isinstance(start, str) or start not in STARTS:
        raise InputError(f"{name}: expected one of {', '.join(STARTS)}, got {start!r}")
    return start


def find_clusters(
    points: np.ndarray, outer_radius_m: float, inner_radius_m: float, minimum_points: int = 1, seed: int = 0, start: str = "quick_means"
) -> Clusters:
    """Clusters of `points (N, D)`: seeds by `start`, with everything within the outer radius, if that is more than `minimum_points`.

    inner_radius_m: of Quick-Means, and the distance threshold of ASK-Means; it decides the number of seeds of the others too.
    """
    check_start(start)
    if start == "quick_means":
        return quick_means(points, outer_radius_m, inner_radius_m, minimum_points, seed)  # the same, without counting large balls
    points = check_points(points, "points")
    check_radii(outer_radius_m, inner_radius_m, minimum_points)
    return clusters_around(points, STARTS[start](points, inner_radius_m, seed), outer_radius_m, minimum_points)
