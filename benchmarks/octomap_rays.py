"""What OctoMap says in gaps when it is fed rays instead of labelled points: beams that end beyond a gap cross it.

    python benchmarks/octomap_rays.py [--quick]

On kitti00_start, where choices are made; with `--quick` on a simulated street. No returns of a gap are inserted, and no held-out beams.
"""

from __future__ import annotations

import numpy as np
import octomap
from measuring import arguments, report

from hilbertvae.gaps import INSIDE, OUTSIDE, Gaps
from hilbertvae.scoring.metrics import score
from hilbertvae.scoring.protocol import Protocol, cut_site
from hilbertvae.simulate.street import StreetSettings
from hilbertvae.site import Site, SiteSource, open_site

SEEDS = (0, 1, 2, 3, 4)


def tree_of_rays(site: Site, gaps: Gaps) -> octomap.OcTree:
    """OctoMap's own insertion, scan by scan, of the fitted beams that end outside of the gaps."""
    scans = site.scans.select(~site.scans.held_out() & (gaps.part(site.scans.points) == OUTSIDE))
    tree = octomap.OcTree(site.resolution_m)
    for number in np.unique(scans.scan):
        one = scans.select(scans.scan == number)
        tree.insertPointCloud(np.ascontiguousarray(one.points), np.ascontiguousarray(one.origins[0]))
    return tree


def rows_of(site: Site, seed: int) -> list[dict]:
    """Precision and recall on points in gaps: as OctoMap answers, and with what it does not know taken for occupied."""
    gaps = cut_site(site, Protocol(), seed)
    inside = gaps.part(site.points.points) == INSIDE
    occupied = site.points.occupied[inside]
    label = np.asarray(tree_of_rays(site, gaps).getLabels(np.ascontiguousarray(site.points.points[inside])))
    found = []
    for what, called in (("as it answers", label == 1), ("unknown taken for occupied", label != 0)):
        scores = score(occupied, called.astype(float))
        found.append({"what": what, "gap seed": seed, "precision": scores["precision"], "recall": scores["recall"]})
        found[-1] |= {"unknown": float(np.mean(label == -1)), "occupied points": float(occupied.mean())}
    return found


def main(words: list[str] | None = None) -> None:
    given = arguments(__doc__).parse_args(words)
    source = SiteSource(3, street=StreetSettings(scans=2, azimuths=250, max_range_m=12.0))
    site = open_site("simulated:0", source=source) if given.quick else open_site("kitti00_start")
    rows = [row for seed in (SEEDS[:1] if given.quick else SEEDS) for row in rows_of(site, seed)]
    report("octomap_rays", given, rows, [], {"site": site.name, "resolution_m": site.resolution_m})


if __name__ == "__main__":
    main()
