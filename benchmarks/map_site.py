"""A site mapped with a trained network: cloud in, fitted, all its points answered; GPOM and OctoMap beside it.

    python benchmarks/map_site.py WEIGHTS [--site intel] [--quick]

Seconds by stage, of what `load_mapper(WEIGHTS).fit(...).predict_proba(...)` runs, with weights that came with the network (`rank`) and
with weights refitted on the site (`cluster`), where "fit weights" has a second reconstruction in it. GPOM is left out in 3D,
where the paper has none either. OctoMap is our mapper over its binding, and runs on one core.
"""

from __future__ import annotations

from measuring import SMALL_BUILDING, arguments, report, seconds_of, stage_seconds, target

from hilbertvae.cloud import Cloud
from hilbertvae.mappers import completing_mapper, hilbert_map
from hilbertvae.mappers.gpom import GpomMapper
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.loading import load_mapper
from hilbertvae.mappers.octomap_mapper import OctoMapMapper
from hilbertvae.site import SiteSource, open_site

STAGES = {
    "evidence": (hilbert_map, "Evidence"),
    "cluster": (hilbert_map, "cloud_clusters"),
    "bin": (completing_mapper, "bin_shown"),
    "reconstruct": (HilbertMap, "_complete"),
    "fit weights": (HilbertMap, "_cluster_factors"),
}
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
    site = open_site("simulated:1", source=SiteSource(building=SMALL_BUILDING)) if given.quick else open_site(given.site)
    cloud = site.fit

    rows = []
    for weights in ("rank", "cluster"):
        mapper = load_mapper(given.checkpoint, weights=weights) if given.checkpoint else HilbertMap(None, weights=weights)
        rows.append({"what": f"Hilbert Map, weights {weights}", "points": len(cloud), **map_with(mapper, cloud)})
    boxes = len(mapper.frames_)

    rivals = {"OctoMap": OctoMapMapper(), "GPOM": GpomMapper()} if site.dimension == 2 else {"OctoMap": OctoMapMapper()}
    for name, rival in rivals.items():
        fit_s, _ = seconds_of(lambda rival=rival: rival.fit(cloud.points, cloud.occupied, cloud.weight))
        query_s, _ = seconds_of(lambda rival=rival: rival.predict_proba(cloud.points))
        rows.append({"what": name, "points": len(cloud), "seconds": fit_s + query_s, "fit": fit_s, "query": query_s})

    for row in rows:
        row["times ours"] = row["seconds"] / rows[0]["seconds"]
    total = rows[0]["seconds"]
    facts = {"site": site.name, "boxes": boxes, "trained": bool(given.checkpoint)}
    wanted = [target(f"seconds to map {site.name}", f"<= {WANTED_S:g}", total, total <= WANTED_S)] if site.dimension == 2 else []
    report(f"map_{given.site}", given, rows, wanted, facts, script="map_site")


if __name__ == "__main__":
    main()
