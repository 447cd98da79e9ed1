"""The five starts side by side (the paper's Fig. 2): time over the number of points, potential over Lloyd's iterations.

All get as many seeds as Quick-Means draws for the same points and seed, so that their potentials are of equal numbers of clusters.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from hilbertvae.checks import InputError, check_count, check_points, check_positive, check_seeds
from hilbertvae.clusters.ask_means import ask_means
from hilbertvae.clusters.lloyd import lloyd
from hilbertvae.clusters.starts import COUNTED, check_start, quick_means_seeds

CLOUDS = ("returns", "uniform")
Draw = Callable[[int, int], np.ndarray]
"""A cloud of so many points for a seed: (size, seed) -> (size, D) metres."""
TOO_MANY = 0.01
"""Share of ASK-Means' seeds too many at which no better threshold is looked for."""
TRIALS = 16
REPEATS = 3
REPEATED_SECONDS = 0.2
WARMING_POINTS = 500


@dataclass
class StudySettings:
    """What is compared, and on what. The defaults take a minute for all starts together; the paper's figure is the mean of 50 seeds."""

    cloud: str = "returns"
    """`returns`: random ones of a site's, so that a larger cloud is a denser one; `uniform`: in a square that grows with the number."""
    sizes: list[int] = field(default_factory=lambda: [1000, 2000, 5000, 10_000, 20_000])
    """Numbers of points."""
    seeds: list[int] = field(default_factory=lambda: list(range(10)))
    """Each draws a cloud of its own at each size, the same for every start."""
    inner_radius_m: float = 1.0
    """Of Quick-Means: it decides how many clusters there are."""
    lloyd_iterations: int = 10
    points_per_m2: float = 12.5
    """Of the uniform cloud, in the plane."""

    def check(self) -> None:
        """An `InputError` that names the key for a value that makes no study."""
        if self.cloud not in CLOUDS:
            raise InputError(f"study.cloud: expected one of {', '.join(CLOUDS)}, got {self.cloud!r}")
        if not isinstance(self.sizes, (list, tuple, range)):
            raise InputError(f"study.sizes: expected a list of numbers of points, got {self.sizes!r}")
        if not self.sizes:
            raise InputError("study.sizes: expected at least one, got none")
        for size in self.sizes:
            check_count(size, "study.sizes")
        check_seeds(self.seeds, "study.seeds")
        check_positive(self.inner_radius_m, "study.inner_radius_m")
        check_count(self.lloyd_iterations, "study.lloyd_iterations")
        check_positive(self.points_per_m2, "study.points_per_m2")


def study_clouds(settings: StudySettings, returns: np.ndarray | None = None) -> Draw:
    """What draws a study's clouds. returns: (N, D) metres, a site's, unless they are uniform. Raises `InputError` for settings that make no
    study, and for returns that are too few."""
    settings.check()
    if settings.cloud == "uniform":
        return uniform_squares(settings.points_per_m2)
    if returns is None:
        raise InputError("returns: expected points of a site for study.cloud=returns, got none")
    return random_parts(returns, max(settings.sizes))


def study(start: str, settings: StudySettings, clouds: Draw, progress: Callable[[int, int], None] | None = None) -> list[dict]:
    """A plain row for each size and seed that the settings name, on `study_clouds`. A size and a seed draw the same cloud for every start,
    so starts can be compared pairwise. Raises `InputError` for an unknown start.

    seconds: wall time of finding the seeds, the shortest of three where that is a matter of milliseconds. potentials_m2: before the first
    of Lloyd's iterations and after each. progress: called with (runs done, runs in all).
    """
    check_start(start)
    drawn = [(size, seed) for size in settings.sizes for seed in settings.seeds]
    _find_seeds(start, clouds(*drawn[0])[:WARMING_POINTS], settings.inner_radius_m, drawn[0][1])  # the first call loads code
    rows = []
    for size, seed in drawn:
        cloud = clouds(size, seed)
        found, seconds = _find_seeds(start, cloud, settings.inner_radius_m, seed)
        potentials = lloyd(cloud, found, settings.lloyd_iterations)[1]
        row = {"start": start, "points": size, "seed": seed, "seconds": seconds, "clusters": len(found), "potentials_m2": potentials}
        rows.append(row)
        if progress:
            progress(len(rows), len(drawn))
    return rows


def random_parts(points: np.ndarray, largest: int) -> Draw:
    """Clouds of different ones of `points (N, D)`; an `InputError` if these are fewer than the largest is to have."""
    points = check_points(points, "points")
    check_count(largest, "sizes", len(points))

    def draw(size: int, seed: int) -> np.ndarray:
        return points[np.random.default_rng([size, seed]).choice(len(points), size, replace=False)]

    return draw


def uniform_squares(points_per_m2: float) -> Draw:
    """Clouds in the plane, uniform in a square of such a size that they are all as dense."""

    def draw(size: int, seed: int) -> np.ndarray:
        return np.random.default_rng([size, seed]).uniform(0, np.sqrt(size / points_per_m2), (size, 2))

    return draw


def _find_seeds(start: str, points: np.ndarray, inner_radius_m: float, seed: int) -> tuple[np.ndarray, float]:
    """Seeds, as many as Quick-Means draws, and the seconds that they took."""
    drawn, seconds = _timed(lambda: quick_means_seeds(points, inner_radius_m, seed))
    if start == "quick_means":
        return drawn, seconds
    if start == "ask_means":
        threshold_m = matching_threshold(points, len(drawn), inner_radius_m, seed)
        found, seconds = _timed(lambda: ask_means(points, threshold_m, seed=seed))
        return found[: len(drawn)], seconds
    return _timed(lambda: COUNTED[start](points, len(drawn), seed=seed))


def matching_threshold(points: np.ndarray, count: int, inner_radius_m: float, seed: int) -> float:
    """The threshold (m) at which ASK-Means picks `count` seeds or hardly more, where Quick-Means draws `count` for the inner radius.

    ASK-Means takes a threshold and no number, so the threshold is narrowed in on, from the inner radius on. The number falls with it only
    by and large; where no threshold tried hits it, the one with the fewest seeds too many is taken. The last seeds, picked when least
    was left to cover, are then cut off, as if ASK-Means had been stopped. Half of the inner radius always gives enough: Quick-Means'
    seeds are more than the inner radius apart, so no seed of ASK-Means is closer than half of it to two of them.
    """
    low, high = inner_radius_m / 2, np.inf  # gives enough seeds; gives too few
    best, fewest = low, np.inf
    threshold_m = inner_radius_m
    for _ in range(TRIALS):
        found = len(ask_means(points, threshold_m, seed=seed))
        if found >= count:
            low = threshold_m
            if found < fewest:
                best, fewest = threshold_m, found
            if found <= count * (1 + TOO_MANY):
                break
        else:
            high = threshold_m
        threshold_m = low * 1.1 if high == np.inf else (low + high) / 2
    return best


def _timed(work: Callable[[], np.ndarray]) -> tuple[np.ndarray, float]:
    """What `work` returns, and the shortest time of some repeats: of what takes milliseconds, one time says little."""
    spent: list[float] = []
    while len(spent) < REPEATS and sum(spent) < REPEATED_SECONDS:
        begun = time.perf_counter()
        found = work()
        spent.append(time.perf_counter() - begun)
    return found, min(spent)
