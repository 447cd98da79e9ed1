"""How many queries a second a Hilbert Map answers, K = 5, and how many OctoMap's batch look-up does.

    python benchmarks/queries.py [--checkpoint WEIGHTS] [--site csail] [--queries 1000000] [--quick]

Two rows are ours: the kernel alone (the K nearest boxes that hold a query, and their cells), and the whole answer with evidence and
weights. Queries lie within half a metre or so of observed voxels, so most have K boxes and evidence. The kernel is checked against
a loop over all boxes, the answers against the same queries asked one by one: both to the bit, but values between cells to rounding.
OctoMap's look-up runs on one core, since its binding is built without OpenMP; ours run on all.
"""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
from measuring import OCTOMAP_CORES, arguments, report, seconds_of, target
from octomap_layer import OctoMapLayer

from hilbertvae.grids.kernel import NONE, kernel
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.loading import load_mapper
from hilbertvae.mappers.mapper import answer_in_chunks
from hilbertvae.site import open_site

SPREAD_M = 0.5
CHECKED = 2000
FILES = {"csail": "queries", "kitti00_start": "queries_3d"}
"""Names of the files of the sites that the documentation speaks of; one of any other site has its name."""


def kernel_of_one(mapper: HilbertMap, query: np.ndarray) -> np.ndarray:
    """(K,) the brute-force twin: every box is asked whether it holds the query."""
    frames, grids = mapper.frames_, mapper.grids_
    held = []
    for m in range(len(frames)):
        place = frames.into(query[None], np.array([m]))[0]
        if (place >= -0.5 - 1e-12).all() and (place < 0.5 - 1e-12).all():
            value = value_between(grids[m], place) if mapper.grid_.interpolated else grids[m][cell_of(grids[m], place)]
            held.append((np.sqrt(np.square(query - frames.centre[m]).sum()), m, value))
    values = [value for _, _, value in sorted(held)[: mapper.neighbours]]
    return np.array(values + [0.0] * (mapper.neighbours - len(values)), np.float32)


def cell_of(grid: np.ndarray, place: np.ndarray) -> tuple[int, ...]:
    return tuple(np.floor((place + 0.5) * grid.shape[0] + 1e-9).astype(int))


def value_between(grid: np.ndarray, place: np.ndarray) -> float:
    """Each of the cells around a place, which lies in a box from -1/2 to 1/2, by how near its middle is."""
    along, total = (place + 0.5) * grid.shape[0] - 0.5, 0.0
    for corner in itertools.product((0, 1), repeat=len(place)):
        cell = np.floor(along) + corner
        share = np.prod(1 - np.abs(along - cell))
        total += share * float(grid[tuple(np.clip(cell, 0, grid.shape[0] - 1).astype(int))])
    return total


def main(words: list[str] | None = None) -> None:
    parser = arguments(__doc__)
    parser.add_argument("--checkpoint", help="trained weights; the raw grids unless given, which costs a query as much")
    parser.add_argument("--site", default="csail")
    parser.add_argument("--queries", type=int, default=1_000_000)
    given = parser.parse_args(words)
    site = open_site("simulated:1" if given.quick else given.site)
    count, checked = (20_000, 50) if given.quick else (given.queries, CHECKED)
    mapper = load_mapper(given.checkpoint) if given.checkpoint else HilbertMap(None, weights="unit")
    mapper.fit(site.fit.points, site.fit.occupied, site.fit.weight)
    rng = np.random.default_rng(0)
    queries = site.fit.points[rng.integers(len(site.fit), size=count)] + rng.normal(0, SPREAD_M, (count, site.dimension))

    def mean_value(some: np.ndarray) -> np.ndarray:
        return values(some).sum(axis=1)

    def values(some: np.ndarray) -> np.ndarray:
        holding = mapper.index_.holding(some, mapper.neighbours)
        return kernel(mapper.grids_, mapper.frames_, some, holding, mapper.grid_.interpolated)

    kernel_s, _ = seconds_of(lambda: answer_in_chunks(mean_value, queries, mapper.chunk), repeats=3)
    whole_s, probability = seconds_of(lambda: mapper.predict_proba(queries)[:, 1], repeats=3)
    octomap = OctoMapLayer(site.fit.points, site.fit.occupied, site.resolution_m)
    octomap_s, _ = seconds_of(lambda: octomap.labels(queries), repeats=3)

    sample = rng.choice(count, checked, replace=False)
    twin = np.stack([kernel_of_one(mapper, query) for query in queries[sample]])
    rounding = 1e-4 if mapper.grid_.interpolated else 0.0
    unequal = np.count_nonzero((np.abs(twin - values(queries[sample])) > rounding).any(axis=1))
    alone = np.array([mapper.predict_proba(query[None])[0, 1] for query in queries[sample]])
    unequal_alone = np.count_nonzero(alone != probability[sample])

    rows = [
        {"what": what, "queries": count, "seconds": seconds, "per second": count / seconds, "OctoMap's time": seconds / octomap_s}
        for what, seconds in (
            (f"Hilbert Map, kernel, K = {mapper.neighbours}", kernel_s),
            ("Hilbert Map, predict_proba", whole_s),
            ("OctoMap, getLabels", octomap_s),
        )
    ]
    targets = [
        target("kernel look-ups per second", ">= 1e6", count / kernel_s, count / kernel_s >= 1e6),
        target("answers per second", ">= 1e6", count / whole_s, count / whole_s >= 1e6),
        target(f"kernel values of {checked} that differ from the brute-force twin", "0", unequal, unequal == 0),
        target(f"answers of {checked} that differ when asked alone", "0", unequal_alone, unequal_alone == 0),
    ]
    boxes = float((mapper.index_.holding(queries[:10_000], mapper.neighbours) != NONE).sum(axis=1).mean())
    facts = {
        "interpolated": mapper.grid_.interpolated,
        "site": site.name,
        "OctoMap's cores": OCTOMAP_CORES,
        "boxes": len(mapper.frames_),
        "boxes_per_query": boxes,
        "observed": float(mapper.observed(queries).mean()),
    }
    name = FILES.get(given.site, f"queries_{Path(given.site).name.replace(':', '_')}")
    report(name, given, rows, targets, facts, script="queries")


if __name__ == "__main__":
    main()
