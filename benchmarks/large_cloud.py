"""Clouds of millions of points mapped by a Hilbert Map with a network, in processes of their own: peak memory, and seconds by stage.

    python benchmarks/large_cloud.py [--points 10000000] [--checkpoint WEIGHTS] [--quick]
    python benchmarks/large_cloud.py --dimension 3 --points 1000000 5000000 20000000

The cloud is that of one simulated building, or street, again and again side by side, so that walls, free space and weights are as dense
as in one. The network is the one that comes with the package unless given. Microseconds per point are those of the fit; queries are as
many for every cloud. The peak is that of the whole process, libraries, the cloud and the queries included.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
from measuring import SMALL_BUILDING, arguments, report, seconds_of, stage_seconds, target

from hilbertvae.cloud import Cloud
from hilbertvae.mappers import completing_mapper, hilbert_map
from hilbertvae.mappers.hilbert_map import FLIPS, HilbertMap
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.simulate.building import BuildingSettings
from hilbertvae.simulate.street import StreetSettings
from hilbertvae.site import SiteSource, open_site

WANTED_GB = {2: 6.0, 3: 8.0}
WANTED_GROWTH = 1.3
"""Times that a point may take in the largest cloud of those in the smallest: cost grows linearly."""
STAGES = {
    "evidence": (hilbert_map, "Evidence"),
    "cluster": (hilbert_map, "cloud_clusters"),
    "bin": (completing_mapper, "bin_shown"),
    "reconstruct": (HilbertMap, "_complete"),
}
MARGIN_M = 5.0


def peak_gb() -> float:
    """The most memory that this process has had so far, in GB (1e9 bytes)."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024) / 1e9


def tiled(cloud: Cloud, points: int) -> Cloud:
    """Copies of the cloud on a square lattice, as few as make so many points."""
    copies = -(-points // len(cloud))
    side = int(np.ceil(np.sqrt(copies)))
    step = np.ceil((np.ptp(cloud.points[:, :2], axis=0) + MARGIN_M) * 10) / 10
    place = np.stack(np.divmod(np.arange(copies), side), axis=1) * step
    place = np.pad(place, ((0, 0), (0, cloud.points.shape[1] - 2)))
    every = (cloud.points + place[:, None]).reshape(-1, cloud.points.shape[1])
    return Cloud(every, np.tile(cloud.occupied, copies), np.tile(cloud.weight, copies))


def one_site(dimension: int, small: bool) -> Cloud:
    """The cloud of one simulated site; a tiny one for tests."""
    building = SMALL_BUILDING if small else BuildingSettings()
    street = StreetSettings(sensor="hdl64", single_scan_share=0.0, scans=8)
    if small:
        street = StreetSettings(scans=1, azimuths=60, max_range_m=15.0)
    return open_site("simulated:1", source=SiteSource(dimension=dimension, building=building, street=street)).fit


def work(dimension: int, points: int, flips: int, queries: int, checkpoint: str) -> dict:
    """The process's own part: everything measured, as plain values."""
    cloud = tiled(one_site(dimension, points < 10**6), points)
    start_gb = peak_gb()
    mapper = HilbertMap(Reconstructor.load(checkpoint), flips=flips)
    with stage_seconds(STAGES) as stages:
        fit_s, _ = seconds_of(lambda: mapper.fit(cloud.points, cloud.occupied, cloud.weight))
    fit_gb = peak_gb()
    rng = np.random.default_rng(0)
    asked = cloud.points[rng.integers(len(cloud), size=queries)] + rng.normal(0, 0.3, (queries, dimension))
    query_s, probability = seconds_of(lambda: mapper.predict_proba(asked))
    assert np.isfinite(probability).all()
    return {
        "points": len(cloud),
        "boxes": len(mapper.frames_),
        "seconds": fit_s + query_s,
        "fit": fit_s,
        "us per point": fit_s / len(cloud) * 1e6,
        **stages,
        "query": query_s,
        "queries": queries,
        "cloud_gb": start_gb,
        "peak_fit_gb": fit_gb,
        "peak_gb": peak_gb(),
    }


def main(words: list[str] | None = None) -> None:
    parser = arguments(__doc__)
    parser.add_argument("--dimension", type=int, choices=(2, 3), default=2)
    parser.add_argument("--points", type=int, nargs="+", default=[10_000_000])
    parser.add_argument("--queries", type=int, default=1_000_000)
    parser.add_argument("--flips", type=int, help="symmetries over which a reconstruction is averaged; as maps have it unless given")
    parser.add_argument("--checkpoint", help="trained weights; those that come with the package unless given")
    parser.add_argument("--child", action="store_true", help="do the work here and print the numbers as JSON")
    given = parser.parse_args(words)
    flips, checkpoint = given.flips or FLIPS[given.dimension], given.checkpoint or f"{given.dimension}d"
    counts, flips, queries = ([5_000, 10_000], 1, 20_000) if given.quick else (given.points, flips, given.queries)
    if given.child:
        print(json.dumps(work(given.dimension, given.points[0], flips, given.queries, checkpoint)))
        return
    rows = [measured(given.dimension, points, flips, queries, checkpoint) for points in sorted(counts)]
    largest, wanted_gb = rows[-1], WANTED_GB[given.dimension]
    peak, growth = largest["peak_gb"], largest["us per point"] / rows[0]["us per point"]
    targets = [target(f"GB at the peak for {largest['points']:.2g} points", f"<= {wanted_gb:g}", peak, peak <= wanted_gb)]
    if len(rows) > 1:
        wanted = f"<= {WANTED_GROWTH:g}"
        targets.append(target(f"time of a fit per point there / at {rows[0]['points']:.2g}", wanted, growth, growth <= WANTED_GROWTH))
    name = "large_cloud" if given.dimension == 2 else "large_cloud_3d"
    report(name, given, rows, targets, {"dimension": given.dimension, "flips": flips, "checkpoint": checkpoint}, "large_cloud")


def measured(dimension: int, points: int, flips: int, queries: int, checkpoint: str) -> dict:
    """A row: `work` in a process of its own, whose peak of memory is its own too."""
    command = [sys.executable, str(Path(__file__)), "--child", f"--dimension={dimension}", f"--points={points}"]
    command += [f"--flips={flips}", f"--queries={queries}", f"--checkpoint={checkpoint}"]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    row = json.loads(done.stdout.splitlines()[-1])
    print(f"{row['points']:.2g} points: {row['seconds']:.1f} s, {row['peak_gb']:.2f} GB", flush=True)
    return {"what": "Hilbert Map", **row}


if __name__ == "__main__":
    main()
