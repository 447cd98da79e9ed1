"""Quick-Means against k-means++, faiss's k-means and random seeds: time, and potential after five Lloyd iterations (METHOD 2, Fig. 2).

    python benchmarks/quick_means.py [--quick]

The cloud is uniform in a square, 12.5 points per square metre, 1e5 of them for about 4.9k clusters: the plainest one. Random seeds have
1.12 times the potential of k-means++ there, in a cloud of walls 1.5 times and in a volume 1.04 times. All methods get as many clusters as
Quick-Means found.
"""

from __future__ import annotations

import faiss
import numpy as np
from measuring import arguments, report, seconds_of, target

from hilbertvae.clusters.comparison import uniform_squares
from hilbertvae.clusters.kmeans_plus_plus import kmeans_plus_plus
from hilbertvae.clusters.lloyd import lloyd
from hilbertvae.clusters.quick_means import quick_means
from hilbertvae.clusters.random_start import random_start

POINTS_PER_M2 = 12.5
INNER_RADIUS_M = 1.0
"""Of 1e5 points it makes about 4.9k clusters."""
OUTER_RADIUS_M = INNER_RADIUS_M / 0.55
LLOYD_ITERATIONS = 5

uniform_cloud = uniform_squares(POINTS_PER_M2)


def cluster(points: np.ndarray, seed: int):
    return quick_means(points, OUTER_RADIUS_M, INNER_RADIUS_M, seed=seed)


def potential(points: np.ndarray, seeds: np.ndarray) -> float:
    """Sum of squared distances (m^2) to the nearest centre after `LLOYD_ITERATIONS` from `seeds`."""
    return lloyd(points, seeds, LLOYD_ITERATIONS)[1][-1]


def faiss_centres(points: np.ndarray, count: int, seed: int) -> np.ndarray:
    """faiss's own k-means: random seeds and the same number of iterations."""
    sampling = {"min_points_per_centroid": 1, "max_points_per_centroid": len(points)}  # all of them
    kmeans = faiss.Kmeans(points.shape[1], count, niter=LLOYD_ITERATIONS, seed=seed, **sampling)
    kmeans.train(points.astype(np.float32))
    return kmeans.centroids


def compare(count: int, seeds: int) -> list[dict]:
    """A row per method: seconds and potentials, means over `seeds` clouds."""
    found: dict[str, list[tuple[float, float]]] = {}
    clusters = []
    for seed in range(seeds):
        points = uniform_cloud(count, seed)
        cluster(points[:1000], seed)  # the first call loads code
        seconds, ours = seconds_of(lambda: cluster(points, seed), repeats=3)  # noqa: B023 (called at once)
        clusters.append(len(ours))
        found.setdefault("Quick-Means", []).append((seconds, potential(points, ours.seeds)))
        seconds, theirs = seconds_of(lambda: kmeans_plus_plus(points, len(ours), seed=seed))  # noqa: B023
        found.setdefault("k-means++ (scikit-learn)", []).append((seconds, potential(points, theirs)))
        seconds, centres = seconds_of(lambda: faiss_centres(points, len(ours), seed))  # noqa: B023
        reached = lloyd(points, centres, 0)[1][0]
        found.setdefault("k-means (faiss, its 5 iterations included)", []).append((seconds, reached))
        seconds, chosen = seconds_of(lambda: random_start(points, len(ours), seed))  # noqa: B023
        found.setdefault("random", []).append((seconds, potential(points, chosen)))
        latest = "; ".join(f"{rows[-1][0]:.3g} s, {rows[-1][1]:.0f} m2" for rows in found.values())
        print(f"seed {seed}: {len(ours)} clusters; {latest}", flush=True)
    mean = {name: np.mean(rows, axis=0) for name, rows in found.items()}
    ours, plus = mean["Quick-Means"], mean["k-means++ (scikit-learn)"]
    return [
        {
            "method": name,
            "points": count,
            "clusters": int(np.mean(clusters)),
            "seconds": float(seconds),
            "times Quick-Means": float(seconds / ours[0]),
            "potential_m2": float(sum_m2),
            "potential / k-means++": float(sum_m2 / plus[1]),
        }
        for name, (seconds, sum_m2) in mean.items()
    ]


def scale(counts: list[int]) -> list[dict]:
    """Quick-Means alone at constant density; the best of three."""
    rows = []
    for count in counts:
        points = uniform_cloud(count, 0)
        seconds, found = seconds_of(lambda: cluster(points, 0), repeats=3)  # noqa: B023
        row = {"method": "Quick-Means, scaling", "points": count, "clusters": len(found), "seconds": seconds}
        rows.append({**row, "us per point": seconds / count * 1e6})
        print(f"{count:.0e} points: {seconds:.2f} s", flush=True)
    return rows


def main(words: list[str] | None = None) -> None:
    parser = arguments(__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    given = parser.parse_args(words)
    rows = compare(3000, 2) if given.quick else compare(100_000, given.seeds)
    grown = scale([3000, 30_000] if given.quick else [10**5, 10**6, 10**7])
    ratio, growth = rows[1]["times Quick-Means"], grown[-1]["us per point"] / grown[0]["us per point"]
    worse = rows[0]["potential / k-means++"]
    targets = [
        target("times faster than k-means++", ">= 250", ratio, ratio >= 250),
        target("potential after 5 Lloyd iterations / k-means++", "<= 1.05", worse, worse <= 1.05),
        target(f"time per point at {grown[-1]['points']:.0e} / at {grown[0]['points']:.0e}", "<= 2", growth, growth <= 2),
    ]
    facts = {"points_per_m2": POINTS_PER_M2, "inner_radius_m": INNER_RADIUS_M, "outer_radius_m": OUTER_RADIUS_M, "seeds": given.seeds}
    report("quick_means", given, [*rows, *grown], targets, facts)


if __name__ == "__main__":
    main()
