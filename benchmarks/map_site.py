"""A site mapped with a trained network: cloud in, fitted, all its points answered; a GPOM-like process and OctoMap beside it.

    python benchmarks/map_site.py WEIGHTS [--site intel] [--quick]

Seconds by stage, of what `load_mapper(WEIGHTS).fit(...).predict_proba(...)` runs, with weights that came with the network (`rank`) and
with weights refitted on the site (`cluster`), where "fit weights" has a second reconstruction in it. The Gaussian process is timed on a
sample of the queries, spread evenly, and its time for all of them extrapolated; in 3D, where the paper has none either, it is left out.
"""

from __future__ import annotations

import numpy as np
from local_gp import LocalGP
from measuring import arguments, report, seconds_of, stage_seconds, target

from hilbertvae.cloud import Cloud
from hilbertvae.mappers import hilbert_map
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.loading import load_mapper
from hilbertvae.mappers.octomap_mapper import OctoMapMapper
from hilbertvae.site import open_site

STAGES = {
    "evidence": (hilbert_map, "Evidence"),
    "cluster": (hilbert_map, "find_frames"),
    "bin": (hilbert_map, "bin_grids"),
    "reconstruct": (HilbertMap, "_reconstruct"),
    "fit weights": (HilbertMap, "_cluster_factors"),
}
ASKED_OF_GP = 500
WANTED_S = 10.0


def map_with(mapper: HilbertMap, cloud: Cloud) -> dict[str, float]:
    """Seconds by stage of fitting the cloud and answering all its points."""
    with stage_seconds(STAGES) as stages:
        fit_s, _ = seconds_of(lambda: mapper.fit(cloud.points, cloud.occupied, cloud.weight))
    query_s, _ = seconds_of(lambda: mapper.predict_proba(cloud.points))
    return {"seconds": fit_s + query_s, **stages, "query": query_s}


def main(words: list[str] | None = None) -> None:
    parser = arguments(__doc__)
    parser.add_argument("checkpoint", nargs="?", help="trained weights (.safetensors); the raw grids unless given, for tests")
    parser.add_argument("--site", default="intel")
    given = parser.parse_args(words)
    site = open_site("simulated:1" if given.quick else given.site)
    cloud = site.fit

    rows = []
    for weights in ("rank", "cluster"):
        mapper = load_mapper(given.checkpoint, weights=weights) if given.checkpoint else HilbertMap(None, weights=weights)
        rows.append({"what": f"Hilbert Map, weights {weights}", "points": len(cloud), **map_with(mapper, cloud)})
    boxes = len(mapper.frames_)

    octomap = OctoMapMapper()
    build_s, _ = seconds_of(lambda: octomap.fit(cloud.points, cloud.occupied, cloud.weight))
    query_s, _ = seconds_of(lambda: octomap.predict_proba(cloud.points))
    rows.append({"what": "OctoMap", "points": len(cloud), "seconds": build_s + query_s, "insert": build_s, "query": query_s})

    asked = cloud.points[np.linspace(0, len(cloud) - 1, 20 if given.quick else ASKED_OF_GP).astype(int)]
    if site.dimension == 2:
        build_s, process = seconds_of(lambda: LocalGP(cloud.points, cloud.occupied))
        query_s = seconds_of(lambda: process.probability(asked))[0] / len(asked) * len(cloud)
        rows.append({"what": "local GP, extrapolated", "points": len(cloud), "seconds": build_s + query_s, "query": query_s})

    for row in rows:
        row["times ours"] = row["seconds"] / rows[0]["seconds"]
    total = rows[0]["seconds"]
    facts = {"site": site.name, "boxes": boxes, "asked_of_gp": len(asked), "trained": bool(given.checkpoint)}
    wanted = [target(f"seconds to map {site.name}", f"<= {WANTED_S:g}", total, total <= WANTED_S)] if site.dimension == 2 else []
    report(f"map_{given.site}", given, rows, wanted, facts, script="map_site")


if __name__ == "__main__":
    main()
