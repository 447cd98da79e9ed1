"""A cloud of ten million points mapped by a Hilbert Map with a network, in a process of its own: peak memory, and seconds by stage.

    python benchmarks/large_cloud.py [--checkpoint WEIGHTS] [--points 10000000] [--quick]

The cloud is one simulated building's, again and again side by side, so that walls, free space and weights are as dense as in a
building. The network has fresh weights unless given: they change neither time nor memory. The peak is that of the whole process,
libraries and the cloud included.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
from measuring import arguments, report, seconds_of, stage_seconds, target

from hilbertvae.cloud import Cloud
from hilbertvae.grids.cluster_grids import GridSettings
from hilbertvae.mappers import hilbert_map
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.reconstruction.gated_network import GatedNetworkSettings
from hilbertvae.reconstruction.likelihood import LikelihoodSettings
from hilbertvae.reconstruction.networks import build_network
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.simulate.building import BuildingSettings
from hilbertvae.site import SiteSource, open_site

WANTED_GB = 6.0
STAGES = {
    "evidence": (hilbert_map, "Evidence"),
    "cluster": (hilbert_map, "find_frames"),
    "bin": (hilbert_map, "bin_grids"),
    "reconstruct": (HilbertMap, "_reconstruct"),
}
MARGIN_M = 5.0


def peak_gb() -> float:
    """The most memory that this process has had so far, in GB (1e9 bytes)."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024) / 1e9


def tiled(cloud: Cloud, points: int) -> Cloud:
    """Copies of the cloud on a square lattice, as few as make so many points."""
    copies = -(-points // len(cloud))
    side = int(np.ceil(np.sqrt(copies)))
    step = np.ceil((cloud.points.max(axis=0) - cloud.points.min(axis=0) + MARGIN_M) * 10) / 10
    place = np.stack(np.divmod(np.arange(copies), side), axis=1) * step
    every = (cloud.points + place[:, None]).reshape(-1, 2)
    return Cloud(every, np.tile(cloud.occupied, copies), np.tile(cloud.weight, copies))


def fresh_network() -> Reconstructor:
    """The default network before any training."""
    grid = GridSettings()
    network = build_network(GatedNetworkSettings(), 2, grid.cells)
    return Reconstructor(network, GatedNetworkSettings(), LikelihoodSettings(), grid, 2, 0.1)


def work(points: int, flips: int, queries: int, checkpoint: str | None) -> dict:
    """The process's own part: everything measured, as plain values."""
    building = BuildingSettings() if points >= 10**6 else BuildingSettings(shortest_extent_m=12.0, longest_extent_m=15.0, scans=50)
    cloud = tiled(open_site("simulated:1", source=SiteSource(building=building)).fit, points)
    start_gb = peak_gb()
    mapper = HilbertMap(Reconstructor.load(checkpoint) if checkpoint else fresh_network(), flips=flips)
    with stage_seconds(STAGES) as stages:
        fit_s, _ = seconds_of(lambda: mapper.fit(cloud.points, cloud.occupied, cloud.weight))
    fit_gb = peak_gb()
    rng = np.random.default_rng(0)
    asked = cloud.points[rng.integers(len(cloud), size=queries)] + rng.normal(0, 0.3, (queries, 2))
    query_s, probability = seconds_of(lambda: mapper.predict_proba(asked))
    assert np.isfinite(probability).all()
    return {
        "points": len(cloud),
        "boxes": len(mapper.frames_),
        "seconds": fit_s + query_s,
        **stages,
        "query": query_s,
        "queries": queries,
        "cloud_gb": start_gb,
        "peak_fit_gb": fit_gb,
        "peak_gb": peak_gb(),
    }


def main(words: list[str] | None = None) -> None:
    parser = arguments(__doc__)
    parser.add_argument("--points", type=int, default=10_000_000)
    parser.add_argument("--queries", type=int, default=1_000_000)
    parser.add_argument("--flips", type=int, default=4, help="symmetries over which a reconstruction is averaged")
    parser.add_argument("--checkpoint")
    parser.add_argument("--child", action="store_true", help="do the work here and print the numbers as JSON")
    given = parser.parse_args(words)
    points, flips, queries = (10_000, 1, 20_000) if given.quick else (given.points, given.flips, given.queries)
    if given.child:
        print(json.dumps(work(points, flips, queries, given.checkpoint)))
        return
    command = [sys.executable, str(Path(__file__)), "--child", f"--points={points}", f"--flips={flips}", f"--queries={queries}"]
    command += [f"--checkpoint={given.checkpoint}"] if given.checkpoint else []
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    row = json.loads(done.stdout.splitlines()[-1])
    kept = target(f"GB at the peak for {row['points']:.0e} points", f"<= {WANTED_GB:g}", row["peak_gb"], row["peak_gb"] <= WANTED_GB)
    report("large_cloud", given, [{"what": "Hilbert Map", **row}], [kept], {"flips": flips, "trained": bool(given.checkpoint)})


if __name__ == "__main__":
    main()
