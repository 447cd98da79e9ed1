"""A site mapped scan by scan with a trained network: scans per second of `partial_fit`, and of OctoMap's insertion of the same rays.

    python benchmarks/streaming.py [--site intel] [--scans 0] [--quick]

Each scan becomes a cloud (`cloud`) and is added to the evidence and the clusters (`add`); then the clusters that were changed are
reconstructed: all of them after each scan or after every tenth, or those alone that answer 10 000 queries around the sensor (`rest`, with
these answers). OctoMap casts each scan's rays by its own `insertPointCloud`, on one core, since its binding is built without OpenMP; ours
has all cores. At the end the grids are compared with those of all scans binned at once in the same boxes.
"""

from __future__ import annotations

import time

import numpy as np
import octomap
from measuring import OCTOMAP_CORES, arguments, report, target

from hilbertvae.checks import InputError
from hilbertvae.cloud import cloud_from_scans, fit_cloud
from hilbertvae.grids.cluster_grids import bin_shown
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.loading import load_mapper
from hilbertvae.scans.scan import Scans
from hilbertvae.site import Site, open_site

SIMULATED = "simulated:1"
"""In place of a real site that is not here."""
TOGETHER = 10
ASKED, ASKED_M = 10_000, 10.0
"""Queries after each scan, and how far from the sensor along each axis."""
CHECKED = 20


def ask_around(mapper: HilbertMap, scan: Scans, number: int) -> None:
    middle = scan.origins[0]
    mapper.predict_proba(np.random.default_rng(number).uniform(middle - ASKED_M, middle + ASKED_M, (ASKED, len(middle))))


WAYS = {
    "Hilbert Map, reconstructed after each scan": lambda mapper, scan, number: mapper.settle(),
    f"Hilbert Map, reconstructed after every {TOGETHER} scans": lambda mapper, scan, number: number % TOGETHER or mapper.settle(),
    f"Hilbert Map, asked within {ASKED_M:g} m after each scan": ask_around,
}


def scans_of(site: Site, count: int) -> list[Scans]:
    """The first `count` scans of the drive, all unless given."""
    scans = site.scans
    edges = np.flatnonzero(np.diff(scans.scan, prepend=-1, append=-1))[: count + 1 if count else None]
    return [scans.select(slice(start, end)) for start, end in zip(edges, edges[1:], strict=False)]


def stream(site: Site, scans: list[Scans], checkpoint: str, what: str, flips: int | None = None) -> tuple[HilbertMap, dict]:
    """A map of the scans, reconstructed one of the `WAYS`, and its row of seconds."""
    mapper, counted = load_mapper(checkpoint, flips=flips), []
    complete = mapper.reconstructor.complete

    def counting(grids: np.ndarray, *given, **named):
        counted.append(len(grids))
        return complete(grids, *given, **named)

    mapper.reconstructor.complete = counting
    seconds = np.zeros((len(scans), 3))
    for k, scan in enumerate(scans):
        start = time.perf_counter()
        cloud = cloud_from_scans(scan.points, scan.origins, site.resolution_m)
        made = time.perf_counter()
        mapper.partial_fit(cloud.points, cloud.occupied, cloud.weight, reconstruct=False)
        added = time.perf_counter()
        WAYS[what](mapper, scan, k + 1)
        seconds[k] = made - start, added - made, time.perf_counter() - added
    stages = dict(zip(("cloud", "add", "rest"), seconds.sum(axis=0).tolist(), strict=True))
    return mapper, {**timed(what, seconds.sum(axis=1)), **stages, "grids per scan": sum(counted) / len(scans)}


def timed(what: str, seconds: np.ndarray) -> dict:
    """A row of seconds by scan."""
    total, count = float(seconds.sum()), len(seconds)
    row = {"what": what, "scans": count, "seconds": total, "scans per second": count / total}
    return {**row, "median scan": float(np.median(seconds)), "slowest scan": float(seconds.max())}


def insert(scans: list[Scans], resolution_m: float) -> dict:
    """OctoMap's row: the rays of each scan, from where its first beam began."""
    tree = octomap.OcTree(resolution_m)

    def lifted(points: np.ndarray) -> np.ndarray:
        return points if points.shape[1] == 3 else np.column_stack([points, np.full(len(points), resolution_m / 2)])

    seconds = np.zeros(len(scans))
    for k, scan in enumerate(scans):
        points, origin = lifted(scan.points), lifted(scan.origins[:1])[0]
        start = time.perf_counter()
        tree.insertPointCloud(points, origin)
        seconds[k] = time.perf_counter() - start
    return timed("OctoMap, insertPointCloud", seconds)


def unequal_cells(mapper: HilbertMap, scans: list[Scans], resolution_m: float) -> tuple[float, float]:
    """The share of cells that all scans binned at once would show to the network otherwise, and how far some boxes' values are off."""
    whole = Scans(*(np.concatenate([getattr(scan, name) for scan in scans]) for name in ("points", "origins", "scan", "beam")))
    clouds = fit_cloud(whole, resolution_m), mapper.evidence_.cloud()
    expected, shown = (bin_shown(cloud, mapper.frames_, mapper.grid_, mapper.detailed_) for cloud in clouds)
    some = np.flatnonzero((expected == shown).reshape(len(shown), -1).all(axis=1))[:CHECKED]
    completed = mapper.reconstructor.complete(expected[some], mapper.flips_)
    return float((expected != shown).mean()), float(np.abs(completed.value.astype(float) - mapper.grids_[some]).max(initial=0.0))


def main(words: list[str] | None = None) -> None:
    parser = arguments(__doc__)
    parser.add_argument("--site", default="intel")
    parser.add_argument("--scans", type=int, default=0, help="of the drive, only so many (default: all)")
    parser.add_argument("--checkpoint", help="a network; the one that comes with the package unless given")
    given = parser.parse_args(words)
    try:
        site = open_site(SIMULATED if given.quick else given.site)
    except InputError as error:
        print(f"{error}; {SIMULATED} instead")
        site = open_site(SIMULATED)
    scans = scans_of(site, 2 if given.quick else given.scans)
    checkpoint = given.checkpoint or f"{site.dimension}d"
    rows, facts = [], {"site": site.name, "checkpoint": checkpoint, "OctoMap's cores": OCTOMAP_CORES}
    facts["returns_per_scan"] = len(site.scans) / (site.scans.scan.max() + 1)
    for what in WAYS:
        mapper, row = stream(site, scans, checkpoint, what, flips=1 if given.quick else None)
        rows.append(row)
        print(f"{what}: {row['scans per second']:.3g} scans per second", flush=True)
    mapper.settle()
    rows.append(insert(scans, site.resolution_m))
    share, off = unequal_cells(mapper, scans, site.resolution_m)
    targets = [
        target("share of cells that differ from the batch's in the same boxes", "<= 1e-5", share, share <= 1e-5),
        target(f"largest difference of {CHECKED} boxes' kernel values from the batch's", "<= 0.05", off, off <= 0.05),
    ]
    facts |= {"boxes": mapper.cluster_count(), "voxels": len(mapper.evidence_)}
    report(f"streaming_{site.name.replace(':', '_')}", given, rows, targets, facts, script="streaming")


if __name__ == "__main__":
    main()
