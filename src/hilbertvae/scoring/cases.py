"""What a mapper is shown of a site, what it is asked, and in which rows the answers count (METHOD 7)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from hilbertvae.cloud import Cloud
from hilbertvae.cores import cores
from hilbertvae.gaps import INSIDE, OUTSIDE, Gaps
from hilbertvae.ground import ABOVE_GROUND_M
from hilbertvae.observed_map import FINE, map_of
from hilbertvae.scans.scan import Scans
from hilbertvae.site import Site
from hilbertvae.voxel_votes import voxel_index

OCCLUSION_STEP = {2: 10, 3: 3}
"""`occluded-sparse` keeps every n-th scan."""
OCCLUSION_BANDS_M = ((0.25, 0.5), (0.5, 1.0), (1.0, 2.5))
OCCLUSION_RANGE_M = (0.5, 2.5)
MOST_SCORED = 500_000
"""Of a larger region so many queries are scored, drawn once: a share of them is known to 0.001. No region of Intel or csail is larger."""


@dataclass(frozen=True)
class Questions:
    """points: (Q, D) metres; occupied: (Q,) bool, the answers; regions: by name, the indices of the queries that count there."""

    points: np.ndarray
    occupied: np.ndarray
    regions: dict[str, np.ndarray]


@dataclass(frozen=True)
class Case:
    """shown: what a mapper is fitted on; asked: questions by reading."""

    shown: Cloud
    asked: dict[str, Questions]


def given_cloud(site: Site, given: str, gaps: Gaps | None = None) -> Cloud:
    """What a mapper is given of a site, without what gaps hide, as `given` says (`Protocol.given`)."""
    fine = given == "fine-map"
    cloud = site.fine_fit if fine else site.fit
    shown = gaps.cut(cloud) if gaps else cloud
    return shown if given == "scans" else map_of(shown, site.resolution_m / (FINE if fine else 1), site.resolution_m)


def gap_case(site: Site, gaps: Gaps, given: str = "scans") -> Case:
    """What held-out beams saw outside the gaps, what fitted beams saw there, and what the gaps removed."""
    asked = {}
    for reading, cloud, held_out, fitted in (
        ("points", site.points, site.points_held_out, ~site.points_held_out),
        ("voxels", site.voxels, site.voxels_held_out, site.voxels_fitted),
    ):
        part = gaps.part(cloud.points)
        regions = {"observed": held_out & (part == OUTSIDE), "fitted": fitted & (part == OUTSIDE), "gaps": part == INSIDE}
        asked[reading] = _questions(site, cloud, {name: np.flatnonzero(chosen) for name, chosen in regions.items()})
    return Case(given_cloud(site, given, gaps), asked)


def _questions(site: Site, cloud: Cloud, regions: dict[str, np.ndarray]) -> Questions:
    """Some of each region's points, and in 3D those of `observed` and `gaps` near the ground and above it in rows of their own."""
    rng = np.random.default_rng(0)
    regions = {
        name: chosen if len(chosen) <= MOST_SCORED else np.sort(rng.choice(chosen, MOST_SCORED, replace=False))
        for name, chosen in regions.items()
    }
    if site.dimension == 3:
        for name in ("observed", "gaps"):
            above = site.ground.height_above(cloud.points[regions[name]]) > ABOVE_GROUND_M
            regions |= {f"{name}-above-ground": regions[name][above], f"{name}-near-ground": regions[name][~above]}
    asked = np.zeros(len(cloud.points), bool)
    for chosen in regions.values():
        asked[chosen] = True
    place = np.cumsum(asked) - 1
    return Questions(cloud.points[asked], cloud.occupied[asked], {name: place[chosen] for name, chosen in regions.items()})


def occluded_parts(scans: Scans, seed: int) -> dict[str, np.ndarray]:
    """The kept returns of each setting, (N,) bool: every tenth scan in 2D and third in 3D, from scan `seed` on; the first half.

    Numbers count from the drive's first scan. A setting is left out, for every seed, where a site has too few scans for it. In 2D all
    kept scans of a seed hold out the same beams (`Scans.held_out` moves on by one a scan, too); what these saw is never asked.
    """
    step, scan = OCCLUSION_STEP[scans.dimension], scans.scan - scans.scan.min()
    count = int(scan.max()) + 1
    fitted = ~scans.held_out()  # a scan may have returned nothing, and then has a number alone
    kept = {"occluded-sparse": scan % step == seed % step, "occluded-half": scan < count / 2}
    enough = {"occluded-sparse": len(np.unique(scan[fitted] % step)) == step, "occluded-half": kept["occluded-half"][fitted].any()}
    return {region: kept[region] for region, some in enough.items() if some and count >= 2}


def occlusion_case(site: Site, region: str, kept: np.ndarray, given: str = "scans") -> Case:
    """What only the scans that are not `kept` saw, by distance from the nearest point of the kept ones (voxels)."""
    part = Site(site.name, site.scans.select(kept), site.resolution_m)
    seen, shown = part.whole, given_cloud(part, given)
    every, known = voxel_keys(site.voxels.points, site), voxel_keys(part.voxels.points, site)
    hidden = np.flatnonzero(~np.isin(every, known, assume_unique=True))
    distance, _ = cKDTree(seen.points).query(site.voxels.points[hidden], distance_upper_bound=OCCLUSION_RANGE_M[1], workers=cores())
    chosen = (distance >= OCCLUSION_BANDS_M[0][0]) & (distance < OCCLUSION_RANGE_M[1])
    hidden, distance = hidden[chosen], distance[chosen]
    if len(hidden) > MOST_SCORED:
        some = np.sort(np.random.default_rng(0).choice(len(hidden), MOST_SCORED, replace=False))
        hidden, distance = hidden[some], distance[some]
    regions = {}
    for low, high in (OCCLUSION_RANGE_M, *OCCLUSION_BANDS_M):
        row = region if (low, high) == OCCLUSION_RANGE_M else f"{region}-{low:g}-{high:g}"
        regions[row] = np.flatnonzero((distance >= low) & (distance < high))
    return Case(shown, {"voxels": Questions(site.voxels.points[hidden], site.voxels.occupied[hidden], regions)})


def voxel_keys(points: np.ndarray, site: Site) -> np.ndarray:
    """(N,) one number per voxel of the site; beams, and so all clouds, lie between the corners of what was measured and from where."""
    scans = site.scans
    low = voxel_index(np.minimum(scans.points.min(axis=0), scans.origins.min(axis=0)), site.resolution_m)
    shape = voxel_index(np.maximum(scans.points.max(axis=0), scans.origins.max(axis=0)), site.resolution_m) - low + 1
    return np.ravel_multi_index(tuple((voxel_index(points, site.resolution_m) - low).T), tuple(shape))
